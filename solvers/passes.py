"""The vectors of L-BFGS in two passes over memory, each reading its operands once, all products on the way.

Kernels work on ``[start, stop)`` in tiles that stay in the first cache. Products are summed in float32 within a tile
and in float64 over tiles. Importing this imports numba.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from solvers.ahead import Call
from solvers.base import Vector
from solvers.kernels import compiled, in_blocks, inlined

Sums = NDArray[np.float64]
Vectors = NDArray[np.float32]
Part = TypeVar("Part")

# Numbers of a tile, 32 KB each of a few vectors: set by hand for the caches of today's cores.
_TILE = 8192
# Half a millisecond of work; below twice that a second thread does not pay.
_BLOCK = 1 << 17


class Pairs:
    """Steps and gradient changes of the last iterations, and the gradient that the next change is taken from.

    Allocates 2 m + 1 vectors of n; pages of pairs not yet written take no memory. The gradient is kept times a unit
    that brings it near 1.

    Parameters
    ----------
    n : int
        Unknowns.
    history : int
        m, the most pairs.
    """

    def __init__(self, n: int, history: int) -> None:
        self._n = n
        self._steps, self._changes = np.empty((2, history, n), np.float32)
        self._gradient = np.empty(n, np.float32)
        self._unit = 1.0

    def begin(self, gradient: Vector, unit: float) -> float:
        """Keep a first gradient; its square, in units."""
        self._unit = unit
        np.multiply(gradient, np.float32(unit), out=self._gradient)
        return sum(self._passed(lambda start, stop: square(self._gradient, start, stop)))

    def propose(self, x: Vector, weights: Sums, trial: Vector) -> None:
        """Write `x` plus the weighted gradient, steps and changes into `trial`."""
        arguments = (x, self._gradient, self._steps, self._changes, weights, trial)
        self._passed(lambda start, stop: propose(*arguments, start, stop))

    def absorb(self, move: tuple[Vector, Vector], gradient: Vector, slot: tuple[int, int]) -> Sums:
        """Write the pair of a move (from, to) and its new gradient; the products that `Gram.remember` takes."""
        arguments = (*move, gradient, self._gradient, self._unit, self._steps, self._changes, *slot)
        parts = self._passed(lambda start, stop: absorb(*arguments, start, stop))
        # In the order of the blocks: the same bits whatever the number of threads.
        total: Sums = np.sum(parts, axis=0)
        return total

    def _passed(self, kernel: Callable[[int, int], Part]) -> list[Part]:
        return in_blocks(kernel, self._n, _BLOCK, smallest=2 * _BLOCK)


@inlined
def _add(total: Vector, a: np.float32, s: Vector, b: np.float32, y: Vector) -> None:
    for j in range(total.size):
        total[j] += a * s[j] + b * y[j]


@inlined
def _finish(x: Vector, weight: np.float32, gradient: Vector, total: Vector, trial: Vector) -> None:
    for j in range(trial.size):
        trial[j] = x[j] + (total[j] + weight * gradient[j])


@compiled
def propose(
    x: Vector, gradient: Vector, steps: Vectors, changes: Vectors, weights: Sums, trial: Vector, start: int, stop: int
) -> None:
    """``trial = x + weights[0] gradient + sum_i weights[1 + i] steps[i] + sum_i weights[1 + m + i] changes[i]``.

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
        _finish(x[begin:end], np.float32(weights[0]), gradient[begin:end], total, trial[begin:end])


@inlined
def _difference(a: Vector, factor: np.float32, b: Vector, difference: Vector) -> None:
    for j in range(difference.size):
        difference[j] = factor * a[j] - b[j]


@inlined
def _copy(a: Vector, factor: np.float32, copy: Vector) -> None:
    for j in range(copy.size):
        copy[j] = factor * a[j]


@inlined
def _products(a: Vector, b: Vector, s: Vector, y: Vector) -> tuple[np.float32, np.float32, np.float32, np.float32]:
    """Inner products of a and b with s and y."""
    a_s = a_y = b_s = b_y = np.float32(0)
    for j in range(a.size):
        a_s += a[j] * s[j]
        a_y += a[j] * y[j]
        b_s += b[j] * s[j]
        b_y += b[j] * y[j]
    return a_s, a_y, b_s, b_y


@inlined
def _square(a: Vector) -> np.float32:
    total = np.float32(0)
    for j in range(a.size):
        total += a[j] * a[j]
    return total


@compiled
def absorb(
    x: Vector,
    trial: Vector,
    gradient: Vector,
    kept: Vector,
    unit: float,
    steps: Vectors,
    changes: Vectors,
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
    steps, changes : array, shape (m, n)
        Differences of points and of gradients.
    n_used : int
        Slots below this one hold something, the new pair included.

    Returns
    -------
    array, shape (4 m + 3,)
        Steps with the new gradient; changes with it; steps with the gradients' difference; changes with it; then the
        squares of the new gradient, of the difference and of the new step.
    """
    m = steps.shape[0]
    sums = np.zeros(4 * m + 3)
    one, factor = np.float32(1), np.float32(unit)
    for begin in range(start, stop, _TILE):
        end = min(begin + _TILE, stop)
        new, s, y = kept[begin:end], steps[slot, begin:end], changes[slot, begin:end]
        _difference(trial[begin:end], one, x[begin:end], s)
        _difference(gradient[begin:end], factor, new, y)
        _copy(gradient[begin:end], factor, new)
        for i in range(n_used):
            a, b, c, d = _products(new, y, steps[i, begin:end], changes[i, begin:end])
            sums[i] += a
            sums[m + i] += b
            sums[2 * m + i] += c
            sums[3 * m + i] += d
        sums[4 * m] += _square(new)
        sums[4 * m + 1] += _square(y)
        sums[4 * m + 2] += _square(s)
    return sums


@compiled
def square(a: Vector, start: int, stop: int) -> float:
    """Square of ``a[start:stop]``."""
    total = np.float64(0)
    for begin in range(start, stop, _TILE):
        total += _square(a[begin : min(begin + _TILE, stop)])
    return float(total)


def first_calls() -> list[Call]:
    """Calls on next to nothing of the kernels that every separation needs, for `solvers.ahead`."""
    vector, vectors = np.zeros(1, np.float32), np.zeros((1, 1), np.float32)
    return [
        (absorb, (vector, vector, vector, vector.copy(), 1.0, vectors, vectors.copy(), 0, 0, 0, 0)),
        (propose, (vector, vector, vectors, vectors, np.zeros(3), vector.copy(), 0, 0)),
        (square, (vector, 0, 0)),
    ]
