"""Compiled passes over rows: the local penalties on the layers and their gradient within the frame.

Values and gradients are those of `priors.gradient_sparsity`, `priors.edge_independence` and `priors.nonnegativity`. A
pass over some rows needs the pass before it over all rows.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from solvers.ahead import Call
from solvers.kernels import compiled

Array = NDArray[Any]


class Frame(NamedTuple):
    """Where the frame lies within the canvas."""

    top: int
    left: int
    height: int
    width: int


def _polynomial(function: Callable[[Array], Array], degree: int, start: float, stop: float) -> tuple[np.float32, ...]:
    series = np.polynomial.Chebyshev.interpolate(function, degree, (start, stop))
    return tuple(np.float32(c) for c in series.convert(kind=np.polynomial.Polynomial).coef)


# To the accuracy of float32. Unlike the library's functions they run in vectors.
_LOG2 = _polynomial(np.log2, 8, 1, 2)
_EXP2 = _polynomial(np.exp2, 6, 0, 1)


@compiled
def raise_to_power(base: Array, exponent: Any, out: Array) -> None:
    """out = base ** exponent for float32 that are positive and normal."""
    fraction = np.empty(base.size, np.float32)
    bits, fraction_bits, out_bits = base.view(np.int32), fraction.view(np.int32), out.view(np.int32)
    for x in range(base.size):
        fraction_bits[x] = (bits[x] & 0x7FFFFF) | 0x3F800000
    for x in range(base.size):
        m, log = fraction[x], _LOG2[8]
        log = log * m + _LOG2[7]
        log = log * m + _LOG2[6]
        log = log * m + _LOG2[5]
        log = log * m + _LOG2[4]
        log = log * m + _LOG2[3]
        log = log * m + _LOG2[2]
        log = log * m + _LOG2[1]
        log = log * m + _LOG2[0]
        t = exponent * (np.float32((bits[x] >> 23) - 127) + log)
        whole = np.floor(t)
        f, power = t - whole, _EXP2[6]
        power = power * f + _EXP2[5]
        power = power * f + _EXP2[4]
        power = power * f + _EXP2[3]
        power = power * f + _EXP2[2]
        power = power * f + _EXP2[1]
        power = power * f + _EXP2[0]
        fraction[x] = power
        out_bits[x] = (np.int32(whole) + 127) << 23
    for x in range(base.size):
        out[x] *= fraction[x]


@compiled
def _row(layers: Array, i: int, c: int, frame: Frame, y: int) -> Array:
    """Row y of the frame; the last one stands for those below it."""
    row: Array = layers[i, c, frame.top + min(y, frame.height - 1), frame.left : frame.left + frame.width]
    return row


@compiled
def _differ(row: Array, below: Array, dx: Array, dy: Array, sums: Array, anew: bool) -> None:
    """Differences of a row to the right and down, which are added to sums (2, w) or begin them."""
    # Loops that write one array each: more of them in one do not vectorize.
    for x in range(row.size - 1):
        dx[x] = row[x + 1] - row[x]
    dx[row.size - 1] = 0
    for x in range(row.size):
        dy[x] = below[x] - row[x]
    _accumulate(dx, sums[0], anew)
    _accumulate(dy, sums[1], anew)


@compiled
def _accumulate(source: Array, total: Array, anew: bool) -> None:
    if anew:
        for x in range(total.size):
            total[x] = source[x]
    else:
        for x in range(total.size):
            total[x] += source[x]


@compiled
def energies(layers: Array, frame: Frame, chroma: Any, energy: Array, start: int, stop: int) -> None:
    """Gradient energy of rows start..stop of the frame, all colours together, into energy (2, h, w)."""
    colors = layers.shape[1]
    excess = (chroma - np.float32(1)) / np.float32(colors)
    scratch, sums = np.zeros((2, frame.width), np.float32), np.zeros((2, frame.width), np.float32)
    dx, dy, sum_x, sum_y = scratch[0], scratch[1], sums[0], sums[1]
    for i in range(2):
        for y in range(start, stop):
            q = energy[i, y]
            for c in range(colors):
                _differ(_row(layers, i, c, frame, y), _row(layers, i, c, frame, y + 1), dx, dy, sums, c == 0)
                if c == 0:
                    for x in range(q.size):
                        q[x] = 0
                for x in range(q.size):
                    q[x] += chroma * (dx[x] * dx[x] + dy[x] * dy[x])
            for x in range(q.size):
                q[x] -= excess * (sum_x[x] * sum_x[x] + sum_y[x] * sum_y[x])


@compiled
def _pooled_row(plane: Array, y: int, rows: Array, out: Array) -> None:
    """Mean over 3x3 pixels of row y, nothing beyond the frame."""
    height, width = plane.shape
    row, above, below = plane[y], plane[max(y - 1, 0)], plane[min(y + 1, height - 1)]
    with_above, with_below = np.float32(y > 0), np.float32(y < height - 1)
    for x in range(width):
        rows[x] = row[x] + with_above * above[x] + with_below * below[x]
    ninth = np.float32(1 / 9)
    for x in range(width - 2):
        out[x + 1] = ninth * (rows[x] + rows[x + 1] + rows[x + 2])
    out[0] = ninth * (rows[0] + (rows[1] if width > 1 else np.float32(0)))
    if width > 1:
        out[width - 1] = ninth * (rows[width - 2] + rows[width - 1])


@compiled
def sparsity(
    energy: Array,
    floor: Array,
    factor: Array,
    exponent: float,
    weight: float,
    slope: Array,
    start: int,
    stop: int,
) -> Any:
    """Sum of factor ((pooled energy + floor)^(exponent/2) - floor^(exponent/2)) over rows start..stop.

    Weight times its derivative by the pooled energy goes into slope (2, h, w); floor and factor (2,).
    """
    scratch = np.empty((2, energy.shape[2]), np.float32)
    rows, pooled = scratch[0], scratch[1]
    total: Any = 0.0
    for i in range(2):
        least, offset = floor[i] ** (exponent / 2), np.float32(floor[i])
        derivative = np.float32(weight * factor[i] * exponent / 2)
        for y in range(start, stop):
            out = slope[i, y]
            _pooled_row(energy[i], y, rows, pooled)
            for x in range(out.size):
                pooled[x] += offset
            raise_to_power(pooled, np.float32(exponent / 2), out)
            in_row = np.float32(0)
            for x in range(out.size):
                in_row += out[x]
                out[x] = derivative * out[x] / pooled[x]
            total += factor[i] * (in_row - out.size * least)
    return total


@compiled
def independence(energy: Array, typical: Array, start: int, stop: int) -> Any:
    """Sum over rows start..stop of the product of both layers' normalized energies q / (q + typical)."""
    t0, t1 = np.float32(typical[0]), np.float32(typical[1])
    total: Any = 0.0
    for y in range(start, stop):
        first, second = energy[0, y], energy[1, y]
        in_row = np.float32(0)
        for x in range(first.size):
            in_row += (first[x] / (first[x] + t0)) * (second[x] / (second[x] + t1))
        total += in_row
    return total


