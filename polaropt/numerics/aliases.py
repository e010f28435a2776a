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
from solvers.kernels import in_blocks

Spectrum = NDArray[np.complex64]
Array = NDArray[Any]


@dataclass(frozen=True)
class Members:
    """Where the frequencies of some groups stand in a half spectrum.

    Attributes
    ----------
    index : ndarray of int, shape (alias, group)
        Flat.
    mirrored : ndarray of bool, same shape
        Whether the half spectrum holds the conjugate there.
    own : ndarray of bool, same shape
        Whether the frequency there is this group's to write: in columns that are their own mirror image two groups
        hold each, conjugate and equal but for rounding.
    """

    index: NDArray[np.intp]
    mirrored: NDArray[np.bool_]
    own: NDArray[np.bool_]

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
        spectra.reshape(*spectra.shape[:-2], -1)[..., self.index[self.own]] = self.conjugated(values)[..., self.own]


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
        of_itself = 2 * np.asarray(column) % self._columns == 0
        return Members(down * (self.width // 2 + 1) + across, mirrored, ~(mirrored & of_itself))

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
        return np.ascontiguousarray(flat[..., alias_steps(self.period)], dtype=np.complex64)


def alias_steps(period: int) -> NDArray[np.intp]:
    """Which line of a pattern's spectrum, flat, brings each alias to each measured one, (measured, true)."""
    down, across = np.divmod(np.arange(period**2), period)
    steps = ((down[:, None] - down) % period) * period + (across[:, None] - across) % period
    return np.asarray(steps)


@dataclass(frozen=True)
class Explained:
    """What samples say of images' entries at some groups of frequencies.

    Attributes
    ----------
    mean : ndarray of complex64, shape (color, entry, alias, group)
        The entries' posterior mean is their covariance times it.
    information : ndarray of complex64, shape (color, entry, entry, alias, group)
        Their posterior covariance is ``C - C information C`` with C their covariance; empty if not asked for.
    """

    mean: Spectrum
    information: Spectrum


def explained_groups(
    combs: Spectrum,
    power: Spectrum,
    noise_power: float,
    data: Spectrum,
    *,
    information: bool = False,
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
    """
    # Kernels load numba: half a second, only where they are called.
    from polaropt.numerics.alias_kernels import LANES, explained

    n = data.shape[1]
    padded = -n % LANES
    power, data = (_filled_up(values, padded) for values in (power, data))
    mean = np.empty((*combs.shape[:2], *data.shape), np.complex64)
    shape = (*power.shape[:-1], power.shape[-1]) if information else (0, 0, 0, 0, 0)
    told = np.empty(shape, np.complex64)
    explained(combs, power, np.float32(noise_power), data, mean, told)
    return Explained(mean[..., :n], told[..., :n])


def filter_of_groups(combs: Spectrum, power: Spectrum, noise_power: float, seen: Spectrum) -> Spectrum:
    """Wiener's filter at some groups: what each sample counts in a sum over an image's frequencies.

    Parameters
    ----------
    combs, power, noise_power
        As for `explained_groups`.
    seen : ndarray, shape (alias, group)
        Weight of each frequency in the sum.

    Returns
    -------
    ndarray of complex64, shape (color, entry, alias, group)
        The sum of an entry is that of these times the samples' spectrum.
    """
    from polaropt.numerics.alias_kernels import LANES, filter_rows

    n = seen.shape[1]
    power, seen = (_filled_up(values, -n % LANES) for values in (power, seen))
    found = np.empty((*combs.shape[:2], *seen.shape), np.complex64)
    filter_rows(combs, power, np.float32(noise_power), seen, found)
    return found[..., :n]


def mixed_spectra(gains: tuple[Array, Array], spectra: Spectrum) -> Spectrum:
    """Sums (image, row, column) of spectra (place, row, column), a row of them at a time.

    Parameters
    ----------
    gains : (ndarray, ndarray)
        Real and imaginary parts of each spectrum's share, float32, (row, image, place, column).
    spectra : ndarray of complex64
    """
    from polaropt.numerics.alias_kernels import mixed_rows

    mixed = np.empty((gains[0].shape[1], *spectra.shape[1:]), np.complex64)
    in_blocks(lambda start, stop: mixed_rows(*gains, spectra, mixed, start, stop), spectra.shape[1], 16)
    return mixed


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
