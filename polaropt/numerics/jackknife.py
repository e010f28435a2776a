"""Standard errors by leaving parts of a frame out."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from polaropt.numerics.minima import vertex

Values = NDArray[np.float64]

_FARTHEST = 4.0
"""Steps up to which a parabola is followed beyond its three points; set by hand."""


def grid_sums(maps: NDArray[np.floating], groups: int | tuple[int, int]) -> Values:
    """Sums of maps (..., h, w) over a chessboard of up to so many parts each way, flat: (..., part)."""
    sums = maps.astype(np.float64)
    rows, columns = (groups, groups) if isinstance(groups, int) else groups
    for axis, most, length in ((-2, rows, maps.shape[-2]), (-1, columns, maps.shape[-1])):
        starts = np.linspace(0, length, min(most, length) + 1)[:-1].astype(int)
        sums = np.add.reduceat(sums, starts, axis=axis)
    return sums.reshape(*maps.shape[:-2], -1)


def left_out(sums: Values) -> Values:
    """Of sums (..., part) the whole without each part, (..., part)."""
    rest: Values = sums.sum(axis=-1, keepdims=True) - sums
    return rest


def jackknife_error(estimates: Values) -> float:
    """Standard error from the estimates (part,) that leave one part of a frame out each.

    Parts of equal weight are assumed; see Efron and Stein, The jackknife estimate of variance (1981).
    """
    n = estimates.size
    return math.sqrt((n - 1) / n * float(np.square(estimates - estimates.mean()).sum())) if n > 1 else math.inf


def minimum_error(values: Sequence[Values], step: float) -> float:
    """Standard error of where a function is least.

    Parameters
    ----------
    values : three arrays (part,)
        The function without each part of a frame, at points `step` apart around the minimum.
    step : float
    """
    minima = [vertex(before, here, after, _FARTHEST) for before, here, after in zip(*values, strict=True)]
    return step * jackknife_error(np.array(minima))
