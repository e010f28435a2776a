"""The passes over long vectors that L-BFGS needs, each reading its operands once.

Kernels work on ``[start, stop)`` in tiles that stay in the first cache. Products are summed in float32 within a tile
and in float64 over tiles. Pairs are stored as bits: uint32 is float32 itself, uint16 its upper half (bfloat16).

Importing this imports numba.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from solvers.kernels import compiled

Floats = NDArray[np.float32]
Sums = NDArray[np.float64]
Bits = NDArray[np.uint16] | NDArray[np.uint32]

_TILE = 8192


@compiled
def _pack(values: Floats, row: Bits) -> None:
    """Store a tile, rounded to nearest even where only the upper half is kept, and read it back into `values`."""
    bits = values.view(np.uint32)
    if row.itemsize == 4:
        for j in range(bits.size):
            row[j] = bits[j]
        return
    for j in range(bits.size):
        bits[j] += np.uint32(0x7FFF) + ((bits[j] >> np.uint32(16)) & np.uint32(1))
        bits[j] &= np.uint32(0xFFFF0000)
    for j in range(bits.size):
        row[j] = bits[j] >> np.uint32(16)


@compiled
def _float(bits: int, shift: np.uint32) -> np.float32:
    """The number whose upper bits these are."""
    return np.uint32(np.uint32(bits) << shift).view(np.float32)


@compiled
def _shift(row: Bits) -> np.uint32:
    return np.uint32(16 if row.itemsize == 2 else 0)


@compiled
def _add(total: Floats, a: np.float32, s: Bits, b: np.float32, z: Bits) -> None:
    shift = _shift(s)
    for j in range(total.size):
        total[j] += a * _float(s[j], shift) + b * _float(z[j], shift)


@compiled
def _finish(x: Floats, weight: np.float32, base: Floats, total: Floats, trial: Floats) -> None:
    for j in range(trial.size):
        trial[j] = x[j] + (total[j] + weight * base[j])


@compiled
def propose(
    x: Floats, base: Floats, steps: Bits, changes: Bits, weights: Sums, trial: Floats, start: int, stop: int
) -> None:
    """``trial = x + weights[0] base + sum_i weights[1 + i] steps[i] + sum_i weights[1 + m + i] changes[i]``.

    Slots whose two weights are 0 are not read: they may hold anything.
    """
    m = steps.shape[0]
    buffer = np.empty(_TILE, np.float32)
    for begin in range(start, stop, _TILE):
        end = min(begin + _TILE, stop)
        total = buffer[: end - begin]
        total[:] = 0
        for i in range(m):
            a, b = np.float32(weights[1 + i]), np.float32(weights[1 + m + i])
            if a != 0 or b != 0:
                _add(total, a, steps[i, begin:end], b, changes[i, begin:end])
        _finish(x[begin:end], np.float32(weights[0]), base[begin:end], total, trial[begin:end])


@compiled
def _difference(a: Floats, factor: np.float32, b: Floats, difference: Floats) -> None:
    for j in range(difference.size):
        difference[j] = factor * a[j] - b[j]


@compiled
def _copy(a: Floats, factor: np.float32, copy: Floats) -> None:
    for j in range(copy.size):
        copy[j] = factor * a[j]


@compiled
def _products(a: Floats, b: Floats, s: Bits, z: Bits) -> tuple[np.float32, np.float32, np.float32, np.float32]:
    """Inner products of a and b with stored s and z."""
    shift = _shift(s)
    a_s = a_z = b_s = b_z = np.float32(0)
    for j in range(a.size):
        s_j, z_j = _float(s[j], shift), _float(z[j], shift)
        a_s += a[j] * s_j
        a_z += a[j] * z_j
        b_s += b[j] * s_j
        b_z += b[j] * z_j
    return a_s, a_z, b_s, b_z


@compiled
def _product(a: Floats, b: Floats) -> np.float32:
    total = np.float32(0)
    for j in range(a.size):
        total += a[j] * b[j]
    return total


@compiled
def absorb(
    x: Floats,
    trial: Floats,
    gradient: Floats,
    kept: Floats,
    direct: Floats,
    kept_direct: Floats,
    unit: float,
    steps: Bits,
    changes: Bits,
    slot: int,
    n_used: int,
    start: int,
    stop: int,
) -> Sums:
    """Write the pair of the step from `x` to `trial` into `slot`, and sum every product that the next direction needs.

    Parameters
    ----------
    gradient, kept : array
        At `trial`, in the objective's unit; at `x`, times `unit`. The new one replaces the kept one.
    direct, kept_direct : array
        The same preconditioned, both as they are; empty without a preconditioner.
    steps, changes : array, shape (m, n)
        Differences of points and of preconditioned gradients.
    n_used : int
        Slots below this one hold something, the new pair included.

    Returns
    -------
    array, shape (4 m + 3,)
        Steps with the new gradient; changes with it; steps with the gradients' difference; changes with it; then the
        new gradient with itself preconditioned, the difference with itself, the new step with itself.
    """
    m = steps.shape[0]
    sums = np.zeros(4 * m + 3)
    one, factor = np.float32(1), np.float32(unit)
    buffers = np.empty((3, _TILE), np.float32)
    for begin in range(start, stop, _TILE):
        end = min(begin + _TILE, stop)
        y, s, z = buffers[0, : end - begin], buffers[1, : end - begin], buffers[2, : end - begin]
        new = base = kept[begin:end]
        _difference(trial[begin:end], one, x[begin:end], s)
        _pack(s, steps[slot, begin:end])
        _difference(gradient[begin:end], factor, new, y)
        _copy(gradient[begin:end], factor, new)
        if kept_direct.size == 0:
            # Rounds y too: the recursion holds exactly only if products are of what is stored.
            _pack(y, changes[slot, begin:end])
        else:
            base = kept_direct[begin:end]
            _difference(direct[begin:end], one, base, z)
            _copy(direct[begin:end], one, base)
            _pack(z, changes[slot, begin:end])
        for i in range(n_used):
            a, b, c, d = _products(new, y, steps[i, begin:end], changes[i, begin:end])
            sums[i] += a
            sums[m + i] += b
            sums[2 * m + i] += c
            sums[3 * m + i] += d
        sums[4 * m] += _product(new, base)
        sums[4 * m + 1] += _product(y, y)
        sums[4 * m + 2] += _product(s, s)
    return sums


@compiled
def inner(a: Floats, b: Floats, start: int, stop: int) -> float:
    """Inner product of ``a[start:stop]`` and ``b[start:stop]``."""
    total = np.float64(0)
    for begin in range(start, stop, _TILE):
        end = min(begin + _TILE, stop)
        total += _product(a[begin:end], b[begin:end])
    return float(total)
