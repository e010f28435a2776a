"""Compiled passes over rows: misfit and gradient where what the pane does is another thing in every pixel."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from polaropt.misfit_kernels import Ghosts, read_shifted, spread_row
from polaropt.whitening_kernels import residual_row
from solvers.compiled import compiled

Array = NDArray[Any]


@compiled
def _mixed_row(layers: Array, mixtures: Array, c: int, y: int, top: int, left: int, entries: Array) -> None:
    """Entries (entry, w) of row y of the frame from layers on the canvas."""
    width = entries.shape[1]
    t, r = layers[0, c, top + y, left : left + width], layers[1, c, top + y, left : left + width]
    for e in range(entries.shape[0]):
        out, of_t, of_r = entries[e], mixtures[e, 0, y], mixtures[e, 1, y]
        for x in range(width):
            out[x] = of_t[x] * t[x] + of_r[x] * r[x]


@compiled
def varying_residuals(
    layers: Array,
    top: int,
    left: int,
    mixtures: Array,
    roots: Array,
    kinds: Array,
    data: Array,
    weight: Any,
    slopes: Array,
    gradient: Array,
    start: int,
    stop: int,
) -> Any:
    """Half the sum of squared residuals of rows start..stop; weight times its gradient goes into `gradient`.

    Shapes: layers and gradient (2, channel, H, W), mixtures (entry, 2, h, w), slopes (entry, channel, h, w); the
    others as in `whitening_kernels`.
    """
    n, colors, _, width = data.shape
    entries, residual = np.empty((n, width), np.float32), np.empty((n, width), np.float32)
    total: Any = 0.0
    for y in range(start, stop):
        for c in range(colors):
            _mixed_row(layers, mixtures, c, y, top, left, entries)
            total += residual_row(entries, roots, kinds, data, weight, c, y, residual, slopes)
            for i in range(2):
                out = gradient[i, c, top + y, left : left + width]
                for x in range(width):
                    out[x] = 0
                for e in range(n):
                    slope, of_layer = slopes[e, c, y], mixtures[e, i, y]
                    for x in range(width):
                        out[x] += of_layer[x] * slope[x]
    return total


@compiled
def _add_product(weights: Array, source: Array, out: Array) -> None:
    for x in range(out.size):
        out[x] += weights[x] * source[x]


@compiled
def varying_ghost_residuals(
    layers: Array,
    top: int,
    left: int,
    ghosts: Ghosts,
    mixtures: Array,
    roots: Array,
    kinds: Array,
    data: Array,
    weight: Any,
    slopes: Array,
    start: int,
    stop: int,
) -> Any:
    """Half the sum of squared residuals of rows start..stop; weight times its slope by the entries goes into slopes.

    Shapes: mixtures (entry, 2, ghost, h, w); the ghosts' taps say whether a layer has a part in one; the others as for
    `varying_residuals`.
    """
    n, colors, _, width = data.shape
    entries, residual = np.empty((n, width), np.float32), np.empty((n, width), np.float32)
    scratch = np.empty((3, width + 1), np.float32)
    shifted = scratch[2, :width]
    total: Any = 0.0
    for y in range(start, stop):
        for c in range(colors):
            entries[:] = 0
            for k in range(ghosts.taps.shape[1]):
                for i in range(2):
                    if not ghosts.shown[i, k]:
                        continue
                    read_shifted(layers[i, c], top + y, left, ghosts.whole[k], ghosts.fraction[k], scratch, shifted)
                    for e in range(n):
                        _add_product(mixtures[e, i, k, y], shifted, entries[e])
            total += residual_row(entries, roots, kinds, data, weight, c, y, residual, slopes)
    return total


@compiled
def varying_ghost_spread(
    slopes: Array, top: int, left: int, ghosts: Ghosts, mixtures: Array, gradient: Array, start: int, stop: int
) -> None:
    """Bring slopes by the entries (entry, channel, h, w) back to the layers.

    Planes start..stop of gradient (2, channel, H, W), counted through both layers, are overwritten.
    """
    n, colors, height, width = slopes.shape
    mixed, samples = np.empty(width, np.float32), np.empty(width + 1, np.float32)
    for which in range(start, stop):
        i, c = which // colors, which % colors
        plane = gradient[i, c]
        plane[:] = 0
        for y in range(height):
            for k in range(ghosts.taps.shape[1]):
                if not ghosts.shown[i, k]:
                    continue
                mixed[:] = 0
                for e in range(n):
                    _add_product(mixtures[e, i, k, y], slopes[e, c, y], mixed)
                spread_row(mixed, top + y, left, ghosts.whole[k], ghosts.fraction[k], samples, plane)
