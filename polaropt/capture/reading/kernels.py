"""Compiled passes over the samples of a mosaic; importing this imports numba."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from solvers.kernels import compiled

Images = NDArray[np.float32]
Places = NDArray[np.intp]


@compiled
def framed_pixels(
    values: NDArray[Any],
    corner: tuple[int, int],
    period: int,
    rows: Places,
    columns: Places,
    level: np.float32,
    down: Images,
    across: Images,
    out: Images,
) -> None:
    """One pixel of all patterns of a mosaic (h, w) as an image `out`, off its level and times a separable window.

    Parameters
    ----------
    corner : (int, int)
        Row and column of the pixel in its pattern.
    rows, columns : ndarray of int
        Patterns that the rows and columns of `out` show.
    down, across : ndarray of float32
        The window along both.
    """
    row, column = corner
    for y in range(rows.size):
        line, weight = values[row + period * rows[y]], down[y]
        for x in range(columns.size):
            out[y, x] = (line[column + period * columns[x]] - level) * (weight * across[x])
