"""Overlapping windows of images: their sizes, their spectra, and which of their frequencies belong together."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from polaropt.numerics import squared_frequencies
from solvers.kernels import in_blocks

Images = NDArray[np.float32]
Spectrum = NDArray[np.complex64]
Frequencies = NDArray[np.floating[Any]]

# Root of two: the power of pixels seen through a window, whose mean square is a quarter, is that of the pixels.
_SQUARED = np.float32(np.sqrt(2))

# Standard deviation of the Gaussian that tells slow changes from fast ones, in sides of a window. Behind wide lenses a
# sixth is worse by up to 0.05 dB; behind panes that are the same everywhere 0.18, 0.25 and 0.35 are alike.
_SLOW = 0.25
# Distance in periods per pixel from what repeats with every second pixel, up to which the samples of a mosaic cannot
# tell detail from polarized light, and the directions that tell which of both it is. A window takes a highlight that is
# polarized by itself, which no pane explains, for such detail, beads along a line, the more so the more turns there
# are. On 35 mosaics of training photographs 0.15 gains 0.1 and 0.15 dB at noise of 0.5 %, at 2 % it loses 0.05.
_LIKE_PATTERN, _DIRECTIONS = 0.15, 12
# What repeats so, down and across, in periods per pixel.
_REPEATS = ((0.0, 0.5), (0.5, 0.0), (0.5, 0.5))
# Periods per window from which on a frequency has one before it in its direction.
_SLOWEST_WITH_ONE_BEFORE = 1.5


@dataclass(frozen=True)
class WindowSize:
    """How large windows are.

    Attributes
    ----------
    side_px : int
        Neighbours lie half a side apart: each pixel lies in four.
    slowest : float
        Periods per window, up to which a window cannot tell a layer's changes: they stay those at hand.
    """

    side_px: int
    slowest: float

    @property
    def step_px(self) -> int:
        """From a window to the next."""
        return self.side_px // 2

    @cached_property
    def profile(self) -> Images:
        """Of a window along a side, (side,).

        The squares of all windows that a pixel lies in add up to one; within a window their mean is a quarter.
        """
        return np.asarray(np.sin(np.pi * (np.arange(self.side_px) + 0.5) / self.side_px), dtype=np.float32)

    @property
    def fast(self) -> Images:
        """1 at the frequencies (side, side // 2 + 1) whose changes a window tells, 0 elsewhere."""
        rows, columns = np.fft.fftfreq(self.side_px), np.fft.rfftfreq(self.side_px)
        return np.asarray(np.hypot(rows[:, None], columns) * self.side_px > self.slowest, dtype=np.float32)

    def faster(self, height: int, width: int) -> Images:
        """What windows are shown of each frequency of a half spectrum (height, width): little that is slower than they.

        Of slow changes a window's profile makes fast ones, which its spectrum would draw to nothing: where the pane
        tells little of a layer that shows as a weave.
        """
        rows, columns = squared_frequencies(height, width)
        blurred = np.exp(-0.5 * (self.side_px * _SLOW) ** 2 * (rows[:, None] + columns))
        return np.asarray(1 - blurred, dtype=np.float32)

    def nearest(self, height: int, width: int) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
        """Rows (side,) and columns (side // 2 + 1,) of a half spectrum (height, width) that are a window's own."""
        rows = np.round(np.fft.fftfreq(self.side_px) * height).astype(int) % height
        return rows, np.minimum(np.round(np.fft.rfftfreq(self.side_px) * width).astype(int), width // 2)

    @property
    def along(self) -> NDArray[np.intp]:
        """Of each frequency of a half spectrum (side, side // 2 + 1) those beside it of its direction, (2, n)."""
        half = self.side_px // 2
        rows, columns = np.meshgrid(np.fft.fftfreq(self.side_px) * self.side_px, np.arange(half + 1.0), indexing="ij")
        length = np.hypot(rows, columns)
        apart, places = 1 / np.maximum(length, 1), []
        # Those next to no frequency have none before them.
        for step in (apart, np.where(length < _SLOWEST_WITH_ONE_BEFORE, 0, -apart)):
            # The last column stays in itself: what lies opposite there is the same and must have the same beside it.
            y, x = np.rint(rows * (1 + step)), np.where(columns < half, np.rint(columns * (1 + step)), half)
            inside = np.clip(y, -half, half).astype(int) % self.side_px, np.minimum(x, half).astype(int)
            places.append(np.ravel_multi_index(inside, rows.shape).ravel())
        return np.stack(places)

    @property
    def of_pattern(self) -> OfPattern:
        """Frequencies that repeat with a mosaic's polarizers, and which tell how much there is of them."""
        rows, columns = np.fft.fftfreq(self.side_px), np.fft.rfftfreq(self.side_px)
        repeats = (np.min(apart_from(_REPEATS, rows, columns), axis=0) < _LIKE_PATTERN).ravel()
        rows, columns = np.meshgrid(rows, columns, indexing="ij")
        direction = np.floor(np.arctan2(rows, columns) % np.pi * (_DIRECTIONS / np.pi)).astype(np.intp) % _DIRECTIONS
        # Those within a column that stands for two count twice.
        weight = np.where((columns == 0) | (columns == 0.5), 1, 2) * self.fast
        return OfPattern(
            np.where(repeats, 0, weight.ravel()).astype(np.float32), np.where(self.fast > 0, direction, -1).ravel()
        )

    def kernel_within(self, height: int, width: int) -> KernelWithin:
        """What windows see of kernels (height, width)."""
        # How much of a window lies in itself, moved; what lies farther apart than its side nothing does.
        profile = np.sin(np.pi * (np.arange(self.side_px) + 0.5) / self.side_px)
        overlap = np.correlate(profile, profile, "full") * (2 / self.side_px)
        apart = np.arange(1 - self.side_px, self.side_px)
        down, across = (overlap * (2 * np.abs(apart) < side) for side in (height, width))
        return KernelWithin(
            (apart % height)[:, None], apart % width, np.outer(down, across).astype(np.float32), apart % self.side_px
        )


class OfPattern(NamedTuple):
    """How much the frequencies of a window count in the mean of their direction, 0 for those bounded by it, and the
    number of that direction, -1 for none."""

    weight: Images
    direction: NDArray[np.intp]


class KernelWithin(NamedTuple):
    """What a window sees of a kernel: the values at `rows` and `columns` times `weights`, which lie at `places` of it,
    down and across."""

    rows: NDArray[np.intp]
    columns: NDArray[np.intp]
    weights: Images
    places: NDArray[np.intp]


# By trial on four pairs of photographs behind panes at 10 to 75 degrees (24, 32, 64 px).
COARSE = WindowSize(32, 1.5)
# Of the last turn, from layers at hand that are near. On 40 captures of training photographs behind panes at 10 to 85
# degrees both layers gain 0.2 dB by it, and 0.14 / 0.07 dB on 32 mosaics; by windows of 24 px less, of 12 px as much;
# where a lens blurs by 0.8 px nothing. A window's own profile mixes what is slower into its first period: with that
# both lose 0.2 to 0.7 dB at 10 degrees.
FINE = WindowSize(16, 1.5)


def apart_from(places: Sequence[tuple[float, float]], rows: Frequencies, columns: Frequencies) -> Frequencies:
    """From each of some frequencies (y, x) to those of a spectrum, (n, rows, columns), in periods per pixel.

    Those that differ by whole periods are the same.
    """
    away = [np.hypot(((rows - y + 0.5) % 1 - 0.5)[:, None], (columns - x + 0.5) % 1 - 0.5) for y, x in places]
    return np.stack(away)


def mirrored_around(images: Images, size: WindowSize, at: Literal["borders", "pixels"] = "borders") -> Images:
    """Images (..., h, w), mirrored around their frame so far that whole windows fill it.

    At the frame's borders, so that the outermost pixels stand there twice, or at these pixels, so that what alternates
    goes on to do so.
    """
    step = size.step_px
    around = [(step, step + -side % step) for side in images.shape[-2:]]
    return np.pad(images, [*[(0, 0)] * (images.ndim - 2), *around], mode="symmetric" if at == "borders" else "reflect")


def frame_of(extended: Images, size: WindowSize, height: int, width: int) -> Images:
    """The frame of images that are `mirrored_around`; a view."""
    step = size.step_px
    return extended[..., step : step + height, step : step + width]


def in_rows(turn: Callable[[int], None], n: int) -> None:
    """Call ``turn(i)`` for each of n rows of windows, on all cores; no two at once that share a pixel."""

    def every_second(first: int, place: int, _: int) -> None:
        turn(2 * place + first)

    for first in (0, 1):
        in_blocks(partial(every_second, first), (n - first + 1) // 2, 1)


def row_of(images: Images, i: int, size: WindowSize) -> Images:
    """What the i-th row of windows sees of images that are `mirrored_around`; a view."""
    return images[..., i * size.step_px : i * size.step_px + size.side_px, :]


def spectra_of(row: Images, size: WindowSize) -> Spectrum:
    """Of a row of windows: (2, channel, side, width) to (2, channel, window, side, side // 2 + 1)."""
    from scipy.fft import rfft2

    from polaropt.solving.kernels.windows import cut

    n = row.shape[-1] // size.step_px - 1
    pieces = np.empty((*row.shape[:2], n, size.side_px, size.side_px), dtype=np.float32)
    cut(row, _SQUARED * size.profile, size.step_px, pieces)
    return np.asarray(rfft2(pieces, norm="ortho", overwrite_x=True))


def add_to(row: Images, spectra: Spectrum, size: WindowSize) -> None:
    """Add what windows of these spectra show to a row of them, (2, channel, side, width)."""
    from scipy.fft import irfft2

    from polaropt.solving.kernels.windows import put

    pieces = irfft2(spectra, s=(size.side_px, size.side_px), norm="ortho", overwrite_x=True)
    put(pieces, size.profile / _SQUARED, size.step_px, row)
