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
from solvers.ahead import Call
from solvers.kernels import compiled, in_blocks, inlined

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


# To have less to compile, kernels take tuples of arrays apart once, pick rows once, and read from an array that there
# are two layers, and two parts of a complex number: loops over a number that is written out are unrolled.


@inlined
def _curved(told: Array, stiffness: Array, curvature: Any, row: Any, columns: Array, out: Array) -> None:
    """A row of H's diagonal."""
    for x in range(out.size):
        out[x] = told[x] + stiffness[x] + curvature * (row + columns[x])


@compiled
def _determinant(t: Any, r: Any, k_re: Any, k_im: Any) -> Any:
    """At least what rounding leaves uncertain."""
    product = t * r
    return max(product - (k_re * k_re + k_im * k_im), RESOLUTION * product)


@inlined
def _invert_root(t: Array, r: Array, k_re: Array, k_im: Array, mixed: Array) -> None:
    """Diagonal of H^(-1/2) in place of H's, and the factor on the cross information off it."""
    for x in range(t.size):
        determinant = _determinant(t[x], r[x], k_re[x], k_im[x])
        root = np.sqrt(determinant)
        # Not of the product of both: it is beyond single precision where H is 1e13, as where there is next to no noise.
        factor = _ONE / (root * np.sqrt(t[x] + r[x] + root + root))
        of_t = t[x]
        t[x] = factor * (r[x] + root)
        r[x] = factor * (of_t + root)
        mixed[x] = -factor


@inlined
def _take_root(t: Array, r: Array, k_re: Array, k_im: Array, mixed: Array) -> None:
    """As `_invert_root` for H^(1/2)."""
    for x in range(t.size):
        root = np.sqrt(_determinant(t[x], r[x], k_re[x], k_im[x]))
        factor = _ONE / np.sqrt(t[x] + r[x] + root + root)
        t[x] = factor * (t[x] + root)
        r[x] = factor * (r[x] + root)
        mixed[x] = factor


@inlined
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


@inlined
def _apart(pairs: Array, re: Array, im: Array) -> None:
    for x in range(re.size):
        re[x] = pairs[2 * x]
        im[x] = pairs[2 * x + 1]


@inlined
def _together(re: Array, im: Array, factor: Array, pairs: Array) -> None:
    for x in range(re.size):
        pairs[2 * x] = factor[x] * re[x]
        pairs[2 * x + 1] = factor[x] * im[x]


@inlined
def _turned(spectra: Array, weights: Array, y: int, part_re: Array, part_im: Array, re: Array, im: Array) -> None:
    """Sum of the colours' spectra (channel, H, ...) in row y with weights (channel,)."""
    for x in range(re.size):
        re[x] = 0
        im[x] = 0
    for o in range(weights.size):
        weight = weights[o]
        _apart(spectra[o, y], part_re, part_im)
        for x in range(re.size):
            re[x] += weight * part_re[x]
            im[x] += weight * part_im[x]


@inlined
def _energy(stiffness: Array, re: Array, im: Array) -> Any:
    total = np.float32(0)
    for x in range(re.size):
        total += stiffness[x] * (re[x] * re[x] + im[x] * im[x])
    return total


