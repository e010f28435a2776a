"""Large images in overlapping tiles, so that memory stays bounded and priors fit what they are applied to."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

# An image with no longer side is solved in one piece.
LARGEST_TILE = 800
_OVERLAP = 64


@dataclass(frozen=True)
class Tile:
    """A part of a frame.

    Attributes
    ----------
    rows, columns : slice
    weights : ndarray of float32, shape (rows, columns)
        Falling linearly where neighbours overlap; over all tiles they add up to 1 in every pixel.
    """

    rows: slice
    columns: slice
    weights: NDArray[np.float32]

    @property
    def where(self) -> tuple[slice, slice]:
        """Rows and columns."""
        return self.rows, self.columns


def tiles(height: int, width: int, largest: int = LARGEST_TILE) -> list[Tile]:
    """Tiles of a frame, none with a side longer than `largest` pixels.

    Parameters
    ----------
    height, width : int
    largest : int
        More than twice the overlap of 64 px.
    """
    return [
        Tile(rows, columns, np.outer(down, across))
        for rows, down in _parts(height, largest)
        for columns, across in _parts(width, largest)
    ]


def _parts(length: int, largest: int) -> Iterator[tuple[slice, NDArray[np.float32]]]:
    """Equal parts of a side with their weights."""
    n = max(1, math.ceil((length - _OVERLAP) / (largest - _OVERLAP)))
    inner = (length - _OVERLAP) / n
    ramp = (np.arange(_OVERLAP, dtype=np.float32) + np.float32(0.5)) / _OVERLAP
    for i in range(n):
        start, stop = round(i * inner), round((i + 1) * inner) + _OVERLAP
        weights = np.ones(stop - start, dtype=np.float32)
        if i > 0:
            weights[:_OVERLAP] = ramp
        if i < n - 1:
            weights[-_OVERLAP:] = ramp[::-1]
        yield slice(start, min(stop, length)), weights[: length - start]
