"""Which values of a file are black and white."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from polaropt.errors import InputError

_FEWEST = 16
_SHARE = 1e-5
_LARGE_SHARE = 1e-3
_STEEP = 8
_MANY_LEVELS = 32


@dataclass(frozen=True)
class Levels:
    """Values that become 0 and 1; values at white and above are clipped."""

    black: float
    white: float

    def apply(self, pixels: NDArray[Any]) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
        """Scaled values (float32), and which of them are below white."""
        scale = 1 / (self.white - self.black)
        if pixels.dtype.kind == "f" and pixels.dtype.itemsize <= 4:
            scaled = (pixels - np.float32(self.black)) * np.float32(scale)
        else:
            scaled = (pixels.astype(np.float64) - self.black) * scale
        return scaled.astype(np.float32), pixels < self.white


def find_levels(pixels: NDArray[Any], black: float, white: float | None) -> Levels:
    """Check a file's values and find white where it is not given.

    Parameters
    ----------
    pixels : ndarray
        All photographs of a capture, as stored.
    black, white : float
        In the file's units. White None: full scale (1 for floating point), or a lower value at which integers are
        clipped.

    Raises
    ------
    InputError
        No numbers, NaN, or no room between black and white.
    """
    if pixels.dtype.kind not in "uif":
        raise InputError(f"holds values of type {pixels.dtype}; integers or floating point numbers are needed")
    if pixels.size == 0:
        raise InputError("holds no pixels; give images of at least 16x16 px")
    if pixels.dtype.kind == "f" and not np.all(np.isfinite(pixels)):
        raise InputError("holds NaN or infinite values; replace them, or mask them in an npz file")
    if white is None:
        white = _white_of(pixels)
    if white <= black:
        raise InputError(f"the white level {white:g} is not above the black level {black:g}; correct one of them")
    return Levels(black, white)


def _white_of(pixels: NDArray[Any]) -> float:
    if pixels.dtype.kind == "f":
        if np.mean(pixels > 1) > 0.5:
            raise InputError(
                f"floating point values reach {float(pixels.max()):g}, while white is taken as 1; give the white level"
            )
        return 1.0
    full = float(np.iinfo(pixels.dtype).max)
    highest = float(pixels.max())
    return highest if highest < full and _is_clipped(pixels, highest) else full


def _is_clipped(pixels: NDArray[Any], highest: float) -> bool:
    """Whether pixels pile up at the highest value: many more than at the levels just below it.

    A pile at the full scale of a smaller depth (4095 for 12 bits, also shifted up to 16) is believed at once; elsewhere
    it must be large.
    """
    levels, counts = np.unique(pixels[pixels >= highest / 2], return_counts=True)
    below = counts[:-1][-_MANY_LEVELS:]
    if levels.size <= _MANY_LEVELS:
        return False
    pile = int(counts[-1])
    share = _SHARE if _is_full_scale(int(highest)) else _LARGE_SHARE
    return pile >= max(_FEWEST, share * pixels.size) and pile >= _STEEP * float(below.mean())


def _is_full_scale(value: int) -> bool:
    """Whether a value is 2^n - 1 with n of 8 or more, possibly shifted left."""
    ones = value >> ((value & -value).bit_length() - 1) if value > 0 else 0
    return ones & (ones + 1) == 0 and ones.bit_length() >= 8
