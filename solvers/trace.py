"""One wrapper that counts, times and records evaluations, and stops what must be stopped."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from typing import Any

import numpy as np

from solvers.base import SolverResult, Status, StoppingRule, TracePoint, ValueAndGrad, Vector
from solvers.norms import NUMPY, Norms


class StopSolving(Exception):
    """Raised inside an evaluation to end a solver; carries the reason."""

    def __init__(self, status: Status) -> None:
        super().__init__(status.value)
        self.status = status


class NotFinite(StopSolving):
    """Raised where a value or gradient is not finite: a solver that knows how may go on from the best point."""

    def __init__(self) -> None:
        super().__init__(Status.NOT_FINITE)


class Traced:
    """An objective that remembers its evaluations and the best point.

    Parameters
    ----------
    objective : callable
    stopping : StoppingRule
    norms : Norms
        Of the kind of array that the objective takes.

    Attributes
    ----------
    best : array or None
        The best point, not copied: a solver must not write into an array while it is the best.
    """

    def __init__(self, objective: ValueAndGrad, stopping: StoppingRule, norms: Norms = NUMPY) -> None:
        self._objective = objective
        self._stopping = stopping
        self._norms = norms
        self._started, self._cpu_started = time.perf_counter(), time.process_time()
        self.best: Any = None
        self.best_value = math.inf
        self.n_evaluations = 0
        self.trace: list[TracePoint] = []

    def __call__(self, x: Vector) -> tuple[float, Vector]:
        """Value and gradient at `x`; raises `StopSolving` where the rule or a non-finite value says so."""
        self._check_limits()
        # An objective that ends the solve by itself is not counted.
        value, gradient = self._objective(x)
        self.n_evaluations += 1
        if gradient.shape != x.shape:
            raise ValueError(f"the objective gave a gradient of shape {gradient.shape} at a point of shape {x.shape}")
        value, norm = float(value), self._norms.euclidean(gradient)
        if not (math.isfinite(value) and math.isfinite(norm)):
            raise NotFinite
        cpu_seconds = time.process_time() - self._cpu_started
        self.trace.append(TracePoint(self.n_evaluations, self._seconds(), value, norm, cpu_seconds))
        if value < self.best_value:
            self.best_value, self.best = value, x
        if self._is_small(gradient, norm):
            raise StopSolving(Status.SMALL_GRADIENT)
        return value, gradient

    def result(
        self,
        status: Status,
        n_iterations: int,
        start: Any,
        *,
        restarts: int = 0,
        to_numpy: Callable[[Any], Any] = np.asarray,
    ) -> SolverResult:
        """The best point seen, with the trace; a copy of the start where nothing was finite."""
        point = np.array(to_numpy(start), dtype=np.float32) if self.best is None else to_numpy(self.best)
        return SolverResult(
            x=np.asarray(point, dtype=np.float32),
            value=self.best_value,
            n_evaluations=self.n_evaluations,
            n_iterations=n_iterations,
            status=status,
            seconds=self._seconds(),
            trace=self.trace,
            restarts=restarts,
        )

    def _is_small(self, gradient: Vector, norm: float) -> bool:
        """Whether no entry is larger than the rule's; the norm alone nearly always tells."""
        limit = self._stopping.gradient_norm
        return norm == 0 or (norm <= limit * math.sqrt(gradient.shape[0]) and self._norms.largest(gradient) <= limit)

    def _seconds(self) -> float:
        return time.perf_counter() - self._started

    def _check_limits(self) -> None:
        if self.n_evaluations >= self._stopping.max_evaluations:
            raise StopSolving(Status.EVALUATION_LIMIT)
        seconds = self._stopping.seconds
        # The first evaluation is always made: without it there is no result.
        if seconds is not None and self.n_evaluations and self._seconds() > seconds:
            raise StopSolving(Status.TIME_LIMIT)


class Progress:
    """Counts iterations and stops when two in a row lower the objective too little."""

    def __init__(self, traced: Traced, stopping: StoppingRule) -> None:
        self._traced, self._tolerance = traced, stopping.relative_change
        self._last = math.inf
        self._slow = 0
        self.count = 0

    def iteration(self) -> None:
        """Note that an iteration has ended; raises `StopSolving` where the rule says so."""
        self.count += 1
        value = self._traced.best_value
        # The first iteration is measured against the start.
        before = self._traced.trace[0].value if self.count == 1 else self._last
        slow = before - value <= self._tolerance * abs(value)
        self._slow = self._slow + 1 if slow else 0
        self._last = value
        if self._slow == 2:
            raise StopSolving(Status.CONVERGED if self._tolerance else Status.ROUNDOFF_LIMITED)
