"""Change of variables that makes the objective nearly round: Fourier coefficients, whitened per frequency.

With H the Hessian's approximation per frequency and colour (what the photographs tell, the spectral prior and the mean
curvature of the edges), layers are ``mean + F^-1 H^(-1/2) z``. Any solver that knows nothing of preconditioning gains
from it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from array_api_compat import array_namespace, is_torch_namespace
from numpy.typing import NDArray

from polaropt.inversion.spectra import RESOLUTION, Power, Spectrum
from polaropt.numerics import Basis, column_multiplicity, squared_frequencies
from priors.natural_image import in_basis


@dataclass(frozen=True)
class AssumedHessian:
    """The Hessian that is assumed, a 2x2 matrix per frequency and colour of the basis.

    A mosaic's samples tell of a frequency and its aliases together; here stands their average. With the matrix of each
    group of aliases (8x8 mono, 96x96 colour) a solve takes 0 or 1 of 5 to 18 evaluations less, of colour up to 5 of 19,
    which its factors cost many times over.

    Attributes
    ----------
    told : ndarray of float32, shape (2, H, W // 2 + 1)
        What the photographs tell of each layer.
    cross : ndarray of complex64, shape (H, W // 2 + 1)
        What they tell of both together: the entry in the transmission's row.
    stiffness : ndarray of float32, shape (2, channel, H, W // 2 + 1)
        Of the spectral prior.
    curvature : ndarray, shape (2, channel)
        Of the penalties on gradients, per squared frequency.
    """

    told: Power
    cross: Spectrum
    stiffness: Power
    curvature: NDArray[np.float64]

    def diagonal(self, width: int) -> Power:
        """Its diagonal, (2, channel, H, W // 2 + 1)."""
        rows, columns = squared_frequencies(self.told.shape[1], width)
        squared = (rows[:, None] + columns).astype(np.float32)
        diagonal: Power = self.told[:, None] + self.stiffness
        diagonal += self.curvature.astype(np.float32)[:, :, None, None] * squared
        return diagonal


class FourierPreconditioner:
    """Layers from whitened coordinates and back, for numpy arrays or torch tensors.

    The readable form: `polaropt.inversion.compiled_whitening` does the same in compiled passes.

    Parameters
    ----------
    hessian : AssumedHessian
    mean : ndarray, shape (2, channel, 1, 1)
        Means of the layers in the colour basis.
    basis : ndarray, shape (channel, channel)
    width : int
        W, which half spectra do not tell.
    place : callable, optional
        Turns numpy arrays into those to work with, such as tensors on a device.
    """

    def __init__(
        self,
        hessian: AssumedHessian,
        mean: NDArray[np.float32],
        basis: Basis,
        width: int,
        place: Callable[[NDArray[Any]], Any] = np.asarray,
    ) -> None:
        self._frame = (hessian.told.shape[1], width)
        self._basis = place(basis.astype(np.float32))
        self._mean = place(mean)
        # The half spectrum stands for two; scaled, the transform keeps lengths.
        self._length = place(np.sqrt(column_multiplicity(width)).astype(np.float32))
        self._roots = [
            (place(own.astype(np.float32)), place(cross.astype(np.complex64))) for own, cross in _roots(hessian, width)
        ]

    def layers(self, z: Any) -> Any:
        """Layers (2, channel, H, W) at coordinates z, a flat float32 vector."""
        xp = array_namespace(z)
        coefficients = applied(self._roots[0], self._spectrum(z, xp), xp) / self._length
        own = xp.fft.irfftn(coefficients, s=self._frame, axes=(-2, -1), norm="ortho") + self._mean
        return in_basis(self._basis.T, own, xp)

    def coordinates(self, layers: Any) -> Any:
        """Coordinates of layers: the inverse of `layers`."""
        xp = array_namespace(layers)
        return _flat(applied(self._roots[1], self._transformed(layers, self._mean, xp), xp), xp)

    def gradient(self, gradient: Any) -> Any:
        """Gradient by z of a function with this gradient by the layers."""
        xp = array_namespace(gradient)
        return _flat(applied(self._roots[0], self._transformed(gradient, 0.0, xp), xp), xp)

    def _transformed(self, images: Any, mean: Any, xp: Any) -> Any:
        own = in_basis(self._basis, images, xp) - mean
        return xp.fft.rfftn(own, axes=(-2, -1), norm="ortho") * self._length

    def _spectrum(self, z: Any, xp: Any) -> Any:
        height, width = self._frame
        shape = (2, self._basis.shape[0], height, width // 2 + 1)
        if is_torch_namespace(xp):
            return xp.view_as_complex(xp.reshape(z, (*shape, 2)))
        return z.view(np.complex64).reshape(shape)


def _flat(spectrum: Any, xp: Any) -> Any:
    if is_torch_namespace(xp):
        return xp.reshape(xp.view_as_real(spectrum), (-1,))
    return np.ascontiguousarray(spectrum, dtype=np.complex64).view(np.float32).ravel()


def applied(root: tuple[Any, Any], pair: Any, xp: Any) -> Any:
    """A Hermitian 2x2 matrix per frequency, as its diagonal and upper entry, times a pair of layers."""
    own, cross = root
    t, r = pair[0, ...], pair[1, ...]
    return xp.stack([own[0, ...] * t + cross * r, own[1, ...] * r + xp.conj(cross) * t])


def _roots(hessian: AssumedHessian, width: int) -> list[tuple[NDArray[Any], NDArray[Any]]]:
    """Diagonal (2, channel, ...) and upper entry (channel, ...) of H^(-1/2) and of H^(1/2)."""
    return roots_of(hessian.diagonal(width), hessian.cross)


def roots_of(diagonal: Any, cross: Any) -> list[tuple[Any, Any]]:
    """Diagonal (2, ...) and upper entry (...) of H^(-1/2) and of H^(1/2), of a matrix H given likewise."""
    xp = array_namespace(diagonal)
    t, r = diagonal[0, ...], diagonal[1, ...]
    product = t * r
    # Square root of a 2x2 matrix B: (B + sqrt(det B)) / sqrt(tr B + 2 sqrt(det B)).
    root = xp.sqrt(xp.maximum(product - xp.abs(cross) ** 2, float(RESOLUTION) * product))
    scale = 1 / xp.sqrt(t + r + 2 * root)
    inverse = (xp.stack([(r + root) * scale / root, (t + root) * scale / root]), -cross * scale / root)
    return [inverse, (xp.stack([(t + root) * scale, (r + root) * scale]), cross * scale)]
