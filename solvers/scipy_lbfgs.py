"""scipy's L-BFGS-B, without bounds."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from solvers.base import SolverResult, Status, StoppingRule, ValueAndGrad, Vector
from solvers.trace import StopSolving, Traced


@dataclass(frozen=True)
class ScipyLBFGSB:
    """Options of scipy.optimize's L-BFGS-B."""

    history: int = 10
    """Pairs of steps and gradient differences that are kept."""

    def minimize(self, objective: ValueAndGrad, start: Vector, stopping: StoppingRule) -> SolverResult:
        """Minimize `objective` from `start` until `stopping` says so."""
        from scipy.optimize import minimize

        traced = Traced(objective, stopping)
        scale = _Scale()
        iterations = _Iterations(traced, stopping)

        def scaled(x: NDArray[np.float64]) -> tuple[float, NDArray[np.float64]]:
            value, gradient = traced(x.astype(np.float32))
            return scale(value), gradient.astype(np.float64) / scale.size

        try:
            found = minimize(
                scaled,
                start.astype(np.float64),
                jac=True,
                method="L-BFGS-B",
                callback=iterations,
                # Its own tests look at one step alone and can stop far from the minimum (scipy#23161).
                options={
                    "maxcor": self.history,
                    "ftol": 0.0,
                    "gtol": 0.0,
                    "maxfun": 10 * stopping.max_evaluations + 100,
                    "maxiter": 10 * stopping.max_evaluations + 100,
                },
            )
            status = Status.ROUNDOFF_LIMITED if found.status == 2 else Status.CONVERGED
        except StopSolving as stop:
            status = stop.status
        return traced.result(status, iterations.count, start)


class _Scale:
    """Divides the objective by its first value: L-BFGS-B's first step has the gradient's length."""

    def __init__(self) -> None:
        self.size = 0.0

    def __call__(self, value: float) -> float:
        if self.size == 0.0:
            self.size = max(abs(value), 1e-30)
        return value / self.size


class _Iterations:
    """Counts iterations and stops when one lowers the objective too little."""

    def __init__(self, traced: Traced, stopping: StoppingRule) -> None:
        self._traced, self._stopping = traced, stopping
        self._last = np.inf
        self.count = 0

    def __call__(self, x: NDArray[np.float64]) -> None:
        self.count += 1
        value = self._traced.best_value
        if self._last - value <= self._stopping.relative_change * max(abs(value), 1e-30):
            raise StopSolving(Status.CONVERGED)
        self._last = value
