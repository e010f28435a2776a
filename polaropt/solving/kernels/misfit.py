"""Compiled passes over rows: from layers to whitened residuals of the plate's entries, and back.

Shapes: roots (kind, entry, entry), kinds (channel, h, w) or empty where all pixels are of one kind, data (entry,
channel, h, w).
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from solvers.ahead import Call
from solvers.kernels import compiled

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


class Ghosts(NamedTuple):
    """What the pane does to the layers: weights (2, ghost, entry), whole and fractional shifts (ghost, 2) in pixels.

    `shown` (2, ghost) says whether a layer has a part in a ghost at all.
    """

    taps: Array
    whole: Array
    fraction: Array
    shown: Array


@compiled
def _continued_row(plane: Array, y: int, first: int, out: Array) -> None:
    """Samples first, first + 1, ... of row y, continued by the edge values."""
    height, width = plane.shape
    row = plane[min(max(y, 0), height - 1)]
    begin, end = min(max(-first, 0), out.size), max(min(width - first, out.size), 0)
    if end > begin:
        inside, source = out[begin:end], row[first + begin : first + end]
        for x in range(inside.size):
            inside[x] = source[x]
    for x in range(begin):
        out[x] = row[0]
    for x in range(max(end, begin), out.size):
        out[x] = row[width - 1]


@compiled
def _moves(whole: Array, fraction: Array) -> bool:
    return bool(whole[0] != 0 or whole[1] != 0 or fraction[0] != 0 or fraction[1] != 0)


@compiled
def _shifted_row(
    plane: Array, y: int, left: int, whole: Array, fraction: Array, padded: Array, other: Array, out: Array
) -> None:
    """Row y from column left on of a plane shifted by whole + fraction (columns, rows), bilinear."""
    first = left - whole[0] - 1
    _continued_row(plane, y - whole[1], first, padded)
    if fraction[1] != 0:
        _continued_row(plane, y - whole[1] - 1, first, other)
        for x in range(padded.size):
            padded[x] += fraction[1] * (other[x] - padded[x])
    before, at = padded[:-1], padded[1:]
    for x in range(out.size):
        out[x] = at[x] + fraction[0] * (before[x] - at[x])


@compiled
def _within(first: int, n: int, y: int, height: int, width: int) -> bool:
    """Whether n samples from column first on, in rows y - 1 and y, lie on the canvas."""
    return first >= 0 and first + n <= width and 1 <= y < height


@compiled
def _interpolate(above: Array, row: Array, fraction: Array, out: Array) -> None:
    """Bilinear shift by a fraction to the right and down: n samples from n + 1 of a row and of the one above."""
    across, down = fraction[0], fraction[1]
    at, at_above = row[1:], above[1:]
    for x in range(out.size):
        before = row[x] + down * (above[x] - row[x])
        here = at[x] + down * (at_above[x] - at[x])
        out[x] = here + across * (before - here)


@compiled
def _add_to_both(source: Array, first: Any, second: Any, out: Array, other: Array) -> None:
    for x in range(out.size):
        out[x] += first * source[x]
        other[x] += second * source[x]


@compiled
def _add_to_entries(source: Array, taps: Array, entries: Array) -> None:
    if taps.size == 2:
        _add_to_both(source, taps[0], taps[1], entries[0], entries[1])
    else:
        for e in range(taps.size):
            add_scaled(source, taps[e], entries[e])


@compiled
def read_shifted(plane: Array, y: int, left: int, whole: Array, fraction: Array, scratch: Array, out: Array) -> None:
    """Row y from column left on of a plane shifted by whole + fraction, with scratch (2, more than out's size)."""
    width = out.size
    first, row = left - whole[0] - 1, y - whole[1]
    if not _moves(whole, fraction):
        source = plane[y, left : left + width]
        for x in range(width):
            out[x] = source[x]
    elif _within(first, width + 1, row, plane.shape[0], plane.shape[1]):
        _interpolate(plane[row - 1, first : first + width + 1], plane[row, first : first + width + 1], fraction, out)
    else:
        _shifted_row(plane, y, left, whole, fraction, scratch[0, : width + 1], scratch[1, : width + 1], out)


@compiled
def _entries_row(layers: Array, c: int, y: int, left: int, ghosts: Ghosts, entries: Array, scratch: Array) -> None:
    """One row of the plate's entries (entry, w), all ghosts of both layers; `read_shifted` written out for speed."""
    width = entries.shape[1]
    padded, other, shifted = scratch[0, : width + 1], scratch[1, : width + 1], scratch[2, :width]
    entries[:] = 0
    for k in range(ghosts.taps.shape[1]):
        whole, fraction = ghosts.whole[k], ghosts.fraction[k]
        first, row = left - whole[0] - 1, y - whole[1]
        inside = _within(first, width + 1, row, layers.shape[2], layers.shape[3])
        for i in range(2):
            if not ghosts.shown[i, k]:
                continue
            source = shifted
            if not _moves(whole, fraction):
                source = layers[i, c, y, left : left + width]
            elif inside:
                above, at = (
                    layers[i, c, row - 1, first : first + width + 1],
                    layers[i, c, row, first : first + width + 1],
                )
                _interpolate(above, at, fraction, shifted)
            else:
                _shifted_row(layers[i, c], y, left, whole, fraction, padded, other, shifted)
            _add_to_entries(source, ghosts.taps[i, k], entries)


@compiled
def residuals(
    layers: Array,
    top: int,
    left: int,
    ghosts: Ghosts,
    roots: Array,
    kinds: Array,
    data: Array,
    weight: Any,
    out: Array,
    start: int,
    stop: int,
) -> Any:
    """Half the sum of squared residuals of rows start..stop; weight times its slope by the entries goes into out.

    Shapes: layers (2, channel, H, W), roots (kind, entry, entry), kinds (channel, h, w) or empty where all pixels are
    of one kind, data and out (entry, channel, h, w).
    """
    n, colors, _, width = data.shape
    entries, residual = np.empty((n, width), np.float32), np.empty((n, width), np.float32)
    scratch = np.empty((3, width + 1), np.float32)
    total: Any = 0.0
    for y in range(start, stop):
        for c in range(colors):
            _entries_row(layers, c, top + y, left, ghosts, entries, scratch)
            total += residual_row(entries, roots, kinds, data, weight, c, y, residual, out)
    return total


@compiled
def _add_continued_row(samples: Array, factor: Any, y: int, first: int, plane: Array) -> None:
    """Transpose of `_continued_row`, times factor."""
    height, width = plane.shape
    row = plane[min(max(y, 0), height - 1)]
    begin, end = min(max(-first, 0), samples.size), max(min(width - first, samples.size), 0)
    if end > begin:
        add_scaled(samples[begin:end], factor, row[first + begin : first + end])
    for x in range(begin):
        row[0] += factor * samples[x]
    for x in range(max(end, begin), samples.size):
        row[width - 1] += factor * samples[x]


@compiled
def _add_shifted_row(
    row: Array, y: int, left: int, whole: Array, fraction: Array, samples: Array, plane: Array
) -> None:
    """Transpose of `_shifted_row`."""
    one = np.float32(1)
    samples[0] = 0
    at, before = samples[1:], samples[:-1]
    for x in range(row.size):
        at[x] = (one - fraction[0]) * row[x]
    add_scaled(row, fraction[0], before)
    first = left - whole[0] - 1
    _add_continued_row(samples, one - fraction[1], y - whole[1], first, plane)
    if fraction[1] != 0:
        _add_continued_row(samples, fraction[1], y - whole[1] - 1, first, plane)


@compiled
def _interpolate_transposed(row: Array, fraction: Array, above: Array, at: Array) -> None:
    """Transpose of `_interpolate`: adds n samples to n + 1 of a row and of the one above."""
    n, one = row.size, np.float32(1)
    across, down = fraction[0], fraction[1]
    up, here = down, one - down
    above[0] += up * across * row[0]
    at[0] += here * across * row[0]
    above[n] += up * (one - across) * row[n - 1]
    at[n] += here * (one - across) * row[n - 1]
    later, inner_above, inner = row[1:], above[1:n], at[1:n]
    for x in range(n - 1):
        mixed = row[x] + across * (later[x] - row[x])
        inner_above[x] += up * mixed
        inner[x] += here * mixed


@compiled
def _mix(slopes: Array, c: int, y: int, taps: Array, out: Array) -> None:
    """Sum of the entries' slopes in row y, weighted by taps."""
    first, second, t0, t1 = slopes[0, c, y], slopes[1, c, y], taps[0], taps[1]
    for x in range(out.size):
        out[x] = t0 * first[x] + t1 * second[x]
    for e in range(2, taps.size):
        add_scaled(slopes[e, c, y], taps[e], out)


@compiled
def spread_row(row: Array, y: int, left: int, whole: Array, fraction: Array, samples: Array, plane: Array) -> None:
    """Transpose of `read_shifted`: add a row to a plane, with scratch for one sample more."""
    width = row.size
    first, at = left - whole[0] - 1, y - whole[1]
    if not _moves(whole, fraction):
        add_scaled(row, np.float32(1), plane[y, left : left + width])
    elif _within(first, width + 1, at, plane.shape[0], plane.shape[1]):
        here = slice(first, first + width + 1)
        _interpolate_transposed(row, fraction, plane[at - 1, here], plane[at, here])
    else:
        _add_shifted_row(row, y, left, whole, fraction, samples, plane)


@compiled
def spread(slopes: Array, top: int, left: int, ghosts: Ghosts, gradient: Array, start: int, stop: int) -> None:
    """Bring slopes by the entries (entry, channel, h, w) back to the layers; `spread_row` written out for speed.

    Planes start..stop of gradient (2, channel, H, W), counted through both layers, are overwritten.
    """
    colors, height, width = slopes.shape[1], slopes.shape[2], slopes.shape[3]
    mixed, samples = np.empty(width, np.float32), np.empty(width + 1, np.float32)
    for which in range(start, stop):
        i, c = which // colors, which % colors
        plane = gradient[i, c]
        plane[:] = 0
        for y in range(top, top + height):
            for k in range(ghosts.taps.shape[1]):
                if not ghosts.shown[i, k]:
                    continue
                whole, fraction = ghosts.whole[k], ghosts.fraction[k]
                _mix(slopes, c, y - top, ghosts.taps[i, k], mixed)
                first, row = left - whole[0] - 1, y - whole[1]
                if not _moves(whole, fraction):
                    add_scaled(mixed, np.float32(1), plane[y, left : left + width])
                elif _within(first, width + 1, row, plane.shape[0], plane.shape[1]):
                    above, at = plane[row - 1, first : first + width + 1], plane[row, first : first + width + 1]
                    _interpolate_transposed(mixed, fraction, above, at)
                else:
                    _add_shifted_row(mixed, y, left, whole, fraction, samples, plane)


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


def first_calls() -> list[Call]:
    """Calls on next to nothing of the kernels that every separation needs, for `solvers.ahead`."""
    one, row = np.float32(1), np.zeros((1, 1, 1, 1), np.float32)
    layers, shifts = np.zeros((2, 1, 1, 1), np.float32), np.zeros((1, 2), np.float32)
    ghosts = Ghosts(np.zeros((2, 1, 1), np.float32), shifts.astype(np.int64), shifts, np.zeros((2, 1), np.bool_))
    photographs = (np.zeros((1, 1, 1), np.float32), np.zeros((0, 0, 0), np.uint16), row, one, row.copy())
    return [
        (residuals, (layers, 0, 0, ghosts, *photographs, 0, 0)),
        (spread, (row, 0, 0, ghosts, layers.copy(), 0, 0)),
    ]
