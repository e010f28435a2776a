"""The vectors of L-BFGS in two passes over memory: pairs kept in few bytes, all products on the way."""

from __future__ import annotations

from collections.abc import Callable
from typing import Literal, TypeVar

import numpy as np
from numpy.typing import NDArray

from solvers.base import Vector
from solvers.kernels import in_blocks

Storage = Literal["float32", "bfloat16"]
Sums = NDArray[np.float64]
Part = TypeVar("Part")

# Half a millisecond of work; below twice that a second thread does not pay.
_BLOCK = 1 << 17
_BITS = {"float32": np.uint32, "bfloat16": np.uint16}


class Pairs:
    """Steps and gradient changes of the last iterations, and the gradient that the next change is taken from.

    Allocates 2 m + 1 vectors of n (m + 1 in bfloat16), and one more with a preconditioner; pages of pairs not yet
    written take no memory. The gradient is kept times a unit that brings it near 1.

    Parameters
    ----------
    n : int
        Unknowns.
    history : int
        m, the most pairs.
    storage : {"float32", "bfloat16"}
        Of steps and changes.
    preconditioned : bool
        Whether a preconditioned gradient comes with every gradient.
    """

    def __init__(self, n: int, history: int, storage: Storage, preconditioned: bool) -> None:
        self._n = n
        self._steps, self._changes = np.empty((2, history, n), _BITS[storage])
        self._gradient = np.empty(n, np.float32)
        self._direct = np.empty(n if preconditioned else 0, np.float32)
        self._unit = 1.0

    def begin(self, gradient: Vector, direct: Vector | None, unit: float) -> float:
        """Keep a first gradient and its preconditioned self; their inner product, in units."""
        from solvers import sweeps

        self._unit = unit
        np.multiply(gradient, np.float32(unit), out=self._gradient)
        if direct is not None:
            self._direct[:] = direct
        base = self._base
        return sum(self._passed(lambda start, stop: sweeps.inner(self._gradient, base, start, stop)))

    def propose(self, x: Vector, weights: Sums, trial: Vector) -> None:
        """Write `x` plus the weighted gradient, steps and changes into `trial`."""
        from solvers import sweeps

        arguments = (x, self._base, self._steps, self._changes, weights, trial)
        self._passed(lambda start, stop: sweeps.propose(*arguments, start, stop))

    def absorb(
        self, move: tuple[Vector, Vector], gradient: Vector, direct: Vector | None, slot: tuple[int, int]
    ) -> Sums:
        """Write the pair of a move (from, to) and its new gradient; the products that `Gram.remember` takes."""
        from solvers import sweeps

        new = self._direct if direct is None else direct
        arguments = (*move, gradient, self._gradient, new, self._direct, self._unit, self._steps, self._changes, *slot)
        parts = self._passed(lambda start, stop: sweeps.absorb(*arguments, start, stop))
        # In the order of the blocks: the same bits whatever the number of threads.
        total: Sums = np.sum(parts, axis=0)
        return total

    @property
    def _base(self) -> Vector:
        """The gradient as the direction contains it."""
        return self._direct if self._direct.size else self._gradient

    def _passed(self, kernel: Callable[[int, int], Part]) -> list[Part]:
        return in_blocks(kernel, self._n, _BLOCK, smallest=2 * _BLOCK)
