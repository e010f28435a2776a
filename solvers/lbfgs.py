"""L-BFGS in float32 with sums in float64, a noise-aware line search and an optional preconditioner."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from solvers.base import SolverResult, Status, StoppingRule, ValueAndGrad, Vector
from solvers.trace import Progress, StopSolving, Traced

_ROW = 8192
_SUFFICIENT = 1e-4
_SHORTEST, _LONGEST = 0.1, 0.5
_MOST_HALVINGS = 20
# The value of a sum over a million float32 residuals is known to about this share of it.
_VALUE_NOISE = 1e-7
_CURVED = 1e-8


@dataclass(frozen=True)
class LBFGS:
    """Limited-memory BFGS made for large images.

    Parameters
    ----------
    history : int
        Pairs of steps and gradient differences that are kept.
    preconditioner : callable, optional
        Approximate inverse Hessian applied to a vector: replaces the scaled identity.

    Notes
    -----
    Vectors are float32 and every inner product is summed in float64. A step is accepted where the value falls enough,
    or rises by less than its own rounding (backtracking by quadratic interpolation). Deterministic.

    References
    ----------
    J. Nocedal, Updating quasi-Newton matrices with limited storage, Mathematics of Computation 35, 1980.
    """

    history: int = 5
    preconditioner: Callable[[Vector], Vector] | None = None

    def minimize(self, objective: ValueAndGrad, start: Vector, stopping: StoppingRule) -> SolverResult:
        """Minimize `objective` from `start` until `stopping` says so."""
        traced = Traced(objective, stopping)
        progress = Progress(traced, stopping)
        pairs: deque[_Pair] = deque(maxlen=self.history)
        try:
            x = np.array(start, dtype=np.float32)
            value, gradient = traced(x)
            while True:
                direction, slope = self._direction(gradient, pairs)
                if not slope < 0:
                    raise StopSolving(Status.ROUNDOFF_LIMITED)
                first = 1.0 if pairs or self.preconditioner else 1 / max(np.sqrt(-slope), 1e-30)
                step, next_value, next_gradient = _line_search(traced, x, value, direction, slope, first)
                if step == 0:
                    if not pairs:
                        raise StopSolving(Status.ROUNDOFF_LIMITED)
                    pairs.clear()
                    continue
                direction *= np.float32(step)
                x = x + direction
                _remember(pairs, direction, next_gradient - gradient)
                value, gradient = next_value, next_gradient
                progress.iteration()
        except StopSolving as stop:
            status = stop.status
        return traced.result(status, progress.count, start)

    def _direction(self, gradient: Vector, pairs: deque[_Pair]) -> tuple[Vector, float]:
        """Downhill direction by the two-loop recursion, and the slope along it."""
        q = -gradient
        factors = []
        for pair in reversed(pairs):
            factor = inner(pair.step, q) / pair.curvature
            q -= np.float32(factor) * pair.change
            factors.append(factor)
        if self.preconditioner is not None:
            q = self.preconditioner(q)
        elif pairs:
            q *= np.float32(pairs[-1].curvature / inner(pairs[-1].change, pairs[-1].change))
        for pair, factor in zip(pairs, reversed(factors), strict=True):
            q += np.float32(factor - inner(pair.change, q) / pair.curvature) * pair.step
        return q, inner(gradient, q)


@dataclass(frozen=True)
class _Pair:
    step: Vector
    change: Vector
    curvature: float


def inner(a: Vector, b: Vector) -> float:
    """Inner product of float32 vectors: rows in float32, their sum in float64."""
    whole = a.size // _ROW * _ROW
    rows = np.vecdot(a[:whole].reshape(-1, _ROW), b[:whole].reshape(-1, _ROW))
    return float(rows.sum(dtype=np.float64)) + float(np.dot(a[whole:], b[whole:]))


def _remember(pairs: deque[_Pair], step: Vector, change: Vector) -> None:
    """Keep a pair whose curvature is positive beyond rounding."""
    curvature = inner(step, change)
    if curvature > _CURVED * np.sqrt(inner(step, step) * inner(change, change)):
        pairs.append(_Pair(step, change, curvature))


def _line_search(
    traced: Traced, x: Vector, value: float, direction: Vector, slope: float, step: float
) -> tuple[float, float, Vector]:
    """First step that lowers the value enough, with value and gradient there; 0 where there is none."""
    for _ in range(_MOST_HALVINGS):
        new_value, new_gradient = traced(x + np.float32(step) * direction)
        if new_value <= value + _SUFFICIENT * step * slope + _VALUE_NOISE * abs(value):
            return step, new_value, np.asarray(new_gradient, dtype=np.float32)
        vertex = -slope * step**2 / (2 * (new_value - value - slope * step))
        step = min(max(vertex, _SHORTEST * step), _LONGEST * step)
    return 0.0, value, direction
