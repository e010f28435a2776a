"""NLopt's LD_LBFGS."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from solvers.base import (
    HISTORY,
    Progress,
    Scaled,
    SolverResult,
    Status,
    StoppingRule,
    StopSolving,
    TooLarge,
    Traced,
    ValueAndGrad,
    Vector,
)

# Successive moves along one line are parallel to rounding.
_PARALLEL = 1 - 1e-6
# It counts 999 numbers per unknown in 32 bits; beyond this it fails after one evaluation (NLopt#632).
MOST_UNKNOWNS = 2_149_632


class NLoptLBFGS:
    """NLopt's LD_LBFGS, a limited-memory method in float64.

    It tells nothing of its iterations: a search line has ended where the points evaluated leave it.
    """

    def minimize(self, objective: ValueAndGrad, start: Vector, stopping: StoppingRule) -> SolverResult:
        """Minimize `objective` from `start` until `stopping` says so.

        Raises
        ------
        TooLarge
            More unknowns than it can count.
        """
        if start.size > MOST_UNKNOWNS:
            raise TooLarge(
                f"{start.size} unknowns are too many for solver 'nlopt', which takes {MOST_UNKNOWNS}; "
                "take 'lbfgs', 'scipy' or 'torch', or a smaller image"
            )
        traced = Traced(objective, stopping)
        progress = Progress(traced, stopping)
        evaluations = _Evaluations(traced, progress)
        _optimize(evaluations, start)
        return traced.result(evaluations.status(), progress.count, start)


class _Evaluations:
    """The objective as NLopt calls it; keeps what was raised inside, for NLopt does not always pass it on."""

    def __init__(self, traced: Traced, progress: Progress) -> None:
        self._scaled, self._progress = Scaled(traced), progress
        self._last: NDArray[np.float64] | None = None
        self._move: NDArray[np.float64] | None = None
        self.raised: BaseException | None = None

    def __call__(self, x: NDArray[np.float64], gradient: NDArray[np.float64]) -> float:
        if self.raised is not None:
            raise self.raised
        try:
            if self._turns(x):
                self._progress.iteration()
            value, gradient[:] = self._scaled(x)
        except BaseException as raised:
            self.raised = raised
            raise
        return value

    def _turns(self, x: NDArray[np.float64]) -> bool:
        """Whether the way to `x` leaves the line of the move before."""
        last, before = self._last, self._move
        self._last = x.copy()
        if last is None:
            return False
        self._move = x - last
        if before is None:
            return False
        lengths = np.linalg.norm(before) * np.linalg.norm(self._move)
        return bool(abs(before @ self._move) < _PARALLEL * lengths)

    def status(self) -> Status:
        """Why it stopped; raises what is not a reason to stop but an error."""
        if self.raised is None:
            # With its tests off it ends by itself only where it finds nothing lower.
            return Status.ROUNDOFF_LIMITED
        if not isinstance(self.raised, StopSolving):
            raise self.raised
        return self.raised.status


def _optimize(evaluations: _Evaluations, start: Vector) -> None:
    """Run NLopt until it ends or something is raised inside an evaluation."""
    import nlopt

    optimizer = nlopt.opt(nlopt.LD_LBFGS, start.size)
    optimizer.set_min_objective(evaluations)
    optimizer.set_vector_storage(HISTORY)
    try:
        optimizer.optimize(start.astype(np.float64))
    except MemoryError:
        raise
    except BaseException as error:
        # Its one code for failure also stands for a line search that found nothing lower.
        if evaluations.raised is None and not isinstance(error, nlopt.runtime_error | nlopt.RoundoffLimited):
            raise
