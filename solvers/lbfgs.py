"""L-BFGS for large images: two passes over memory per iteration, float32 state, sums in float64."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from solvers.base import (
    NotFinite,
    Progress,
    SolverResult,
    Status,
    StoppingRule,
    StopSolving,
    Traced,
    ValueAndGrad,
    Vector,
    distance,
)

if TYPE_CHECKING:
    from solvers.passes import Pairs

Matrix = NDArray[np.float64]

HISTORY = 3
"""Pairs of steps and gradient changes that are kept: with five there were as few evaluations, and more memory."""
# Least cosine of a step and its gradient change that counts as curvature: rounding in float32, set by hand.
_CURVED = 1e-8


@dataclass(frozen=True)
class Direction:
    """A direction as weights of vectors, and the slope along it.

    Attributes
    ----------
    weights : array, shape (1 + 2 m,)
        Of the gradient, the steps, the changes of the gradient.
    slope : float
        Of the objective along it.
    """

    weights: Matrix
    slope: float


class Gram:
    """The inner products that the recursion needs, kept up to date with 4 m + 3 new ones per iteration.

    With steps S and gradient differences Y the recursion reads no more than S'Y for steps not younger than the
    difference, Y'Y, and the products of S and Y with the gradient.

    Parameters
    ----------
    history : int
        m, the most pairs.

    References
    ----------
    R. H. Byrd, J. Nocedal, R. B. Schnabel, Representations of quasi-Newton matrices and their use in limited memory
    methods, Mathematical Programming 63, 1994.
    """

    def __init__(self, history: int) -> None:
        self._m = history
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
        """Forget all pairs and begin with a gradient of this square."""
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
        """Take in the products of `passes.absorb`; the pair counts where its curvature is positive beyond rounding."""
        m = self._m
        self._steps_gradient, self._changes_gradient = sums[:m], sums[m : 2 * m]
        self._steps_changes[:, slot] = sums[2 * m : 3 * m]
        self._changes_changes[:, slot] = self._changes_changes[slot] = sums[3 * m : 4 * m]
        self._gradient_gradient, change_change, step_step = sums[4 * m :]
        if self._steps_changes[slot, slot] > _CURVED * np.sqrt(step_step * change_change):
            self._slots.append(slot)

    def direction(self) -> Direction:
        """The quasi-Newton direction; the gradient downhill where there is no pair."""
        slots, m = self._slots, self._m
        weights = np.zeros(1 + 2 * m)
        weights[0] = -1.0
        if slots:
            square = np.ix_(slots, slots)
            upper, inner = np.triu(self._steps_changes[square]), self._changes_changes[square]
            curvature = np.diag(upper)
            # The inverse Hessian that the recursion begins with: the identity times the youngest pair's curvature.
            scale = curvature[-1] / inner[-1, -1]
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


# Share of the decrease that the slope promises: Nocedal and Wright, Numerical Optimization, 2006, sect. 3.1.
SUFFICIENT = 1e-4
# Parts of the step between which its successor lies: Dennis and Schnabel, Numerical Methods, 1983, sect. 6.3.2.
SHORTEST, LONGEST = 0.1, 0.5
# Shorter steps are rounding: a half is the longest, so 20 are a millionth.
MOST_HALVINGS = 20
# The value of a sum over a million float32 residuals is known to about this share of it.
VALUE_NOISE = 1e-7
# Restarts before it gives up, and the part of the step that failed: set by hand.
MOST_RESTARTS = 3
SHORTER = 0.1
# The gradient is kept in units of its first norm; float32 holds no larger ones.
_LARGEST_UNIT = 1e30


class LBFGS:
    """Limited-memory BFGS made for large images.

    Notes
    -----
    Inner products of all kept vectors are known at any time, so that the direction is found among a few numbers; one
    pass over memory forms the trial point, another takes in the new pair with all its products. Both run on all cores.
    The result is the same to the last bit whatever their number.

    A step is accepted where the value falls enough, or rises by less than its own rounding (backtracking by quadratic
    interpolation). Where a value or gradient is not finite the solver goes back to the best point, forgets its pairs
    and tries a tenth of the step, three times at most (`SolverResult.restarts`).

    Memory in vectors of N float32, with m = `HISTORY` pairs: 2 m + 3 for pairs, point, trial point and gradient; one
    more where the best point is neither of the two. What the objective returns comes on top and is not kept while the
    next is computed.

    References
    ----------
    J. Nocedal, Updating quasi-Newton matrices with limited storage, Mathematics of Computation 35, 1980.
    """

    def minimize(self, objective: ValueAndGrad, start: Vector, stopping: StoppingRule) -> SolverResult:
        """Minimize `objective` from `start` until `stopping` says so."""
        traced = Traced(objective, stopping)
        progress = Progress(traced, stopping)
        restarts = 0
        try:
            descent = _Descent(traced, start)
            broken = False
            while True:
                try:
                    if broken:
                        descent.restart()
                    broken = False
                    descent.iterate()
                    progress.iteration()
                except NotFinite:
                    if restarts == MOST_RESTARTS:
                        raise
                    restarts, broken = restarts + 1, True
        except StopSolving as stop:
            status = stop.status
        return traced.result(status, progress.count, start, restarts=restarts)


class _Descent:
    """The state between iterations: a point, its value, and the pairs that led there."""

    def __init__(self, traced: Traced, start: Vector) -> None:
        from solvers.passes import Pairs

        self._traced = traced
        self._x = np.array(start, dtype=np.float32)
        self._trial = self._x
        # Points take turns in these: a third is made only where the best point is neither the last nor the new one.
        self._buffers = [self._x]
        self._reach: float | None = None
        # Where the last step came from, and the gradient where it led.
        self._last: tuple[Vector, Vector] | None = None
        self._value, gradient = traced(self._x)
        self._pairs: Pairs = Pairs(self._x.size, HISTORY)
        self._gram = Gram(HISTORY)
        self._begin(gradient)

    def iterate(self) -> None:
        """Move to a lower point; raises `StopSolving` where there is none."""
        self._absorb()
        while not self._moved():
            if self._gram.empty:
                raise StopSolving(Status.ROUNDOFF_LIMITED)
            self._gram.clear()

    def restart(self) -> None:
        """Go back to the best point without pairs, and tread more carefully: a tenth of the step that failed."""
        self._reach = SHORTER * distance(self._trial, self._x)
        assert self._last is None  # it was taken in before the step that failed
        if self._x is self._traced.best:
            self._gram.clear()
            return
        best = self._traced.best
        self._value, gradient = self._traced(best)
        self._x = best
        self._begin(gradient)

    def _begin(self, gradient: Vector) -> None:
        """Without pairs, from the gradient of the last evaluation, which becomes the unit of those that follow."""
        self._unit = min(1 / self._traced.trace[-1].gradient_norm, _LARGEST_UNIT)
        self._gram.begin(self._pairs.begin(_flat(gradient), self._unit))

    def _moved(self) -> bool:
        """Search along the direction of the pairs; False where it does not lead down."""
        direction = self._gram.direction()
        slope = direction.slope / self._unit
        if not slope < 0:
            return False
        step = self._first_step(direction)
        for _ in range(MOST_HALVINGS):
            trial = self._propose(direction, step)
            value, gradient = self._traced(trial)
            if value <= self._value + SUFFICIENT * step * slope + VALUE_NOISE * abs(self._value):
                self._accept(trial, value, _flat(gradient))
                return True
            del gradient
            step = shorter_step(step, slope, value - self._value)
        return False

    def _first_step(self, direction: Direction) -> float:
        """1 where the direction knows its length; else as far as the last step, or as a restart allows.

        The very first step is `first_reach`.
        """
        if not self._gram.empty:
            return 1.0
        length = max(math.sqrt(-direction.slope), 1e-30)
        if self._reach is None:
            self._reach = first_reach(length / self._unit, self._value, self._x.size)
        return self._reach / length

    def _propose(self, direction: Direction, step: float) -> Vector:
        taken = (self._x, self._traced.best)
        self._trial = next((buffer for buffer in self._buffers if not any(buffer is x for x in taken)), self._x)
        if self._trial is self._x:
            self._trial = np.empty_like(self._x)
            self._buffers.append(self._trial)
        self._pairs.propose(self._x, step * direction.weights, self._trial)
        return self._trial

    def _accept(self, trial: Vector, value: float, gradient: Vector) -> None:
        self._last = (self._x, gradient)
        self._x, self._value = trial, value

    def _absorb(self) -> None:
        """Take in the pair of the last step: only before another one, which after the last of all never comes."""
        if self._last is None:
            return
        (before, gradient), self._last = self._last, None
        slot = self._gram.take_slot()
        sums = self._pairs.absorb((before, self._x), gradient, slot)
        if np.isfinite(sums).all():
            self._gram.remember(slot[0], sums)
        else:
            # In units of what it was, the gradient has grown beyond float32.
            self._begin(gradient)
        self._reach = math.sqrt(sums[-1])


def first_reach(gradient: float, value: float, n_unknowns: int) -> float:
    """Length of the very first step: the gradient itself, right where the Hessian is near the identity, as in whitened
    coordinates; no longer than if each unknown moved by 1, and 1 where that promises less than rounding."""
    promising = gradient**2 > VALUE_NOISE * abs(value)
    return min(gradient, math.sqrt(n_unknowns)) if promising else 1.0


def shorter_step(step: float, slope: float, rise: float) -> float:
    """The step to try after one along which the objective rose by `rise`, or fell too little, by a parabola."""
    vertex = -slope * step**2 / (2 * (rise - slope * step))
    return min(max(vertex, SHORTEST * step), LONGEST * step)


def _flat(gradient: Vector) -> Vector:
    """As the passes need it; copied only where it is not so already."""
    return np.ascontiguousarray(gradient, dtype=np.float32).reshape(-1)
