"""The change of variables of `polaropt.inversion.whitening` in compiled passes over rows of half spectra.

With H the Hessian that is assumed per frequency and colour, a 2x2 matrix, spectra are ``H^(-1/2) z``. Spectra and
coordinates are passed as pairs of float32 (..., H, 2 (W // 2 + 1)), since complex loops do not vectorize.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from polaropt.inversion.spectra import RESOLUTION, Spectrum
from polaropt.inversion.whitening import AssumedHessian
from polaropt.numerics import Basis, column_multiplicity, each_plane, squared_frequencies
from priors.natural_image import in_basis
from solvers.kernels import compiled, in_blocks

Array = NDArray[Any]

_ONE = np.float32(1)


class Hessian(NamedTuple):
    """The Hessian that is assumed: what the photographs tell, the spectral prior, and a mean curvature of edges."""

    told: Array
    """Diagonal of the information on both layers, (2, H, W // 2 + 1)."""
    cross_re: Array
    cross_im: Array
    """Its entry off the diagonal, the transmission's row, (H, W // 2 + 1)."""
    stiffness: Array
    """Of the spectral prior, (2, channel, H, W // 2 + 1)."""
    curvature: Array
    """Per squared frequency, (2, channel)."""
    squared_rows: Array
    squared_columns: Array
    """Squared frequency as the sum of a row's part (H,) and a column's (W // 2 + 1,)."""


@compiled
def _diagonal(hessian: Hessian, c: int, y: int, t: Array, r: Array) -> None:
    for i in range(2):
        out, told, stiffness = (t if i == 0 else r), hessian.told[i, y], hessian.stiffness[i, c, y]
        curvature, row, columns = hessian.curvature[i, c], hessian.squared_rows[y], hessian.squared_columns
        for x in range(out.size):
            out[x] = told[x] + stiffness[x] + curvature * (row + columns[x])


@compiled
def _determinant(t: Any, r: Any, k_re: Any, k_im: Any) -> Any:
    """At least what rounding leaves uncertain."""
    product = t * r
    return max(product - (k_re * k_re + k_im * k_im), RESOLUTION * product)


@compiled
def _inverse_root(hessian: Hessian, c: int, y: int, t: Array, r: Array, mixed: Array) -> None:
    """Diagonal of H^(-1/2) in row y, and the factor on the cross information off it."""
    _diagonal(hessian, c, y, t, r)
    k_re, k_im = hessian.cross_re[y], hessian.cross_im[y]
    for x in range(t.size):
        determinant = _determinant(t[x], r[x], k_re[x], k_im[x])
        root = np.sqrt(determinant)
        factor = _ONE / np.sqrt(determinant * (t[x] + r[x] + root + root))
        of_t = t[x]
        t[x] = factor * (r[x] + root)
        r[x] = factor * (of_t + root)
        mixed[x] = -factor


@compiled
def _root(hessian: Hessian, c: int, y: int, t: Array, r: Array, mixed: Array) -> None:
    """As `_inverse_root` for H^(1/2)."""
    _diagonal(hessian, c, y, t, r)
    k_re, k_im = hessian.cross_re[y], hessian.cross_im[y]
    for x in range(t.size):
        root = np.sqrt(_determinant(t[x], r[x], k_re[x], k_im[x]))
        factor = _ONE / np.sqrt(t[x] + r[x] + root + root)
        t[x] = factor * (t[x] + root)
        r[x] = factor * (r[x] + root)
        mixed[x] = factor


@compiled
def _multiply(t: Array, r: Array, mixed: Array, k_re: Array, k_im: Array, pair: Array) -> None:
    """Apply a row of 2x2 matrices to a pair of layers (layer, re/im, w) in place."""
    t_re, t_im, r_re, r_im = pair[0, 0], pair[0, 1], pair[1, 0], pair[1, 1]
    for x in range(t.size):
        m_re, m_im = mixed[x] * k_re[x], mixed[x] * k_im[x]
        a, b, c, d = t_re[x], t_im[x], r_re[x], r_im[x]
        t_re[x] = t[x] * a + (m_re * c - m_im * d)
        t_im[x] = t[x] * b + (m_re * d + m_im * c)
        r_re[x] = r[x] * c + (m_re * a + m_im * b)
        r_im[x] = r[x] * d + (m_re * b - m_im * a)


@compiled
def _apart(pairs: Array, re: Array, im: Array) -> None:
    for x in range(re.size):
        re[x] = pairs[2 * x]
        im[x] = pairs[2 * x + 1]


@compiled
def _together(re: Array, im: Array, factor: Array, pairs: Array) -> None:
    for x in range(re.size):
        pairs[2 * x] = factor[x] * re[x]
        pairs[2 * x + 1] = factor[x] * im[x]


@compiled
def _turned(spectra: Array, weights: Array, i: int, y: int, part: Array, out: Array) -> None:
    """Sum of the colours' spectra in row y with weights (channel,), as (re/im, w)."""
    for x in range(out.shape[1]):
        out[0, x] = 0
        out[1, x] = 0
    re, im = out[0], out[1]
    for o in range(weights.size):
        _apart(spectra[i, o, y], part[0], part[1])
        part_re, part_im = part[0], part[1]
        for x in range(re.size):
            re[x] += weights[o] * part_re[x]
            im[x] += weights[o] * part_im[x]


@compiled
def _energy(stiffness: Array, pair: Array) -> Any:
    re, im, total = pair[0], pair[1], np.float32(0)
    for x in range(re.size):
        total += stiffness[x] * (re[x] * re[x] + im[x] * im[x])
    return total


@compiled
def color(z: Array, hessian: Hessian, inverse_length: Array, basis: Array, out: Array, start: int, stop: int) -> float:
    """Spectra of the layers' colours from coordinates, rows start..stop; half the energy under the prior.

    Basis (channel of the basis, channel); inverse_length (W // 2 + 1,) undoes that a column may stand for two.
    """
    colors, width = z.shape[1], inverse_length.size
    own, part = np.empty((colors, 2, 2, width), np.float32), np.empty((2, width), np.float32)
    root = np.empty((3, width), np.float32)
    total = 0.0
    for y in range(start, stop):
        for c in range(colors):
            _inverse_root(hessian, c, y, root[0], root[1], root[2])
            for i in range(2):
                _apart(z[i, c, y], own[c, i, 0], own[c, i, 1])
            _multiply(root[0], root[1], root[2], hessian.cross_re[y], hessian.cross_im[y], own[c])
            for i in range(2):
                total += 0.5 * _energy(hessian.stiffness[i, c, y], own[c, i])
        for i in range(2):
            for o in range(colors):
                re, im = part[0], part[1]
                for x in range(width):
                    re[x] = 0
                    im[x] = 0
                for c in range(colors):
                    own_re, own_im, weight = own[c, i, 0], own[c, i, 1], basis[c, o]
                    for x in range(width):
                        re[x] += weight * own_re[x]
                        im[x] += weight * own_im[x]
                _together(re, im, inverse_length, out[i, o, y])
    return total


@compiled
def whiten(spectra: Array, hessian: Hessian, length: Array, basis: Array, out: Array, start: int, stop: int) -> None:
    """Coordinates of spectra, rows start..stop: the inverse of `color`."""
    colors, width = spectra.shape[1], length.size
    pair, part = np.empty((2, 2, width), np.float32), np.empty((2, width), np.float32)
    root = np.empty((3, width), np.float32)
    for y in range(start, stop):
        for c in range(colors):
            _root(hessian, c, y, root[0], root[1], root[2])
            for i in range(2):
                _turned(spectra, basis[c], i, y, part, pair[i])
            _multiply(root[0], root[1], root[2], hessian.cross_re[y], hessian.cross_im[y], pair)
            for i in range(2):
                _together(pair[i, 0], pair[i, 1], length, out[i, c, y])


@compiled
def whiten_gradient(
    spectra: Array,
    z: Array,
    hessian: Hessian,
    length: Array,
    basis: Array,
    weight: Any,
    out: Array,
    start: int,
    stop: int,
) -> None:
    """Gradient by the coordinates, rows start..stop, of a function of the layers plus weight times the prior.

    Spectra are those of the function's gradient by the layers.
    """
    colors, width = z.shape[1], length.size
    pair, part = np.empty((2, 2, width), np.float32), np.empty((2, width), np.float32)
    point, root = np.empty((2, 2, width), np.float32), np.empty((3, width), np.float32)
    for y in range(start, stop):
        k_re, k_im = hessian.cross_re[y], hessian.cross_im[y]
        for c in range(colors):
            _inverse_root(hessian, c, y, root[0], root[1], root[2])
            for i in range(2):
                _apart(z[i, c, y], point[i, 0], point[i, 1])
                _turned(spectra, basis[c], i, y, part, pair[i])
            _multiply(root[0], root[1], root[2], k_re, k_im, point)
            for i in range(2):
                stiffness = hessian.stiffness[i, c, y]
                for part_of in range(2):
                    slope, at = pair[i, part_of], point[i, part_of]
                    for x in range(width):
                        slope[x] = length[x] * slope[x] + weight * stiffness[x] * at[x]
            _multiply(root[0], root[1], root[2], k_re, k_im, pair)
            for i in range(2):
                _interleave(pair[i, 0], pair[i, 1], out[i, c, y])


@compiled
def _interleave(re: Array, im: Array, pairs: Array) -> None:
    for x in range(re.size):
        pairs[2 * x] = re[x]
        pairs[2 * x + 1] = im[x]


Images = NDArray[np.float32]
Vector = NDArray[np.float32]

# Rows that a thread works on at a time: a few megabytes. By trial.
_ROWS = 32


class FusedPreconditioner:
    """Layers from whitened coordinates and back; parameters as of `FourierPreconditioner`."""

    def __init__(self, hessian: AssumedHessian, mean: Images, basis: Basis, width: int) -> None:
        colors, height = hessian.stiffness.shape[1:3]
        self._frame = (height, width)
        self._shape = (2, colors, height, width // 2 + 1)
        # Laid out by rows wherever it comes from: each other layout is a kernel to compile.
        self._basis = np.ascontiguousarray(basis, dtype=np.float32)
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
        by_rows = np.ascontiguousarray(basis, dtype=np.float32)

        def rows(start: int, stop: int) -> None:
            whiten_gradient(pairs, point, self._hessian, self._length, by_rows, factor, out, start, stop)

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
