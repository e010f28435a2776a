"""One wrapper that counts, times and records evaluations, and stops what must be stopped."""

from __future__ import annotations

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
        self.best_value = np.inf
        self.trace: list[TracePoint] = []

    def __call__(self, x: Vector) -> tuple[float, Vector]:
        """Value and gradient at `x`; raises `StopSolving` where the rule or a non-finite value says so."""
        self._check_limits()
        value, gradient = self._objective(x)
        norm = float(np.linalg.norm(gradient))
        if not (np.isfinite(value) and np.isfinite(norm)):
            raise StopSolving(Status.NOT_FINITE)
        self.trace.append(TracePoint(len(self.trace) + 1, time.perf_counter() - self._started, value, norm))
        if value < self.best_value:
            self.best_value = value
            self._best = np.array(x, dtype=np.float32)
        if np.abs(gradient).max() <= self._stopping.gradient_norm:
            raise StopSolving(Status.SMALL_GRADIENT)
        return value, gradient

    def result(self, status: Status, n_iterations: int, start: Vector) -> SolverResult:
        """The best point seen, with the trace."""
        return SolverResult(
            x=np.asarray(start, dtype=np.float32) if self._best is None else self._best,
            value=float(self.best_value),
            n_evaluations=len(self.trace),
            n_iterations=n_iterations,
            status=status,
            seconds=time.perf_counter() - self._started,
            trace=self.trace,
        )

    def _check_limits(self) -> None:
        if len(self.trace) >= self._stopping.max_evaluations:
            raise StopSolving(Status.EVALUATION_LIMIT)
        seconds = self._stopping.seconds
        if seconds is not None and time.perf_counter() - self._started > seconds:
            raise StopSolving(Status.TIME_LIMIT)
