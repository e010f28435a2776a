"""IPOPT with a limited-memory Hessian, through casadi: a cross-check for small images."""

from __future__ import annotations

import io
from contextlib import ExitStack, redirect_stderr
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from solvers.base import SolverResult, Status, StoppingRule, TooLarge, ValueAndGrad, Vector
from solvers.scaled import Scaled
from solvers.trace import Progress, StopSolving, Traced

# Each iteration takes some 6 microseconds per unknown, several hundred times what the others take.
MOST_UNKNOWNS = 100_000


@dataclass(frozen=True)
class CasadiIPOPT:
    """Options of IPOPT as casadi brings it: an interior-point method in float64, here without constraints."""

    history: int = 5
    """Pairs of steps and gradient differences that are kept."""

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
        from solvers.casadi_callbacks import nonlinear_program

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
            "limited_memory_max_history": self.history,
            # The usual scale of L-BFGS: IPOPT's own makes steps that are too long.
            "limited_memory_initialization": "scalar2",
            # No tolerated rises: our rule counts iterations that lower nothing.
            "watchdog_shortened_iter_trigger": 0,
            "max_iter": 10 * stopping.max_evaluations + 100,
            "tol": 1e-30,
            "dual_inf_tol": 1e-30,
            "acceptable_iter": 0,
        }


class Evaluations:
    """What IPOPT asks for: value and gradient one after the other, and whether to go on."""

    def __init__(self, traced: Traced, progress: Progress, silenced: ExitStack) -> None:
        self._scaled, self._progress, self._silenced = Scaled(traced), progress, silenced
        self._x: NDArray[np.float64] | None = None
        self._known: tuple[float, NDArray[np.float64]] = (0.0, np.zeros(0))
        self._raised: BaseException | None = None

    def at(self, x: NDArray[np.float64]) -> tuple[float, NDArray[np.float64]]:
        """Value and gradient at `x`, evaluated once for both."""
        try:
            if self._raised is not None:
                raise self._raised
            if self._x is None or not np.array_equal(x, self._x):
                self._known = self._scaled(x)
                self._x = x
            return self._known
        except BaseException as raised:
            self._raised = raised
            # The one exception that casadi takes for an order to stop; it also prints a line about it.
            self._silenced.enter_context(redirect_stderr(io.StringIO()))
            raise KeyboardInterrupt from raised

    def goes_on(self, iteration: int) -> bool:
        """Note that an iteration has ended; whether there shall be another."""
        try:
            if iteration:
                self._progress.iteration()
        except StopSolving as stop:
            self._raised = stop
        return self._raised is None

    def status(self, told: str) -> Status:
        """Why it stopped; raises what is not a reason to stop but an error."""
        if self._raised is None:
            if told == "NonIpopt_Exception_Thrown":
                raise KeyboardInterrupt
            if told == "Insufficient_Memory":
                raise MemoryError("IPOPT found no memory")
            # With its tests off it ends by itself only where it finds nothing lower.
            return Status.ROUNDOFF_LIMITED
        if not isinstance(self._raised, StopSolving):
            raise self._raised
        return self._raised.status
