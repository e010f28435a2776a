"""The words every solver speaks: what it minimizes, when it stops, what it returns."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from enum import Enum
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

Vector = NDArray[np.float32]
ValueAndGrad = Callable[[Vector], tuple[float, Vector]]


class TooLarge(ValueError):
    """A solver cannot take so many unknowns; the text is one line that says how many it takes and names others."""


class MissingPackage(ImportError):
    """A solver's package is not installed; the text is one line that says how to install it."""


class Status(Enum):
    """Why a solver stopped; the value is the sentence that a user reads."""

    CONVERGED = "The objective changed by less than the tolerance."
    EXPLAINED = "The photographs are explained to their noise."
    SMALL_GRADIENT = "The gradient is smaller than the tolerance."
    EVALUATION_LIMIT = "The limit of evaluations was reached."
    TIME_LIMIT = "The limit of seconds was reached."
    ROUNDOFF_LIMITED = "No further progress is possible in the precision of the arithmetic."
    NOT_FINITE = "The objective became infinite or NaN; the best point before is returned."
    NOT_RUN = "There was nothing to solve."

    @property
    def success(self) -> bool:
        """Whether the point is a minimum as far as the stopping rule asks."""
        return self not in (Status.EVALUATION_LIMIT, Status.TIME_LIMIT, Status.NOT_FINITE)


@dataclass(frozen=True)
class StoppingRule:
    """When to stop, in one vocabulary for all solvers."""

    max_evaluations: int = 60
    """Evaluations of objective and gradient, at most."""
    relative_change: float = 5e-4
    """Stop when two iterations in a row lower the objective by less than this share of it each; 0: never."""
    gradient_norm: float = 0.0
    """Stop when no entry of the gradient is larger."""
    seconds: float | None = None
    """Stop after this time; the evaluation that runs is completed."""

    def __post_init__(self) -> None:
        # Written so that NaN fails too.
        if not self.max_evaluations >= 1:
            raise ValueError(f"max_evaluations is {self.max_evaluations}; give 1 or more")
        for name in ("relative_change", "gradient_norm"):
            if not getattr(self, name) >= 0:
                raise ValueError(f"{name} is {getattr(self, name)}; give 0 or more")
        if self.seconds is not None and not self.seconds > 0:
            raise ValueError(f"seconds is {self.seconds}; give more than 0")


@dataclass(frozen=True)
class TracePoint:
    """One evaluation: its number, the seconds since the start, the value and the gradient's norm."""

    n_evaluations: int
    seconds: float
    value: float
    gradient_norm: float
    cpu_seconds: float = 0.0
    """Processor time of the whole process since the start, all threads together."""


@dataclass(frozen=True)
class SolverResult:
    """The best point found and how it was found."""

    x: Vector
    """float32, of the start's length; the start itself where no evaluation was finite."""
    value: float
    """Of the objective at `x`; infinite where no evaluation was finite."""
    n_evaluations: int
    """All of them, also one that was not finite."""
    n_iterations: int
    status: Status
    seconds: float
    trace: list[TracePoint] = field(repr=False, default_factory=list)
    """The finite evaluations, in order."""
    restarts: int = 0
    """Times that the solver went back to its best point because a value or gradient was not finite."""

    @property
    def sentence(self) -> str:
        """Why it stopped, and whether it had to restart on its way."""
        if not self.restarts:
            return self.status.value
        times = "once" if self.restarts == 1 else f"{self.restarts} times"
        return f"{self.status.value} It restarted {times} from its best point, where a value was not finite."


class Solver(Protocol):
    """A minimizer of a smooth function of a flat vector."""

    def minimize(self, objective: ValueAndGrad, start: Vector, stopping: StoppingRule) -> SolverResult:
        """Minimize `objective` from `start` until `stopping` says so."""
