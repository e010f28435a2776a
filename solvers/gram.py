"""L-BFGS's direction from inner products alone: the two-loop recursion in the small space that the pairs span."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Matrix = NDArray[np.float64]

_CURVED = 1e-8


@dataclass(frozen=True)
class Direction:
    """A direction as weights of vectors, and the slope along it.

    Attributes
    ----------
    weights : array, shape (1 + 2 m,)
        Of the (preconditioned) gradient, the steps, the changes of the (preconditioned) gradient.
    slope : float
        Of the objective along it.
    """

    weights: Matrix
    slope: float


class Gram:
    """The inner products that the recursion needs, kept up to date with 4 m + 3 new ones per iteration.

    With steps S, gradient differences Y and their preconditioned selves Z = H0 Y, the recursion reads no more than
    S'Y for steps not younger than the difference, Y'Z, and the products of S and Z with the gradient.

    Parameters
    ----------
    history : int
        m, the most pairs.
    scaled : bool
        Scale H0 by the youngest pair's curvature: for H0 = identity.

    References
    ----------
    R. H. Byrd, J. Nocedal, R. B. Schnabel, Representations of quasi-Newton matrices and their use in limited memory
    methods, Mathematical Programming 63, 1994.
    """

    def __init__(self, history: int, scaled: bool) -> None:
        self._m, self._scaled = history, scaled
        self._slots: list[int] = []
        self._next, self._n_used = 0, 0
        self._steps_changes = np.zeros((history, history))
        self._changes_changes = np.zeros((history, history))
        self._steps_gradient, self._changes_gradient = np.zeros(history), np.zeros(history)
        self._gradient_gradient = 0.0

    @property
    def empty(self) -> bool:
        """Whether there is no pair."""
        return not self._slots

    def clear(self) -> None:
        """Forget all pairs."""
        self._slots.clear()
        self._next = self._n_used = 0
        self._steps_gradient[:] = self._changes_gradient[:] = 0.0

    def begin(self, gradient_gradient: float) -> None:
        """Forget all pairs and begin with a gradient of this product with its preconditioned self."""
        self.clear()
        self._gradient_gradient = gradient_gradient

    def take_slot(self) -> tuple[int, int]:
        """The slot of the coming pair, and the number of slots that then hold something; the oldest pair gives way."""
        slot, self._next = self._next, (self._next + 1) % self._m
        if slot in self._slots:
            self._slots.remove(slot)
        self._n_used = max(self._n_used, slot + 1)
        return slot, self._n_used

    def remember(self, slot: int, sums: Matrix) -> None:
        """Take in the products of `sweeps.absorb`; the pair counts where its curvature is positive beyond rounding."""
        m = self._m
        self._steps_gradient, self._changes_gradient = sums[:m], sums[m : 2 * m]
        self._steps_changes[:, slot] = sums[2 * m : 3 * m]
        self._changes_changes[:, slot] = self._changes_changes[slot] = sums[3 * m : 4 * m]
        self._gradient_gradient, change_change, step_step = sums[4 * m :]
        if self._steps_changes[slot, slot] > _CURVED * np.sqrt(step_step * change_change):
            self._slots.append(slot)

    def direction(self) -> Direction:
        """The quasi-Newton direction; the (preconditioned) gradient downhill where there is no pair."""
        slots, m = self._slots, self._m
        weights = np.zeros(1 + 2 * m)
        weights[0] = -1.0
        if slots:
            square = np.ix_(slots, slots)
            upper, inner = np.triu(self._steps_changes[square]), self._changes_changes[square]
            curvature = np.diag(upper)
            scale = curvature[-1] / inner[-1, -1] if self._scaled else 1.0
            # The first loop, youngest pair first, and the second, oldest first, are two triangular systems.
            first = _solve_upper(upper, self._steps_gradient[slots])
            rest = curvature * first + scale * (inner @ first - self._changes_gradient[slots])
            second = _solve_upper(upper[::-1, ::-1].T, rest[::-1])[::-1]
            weights[0] = -scale
            weights[1:][slots] = -second
            weights[1 + m :][slots] = scale * first
        slope = weights @ np.concatenate([[self._gradient_gradient], self._steps_gradient, self._changes_gradient])
        return Direction(weights, float(slope))


def _solve_upper(upper: Matrix, right: Matrix) -> Matrix:
    """Solution by back substitution; a handful of unknowns."""
    solution = np.zeros(len(right))
    for i in reversed(range(len(right))):
        solution[i] = (right[i] - upper[i, i + 1 :] @ solution[i + 1 :]) / upper[i, i]
    return solution
