"""What solvers take and give, and the course of a solve as all of them keep it."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from enum import Enum
from importlib import import_module
from importlib.util import find_spec
from numbers import Real
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

# BLAS works on rows of this length in one thread.
_ROW = 8192
HISTORY = 5
"""Pairs of steps and gradient differences that the backends of others keep, the same for all: set by hand."""
# Squares between these are held by float32 with all their digits.
_SMALL, _LARGE = 1e-24, 1e30


@dataclass(frozen=True)
class Norms:
    """How to measure a gradient, of whatever kind of array."""

    euclidean: Callable[[Any], float]
    """Not finite where an entry is not."""
    largest: Callable[[Any], float]
    """The largest absolute entry."""


def euclidean(gradient: NDArray[Any]) -> float:
    """Euclidean norm: rows in the array's own precision, their sum in float64."""
    flat = gradient.ravel()
    whole = flat.size // _ROW * _ROW
    rows, rest = flat[:whole].reshape(-1, _ROW), flat[whole:]
    with np.errstate(all="ignore"):
        square = float(np.vecdot(rows, rows).sum(dtype=np.float64)) + float(np.dot(rest, rest))
    if not _SMALL < square < _LARGE:
        # Zero, overflow, underflow or not finite: once more, carefully.
        square = sum(_square(flat[start : start + _ROW]) for start in range(0, flat.size, _ROW))
    return math.sqrt(square)


def _square(part: NDArray[Any]) -> float:
    with np.errstate(all="ignore"):
        return float(np.square(part, dtype=np.float64).sum())


def distance(a: NDArray[Any], b: NDArray[Any]) -> float:
    """Euclidean distance of two points, part by part."""
    parts = (slice(start, start + _ROW) for start in range(0, a.size, _ROW))
    return math.sqrt(sum(_square(a[part].astype(np.float64) - b[part]) for part in parts))


def largest(gradient: NDArray[Any]) -> float:
    """Largest absolute entry; 0 where there is none."""
    return max(float(gradient.max(initial=0)), -float(gradient.min(initial=0)))


NUMPY = Norms(euclidean, largest)

Vector = NDArray[np.float32]
ValueAndGrad = Callable[[Vector], tuple[float, Vector]]


class TooLarge(ValueError):
    """A solver cannot take so many unknowns; the text is one line that says how many it takes and names others."""


class MissingPackage(ImportError):
    """A package is not installed, or broken; the text is one line that says how to install it."""


def check_package(package: str, asked: str, install: str) -> None:
    """Import a package that something asks for.

    Parameters
    ----------
    package : str
    asked : str
        What needs it, as a sentence begins.
    install : str
        What pip is told to install.

    Raises
    ------
    MissingPackage
        It is not there, or is there and cannot be imported.
    """
    if find_spec(package) is None:
        raise MissingPackage(f"{asked} needs the package {package}: pip install {install}", name=package)
    try:
        import_module(package)
    except (Exception, SystemExit) as error:  # whatever a broken package raises
        raise MissingPackage(
            f"{asked} needs the package {package}, which is installed and broken ({reason_of(error)}): "
            f"pip install --force-reinstall {package}",
            name=package,
        ) from error


def reason_of(error: BaseException) -> str:
    """What the code of others raised, on one line."""
    told = " ".join(str(error).split())
    return told if told.isprintable() and told else ascii(told)[1:-1] or type(error).__name__


