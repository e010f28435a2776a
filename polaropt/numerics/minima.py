"""Minima of functions that are costly and a little rough: parabolas on a line, a model within bounds.

References
----------
M. J. D. Powell, The BOBYQA algorithm for bound constrained optimization without derivatives, 2009.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

_CLOSER = 0.35
"""The next step of a search on a line, in units of the last; set by hand."""
_MOST_MOVES = 4
"""Steps to the side before the steps become shorter anyway; set by hand."""


def local_minimum(
    value: Callable[[float], float], start: float, bounds: tuple[float, float], step: float, tolerance: float
) -> float:
    """Minimum near a start, from points `step` apart and then ever closer, down to `tolerance`.

    Nothing is evaluated outside the bounds, nor twice.
    """
    known: dict[float, float] = {}

    def at(x: float) -> float:
        if x not in known:
            known[x] = value(x) if bounds[0] <= x <= bounds[1] else math.inf
        return known[x]

    best, moves = min(max(start, bounds[0]), bounds[1]), 0
    while step > tolerance:
        before, here, after = (at(best + shift) for shift in (-step, 0.0, step))
        if min(before, after) < here and moves < _MOST_MOVES:
            best, moves = best + (step if after < before else -step), moves + 1
            continue
        at(best + step * vertex(before, here, after))
        best, step = min(known, key=at), step * _CLOSER
    return best


def vertex(before: float, here: float, after: float, farthest: float = 1.0) -> float:
    """Where the parabola through three equally spaced values is least, from the middle, in units of the spacing."""
    curvature = before - 2 * here + after
    if not 0 < curvature < math.inf:
        return 0.0
    return min(max((before - after) / (2 * curvature), -farthest), farthest)


Values = NDArray[np.float64]


def grid_minimum(points: Values, values: Values) -> float:
    """Where values at equally spaced points are least, by the parabola through the least of them and its neighbours."""
    best = min(max(int(np.argmin(values)), 1), points.size - 2)
    return float(points[best] + (points[1] - points[0]) * vertex(*values[best - 1 : best + 2]))


def local_minima(values: Values) -> NDArray[np.bool_]:
    """Which values have none below them beside them along the last axis; at its ends values merely fall."""
    inside = values[..., 1:-1]
    minima = (inside <= values[..., :-2]) & (inside < values[..., 2:])
    return np.pad(minima, [(0, 0)] * (values.ndim - 1) + [(1, 1)])


_TOLERANCE = 0.02
"""Tolerance of a minimum in units of the first step; set by hand."""
_SHARES = (1.0, 0.5, 0.25, 0.1)
"""Shares of a Newton step that are compared until one is worth it; set by hand."""
_FLATTEST = 1e-4
"""Least curvature in units of the greatest: where there is hardly any, a step would go anywhere; set by hand."""


@dataclass(frozen=True)
class NewtonStep:
    """Where a step leads, the value there, and the curvature (n, n) it was made with, in units of the box's steps."""

    point: Values
    value: float
    curvature: Values


@dataclass(frozen=True)
class Box:
    """Where a search starts, how far it steps at first, and its bounds; all of shape (n,)."""

    start: Values
    step: Values
    low: Values
    high: Values

    def minimum(self, score: Callable[[Values], float], most: int, tolerance: float = _TOLERANCE) -> Values:
        """Point of least score, to a tolerance in units of the step, after at most so many evaluations."""
        import nlopt

        if self.start.size == 0:
            return self.start
        # BOBYQA wants two unknowns at least.
        optimizer = nlopt.opt(nlopt.LN_BOBYQA if self.start.size > 1 else nlopt.LN_NELDERMEAD, self.start.size)
        optimizer.set_lower_bounds(self.low / self.step)
        optimizer.set_upper_bounds(self.high / self.step)
        # It wants room for two steps between the bounds.
        room = (self.high - self.low) / (2 * self.step)
        optimizer.set_initial_step(np.where(room > 0, np.minimum(room, 1.0), 1.0))
        optimizer.set_min_objective(lambda x, _: score(x * self.step))
        optimizer.set_maxeval(most)
        optimizer.set_xtol_abs(tolerance)
        start = np.clip(self.start, self.low, self.high) / self.step
        return np.asarray(optimizer.optimize(start) * self.step)

    def newton(self, score: Callable[[Values], float], curvature: Values | None = None) -> NewtonStep:
        """One Newton step, shortened until it is worth it.

        It goes along narrow valleys, in which the search by values alone stands still.

        Parameters
        ----------
        score : callable
        curvature : ndarray, shape (n, n), optional
            That of a step before, which does for the next one. Default: it is measured.
        """
        here = score(self.start)
        if not self.start.size:
            return NewtonStep(self.start, here, np.empty((0, 0)))
        after, before = self._beside(score)
        if curvature is None:
            curvature = self._curvature(score, here, after, before)
        size, axes = np.linalg.eigh(curvature)
        size = np.maximum(np.abs(size), max(_FLATTEST * float(np.abs(size).max()), 1e-30))
        step = -self.step * (axes / size @ (axes.T @ (after - before) / 2))
        for share in _SHARES:
            there = np.clip(self.start + share * step, self.low, self.high)
            value = score(there)
            if value < here:
                return NewtonStep(there, value, curvature)
        return NewtonStep(self.start, here, curvature)

    def curvature(self, score: Callable[[Values], float]) -> Values:
        """Second derivatives (n, n) at the start."""
        measured = self._curvature(score, score(self.start), *self._beside(score))
        return np.asarray(measured / np.outer(self.step, self.step))

    def _beside(self, score: Callable[[Values], float]) -> tuple[Values, Values]:
        """Values one step after and before the start along each coordinate."""
        after, before = (np.array([score(self.start + sign * move) for move in np.diag(self.step)]) for sign in (1, -1))
        return after, before

    def _curvature(self, score: Callable[[Values], float], here: float, after: Values, before: Values) -> Values:
        """Second differences at the start, per step."""
        moves = np.diag(self.step)
        curvature = np.diag(after + before - 2 * here)
        for i, j in zip(*np.tril_indices(self.start.size, -1), strict=True):
            both = score(self.start + moves[i] + moves[j])
            curvature[i, j] = curvature[j, i] = both - after[i] - after[j] + here
        return curvature
