"""Compiled likelihood of a capture's tiles: the powers of both layers in each cell of frequencies, fitted."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from solvers.ahead import Call
from solvers.kernels import compiled

Array = NDArray[Any]

LOG_OF = 4
"""How many numbers are multiplied for one logarithm, which takes as long as twenty products. Each lies between 1e-38
and 1e38, so that none of the products overflows. Set by hand."""


@compiled
def add_logs(values: Array, first: int, last: int, multiplicity: Array, totals: Array) -> None:
    """Sum of logarithms of values (n, tile) of frequencies first..last, each as often as it counts, added to `totals`.

    Of some that count alike the product's logarithm is taken.
    """
    products, taken = np.ones(totals.size), 0
    for f in range(first, last):
        value, m = values[f - first], multiplicity[f]
        for t in range(totals.size):
            products[t] *= value[t]
        taken += 1
        if taken == LOG_OF or f + 1 == last or multiplicity[f + 1] != m:
            for t in range(totals.size):
                totals[t] += m * np.log(products[t])
                products[t] = 1.0
            taken = 0


@compiled
def step_powers(ps: Array, qs: Array, sums: Array, least: Any) -> None:
    """A multiplicative step of both layers' powers (tile,), by what speaks for more of each and for less, (4, tile)."""
    for t in range(ps.size):
        ps[t] *= max(sums[0, t] / sums[2, t], least)
        qs[t] *= max(sums[1, t] / sums[3, t], least)


@compiled
def tile_misfits(
    response: Array,
    noise: Array,
    data: Array,
    multiplicity: Array,
    natural: Array,
    cells: Array,
    freedom: Any,
    least: Any,
    rounds: int,
    powers: Array,
    out: Array,
    start: int,
    stop: int,
) -> None:
    """Minus log likelihood of tiles start..stop into `out`, their powers (2, cell, tile), reflection first, fitted.

    Hermitian matrices are par, perp, and the real and imaginary part of cross. Shapes: response (2, 4, n), what the
    pane makes of the transmission and of the reflection of power 1; noise (3, cell, tile), without an imaginary part;
    data (4, n, tile); multiplicity, natural (n,), how often a frequency counts, and the power of natural images there;
    cells (cell + 1,), where the frequencies of each begin. `freedom` is that of Student's likelihood, `least` the
    factor by which a power shrinks at most.
    """
    two, half, zero, one = np.float32(2), np.float32(0.5), np.float32(0), np.float32(1)
    n, tiny = multiplicity.size, np.float32(2e-6)
    # Trace of the adjugate of one matrix times the other: reflection a, transmission b.
    aa, bb, ab = np.empty(n, np.float32), np.empty(n, np.float32), np.empty(n, np.float32)
    a, b = np.empty((4, n), np.float32), np.empty((4, n), np.float32)
    for f in range(n):
        for i in range(4):
            a[i, f], b[i, f] = response[1, i, f] * natural[f], response[0, i, f] * natural[f]
        a0, a1, a2, a3 = a[0, f], a[1, f], a[2, f], a[3, f]
        b0, b1, b2, b3 = b[0, f], b[1, f], b[2, f], b[3, f]
        aa[f] = max(two * (a0 * a1 - a2 * a2 - a3 * a3), tiny * a0 * a1)
        bb[f] = max(two * (b0 * b1 - b2 * b2 - b3 * b3), tiny * b0 * b1)
        ab[f] = max(a0 * b1 + a1 * b0 - two * (a2 * b2 + a3 * b3), zero)
    most = 0
    for cell in range(cells.size - 1):
        most = max(most, cells[cell + 1] - cells[cell])
    # All tiles side by side, in arrays that begin with the first: so the loops over them vectorize.
    count = stop - start
    ps, qs, totals = np.empty(count, np.float32), np.empty(count, np.float32), np.zeros((2, count))
    n0s, n1s, n2s = np.empty(count, np.float32), np.empty(count, np.float32), np.empty(count, np.float32)
    nns = np.empty(count, np.float32)
    of_data, sums = np.empty((most, 3, count), np.float32), np.empty((4, count), np.float32)
    volumes, distances = np.empty((most, count), np.float32), np.empty((most, count), np.float32)
    for cell in range(cells.size - 1):
        first, last = cells[cell], cells[cell + 1]
        for t in range(count):
            ps[t], qs[t] = powers[0, cell, start + t], powers[1, cell, start + t]
            n0, n1, n2 = noise[0, cell, start + t], noise[1, cell, start + t], noise[2, cell, start + t]
            n0s[t], n1s[t], n2s[t], nns[t] = n0, n1, n2, two * (n0 * n1 - n2 * n2)
        for f in range(first, last):
            for t in range(count):
                tile = np.uint64(start + t)
                d0, d1, d2, d3 = data[0, f, tile], data[1, f, tile], data[2, f, tile], data[3, f, tile]
                of_data[f - first, 0, t] = a[0, f] * d1 + a[1, f] * d0 - two * (a[2, f] * d2 + a[3, f] * d3)
                of_data[f - first, 1, t] = b[0, f] * d1 + b[1, f] * d0 - two * (b[2, f] * d2 + b[3, f] * d3)
                of_data[f - first, 2, t] = n0s[t] * d1 + n1s[t] * d0 - two * n2s[t] * d2
        for left in range(rounds, -1, -1):
            sums[:] = zero
            for f in range(first, last):
                d, volume, far, m = of_data[f - first], volumes[f - first], distances[f - first], multiplicity[f]
                f_aa, f_bb, f_ab = aa[f], bb[f], ab[f]
                a0, a1, a2, b0, b1, b2 = a[0, f], a[1, f], two * a[2, f], b[0, f], b[1, f], two * b[2, f]
                for t in range(count):
                    p, q, n0, n1, n2 = ps[t], qs[t], n0s[t], n1s[t], n2s[t]
                    an, bn = a0 * n1 + a1 * n0 - a2 * n2, b0 * n1 + b1 * n0 - b2 * n2
                    by_p = p * f_aa + q * f_ab + an
                    by_q = q * f_bb + p * f_ab + bn
                    volume[t] = half * (p * (by_p + an) + q * (by_q + bn) + nns[t])
                    inverse = one / volume[t]
                    distance = (p * d[0, t] + q * d[1, t] + d[2, t]) * inverse
                    far[t] = freedom + distance
                    scale = m * inverse
                    surprise = scale * (freedom + two) / far[t]
                    sums[0, t] += (distance * by_p - d[0, t]) * surprise
                    sums[1, t] += (distance * by_q - d[1, t]) * surprise
                    sums[2, t] += by_p * scale
                    sums[3, t] += by_q * scale
            if left > 0:
                step_powers(ps, qs, sums, least)
        add_logs(volumes, first, last, multiplicity, totals[0])
        add_logs(distances, first, last, multiplicity, totals[1])
        for t in range(count):
            powers[0, cell, start + t], powers[1, cell, start + t] = ps[t], qs[t]
    for t in range(count):
        out[start + t] = totals[0, t] + (freedom + two) * totals[1, t]


def first_calls() -> list[Call]:
    """Calls on next to nothing of the kernel that every separation needs, for `solvers.ahead`."""
    one, numbers = np.float32(1), np.ones(1, np.float32)
    data, powers = np.ones((4, 1, 1), np.float32), np.ones((2, 1, 1), np.float32)
    arrays = (np.ones((2, 4, 1), np.float32), np.ones((3, 1, 1), np.float32), data, numbers, numbers, np.array([0, 1]))
    return [(tile_misfits, (*arrays, one, one, 0, powers, np.zeros(1), 0, 0))]