@compiled
def _add_independence(energy: Array, y: int, typical: Array, strength: float, twice: Array) -> None:
    """Add twice the derivative of strength times `independence` by the energies of row y to twice (2, w)."""
    one, t0, t1 = np.float32(1), np.float32(typical[0]), np.float32(typical[1])
    s0, s1 = np.float32(2 * strength / typical[0]), np.float32(2 * strength / typical[1])
    first, second, out0, out1 = energy[0, y], energy[1, y], twice[0], twice[1]
    for x in range(first.size):
        w0, w1 = t0 / (first[x] + t0), t1 / (second[x] + t1)
        out0[x] += s0 * w0 * w0 * (one - w1)
        out1[x] += s1 * w1 * w1 * (one - w0)


@compiled
def _flows(difference: Array, total: Array, slope: Array, chroma: Any, excess: Any, out: Array) -> None:
    """Slope times half the derivative of the energy by one colour's differences."""
    for x in range(out.size):
        out[x] = slope[x] * (chroma * difference[x] - excess * total[x])


@compiled
def _add_divergence(across: Array, down: Array, from_above: Array, out: Array) -> None:
    out[0] += from_above[0] - down[0] - across[0]
    inner, before, here, below, above = out[1:], across[:-1], across[1:], down[1:], from_above[1:]
    for x in range(inner.size):
        inner[x] += (above[x] - below[x]) + (before[x] - here[x])


