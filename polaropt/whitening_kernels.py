"""Compiled steps on one row: residuals of a pixel's entries in units of the noise, and their slope.

Shapes: roots (kind, entry, entry), kinds (channel, h, w) or empty where all pixels are of one kind, data (entry,
channel, h, w). Other files' kernels build on these: clear their caches (``__pycache__``) after a change here.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from solvers.compiled import compiled

Array = NDArray[Any]


@compiled
def add_scaled(source: Array, factor: Any, out: Array) -> None:
    for x in range(out.size):
        out[x] += factor * source[x]


@compiled
def _whiten_row(entries: Array, root: Array, data: Array, c: int, y: int, residual: Array) -> None:
    """Residual root entries - data of one row, (entry, w), for pixels of one kind."""
    for e in range(root.shape[0]):
        out, target, first, entry = residual[e], data[e, c, y], root[e, 0], entries[0]
        for x in range(out.size):
            out[x] = first * entry[x] - target[x]
        for f in range(1, root.shape[0]):
            add_scaled(entries[f], root[e, f], out)


@compiled
def _whiten_row_of_kinds(
    entries: Array, roots: Array, kinds: Array, data: Array, c: int, y: int, residual: Array
) -> None:
    for x in range(kinds.size):
        root = roots[kinds[x]]
        for e in range(root.shape[0]):
            total = -data[e, c, y, x]
            for f in range(root.shape[0]):
                total += root[e, f] * entries[f, x]
            residual[e, x] = total


@compiled
def _unwhiten_row(residual: Array, root: Array, weight: Any, out: Array, c: int, y: int) -> None:
    """Derivative by the entries: weight times root residual; the root is symmetric."""
    for e in range(root.shape[0]):
        target, first, source = out[e, c, y], weight * root[e, 0], residual[0]
        for x in range(target.size):
            target[x] = first * source[x]
        for f in range(1, root.shape[0]):
            add_scaled(residual[f], weight * root[e, f], target)


@compiled
def _unwhiten_row_of_kinds(
    residual: Array, roots: Array, kinds: Array, weight: Any, out: Array, c: int, y: int
) -> None:
    for x in range(kinds.size):
        root = roots[kinds[x]]
        for e in range(root.shape[0]):
            total = np.float32(0)
            for f in range(root.shape[0]):
                total += root[e, f] * residual[f, x]
            out[e, c, y, x] = weight * total


@compiled
def _half_squares(residual: Array) -> Any:
    total: Any = 0.0
    for e in range(residual.shape[0]):
        row, in_row = residual[e], np.float32(0)
        for x in range(row.size):
            in_row += row[x] * row[x]
        total += in_row
    return 0.5 * total


@compiled
def residual_row(
    entries: Array,
    roots: Array,
    kinds: Array,
    data: Array,
    weight: Any,
    c: int,
    y: int,
    residual: Array,
    out: Array,
) -> Any:
    """Half the sum of squared residuals of a row of entries (entry, w); weight times its slope goes into out."""
    if kinds.size == 0:
        _whiten_row(entries, roots[0], data, c, y, residual)
        _unwhiten_row(residual, roots[0], weight, out, c, y)
    else:
        _whiten_row_of_kinds(entries, roots, kinds[c, y], data, c, y, residual)
        _unwhiten_row_of_kinds(residual, roots, kinds[c, y], weight, out, c, y)
    return _half_squares(residual)
