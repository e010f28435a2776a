"""Natural-image spectra: what is known of means and slow changes, which sparse gradients say nothing of."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from priors.base import Layers


@dataclass(frozen=True)
class NaturalImage:
    """Penalty ``sum_l strength_l / 2 sum_frequencies |F(x_l - mean_l)|^2 / power_l`` in a basis of the colours.

    Parameters
    ----------
    strength : (float, float)
        Weight of each layer.
    power : ndarray, shape (2, channel, h, w // 2 + 1)
        Expected power of each frequency of an orthonormal transform, for each colour of the basis.
    mean : ndarray, shape (2, channel, 1, 1)
        Expected mean, in the basis.
    basis : ndarray, shape (channel, channel)
        Orthonormal rows.

    References
    ----------
    D. J. Field, Relations between the statistics of natural images and the response properties of cortical cells,
    JOSA A 4, 1987.
    """

    strength: tuple[float, float]
    power: NDArray[np.float32]
    mean: NDArray[np.float32]
    basis: NDArray[np.float64]

    def value_and_grad(self, layers: Layers) -> tuple[float, Layers]:
        """Value and gradient at layers (2, channel, h, w)."""
        from scipy.fft import irfft2, rfft2

        basis = self.basis.astype(np.float32)
        off_mean = np.einsum("oc,lchw->lohw", basis, layers) - self.mean
        spectrum = rfft2(off_mean, norm="ortho", workers=2)
        spectrum *= np.array(self.strength, dtype=np.float32)[:, None, None, None] / self.power
        filtered = irfft2(spectrum, s=layers.shape[-2:], norm="ortho", workers=2)
        value = 0.5 * float(np.einsum("lchw,lchw->", off_mean, filtered, dtype=np.float64))
        gradient: Layers = np.einsum("oc,lohw->lchw", basis, filtered)
        return value, gradient