class Status(Enum):
    """Why a solver stopped; the value is the sentence that a user reads."""

    CONVERGED = "The objective changed by less than the tolerance."
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
    """When to stop, in one vocabulary for all solvers.

    Examples
    --------
    After ten evaluations at most, or after two seconds:

    >>> from polaropt import StoppingRule
    >>> rule = StoppingRule(max_evaluations=10, seconds=2.0)
    >>> rule.max_evaluations, rule.relative_change
    (10, 0.0005)
    """

    max_evaluations: int = 200
    """Evaluations of objective and gradient, at most. Of 40 random panes before a lens, or bent, to fit on
    (`studies.random_windows`, even seeds from 9000) 37 end within 60, three after 95 to 160, 2 dB better than at 60."""
    relative_change: float = 5e-4
    """Stop when iterations in a row lower the objective by less than this share of it each; 0: never."""
    gradient_norm: float = 0.0
    """Stop when no entry of the gradient is larger."""
    seconds: float | None = None
    """Stop after this time; the evaluation that runs is completed."""
    slow_iterations: int = 2
    """Iterations in a row that must lower the objective by so little."""

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            if not isinstance(value, Real) and not (name == "seconds" and value is None):
                raise ValueError(f"{name} is {value!r}; give a number")
        # Written so that NaN fails too.
        for name in ("max_evaluations", "slow_iterations"):
            if not (getattr(self, name) >= 1 and getattr(self, name) % 1 == 0):
                raise ValueError(f"{name} is {getattr(self, name)}; give a whole number from 1 on")
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
        self.check_limits()
        # An objective that ends the solve by itself is not counted.
        value, gradient = self._objective(x)
        if gradient.shape != x.shape:
            raise ValueError(f"the objective gave a gradient of shape {gradient.shape} at a point of shape {x.shape}")
        self.note(x, float(value), self._norms.euclidean(gradient), lambda: self._norms.largest(gradient))
        return value, gradient

    def note(self, x: Any, value: float, norm: float, largest: Callable[[], float]) -> None:
        """Take in an evaluation; raises `StopSolving` where its gradient is small or anything is not finite.

        Parameters
        ----------
        x : array
            Not copied.
        value : float
        norm : float
            Of the gradient.
        largest : callable
            Gives the gradient's largest absolute entry.
        """
        self.n_evaluations += 1
        if not (math.isfinite(value) and math.isfinite(norm)):
            raise NotFinite
        cpu_seconds = time.process_time() - self._cpu_started
        self.trace.append(TracePoint(self.n_evaluations, self._seconds(), value, norm, cpu_seconds))
        if value < self.best_value:
            self.best_value, self.best = value, x
        limit = self._stopping.gradient_norm
        # The norm alone nearly always tells.
        if norm == 0 or (norm <= limit * math.sqrt(x.shape[0]) and largest() <= limit):
            raise StopSolving(Status.SMALL_GRADIENT)

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

    def _seconds(self) -> float:
        return time.perf_counter() - self._started

    def check_limits(self) -> None:
        """Raises `StopSolving` where the rule allows no more evaluation."""
        if self.n_evaluations >= self._stopping.max_evaluations:
            raise StopSolving(Status.EVALUATION_LIMIT)
        seconds = self._stopping.seconds
        # The first evaluation is always made: without it there is no result.
        if seconds is not None and self.n_evaluations and self._seconds() > seconds:
            raise StopSolving(Status.TIME_LIMIT)


class Progress:
    """Counts iterations and stops when some in a row lower the objective too little."""

    def __init__(self, traced: Traced, stopping: StoppingRule) -> None:
        self._traced, self._tolerance = traced, stopping.relative_change
        self._patience = stopping.slow_iterations
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
        if self._slow == self._patience:
            raise StopSolving(Status.CONVERGED if self._tolerance else Status.ROUNDOFF_LIMITED)


class Scaled:
    """The objective in units of its first value, in float64: the constants of most solvers expect values near 1."""

    def __init__(self, traced: Traced) -> None:
        self._traced = traced
        self._unit = 0.0

    def __call__(self, x: NDArray[np.float64]) -> tuple[float, NDArray[np.float64]]:
        """Value and gradient at `x`."""
        # A fresh array, which `Traced` may keep.
        value, gradient = self._traced(x.astype(np.float32))
        if self._unit == 0.0:
            self._unit = abs(value) or 1.0
        return value / self._unit, np.divide(gradient, self._unit, dtype=np.float64)
