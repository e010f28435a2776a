"""Black and white of stored values: what becomes 0 and 1, and what is clipped."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from polaropt.capture.files.encoding import linearize
from polaropt.errors import InputError
from polaropt.numerics import BitMask, strips

Images = NDArray[np.float32]

# Where values are clipped below full scale, see `_is_clipped`; all by trial.
_SMALLEST_PILE = 16
"""Pixels at the highest value."""
_SHARE, _LARGE_SHARE = 1e-5, 1e-3
"""Share of the pixels at the highest value: where that is the full scale of some depth, and elsewhere."""
_STEEP = 8
"""How many times as many there are as at each of the levels below."""
_LEVELS_BELOW = 32
"""Levels that are compared with; with no more in all nothing is told."""


@dataclass(frozen=True)
class Levels:
    """Values that become 0 and 1; values at white and above are clipped."""

    black: float
    white: float

    def apply(self, pixels: NDArray[Any], gamma: float | str | None = None) -> tuple[Images, BitMask]:
        """Linear values of pixels (..., h, w) in an encoding, float32, and which of them are below white.

        Small integers by a table of their values. Some rows at a time: the doubles of all, or their places in the
        table, would be several times the photographs.
        """
        below = BitMask.made(pixels.shape, lambda part: pixels[part] < self.white)
        table = None
        if pixels.dtype.kind == "u" and pixels.dtype.itemsize <= 2 and pixels.size > 1 << 16:
            stored = np.arange(1 << (8 * pixels.dtype.itemsize)).astype(pixels.dtype)
            table = np.ascontiguousarray(linearize(self._scaled(stored), gamma))
        values = np.empty(pixels.shape, np.float32)
        for plane in np.ndindex(pixels.shape[:-2]):
            for rows in strips(*pixels.shape[-2:]):
                part = (*plane, rows)
                values[part] = linearize(self._scaled(pixels[part]), gamma) if table is None else table[pixels[part]]
        return values, below

    def _scaled(self, pixels: NDArray[Any]) -> NDArray[np.float32]:
        scale = 1 / (self.white - self.black)
        if pixels.dtype.kind == "f" and pixels.dtype.itemsize <= 4:
            return np.asarray((pixels - np.float32(self.black)) * np.float32(scale), dtype=np.float32)
        # In place: of strips as large as these each copy counts.
        scaled = pixels.astype(np.float64)
        scaled -= self.black
        scaled *= scale
        return scaled.astype(np.float32)


def find_levels(pixels: NDArray[Any], black: float, white: float | None, bits: int | None = None) -> Levels:
    """Check a file's values and find white where it is not given.

    Parameters
    ----------
    pixels : ndarray
        All photographs of a capture, as stored.
    black, white : float
        In the file's units. White None: full scale (1 for floating point), or a lower value at which integers are
        clipped.
    bits : int, optional
        Depth of integers, where it is known to be less than that of their type.

    Raises
    ------
    InputError
        No numbers, NaN, or no room between black and white.
    """
    if pixels.dtype.kind not in "uif":
        raise InputError(f"holds values of type {pixels.dtype}; integers or floating point numbers are needed")
    if pixels.size == 0:
        raise InputError("holds no pixels; give images of at least 16x16 px")
    if pixels.dtype.kind == "f" and not all(np.isfinite(part).all() for part in pixels):
        raise InputError("holds NaN or infinite values; replace them, or mask them in an npz file")
    if white is None:
        white = _white_of(pixels, bits)
    if white <= black:
        raise InputError(f"the white level {white:g} is not above the black level {black:g}; correct one of them")
    return Levels(black, white)


def _white_of(pixels: NDArray[Any], bits: int | None) -> float:
    if pixels.dtype.kind == "f":
        if sum(np.count_nonzero(part > 1) for part in pixels) > pixels.size / 2:
            raise InputError(
                f"floating point values reach {float(pixels.max()):g}, while white is taken as 1; give the white level"
            )
        return 1.0
    full = float(np.iinfo(pixels.dtype).max if bits is None else 2**bits - 1)
    highest = float(pixels.max())
    return highest if highest < full and _is_clipped(pixels, highest) else full


def _is_clipped(pixels: NDArray[Any], highest: float) -> bool:
    """Whether pixels pile up at the highest value: many more than at the levels just below it.

    A pile at the full scale of a smaller depth (4095 for 12 bits, also shifted up to 16) is believed at once; elsewhere
    it must be large.
    """
    levels, counts = _histogram(pixels, highest / 2)
    below = counts[:-1][-_LEVELS_BELOW:]
    if levels.size <= _LEVELS_BELOW:
        return False
    pile = int(counts[-1])
    share = _SHARE if _is_full_scale(int(highest)) else _LARGE_SHARE
    return pile >= max(_SMALLEST_PILE, share * pixels.size) and pile >= _STEEP * float(below.mean())


def _histogram(pixels: NDArray[Any], least: float) -> tuple[NDArray[Any], NDArray[np.intp]]:
    """Values from `least` on and how often each occurs, counted part by part."""
    parts = [np.unique(part[part >= least], return_counts=True) for part in pixels]
    levels, which = np.unique(np.concatenate([part[0] for part in parts]), return_inverse=True)
    counts = np.zeros(len(levels), dtype=np.intp)
    np.add.at(counts, which, np.concatenate([part[1] for part in parts]))
    return levels, counts


def _is_full_scale(value: int) -> bool:
    """Whether a value is 2^n - 1 with n of 8 or more, possibly shifted left."""
    ones = value >> ((value & -value).bit_length() - 1) if value > 0 else 0
    return ones & (ones + 1) == 0 and ones.bit_length() >= 8
