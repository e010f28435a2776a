"""Change of variables that makes the objective nearly round: Fourier coefficients, whitened per frequency.

With H the Hessian's approximation per frequency (what the photographs tell plus the prior), layers are
``start + F^-1 H^(-1/2) z``. Any solver that knows nothing of preconditioning gains from it.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from polaropt.color_basis import Basis
from polaropt.spectra import Power, Spectrum, column_multiplicity

Images = NDArray[np.float32]
Vector = NDArray[np.float32]


class FourierPreconditioner:
    """Whitened coordinates around a start.

    Parameters
    ----------
    start : ndarray, shape (2, channel, H, W)
        Layers at z = 0.
    information : ndarray, shape (2, 2, H, W // 2 + 1)
        What the photographs tell per frequency.
    prior : ndarray, shape (2, channel, H, W // 2 + 1)
        Expected power of each layer per frequency, in the colour basis.
    basis : ndarray, shape (channel, channel)
    """

    def __init__(self, start: Images, information: Spectrum, prior: Power, basis: Basis) -> None:
        self._start = start
        self._basis = basis.astype(np.float32)
        self._shape = start.shape
        # The half spectrum stands for two; scaled, the transform keeps lengths.
        self._length = np.sqrt(column_multiplicity(start.shape[-1])).astype(np.float32)
        self._own, self._cross = _inverse_root(information, prior)

    @property
    def size(self) -> int:
        """Length of z."""
        height, width = self._shape[-2:]
        return int(2 * 2 * self._shape[1] * height * (width // 2 + 1))

    def layers(self, z: Vector) -> Images:
        """Layers (2, channel, H, W) at coordinates z."""
        from scipy.fft import irfft2

        coefficients = self._rooted(self._coefficients(z)) / self._length
        step = irfft2(coefficients, s=self._shape[-2:], norm="ortho", workers=2)
        layers: Images = self._start + np.einsum("oc,lohw->lchw", self._basis, step)
        return layers

    def gradient(self, gradient: Images) -> Vector:
        """Gradient by z of a function with this gradient by the layers."""
        from scipy.fft import rfft2

        turned = np.einsum("oc,lchw->lohw", self._basis, gradient)
        spectrum = rfft2(turned, norm="ortho", workers=2) * self._length
        return np.ascontiguousarray(self._rooted(spectrum)).view(np.float32).ravel()

    def _coefficients(self, z: Vector) -> Spectrum:
        height, width = self._shape[-2:]
        return z.view(np.complex64).reshape(2, self._shape[1], height, width // 2 + 1)

    def _rooted(self, pair: Spectrum) -> Spectrum:
        """Hermitian square root of the inverse Hessian applied per frequency."""
        rooted = self._own * pair
        rooted[0] += self._cross * pair[1]
        rooted[1] += self._cross.conj() * pair[0]
        return rooted


def _inverse_root(information: Spectrum, prior: Power) -> tuple[Power, Spectrum]:
    """Diagonal (2, channel, ...) and upper entry (channel, ...) of H^(-1/2), H = information + diag(1 / prior)."""
    h_t = information[0, 0].real + 1 / prior[0]
    h_r = information[1, 1].real + 1 / prior[1]
    cross = information[0, 1]
    determinant = h_t * h_r - np.abs(cross) ** 2
    inverse_t, inverse_r, inverse_cross = h_r / determinant, h_t / determinant, -cross / determinant
    # Square root of a 2x2 matrix B: (B + sqrt(det B)) / sqrt(tr B + 2 sqrt(det B)).
    root = 1 / np.sqrt(determinant)
    scale = 1 / np.sqrt(inverse_t + inverse_r + 2 * root)
    own = np.stack([inverse_t + root, inverse_r + root]) * scale
    return own.astype(np.float32), (inverse_cross * scale).astype(np.complex64)
