"""One wrapper that counts, times and records evaluations, and stops what must be stopped."""

from __future__ import annotations

import math
import time

import numpy as np

from solvers.base import SolverResult, Status, StoppingRule, TracePoint, ValueAndGrad, Vector


class StopSolving(Exception):
    """Raised inside an evaluation to end a solver; carries the reason."""

    def __init__(self, status: Status) -> None:
        super().__init__(status.value)
        self.status = status


class Traced:
    """An objective that remembers its evaluations and the best point."""

    def __init__(self, objective: ValueAndGrad, stopping: StoppingRule) -> None:
        self._objective = objective
        self._stopping = stopping
        self._started = time.perf_counter()
        self._best: Vector | None = None
        self.best_value = math.inf
        self.n_evaluations = 0
        self.trace: list[TracePoint] = []

    def __call__(self, x: Vector) -> tuple[float, Vector]:
        """Value and gradient at `x`; raises `StopSolving` where the rule or a non-finite value says so."""
        self._check_limits()
        self.n_evaluations += 1
        value, gradient = self._objective(x)
        value, norm = float(value), float(np.linalg.norm(np.asarray(gradient, dtype=np.float64)))
        if not (math.isfinite(value) and math.isfinite(norm)):
            raise StopSolving(Status.NOT_FINITE)
        self.trace.append(TracePoint(self.n_evaluations, self._seconds(), value, norm))
        if value < self.best_value:
            self.best_value = value
            self._best = np.array(x, dtype=np.float32)
        if np.abs(gradient).max(initial=0) <= self._stopping.gradient_norm:
            raise StopSolving(Status.SMALL_GRADIENT)
        return value, gradient

    def result(self, status: Status, n_iterations: int, start: Vector) -> SolverResult:
        """The best point seen, with the trace."""
        return SolverResult(
            x=np.array(start, dtype=np.float32) if self._best is None else self._best,
            value=self.best_value,
            n_evaluations=self.n_evaluations,
            n_iterations=n_iterations,
            status=status,
            seconds=self._seconds(),
            trace=self.trace,
        )

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
