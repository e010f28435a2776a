"""IPOPT with a limited-memory Hessian, through casadi: a cross-check for small images."""

from __future__ import annotations

from contextlib import ExitStack
from typing import Any

import numpy as np

from solvers.base import (
    HISTORY,
    Progress,
    SolverResult,
    StoppingRule,
    TooLarge,
    Traced,
    ValueAndGrad,
    Vector,
)

# Each iteration takes some 6 microseconds per unknown, several hundred times what the others take.
MOST_UNKNOWNS = 100_000


class CasadiIPOPT:
    """IPOPT as casadi brings it: an interior-point method in float64, here without constraints."""

    def minimize(self, objective: ValueAndGrad, start: Vector, stopping: StoppingRule) -> SolverResult:
        """Minimize `objective` from `start` until `stopping` says so.

        Raises
        ------
        TooLarge
            More unknowns than it takes in reasonable time.
        """
        if start.size > MOST_UNKNOWNS:
            raise TooLarge(
                f"{start.size} unknowns are too many for solver 'casadi', which takes {MOST_UNKNOWNS}; "
                "take 'lbfgs', 'scipy' or 'torch', or a smaller image"
            )
        from solvers.casadi.callbacks import Evaluations, nonlinear_program

        traced = Traced(objective, stopping)
        progress = Progress(traced, stopping)
        with ExitStack() as silenced:
            evaluations = Evaluations(traced, progress, silenced)
            program = nonlinear_program(evaluations, start.size, self._options(stopping))
            program(x0=start.astype(np.float64))
        return traced.result(evaluations.status(program.stats()["return_status"]), progress.count, start)

    def _options(self, stopping: StoppingRule) -> dict[str, Any]:
        """Silent, and with its own tests off: ours replace them."""
        return {
            "print_level": 0,
            "sb": "yes",
            "hessian_approximation": "limited-memory",
            "limited_memory_max_history": HISTORY,
            # The usual scale of L-BFGS: IPOPT's own makes steps that are too long.
            "limited_memory_initialization": "scalar2",
            # No tolerated rises: our rule counts iterations that lower nothing.
            "watchdog_shortened_iter_trigger": 0,
            "max_iter": 10 * stopping.max_evaluations + 100,
            "tol": 1e-30,
            "dual_inf_tol": 1e-30,
            "acceptable_iter": 0,
        }
