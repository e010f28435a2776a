"""A race of solvers to the same gap: the judge, the clock that stands still while it judges, and the finish."""

from __future__ import annotations

import math
from collections.abc import Callable
from copy import copy
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from polaropt.capture import noise_level
from polaropt.solving import Problem, Weights, take_start
from solvers.base import Status, StoppingRule, StopSolving
from solvers.registry import get_solver
from studies.camera import Sample
from studies.kit.run import tell
from studies.kit.timing import Clock
from studies.scores import GAP, NEAR_DB, both_psnr

Images = NDArray[np.float32]

# Runs go on a little beyond the finish, so that the curves show it; a lower minimum found later moves it only a trifle.
_BEYOND = 0.1
_REFERENCE_CHANGE = 1e-6
_REFERENCE_RUNS = (("lbfgs", "closed-form"), ("lbfgs", "cold"), ("lbfgs", "per-pixel"), ("scipy", "closed-form"))


@dataclass(frozen=True)
class Verdict:
    """The objective and the PSNR of both layers at a point, by one judge for all solvers."""

    value: float
    transmission_db: float
    reflection_db: float


class Judge:
    """Judges canvas layers by the compiled objective and by the truth.

    Attributes
    ----------
    problem : Problem
        What the contestants may take as given.
    cold : Images
        The start at the plain intensity.
    """

    def __init__(self, sample: Sample) -> None:
        self.sample = sample
        self.noise = noise_level(sample.capture)
        with threadpool_limits(1, "blas"):
            self.problem = self.new_problem()
        self.cold = self.start("cold")
        self._objective = self.problem.compiled(self.start("closed-form"))

    def new_problem(self) -> Problem:
        """What a contestant sets up by itself."""
        return Problem(self.sample.capture, self.sample.scene, self.noise, Weights())

    def start(self, init: str) -> Images:
        """Canvas layers to start from, by name."""
        # The copy gives up what a solve no longer needs.
        return take_start(copy(self.problem), init)

    def verdict(self, layers: Images) -> Verdict:
        """The verdict on canvas layers (2, channel, H, W)."""
        z = self._objective.coordinates(layers)
        there, terms = self._objective.solution(z)
        value = sum(term.weight * term.value for term in terms.values())
        return Verdict(value, *both_psnr(self.problem.canvas.crop(there), self.sample.layers))


@dataclass(frozen=True)
class Finish:
    """Where a run has arrived: the lowest verdict known, and the value at the cold start."""

    best: Verdict
    cold_value: float

    def gap(self, verdict: Verdict) -> float:
        """What is left of the way from the cold start to the lowest value, 1..0."""
        return (verdict.value - self.best.value) / (self.cold_value - self.best.value)

    def near(self, verdict: Verdict) -> bool:
        """Whether the transmission is as good as at the lowest value, within 0.1 dB."""
        return abs(verdict.transmission_db - self.best.transmission_db) <= NEAR_DB

    def lowered(self, verdicts: list[Verdict]) -> Finish:
        """With the lowest of these, if it is lower."""
        return Finish(min([self.best, *verdicts], key=lambda verdict: verdict.value), self.cold_value)


def find_finish(judge: Judge, max_evaluations: int, say: Callable[[str], None] = tell) -> Finish:
    """The lowest value that runs to a relative change of 1e-6 find from several starts."""
    stopping = StoppingRule(max_evaluations=max_evaluations, relative_change=_REFERENCE_CHANGE)
    verdicts = []
    with threadpool_limits(1, "blas"):
        for solver, init in _REFERENCE_RUNS:
            say(f"reference: {solver}, {init}")
            start = judge.start(init)
            objective = judge.problem.compiled(start)
            solution = get_solver(solver).minimize(objective.value_and_grad, objective.coordinates(start), stopping)
            verdicts.append(judge.verdict(objective.solution(solution.x)[0]))
    best = min(verdicts, key=lambda verdict: verdict.value)
    return Finish(best, judge.verdict(judge.cold).value)


@dataclass(frozen=True)
class Limits:
    """When to break a run off: seconds of solving, and evaluations."""

    seconds: float
    evaluations: int = 10_000


@dataclass(frozen=True)
class Point:
    """The best verdict after an evaluation, and the seconds since the run began, set-up included."""

    seconds: float
    cpu_seconds: float
    verdict: Verdict


@dataclass
class Run:
    """A contestant's run: what it had to set up, and a point for each evaluation."""

    set_up: tuple[float, float] = (0.0, 0.0)
    points: list[Point] = field(default_factory=list)
    status: Status = Status.NOT_RUN
    note: str = ""

    def arrival(self, finish: Finish, *, near: bool = True) -> int | None:
        """Index of the first evaluation within the gap (and near the transmission), None if there is none."""
        for i, point in enumerate(self.points):
            if finish.gap(point.verdict) <= GAP and (not near or finish.near(point.verdict)):
                return i
        return None


class Recorder:
    """Notes every evaluation of a contestant and stops it when it has arrived or takes too long.

    Parameters
    ----------
    judge : Judge
    finish : Finish
    limits : Limits
    """

    def __init__(self, judge: Judge, finish: Finish, limits: Limits) -> None:
        self._judge, self._finish, self._limits = judge, finish, limits
        self._best = math.inf
        self._verdict = Verdict(math.inf, -math.inf, -math.inf)
        self.run = Run()
        self.clock = Clock()

    def set_up(self) -> None:
        """Say that everything is set up and the solve begins."""
        self.run.set_up = self.clock.read()

    def evaluated(self, value: float, layers: Callable[[], Images]) -> None:
        """Note an evaluation; raises `StopSolving` when the run is over.

        Parameters
        ----------
        value : float
            As the contestant sees it.
        layers : callable
            Gives the canvas layers; called off the clock, and only where the value is the lowest so far.
        """
        seconds = self.clock.read()
        with self.clock.paused():
            if value < self._best:
                self._best, self._verdict = value, self._judge.verdict(layers())
            self.run.points.append(Point(*seconds, self._verdict))
            over = self._over(seconds[0] - self.run.set_up[0])
        if over is not None:
            raise StopSolving(over)

    def _over(self, seconds: float) -> Status | None:
        finish, verdict = self._finish, self._verdict
        if finish.gap(verdict) <= _BEYOND * GAP and finish.near(verdict):
            return Status.CONVERGED
        if len(self.run.points) >= self._limits.evaluations:
            return Status.EVALUATION_LIMIT
        return Status.TIME_LIMIT if seconds > self._limits.seconds else None


def watched(
    objective: Callable[[Any], tuple[float, Any]], layers: Callable[[Any], Images], recorder: Recorder
) -> Callable[[Any], tuple[float, Any]]:
    """An objective whose evaluations the recorder notes; `layers` turns points into canvas layers."""

    def evaluate(x: Any) -> tuple[float, Any]:
        value, gradient = objective(x)
        recorder.evaluated(value, lambda: layers(x))
        return value, gradient

    return evaluate
