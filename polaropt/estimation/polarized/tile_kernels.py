"""Compiled likelihood of tiles of three Stokes components: the powers of both layers in each cell of frequencies.

With P and Q the powers of reflection and transmission the covariance of whitened components is ``M = P A + Q B + 1``.
For 3x3 matrices the adjugate is quadratic: ``adj M = P^2 adj A + Q^2 adj B + 2 P Q A*B + 2 P A*1 + 2 Q B*1 + 1`` with a
symmetric bilinear product ``*``. So the determinant of M and the data's distance from it are polynomials of P and Q,
whose coefficients are taken once for all powers that are tried.

Hermitian matrices are nine numbers: the diagonal, then real and imaginary parts of 01, 02 and 12.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from polaropt.estimation.flat.windows.tile_kernels import add_logs, step_powers
from solvers.ahead import Call
from solvers.kernels import compiled, inlined

Array = NDArray[Any]

# Of P's matrix, Q's and the noise's: which two are multiplied for P^2, Q^2, PQ, P and Q; and of these products which,
# times which matrix, for the coefficients of the determinant but those of P and Q: of P^2, Q^2, PQ, P^3, Q^3, P^2 Q
# and P Q^2.
_PRODUCTS = ((0, 0), (1, 1), (0, 1), (0, 2), (1, 2))
_TRACES = ((0, 2), (1, 2), (2, 2), (0, 0), (1, 1), (0, 1), (1, 0))


@inlined
def _adjugate(a: Array, b: Array, f: int, out: Array) -> None:
    """The bilinear product of two matrices into `out` (9,): the adjugate of one where they are the same."""
    a0, a1, a2, r01, i01, r02, i02, r12, i12 = a[0], a[1], a[2], a[3], a[4], a[5], a[6], a[7], a[8]
    b0, b1, b2, s01, j01, s02, j02, s12, j12 = b[0], b[1], b[2], b[3], b[4], b[5], b[6], b[7], b[8]
    out[0, f] = (a1 * b2 + b1 * a2) / 2 - (r12 * s12 + i12 * j12)
    out[1, f] = (a0 * b2 + b0 * a2) / 2 - (r02 * s02 + i02 * j02)
    out[2, f] = (a0 * b1 + b0 * a1) / 2 - (r01 * s01 + i01 * j01)
    # 02 times conjugate 12, less 01 times 22; and its like.
    out[3, f] = (r02 * s12 + i02 * j12 + s02 * r12 + j02 * i12 - r01 * b2 - s01 * a2) / 2
    out[4, f] = (i02 * s12 - r02 * j12 + j02 * r12 - s02 * i12 - i01 * b2 - j01 * a2) / 2
    out[5, f] = (r01 * s12 - i01 * j12 + s01 * r12 - j01 * i12 - r02 * b1 - s02 * a1) / 2
    out[6, f] = (r01 * j12 + i01 * s12 + s01 * i12 + j01 * r12 - i02 * b1 - j02 * a1) / 2
    out[7, f] = (s01 * r02 + j01 * i02 + r01 * s02 + i01 * j02 - r12 * b0 - s12 * a0) / 2
    out[8, f] = (r01 * j02 - i01 * s02 + s01 * i02 - j01 * r02 - i12 * b0 - j12 * a0) / 2


@inlined
def _trace(a: Array, b: Array, f: int) -> float:
    """Trace of the product of two matrices, the first of which stands at a frequency."""
    diagonal = a[0, f] * b[0] + a[1, f] * b[1] + a[2, f] * b[2]
    beside = a[3, f] * b[3] + a[4, f] * b[4] + a[5, f] * b[5] + a[6, f] * b[6] + a[7, f] * b[7] + a[8, f] * b[8]
    return float(diagonal + 2 * beside)


@compiled
def stokes_tile_misfits(
    response: Array,
    data: Array,
    multiplicity: Array,
    natural: Array,
    cells: Array,
    freedom: float,
    least: float,
    rounds: int,
    powers: Array,
    out: Array,
    start: int,
    stop: int,
) -> None:
    """Minus log likelihood of tiles start..stop into `out`, their powers (2, cell, tile), reflection first, fitted.

    Shapes: response (2, 9, n), what the pane makes of the transmission and of the reflection of power 1; data
    (9, n, tile), products of the whitened components with each other, unlike matrices with 01, 02 and 12 doubled and
    conjugate; multiplicity, natural (n,), how often a frequency counts, and the power of natural images there; cells
    (cell + 1,), where the frequencies of each begin. `freedom` is that of Student's likelihood, `least` the factor by
    which a power shrinks at most.
    """
    n = multiplicity.size
    # Two responses and the noise's unit matrix; looped over, as each call of what is inlined is compiled for itself.
    matrices = np.zeros((3, 9))
    matrices[2, :3] = 1.0
    # Coefficients of P^2, Q^2, PQ, P and Q in the adjugate; of these, P^3, Q^3, P^2 Q and P Q^2 in the determinant.
    adjugates, c = np.empty((5, 9, n)), np.empty((9, n))
    for f in range(n):
        for i in range(9):
            matrices[0, i], matrices[1, i] = response[1, i, f] * natural[f], response[0, i, f] * natural[f]
        for k in range(5):
            first_of, second_of = _PRODUCTS[k]
            _adjugate(matrices[first_of], matrices[second_of], f, adjugates[k])
        for k in range(2, 5):
            for i in range(9):
                adjugates[k, i, f] *= 2.0
        for k in range(2):
            c[3 + k, f] = matrices[k, 0] + matrices[k, 1] + matrices[k, 2]
        for k in range(7):
            of, by = _TRACES[k]
            c[k if k < 3 else k + 2, f] = _trace(adjugates[of], matrices[by], f)
        c[5, f], c[6, f] = c[5, f] / 3, c[6, f] / 3
    most = 0
    for cell in range(cells.size - 1):
        most = max(most, cells[cell + 1] - cells[cell])
    # All tiles side by side, in arrays that begin with the first: so the loops over them vectorize.
    count = stop - start
    ps, qs, totals = np.empty(count), np.empty(count), np.zeros((2, count))
    of_data, sums = np.zeros((most, 6, count)), np.empty((4, count))
    volumes, distances = np.empty((most, count)), np.empty((most, count))
    for cell in range(cells.size - 1):
        first, last = cells[cell], cells[cell + 1]
        for t in range(count):
            ps[t], qs[t] = powers[0, cell, start + t], powers[1, cell, start + t]
        for f in range(first, last):
            for k in range(6):
                products = of_data[f - first, k]
                products[:] = 0.0
                for i in range(3 if k == 5 else 9):
                    m = 1.0 if k == 5 else adjugates[k, i, f]
                    for t in range(count):
                        products[t] += m * data[i, f, np.uint64(start + t)]
        for left in range(rounds, -1, -1):
            sums[:] = 0.0
            for f in range(first, last):
                d, volume, far, m = of_data[f - first], volumes[f - first], distances[f - first], multiplicity[f]
                c0, c1, c2, c3, c4 = c[0, f], c[1, f], c[2, f], c[3, f], c[4, f]
                c5, c6, c7, c8 = c[5, f], c[6, f], c[7, f], c[8, f]
                for t in range(count):
                    p, q = ps[t], qs[t]
                    d_p, d_q = 2 * p * d[0, t] + q * d[2, t] + d[3, t], 2 * q * d[1, t] + p * d[2, t] + d[4, t]
                    # A quadratic form of the powers is half of what its slopes make of them, and more.
                    square = (p * (d_p + d[3, t]) + q * (d_q + d[4, t])) / 2 + d[5, t]
                    by_p = c3 + q * (c2 + q * c8) + p * (2 * c0 + 3 * p * c5 + 2 * q * c7)
                    by_q = c4 + p * (c2 + p * c7) + q * (2 * c1 + 3 * q * c6 + 2 * p * c8)
                    linear = c4 + q * (c1 + q * c6 + p * c8) + p * c2
                    volume[t] = 1 + p * (c3 + p * (c0 + p * c5 + q * c7)) + q * linear
                    inverse = 1 / volume[t]
                    distance, scale = square * inverse, m * inverse
                    far[t] = freedom + max(distance, 0.0)
                    surprise = scale * (freedom + 3.0) / far[t]
                    sums[0, t] += (distance * by_p - d_p) * surprise
                    sums[1, t] += (distance * by_q - d_q) * surprise
                    sums[2, t] += by_p * scale
                    sums[3, t] += by_q * scale
            if left > 0:
                step_powers(ps, qs, sums, least)
        add_logs(volumes, first, last, multiplicity, totals[0])
        add_logs(distances, first, last, multiplicity, totals[1])
        for t in range(count):
            powers[0, cell, start + t], powers[1, cell, start + t] = ps[t], qs[t]
    for t in range(count):
        out[start + t] = totals[0, t] + (freedom + 3.0) * totals[1, t]


def first_calls() -> list[Call]:
    """Calls on next to nothing of the kernels that tiles of polarized light need, for `solvers.ahead`."""
    one, powers = np.ones(1), np.ones((2, 1, 1))
    data = (np.zeros((2, 9, 1)), np.zeros((9, 1, 1)), one, one.copy(), np.array([0, 1]))
    return [(stokes_tile_misfits, (*data, 1.0, 0.5, 1, powers, one.copy(), 0, 1))]
