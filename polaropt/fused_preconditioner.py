"""The change of variables of `polaropt.preconditioner` in compiled passes, with the spectral prior's energy."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from polaropt.color_basis import Basis
from polaropt.preconditioner import AssumedHessian
from polaropt.spectra import Spectrum, column_multiplicity, each_plane, squared_frequencies
from polaropt.spectral_kernels import Hessian, color, whiten, whiten_gradient
from priors.natural_image import in_basis
from solvers.blocks import in_blocks

Images = NDArray[np.float32]
Vector = NDArray[np.float32]

_ROWS = 32


class FusedPreconditioner:
    """Layers from whitened coordinates and back; parameters as of `FourierPreconditioner`."""

    def __init__(self, hessian: AssumedHessian, mean: Images, basis: Basis, width: int) -> None:
        colors, height = hessian.stiffness.shape[1:3]
        self._frame = (height, width)
        self._shape = (2, colors, height, width // 2 + 1)
        self._basis = basis.astype(np.float32)
        self._length = np.sqrt(column_multiplicity(width)).astype(np.float32)
        self._level = in_basis(self._basis.T, mean, np)
        rows, columns = squared_frequencies(height, width)
        self._hessian = Hessian(
            told=hessian.told,
            cross_re=np.ascontiguousarray(hessian.cross.real),
            cross_im=np.ascontiguousarray(hessian.cross.imag),
            stiffness=hessian.stiffness,
            curvature=hessian.curvature.astype(np.float32),
            squared_rows=rows.astype(np.float32),
            squared_columns=columns.astype(np.float32),
        )
        self._spectrum: Spectrum = np.empty(self._shape, dtype=np.complex64)

    @property
    def size(self) -> int:
        """Length of z."""
        return 2 * int(np.prod(self._shape))

    def layers(self, z: Vector, out: Images) -> float:
        """Write the layers at z into `out` (2, channel, H, W); half their energy under the spectral prior."""
        pairs, inverse = _pairs(self._spectrum), 1 / self._length

        def rows(start: int, stop: int) -> float:
            return float(color(self._paired(z), self._hessian, inverse, self._basis, pairs, start, stop))

        energy = sum(in_blocks(rows, self._frame[0], _ROWS))
        self._inverse_transform(out)
        out += self._level
        return energy

    def coordinates(self, layers: Images) -> Vector:
        """Coordinates of layers: the inverse of `layers`."""
        self._transform(layers - self._level)
        z = np.empty(self.size, dtype=np.float32)
        pairs, out = _pairs(self._spectrum), self._paired(z)

        def rows(start: int, stop: int) -> None:
            whiten(pairs, self._hessian, self._length, self._basis, out, start, stop)

        in_blocks(rows, self._frame[0], _ROWS)
        return z

    def gradient(self, gradient: Images, z: Vector, weight: float) -> Vector:
        """Gradient at z of a function with this gradient by the layers plus `weight` times the prior's energy."""
        self._transform(gradient)
        return self.whitened(self._spectrum, z, self._basis, weight)

    def whitened(self, spectrum: Spectrum, z: Vector, basis: Images, weight: float) -> Vector:
        """As `gradient`, from the spectrum of the gradient in colours that `basis` turns into those of the prior."""
        whitened = np.empty(self.size, dtype=np.float32)
        pairs, point, out, factor = _pairs(spectrum), self._paired(z), self._paired(whitened), np.float32(weight)

        def rows(start: int, stop: int) -> None:
            whiten_gradient(pairs, point, self._hessian, self._length, basis, factor, out, start, stop)

        in_blocks(rows, self._frame[0], _ROWS)
        return whitened

    def _paired(self, z: Vector) -> Vector:
        """Coordinates as pairs of real and imaginary parts (2, channel, H, 2 (W // 2 + 1))."""
        return z.reshape(*self._shape[:-1], 2 * self._shape[-1])

    def _transform(self, images: Images) -> None:
        """Spectra of images (2, channel, H, W), a plane at a time: a plane fits the cache."""
        from scipy.fft import rfft2

        def plane(where: tuple[int, int]) -> None:
            self._spectrum[where] = rfft2(images[where], norm="ortho")

        each_plane(plane, self._shape)

    def _inverse_transform(self, out: Images) -> None:
        from scipy.fft import irfft2

        def plane(where: tuple[int, int]) -> None:
            out[where] = irfft2(self._spectrum[where], s=self._frame, norm="ortho", overwrite_x=True)

        each_plane(plane, self._shape)


def _pairs(spectrum: Spectrum) -> Images:
    return spectrum.view(np.float32)
