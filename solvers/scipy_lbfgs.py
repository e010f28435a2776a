"""scipy's L-BFGS-B, without bounds."""

from __future__ import annotations

import numpy as np

from solvers.base import (
    HISTORY,
    Progress,
    Scaled,
    SolverResult,
    Status,
    StoppingRule,
    StopSolving,
    Traced,
    ValueAndGrad,
    Vector,
)


class ScipyLBFGSB:
    """scipy.optimize's L-BFGS-B."""

    def minimize(self, objective: ValueAndGrad, start: Vector, stopping: StoppingRule) -> SolverResult:
        """Minimize `objective` from `start` until `stopping` says so."""
        from scipy.optimize import minimize

        traced = Traced(objective, stopping)
        progress = Progress(traced, stopping)
        scaled = Scaled(traced)
        # Its own tests look at one step alone and can stop far from the minimum (scipy#23161); ours replace them.
        unlimited = 10 * stopping.max_evaluations + 100
        options = {"maxcor": HISTORY, "ftol": 0.0, "gtol": 0.0, "maxfun": unlimited, "maxiter": unlimited}
        try:
            minimize(
                scaled,
                start.astype(np.float64),
                jac=True,
                method="L-BFGS-B",
                callback=lambda x: progress.iteration(),
                options=options,
            )
            # With its tests off it ends by itself only where a line search finds nothing lower.
            status = Status.ROUNDOFF_LIMITED
        except StopSolving as stop:
            status = stop.status
        return traced.result(status, progress.count, start)
