"""Evenly lit fields, which a polarization camera is calibrated with."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.polynomial.polynomial import polyvander2d
from numpy.typing import NDArray

from polaropt.capture.files.opening import AnyPath
from polaropt.capture.mosaic import SONY_CELL, sampling_of
from polaropt.capture.reading.contents import content_of
from polaropt.capture.reading.levels import find_levels
from polaropt.capture.reading.mosaics import single_plane
from polaropt.capture.reading.options import checked_options
from polaropt.capture.validity import SMALLEST_SIDE
from polaropt.errors import InputError
from polaropt.numerics import block_mean

_CLIPPED_FIELD = 1e-3
"""Share of clipped samples that a field for calibration may have: hot pixels; set by hand."""
_BLOCK_PX = 8
_UNEVEN = 0.1
"""Means of blocks of so many pixels of an evenly lit field deviate less than this from a slow change, relative to their
mean: before lenses of up to 60 degrees with a lamp at one side by 0.01, half of all photographs by 0.29. By trial."""


def field_means(
    paths: Sequence[AnyPath],
    sensor: str = "auto",
    cell_order: Sequence[float] | None = None,
    black_level: float = 0.0,
    white_level: float | None = None,
    *,
    shape: Sequence[int] | None = None,
    pixel_format: str | None = None,
) -> tuple[NDArray[np.float64], tuple[float, ...]]:
    """Mean of each corner's samples in raw mosaics of evenly lit fields, (n, k), and the corners' angles, ascending.

    Of the middle half of the frame, colours together. Arguments as of `read_capture`.

    Raises
    ------
    InputError
        A file that cannot be read, or a field that is clipped or not evenly lit.
    """
    options = checked_options(sensor=sensor, cell_order=cell_order, black_level=black_level, white_level=white_level)
    sampling, angles = sampling_of(False, options.cell_order or SONY_CELL)
    means = []
    for path in paths:
        content, _ = content_of((str(path),), shape, pixel_format)
        try:
            if content.stack:
                raise InputError("holds several photographs; give one raw mosaic a file")
            raw = single_plane(content.pixels)
            levels = find_levels(raw, options.black_level, options.white_level, content.bits)
            values, below_white = levels.apply(raw)
            valid = np.asarray(below_white)
            height, width = (side // 8 * 4 for side in values.shape)
            if min(height, width) < SMALLEST_SIDE:
                raise InputError(f"is {raw.shape[1]}x{raw.shape[0]} px; at least 64x64 are needed")
            top, left = (side // 8 * 2 // 4 * 4 for side in values.shape)
            middle = (slice(top, top + height), slice(left, left + width))
            if np.mean(~valid[middle]) > _CLIPPED_FIELD:
                raise InputError("is clipped; take the field again with a shorter exposure")
            unevenness = _unevenness(values[middle])
            if unevenness > _UNEVEN:
                raise InputError(
                    f"is no evenly lit field: its light differs by {100 * unevenness:.0f} % from place to place; take "
                    "a white surface, out of focus"
                )
            of_corners = sampling.spread(values[middle], len(angles))
            means.append(of_corners.sum(axis=(1, 2, 3), dtype=np.float64) / (height * width / len(angles)))
        except InputError as error:
            raise InputError(f"{path}: {error}") from None
    return np.array(means), angles


def _unevenness(values: NDArray[np.float32]) -> float:
    """Standard deviation of blocks about a slow change over the frame, as lenses make it, relative to the mean."""
    blocks = block_mean(values, _BLOCK_PX).astype(np.float64)
    places = np.meshgrid(*(np.linspace(-1, 1, side) for side in blocks.shape), indexing="ij")
    columns = np.asarray(polyvander2d(places[0].ravel(), places[1].ravel(), [2, 2]))
    slow = columns @ np.linalg.lstsq(columns, blocks.ravel(), rcond=None)[0]
    return float(np.std(blocks.ravel() - slow) / max(blocks.mean(), np.finfo(np.float64).tiny))