@compiled
def _twice_slopes(energy: Array, slope: Array, y: int, typical: Array, shared: float, rows: Array, out: Array) -> None:
    """Twice the derivative of all penalties on edges by the energies of row y, into out (2, w)."""
    for i in range(2):
        s = out[i]
        _pooled_row(slope[i], y, rows, s)
        for x in range(s.size):
            s[x] += s[x]
    if shared != 0:
        _add_independence(energy, y, typical, shared, out)


@compiled
def add_gradient(
    layers: Array,
    frame: Frame,
    chroma: Any,
    energy: Array,
    slope: Array,
    typical: Array,
    shared: float,
    gradient: Array,
    start: int,
    stop: int,
) -> None:
    """Add the gradient of sparsity and of `shared` times the independence in rows start..stop of the frame."""
    colors, width = layers.shape[1], frame.width
    excess = (chroma - np.float32(1)) / np.float32(colors)
    rows, twice, across = np.empty(width, np.float32), np.empty((2, width), np.float32), np.empty(width, np.float32)
    differences, sums = np.empty((colors, 2, width), np.float32), np.zeros((2, width), np.float32)
    # Of two rows in turn: what flows down out of a row flows into the next.
    down = np.zeros((2, 2, colors, width), np.float32)
    for y in range(max(start - 1, 0), stop):
        _twice_slopes(energy, slope, y, typical, shared, rows, twice)
        for i in range(2):
            for c in range(colors):
                row, below = _row(layers, i, c, frame, y), _row(layers, i, c, frame, y + 1)
                _differ(row, below, differences[c, 0], differences[c, 1], sums, c == 0)
            for c in range(colors):
                flow, from_above = down[y % 2, i, c], down[1 - y % 2, i, c]
                _flows(differences[c, 1], sums[1], twice[i], chroma, excess, flow)
                if y >= start:
                    _flows(differences[c, 0], sums[0], twice[i], chroma, excess, across)
                    out = gradient[i, c, frame.top + y, frame.left : frame.left + width]
                    _add_divergence(across, flow, from_above, out)


@compiled
def add_negativity(
    layers: Array, frame: Frame, strength: Array, weight: float, gradient: Array, start: int, stop: int
) -> Any:
    """Half of strength (2,) times the squares below zero in rows start..stop; adds weight times the gradient."""
    total: Any = 0.0
    for i in range(2):
        factor = np.float32(weight * strength[i])
        for c in range(layers.shape[1]):
            for y in range(start, stop):
                row = _row(layers, i, c, frame, y)
                out = gradient[i, c, frame.top + y, frame.left : frame.left + frame.width]
                in_row = np.float32(0)
                for x in range(row.size):
                    below = row[x] if row[x] < 0 else np.float32(0)
                    in_row += below * below
                    out[x] += factor * below
                total += 0.5 * strength[i] * in_row
    return total


def first_calls() -> list[Call]:
    """Calls on next to nothing of the kernels that every separation needs, for `solvers.ahead`."""
    one, frame = np.float32(1), Frame(0, 0, 1, 1)
    layers, energy = np.zeros((2, 1, 1, 1), np.float32), np.zeros((2, 1, 1), np.float32)
    slope, gradient, factors = energy.copy(), layers.copy(), np.ones(2)
    return [
        (add_gradient, (layers, frame, one, energy, slope, factors, 0.0, gradient, 0, 0)),
        (sparsity, (energy, factors, factors, 1.0, 1.0, slope, 0, 0)),
        (energies, (layers, frame, one, energy, 0, 0)),
        (add_negativity, (layers, frame, factors, 1.0, gradient, 0, 0)),
        (independence, (energy, factors, 0, 0)),
    ]
