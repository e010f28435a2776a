"""Natural-image spectra: what is known of means and slow changes, which sparse gradients say nothing of."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from array_api_compat import array_namespace

from priors.base import Layers


@dataclass(frozen=True)
class NaturalImage:
    """Penalty ``1/2 sum_l sum_frequencies stiffness_l |F(x_l - mean_l)|^2`` in a basis of the colours.

    Parameters
    ----------
    stiffness : array, shape (2, channel, h, w // 2 + 1)
        Inverse of the power that is expected at each frequency of an orthonormal transform, for each colour of the
        basis, times the weight of the penalty.
    mean : array, shape (2, channel, 1, 1)
        Expected mean, in the basis.
    basis : array, shape (channel, channel)
        Orthonormal rows.

    References
    ----------
    D. J. Field, Relations between the statistics of natural images and the response properties of cortical cells,
    JOSA A 4, 1987.
    """

    stiffness: Any
    mean: Any
    basis: Any

    def value_and_grad(self, layers: Layers) -> tuple[float, Layers]:
        """Value and gradient at layers (2, channel, h, w)."""
        xp = array_namespace(layers)
        off_mean = in_basis(self.basis, layers, xp) - self.mean
        spectrum = xp.fft.rfftn(off_mean, axes=(-2, -1), norm="ortho") * self.stiffness
        filtered = xp.fft.irfftn(spectrum, s=tuple(layers.shape[-2:]), axes=(-2, -1), norm="ortho")
        value = 0.5 * float(xp.sum(off_mean * filtered, dtype=xp.float64))
        gradient: Layers = in_basis(self.basis.T, filtered, xp)
        return value, gradient


def in_basis(basis: Any, layers: Any, xp: Any) -> Any:
    """Change the colours of images (..., channel, h, w) to another basis (new channel, channel)."""
    if basis.shape[0] == 1:
        return layers * basis[0, 0]
    flat = xp.reshape(layers, (*layers.shape[:-2], -1))
    return xp.reshape(xp.matmul(basis, flat), layers.shape)
