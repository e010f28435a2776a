"""Compiled pass over rows: a table over three coordinates, interpolated in every pixel."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from solvers.ahead import Call
from solvers.kernels import compiled

Array = NDArray[Any]


@compiled
def _corner(position: Any, n: int) -> Any:
    """Index below a position, at most n - 2, and the fraction above it; positions beyond the table are moved in."""
    inside = min(max(position, np.float32(0)), np.float32(n - 1))
    lower = max(min(int(inside), n - 2), 0)
    return lower, inside - np.float32(lower)


@compiled
def interpolated(table: Array, positions: Array, out: Array, start: int, stop: int) -> None:
    """Rows start..stop of out (value, h, w): a table (n0, n1, n2, value) at positions (3, h, w), linear between."""
    n0, n1, n2, n_values = table.shape
    one = np.float32(1)
    for y in range(start, stop):
        for x in range(out.shape[2]):
            i, a = _corner(positions[0, y, x], n0)
            j, b = _corner(positions[1, y, x], n1)
            k, c = _corner(positions[2, y, x], n2)
            i_next = min(i + 1, n0 - 1)
            for v in range(n_values):
                low = (one - b) * ((one - c) * table[i, j, k, v] + c * table[i, j, k + 1, v]) + b * (
                    (one - c) * table[i, j + 1, k, v] + c * table[i, j + 1, k + 1, v]
                )
                high = low
                if a > 0:
                    high = (one - b) * ((one - c) * table[i_next, j, k, v] + c * table[i_next, j, k + 1, v]) + b * (
                        (one - c) * table[i_next, j + 1, k, v] + c * table[i_next, j + 1, k + 1, v]
                    )
                out[v, y, x] = low + a * (high - low)


def first_calls() -> list[Call]:
    """Calls on next to nothing of the kernels that every separation needs, for `solvers.ahead`."""
    planes = np.zeros((3, 1, 1), np.float32)
    return [(interpolated, (np.zeros((1, 1, 1, 1), np.float32), planes, planes.copy(), 0, 0))]