@compiled
def color(z: Array, hessian: Hessian, inverse_length: Array, basis: Array, out: Array, start: int, stop: int) -> float:
    """Spectra of the layers' colours from coordinates, rows start..stop; half the energy under the prior.

    Basis (channel of the basis, channel); inverse_length (W // 2 + 1,) undoes that a column may stand for two.
    """
    told, cross_re, cross_im, stiffness, curvature, squared_rows, columns = hessian
    two, colors, width = len(out), z.shape[1], inverse_length.size
    own, part = np.empty((colors, 2, 2, width), np.float32), np.empty((2, width), np.float32)
    root = np.empty((3, width), np.float32)
    t, r, mixed, re, im = root[0], root[1], root[2], part[0], part[1]
    total = 0.0
    for y in range(start, stop):
        k_re, k_im = cross_re[y], cross_im[y]
        for c in range(colors):
            for i in range(two):
                _curved(told[i, y], stiffness[i, c, y], curvature[i, c], squared_rows[y], columns, root[i])
            _invert_root(t, r, k_re, k_im, mixed)
            pair = own[c]
            for i in range(two):
                _apart(z[i, c, y], pair[i, 0], pair[i, 1])
            _multiply(t, r, mixed, k_re, k_im, pair)
            for i in range(two):
                total += 0.5 * _energy(stiffness[i, c, y], pair[i, 0], pair[i, 1])
        for i in range(two):
            for o in range(colors):
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
    told, cross_re, cross_im, stiffness, curvature, squared_rows, columns = hessian
    two, colors, width = len(out), spectra.shape[1], length.size
    pair, part = np.empty((2, 2, width), np.float32), np.empty((2, width), np.float32)
    root = np.empty((3, width), np.float32)
    t, r, mixed, part_re, part_im = root[0], root[1], root[2], part[0], part[1]
    for y in range(start, stop):
        k_re, k_im = cross_re[y], cross_im[y]
        for c in range(colors):
            for i in range(two):
                _curved(told[i, y], stiffness[i, c, y], curvature[i, c], squared_rows[y], columns, root[i])
            _take_root(t, r, k_re, k_im, mixed)
            for i in range(two):
                _turned(spectra[i], basis[c], y, part_re, part_im, pair[i, 0], pair[i, 1])
            _multiply(t, r, mixed, k_re, k_im, pair)
            for i in range(two):
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
    told, cross_re, cross_im, stiffness, curvature, squared_rows, columns = hessian
    two, colors, width = len(out), z.shape[1], length.size
    # First the point, then the slope at it.
    both, part = np.empty((2, 2, 2, width), np.float32), np.empty((2, width), np.float32)
    root = np.empty((3, width), np.float32)
    t, r, mixed, part_re, part_im = root[0], root[1], root[2], part[0], part[1]
    for y in range(start, stop):
        k_re, k_im = cross_re[y], cross_im[y]
        for c in range(colors):
            for i in range(two):
                _curved(told[i, y], stiffness[i, c, y], curvature[i, c], squared_rows[y], columns, root[i])
                _apart(z[i, c, y], both[0, i, 0], both[0, i, 1])
                _turned(spectra[i], basis[c], y, part_re, part_im, both[1, i, 0], both[1, i, 1])
            _invert_root(t, r, k_re, k_im, mixed)
            for which in range(two):
                _multiply(t, r, mixed, k_re, k_im, both[which])
                if which == 0:
                    for i in range(two):
                        stiff = stiffness[i, c, y]
                        for part_of in range(two):
                            slope, at = both[1, i, part_of], both[0, i, part_of]
                            for x in range(width):
                                slope[x] = length[x] * slope[x] + weight * stiff[x] * at[x]
            for i in range(two):
                _interleave(both[1, i, 0], both[1, i, 1], out[i, c, y])


@inlined
def _interleave(re: Array, im: Array, pairs: Array) -> None:
    for x in range(re.size):
        pairs[2 * x] = re[x]
        pairs[2 * x + 1] = im[x]


def first_calls() -> list[Call]:
    """Calls on next to nothing of the kernels that every separation needs, for `solvers.ahead`."""
    plane, one = np.ones((1, 1), np.float32), np.float32(1)
    line = plane[0]
    pairs, stiffness = np.zeros((2, 1, 1, 2), np.float32), np.ones((2, 1, 1, 1), np.float32)
    hessian = Hessian(np.ones((2, 1, 1), np.float32), plane, plane, stiffness, np.ones((2, 1), np.float32), line, line)
    return [
        (whiten_gradient, (pairs, pairs, hessian, line, plane, one, pairs.copy(), 0, 0)),
        (color, (pairs, hessian, line, plane, pairs.copy(), 0, 0)),
        (whiten, (pairs, hessian, line, plane, pairs.copy(), 0, 0)),
    ]


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
