"""Compiled likelihood of a capture's tiles: the powers of both layers in each cell of frequencies, fitted."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from solvers.ahead import Call
from solvers.kernels import compiled

Array = NDArray[Any]


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
    """Minus log likelihood of tiles start..stop into `out`, their powers (tile, 2, cell), reflection first, fitted.

    Hermitian matrices are par, perp, and the real and imaginary part of cross. Shapes: response (2, 4, n), what the
    pane makes of the transmission and of the reflection of power 1; noise (3,), without an imaginary part; data
    (tile, 4, n); multiplicity, natural (n,), how often a frequency counts, and the power of natural images there; cells
    (cell + 1,), where the frequencies of each begin. `freedom` is that of Student's likelihood, `least` the factor by
    which a power shrinks at most.
    """
    two, half, zero = np.float32(2), np.float32(0.5), np.float32(0)
    n, tiny = multiplicity.size, np.float32(2e-6)
    n0, n1, n2 = noise[0], noise[1], noise[2]
    nn = two * (n0 * n1 - n2 * n2)
    # Trace of the adjugate of one matrix times the other: reflection a, transmission b.
    products, of_data = np.empty((5, n), np.float32), np.empty((3, n), np.float32)
    aa, bb, ab, an, bn = products[0], products[1], products[2], products[3], products[4]
    ad, bd, nd = of_data[0], of_data[1], of_data[2]
    a, b = np.empty((4, n), np.float32), np.empty((4, n), np.float32)
    for f in range(n):
        for i in range(4):
            a[i, f], b[i, f] = response[1, i, f] * natural[f], response[0, i, f] * natural[f]
        a0, a1, a2, a3 = a[0, f], a[1, f], a[2, f], a[3, f]
        b0, b1, b2, b3 = b[0, f], b[1, f], b[2, f], b[3, f]
        aa[f] = max(two * (a0 * a1 - a2 * a2 - a3 * a3), tiny * a0 * a1)
        bb[f] = max(two * (b0 * b1 - b2 * b2 - b3 * b3), tiny * b0 * b1)
        ab[f] = max(a0 * b1 + a1 * b0 - two * (a2 * b2 + a3 * b3), zero)
        an[f] = a0 * n1 + a1 * n0 - two * a2 * n2
        bn[f] = b0 * n1 + b1 * n0 - two * b2 * n2
    for tile in range(start, stop):
        d = data[tile]
        for f in range(n):
            d0, d1, d2, d3 = d[0, f], d[1, f], d[2, f], d[3, f]
            ad[f] = a[0, f] * d1 + a[1, f] * d0 - two * (a[2, f] * d2 + a[3, f] * d3)
            bd[f] = b[0, f] * d1 + b[1, f] * d0 - two * (b[2, f] * d2 + b[3, f] * d3)
            nd[f] = n0 * d1 + n1 * d0 - two * n2 * d2
        total = 0.0
        for cell in range(cells.size - 1):
            p, q = powers[tile, 0, cell], powers[tile, 1, cell]
            for left in range(rounds, -1, -1):
                more_p, less_p, more_q, less_q = zero, zero, zero, zero
                value = 0.0
                for f in range(cells[cell], cells[cell + 1]):
                    by_p = p * aa[f] + q * ab[f] + an[f]
                    by_q = q * bb[f] + p * ab[f] + bn[f]
                    determinant = half * (p * (by_p + an[f]) + q * (by_q + bn[f]) + nn)
                    inverse = np.float32(1) / determinant
                    distance = (p * ad[f] + q * bd[f] + nd[f]) * inverse
                    if left == 0:
                        value += multiplicity[f] * (np.log(determinant) + (freedom + two) * np.log(freedom + distance))
                        continue
                    scale = multiplicity[f] * inverse
                    surprise = scale * (freedom + two) / (freedom + distance)
                    more_p += (distance * by_p - ad[f]) * surprise
                    more_q += (distance * by_q - bd[f]) * surprise
                    less_p += by_p * scale
                    less_q += by_q * scale
                if left == 0:
                    total += value
                else:
                    p *= max(more_p / less_p, least)
                    q *= max(more_q / less_q, least)
            powers[tile, 0, cell], powers[tile, 1, cell] = p, q
        out[tile] = total


def first_calls() -> list[Call]:
    """Calls on next to nothing of the kernel that every separation needs, for `solvers.ahead`."""
    one, numbers = np.float32(1), np.ones(1, np.float32)
    data, powers = np.ones((1, 4, 1), np.float32), np.ones((1, 2, 1), np.float32)
    arrays = (np.ones((2, 4, 1), np.float32), np.ones(3, np.float32), data, numbers, numbers, np.array([0, 1]))
    return [(tile_misfits, (*arrays, one, one, 0, powers, np.zeros(1), 0, 0))]
