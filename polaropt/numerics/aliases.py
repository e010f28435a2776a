"""Frequencies that a mosaic mixes: which alias onto each other, and images from samples by Wiener's filter.

Sampling by a pattern of period P multiplies images by functions of period P, so a frequency of the samples holds that
of the images and its P^2 - 1 aliases, 1 / P apart along rows and columns. Such a group mixes with no other: the images
are as many small systems as there are groups, exactly.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from polaropt.numerics.spectrum import squared_frequencies
from solvers.kernels import compiled, in_blocks

Spectrum = NDArray[np.complex64]
Array = NDArray[Any]

_LANES = 16
"""Groups that are worked on side by side: a few vectors of the processor. By trial."""


@dataclass(frozen=True)
class Members:
    """Where the frequencies of some groups stand in a half spectrum.

    Attributes
    ----------
    index : ndarray of int, shape (alias, group)
        Flat.
    mirrored : ndarray of bool, same shape
        Whether the half spectrum holds the conjugate there.
    """

    index: NDArray[np.intp]
    mirrored: NDArray[np.bool_]

    def of(self, spectra: Array) -> Array:
        """Values (..., alias, group) of half spectra (..., H, W // 2 + 1)."""
        return self.conjugated(spectra.reshape(*spectra.shape[:-2], -1)[..., self.index])

    def conjugated(self, values: Array) -> Array:
        """Values (..., alias, group) that stand at the members' indices, conjugated in place where that is needed."""
        if np.iscomplexobj(values):
            np.conj(values, out=values, where=self.mirrored)
        return np.asarray(values)

    def write(self, values: Array, spectra: Array) -> None:
        """Put values (..., alias, group) into half spectra (..., H, W // 2 + 1)."""
        # What stands for its conjugate is another frequency of the half spectrum.
        spectra.reshape(*spectra.shape[:-2], -1)[..., self.index] = self.conjugated(values)


class AliasGroups:
    """The groups of a periodic frame.

    Parameters
    ----------
    height, width : int
        Of the frame: multiples of the period.
    period : int
        Of the mosaic's pattern.
    """

    def __init__(self, height: int, width: int, period: int) -> None:
        if height % period or width % period:
            raise ValueError(f"a frame of {height}x{width} holds no whole patterns of {period} px")
        self.height, self.width, self.period = height, width, period
        self._rows, self._columns = height // period, width // period

    @property
    def n_columns(self) -> int:
        """Groups in a row of them that a half spectrum tells; the others are their conjugates."""
        return self._columns // 2 + 1

    @property
    def n_rows(self) -> int:
        """Rows of groups."""
        return self._rows

    def members(self, row: Array | int, column: Array | int) -> Members:
        """Members of the groups (row, column), aliases row by row of the pattern."""
        aliases = np.divmod(np.arange(self.period**2), self.period)
        down = (np.asarray(row) + aliases[0][:, None] * self._rows) % self.height
        across = (np.asarray(column) + aliases[1][:, None] * self._columns) % self.width
        mirrored = across > self.width // 2
        down = np.where(mirrored, -down % self.height, down)
        across = np.where(mirrored, self.width - across, across)
        return Members(down * (self.width // 2 + 1) + across, mirrored)

    def slow(self, frequency: float) -> Members:
        """Members of the groups one of which is slower than `frequency` (cycles a pixel), a half of the plane."""
        down, across = np.fft.fftfreq(self.height)[: self._rows], np.fft.rfftfreq(self.width)[: self.n_columns]
        rows, columns = np.mgrid[: self._rows, : self.n_columns]
        nearest = np.minimum(rows, self._rows - rows)
        chosen = np.hypot(down[nearest], across[columns]) < frequency
        return self.members(rows[chosen], columns[chosen])

    def sample(self, n: int) -> tuple[Members, NDArray[np.float64]]:
        """Members of about `n` groups that stand for all, a quarter those that hold the slowest frequencies, and for
        how many groups each stands, (group,)."""
        rows, columns = (grid.ravel() for grid in np.mgrid[: self._rows, : self._columns])
        n_all = rows.size
        if n_all <= n:
            return self.members(rows, columns), np.ones(n_all)
        down, across = squared_frequencies(self.height, self.width)
        # Of its members the one in the band around zero is the slowest.
        nearest = (np.minimum(rows, self._rows - rows), np.minimum(columns, self._columns - columns))
        order = np.argsort(down[nearest[0]] + across[nearest[1]], kind="stable")
        slow, rest = order[: n // 4], order[n // 4 :]
        drawn = np.random.default_rng(0).choice(rest, n - slow.size, replace=False)
        chosen = np.concatenate([slow, drawn])
        counts = np.concatenate([np.ones(slow.size), np.full(drawn.size, rest.size / drawn.size)])
        return self.members(rows[chosen], columns[chosen]), counts

    def combs(self, weights: Array) -> Spectrum:
        """What sampling does to aliases: (..., measured, true) of weights (..., P * P) of the pattern's pixels."""
        pattern = weights.reshape(*weights.shape[:-1], self.period, self.period)
        lines = np.fft.fft2(pattern) / self.period**2
        flat = lines.reshape(*weights.shape[:-1], -1)
        down, across = np.divmod(np.arange(self.period**2), self.period)
        steps = ((down[:, None] - down) % self.period) * self.period + (across[:, None] - across) % self.period
        return np.asarray(flat[..., steps], dtype=np.complex64)


@compiled
def _covariance(combs: Array, power: Array, first: int, noise: Any, re: Array, im: Array) -> None:
    """Covariance (measured, measured, lane) of some groups' samples; below the diagonal and on it."""
    n_colors, n_entries, n = combs.shape[0], combs.shape[1], combs.shape[2]
    lanes = re.shape[2]
    re[:] = 0
    im[:] = 0
    for m in range(n):
        for x in range(lanes):
            re[m, m, x] = noise
    part_re, part_im = np.empty((n, lanes), np.float32), np.empty((n, lanes), np.float32)
    for c in range(n_colors):
        for t in range(n):
            for f in range(n_entries):
                part_re[:] = 0
                part_im[:] = 0
                for e in range(n_entries):
                    values = power[c, e, f, t]
                    for m in range(n):
                        a, b = combs[c, e, m, t].real, combs[c, e, m, t].imag
                        if a == 0 and b == 0:
                            continue
                        out_re, out_im = part_re[m], part_im[m]
                        for x in range(lanes):
                            p, q = values[first + x].real, values[first + x].imag
                            out_re[x] += a * p - b * q
                            out_im[x] += a * q + b * p
                for j in range(n):
                    a, b = combs[c, f, j, t].real, -combs[c, f, j, t].imag
                    if a == 0 and b == 0:
                        continue
                    for m in range(j, n):
                        in_re, in_im, out_re, out_im = part_re[m], part_im[m], re[m, j], im[m, j]
                        for x in range(lanes):
                            out_re[x] += a * in_re[x] - b * in_im[x]
                            out_im[x] += a * in_im[x] + b * in_re[x]


@compiled
def _factorize(re: Array, im: Array, inverse: Array) -> None:
    """Cholesky's factor in place of the lower triangle; `inverse` (n, lane) of its diagonal."""
    n, lanes = re.shape[0], re.shape[2]
    for j in range(n):
        for k in range(j):
            a, b = re[j, k], im[j, k]
            for m in range(j, n):
                c, d, out_re, out_im = re[m, k], im[m, k], re[m, j], im[m, j]
                for x in range(lanes):
                    out_re[x] -= c[x] * a[x] + d[x] * b[x]
                    out_im[x] -= d[x] * a[x] - c[x] * b[x]
        for x in range(lanes):
            inverse[j, x] = 1 / np.sqrt(max(re[j, j, x], np.float32(1e-30)))
        for m in range(j, n):
            for x in range(lanes):
                re[m, j, x] *= inverse[j, x]
                im[m, j, x] *= inverse[j, x]


@compiled
def _substitute(re: Array, im: Array, inverse: Array, v_re: Array, v_im: Array) -> None:
    """Solve with the lower factor in place, (n, lane)."""
    n, lanes = v_re.shape
    for j in range(n):
        for k in range(j):
            a, b, c, d = re[j, k], im[j, k], v_re[k], v_im[k]
            for x in range(lanes):
                v_re[j, x] -= a[x] * c[x] - b[x] * d[x]
                v_im[j, x] -= a[x] * d[x] + b[x] * c[x]
        for x in range(lanes):
            v_re[j, x] *= inverse[j, x]
            v_im[j, x] *= inverse[j, x]


@compiled
def _substitute_back(re: Array, im: Array, inverse: Array, v_re: Array, v_im: Array) -> None:
    """Solve with the lower factor's conjugate transpose in place, (n, lane)."""
    n, lanes = v_re.shape
    for j in range(n - 1, -1, -1):
        for k in range(j + 1, n):
            a, b, c, d = re[k, j], im[k, j], v_re[k], v_im[k]
            for x in range(lanes):
                v_re[j, x] -= a[x] * c[x] + b[x] * d[x]
                v_im[j, x] -= a[x] * d[x] - b[x] * c[x]
        for x in range(lanes):
            v_re[j, x] *= inverse[j, x]
            v_im[j, x] *= inverse[j, x]


@compiled
def explained(combs: Array, power: Array, noise: Any, data: Array, out: Array, told: Array, score: Array) -> None:
    """What the samples of groups say of the images' entries, under covariances of those.

    Shapes: combs (color, entry, measured, true), power (color, entry, entry, true, group), data (measured, group), out
    (color, entry, true, group): the posterior mean of the entries is power times it. told (color, entry, entry, true,
    group): its covariance is power - power told power; empty if not wanted. score (group,): minus twice the log
    likelihood. Groups are a multiple of the lanes.
    """
    n_colors, n_entries, n = combs.shape[0], combs.shape[1], combs.shape[2]
    lanes = _LANES
    re, im = np.empty((n, n, lanes), np.float32), np.empty((n, n, lanes), np.float32)
    inverse = np.empty((n, lanes), np.float32)
    v_re, v_im = np.empty((n, lanes), np.float32), np.empty((n, lanes), np.float32)
    w_re, w_im = np.empty((n_entries, n, lanes), np.float32), np.empty((n_entries, n, lanes), np.float32)
    for first in range(0, data.shape[1], lanes):
        _covariance(combs, power, first, noise, re, im)
        _factorize(re, im, inverse)
        for m in range(n):
            for x in range(lanes):
                v_re[m, x] = data[m, first + x].real
                v_im[m, x] = data[m, first + x].imag
        _substitute(re, im, inverse, v_re, v_im)
        for x in range(lanes):
            score[first + x] = 0
        for m in range(n):
            for x in range(lanes):
                score[first + x] += v_re[m, x] ** 2 + v_im[m, x] ** 2 - 2 * np.log(inverse[m, x])
        _substitute_back(re, im, inverse, v_re, v_im)
        for c in range(n_colors):
            for e in range(n_entries):
                for t in range(n):
                    total_re, total_im = w_re[0, 0], w_im[0, 0]
                    for x in range(lanes):
                        total_re[x] = 0
                        total_im[x] = 0
                    for m in range(n):
                        a, b = combs[c, e, m, t].real, -combs[c, e, m, t].imag
                        for x in range(lanes):
                            total_re[x] += a * v_re[m, x] - b * v_im[m, x]
                            total_im[x] += a * v_im[m, x] + b * v_re[m, x]
                    for x in range(lanes):
                        out[c, e, t, first + x] = complex(total_re[x], total_im[x])
        if told.size == 0:
            continue
        for c in range(n_colors):
            for t in range(n):
                for e in range(n_entries):
                    for m in range(n):
                        for x in range(lanes):
                            w_re[e, m, x] = combs[c, e, m, t].real
                            w_im[e, m, x] = combs[c, e, m, t].imag
                    _substitute(re, im, inverse, w_re[e], w_im[e])
                for e in range(n_entries):
                    for f in range(n_entries):
                        for x in range(lanes):
                            of_re, of_im = np.float32(0), np.float32(0)
                            for m in range(n):
                                of_re += w_re[e, m, x] * w_re[f, m, x] + w_im[e, m, x] * w_im[f, m, x]
                                of_im += w_re[e, m, x] * w_im[f, m, x] - w_im[e, m, x] * w_re[f, m, x]
                            told[c, e, f, t, first + x] = complex(of_re, of_im)


@dataclass(frozen=True)
class Explained:
    """What samples say of images' entries at some groups of frequencies.

    Attributes
    ----------
    mean : ndarray of complex64, shape (color, entry, alias, group)
        The entries' posterior mean is their covariance times it.
    information : ndarray of complex64, shape (color, entry, entry, alias, group)
        Their posterior covariance is ``C - C information C`` with C their covariance; empty if not asked for.
    score : float
        Minus twice the log likelihood per sample, but for a constant, weighted.
    """

    mean: Spectrum
    information: Spectrum
    score: float


def explained_groups(
    combs: Spectrum,
    power: Spectrum,
    noise_power: float,
    data: Spectrum,
    *,
    information: bool = False,
    weights: NDArray[np.float64] | None = None,
) -> Explained:
    """Wiener's filter at some groups.

    Parameters
    ----------
    combs : ndarray, shape (color, entry, alias, alias)
        Of `AliasGroups.combs`; colours in a basis in which they are independent.
    power : ndarray, shape (color, entry, entry, alias, group)
        Covariance of the images' entries at each frequency.
    noise_power : float
        Variance of a sample's noise.
    data : ndarray, shape (alias, group)
        Spectrum of the samples, for an orthonormal transform.
    information : bool
        Whether the information is wanted.
    weights : ndarray, shape (group,), optional
        Of each group in the score. Default: equal.
    """
    n = data.shape[1]
    padded = -n % _LANES
    power, data = (_filled_up(values, padded) for values in (power, data))
    mean = np.empty((*combs.shape[:2], *data.shape), np.complex64)
    shape = (*power.shape[:-1], power.shape[-1]) if information else (0, 0, 0, 0, 0)
    told, score = np.empty(shape, np.complex64), np.empty(data.shape[1], np.float32)
    explained(combs, power, np.float32(noise_power), data, mean, told, score)
    share = np.ones(n) if weights is None else weights
    value = float(score[:n] @ share) / (float(share.sum()) * len(data))
    return Explained(mean[..., :n], told[..., :n], value)


def _filled_up(values: Array, n: int) -> Array:
    """More groups at the end, like the last one, so that lanes are full."""
    filled = np.concatenate([values, np.repeat(values[..., -1:], n, axis=-1)], axis=-1) if n else values
    return np.ascontiguousarray(filled, dtype=np.complex64)


Images = Callable[[Spectrum], Array]
"""Images' values (color, image, alias, group) at some members, from `Explained.mean`."""


def wiener_spectra(
    groups: AliasGroups,
    combs: Spectrum,
    system: Callable[[Members], tuple[Spectrum, Images]],
    noise_power: float,
    data: Spectrum,
    n_images: int,
) -> Spectrum:
    """Half spectra (color, image, H, W // 2 + 1) of images from the half spectrum of samples, rows of groups at a time.

    Parameters
    ----------
    groups, combs, noise_power
        As for `explained_groups`.
    system : callable
        Covariance (color, entry, entry, alias, group) of the entries at the groups' members, and what makes images
        there of what the samples say.
    data : ndarray, shape (H, W // 2 + 1)
    n_images : int
    """
    spectra = np.empty((combs.shape[0], n_images, *data.shape), dtype=np.complex64)
    columns = np.arange(groups.n_columns)

    def rows(start: int, stop: int) -> None:
        for row in range(start, stop):
            members = groups.members(row, columns)
            power, images = system(members)
            found = explained_groups(combs, power, noise_power, members.of(data))
            members.write(images(found.mean), spectra)

    in_blocks(rows, groups.n_rows, 4)
    return spectra
