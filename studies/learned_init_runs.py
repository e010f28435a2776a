"""One scene solved from every start: by the default rule, and on to the minimum, with what every evaluation gave."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from polaropt.capture import Capture, NoiseModel, measured_noise
from polaropt.estimation import find_scene
from polaropt.optics import SceneParameters
from polaropt.progress import Stages
from polaropt.solving import Problem, Settings, Solution, Weights, initializers, solve, take_start
from solvers.base import StoppingRule
from solvers.registry import get_solver
from studies.benchmark_race import GAP, NEAR_DB, Clock
from studies.model_ladder import quality
from studies.protocol import Pair
from studies.stability_capture import Taken, take
from studies.stability_scenes import Case

Images = NDArray[np.float32]

COLD, CLOSED_FORM, LEARNED = "cold", "closed-form", "learned"
_LEFT_OUT = "per-pixel"
_CONVERGED_CHANGE = 1e-6
_PATH = 24


@dataclass(frozen=True)
class Row:
    """One start on one scene. PSNR in dB over the pixels that no photograph clips.

    Attributes
    ----------
    family, case, incidence_deg, noise, pair
        The scene, see `studies.learned_init_scenes`.
    start : str
    rung : str
        Of the scene model that was taken.
    transmission_start, reflection_start : float
        Of the start alone.
    transmission_stopped, reflection_stopped : float
        Where `separate` ends by its default rule.
    transmission_converged, reflection_converged : float
        At the minimum that the start leads to (relative change 1e-6).
    misfit_start, misfit_stopped : float
        Over that of the noise.
    status : str
        Why the default solve ended.
    gap : float
        How far the minimum lies above the lowest of all starts, in parts of the way there from the cold start.
    short_db : float
        How far its transmission lies below that at the lowest.
    evaluations_stopped, evaluations_gap, evaluations_near : float
        Until the default end, the gap of the benchmark and the final transmission less 0.1 dB; NaN where never.
    cpu_scene, cpu_start : float
        CPU seconds of the blind estimate, and of all that a start needs before the first evaluation, networks included.
    cpu_stopped, cpu_gap, cpu_near, seconds_stopped, seconds_gap, seconds_near : float
        CPU and elapsed seconds until there, scene and start included.
    path : tuple of float
        Transmission after each of the first evaluations.
    """

    family: str
    case: str
    incidence_deg: float
    noise: float
    pair: int
    start: str
    rung: str
    transmission_start: float
    reflection_start: float
    transmission_stopped: float
    reflection_stopped: float
    transmission_converged: float
    reflection_converged: float
    misfit_start: float
    misfit_stopped: float
    status: str
    gap: float
    short_db: float
    evaluations_stopped: float
    evaluations_gap: float
    evaluations_near: float
    cpu_scene: float
    cpu_start: float
    cpu_stopped: float
    cpu_gap: float
    cpu_near: float
    seconds_stopped: float
    seconds_gap: float
    seconds_near: float
    path: tuple[float, ...]

    @property
    def worse_minimum(self) -> bool:
        """Whether it ends higher in the objective than another start does, by more than the benchmark's gap."""
        return self.gap > GAP

    @property
    def worse_transmission(self) -> bool:
        """Whether the transmission at its minimum is worse than at the lowest one's."""
        return self.short_db > NEAR_DB


def start_names() -> tuple[str, ...]:
    """The starts that are compared: all that are installed, but for the one that knows no double images."""
    return tuple(start.name for start in initializers() if start.installed and start.name != _LEFT_OUT)


@dataclass(frozen=True)
class Point:
    """An evaluation: value, misfit over that of the noise, PSNR of both layers, elapsed and CPU seconds."""

    value: float
    misfit: float
    transmission: float
    reflection: float
    seconds: tuple[float, float]


@dataclass
class _Course:
    """A solve to the minimum: seconds before its first evaluation, and a point for each one."""

    before: tuple[float, float] = (0.0, 0.0)
    points: list[Point] = field(default_factory=list)

    @property
    def end(self) -> Point:
        return min(self.points, key=lambda point: point.value)


@dataclass(frozen=True)
class _Scene:
    """A capture whose scene was found blind, with the truth."""

    taken: Taken
    scene: SceneParameters
    noise: float
    growth: NoiseModel
    seconds: tuple[float, float]

    @property
    def capture(self) -> Capture:
        return self.taken.capture

    def psnr(self, layers: Images) -> tuple[float, float]:
        """Of both layers on the frame."""
        unclipped = self.capture.valid.all(axis=(0, 1))
        return quality(layers, (self.taken.layers[0], self.taken.layers[1]), unclipped)


def rows_of(case: Case, pair: Pair, most_evaluations: int) -> list[Row]:
    """Solve one scene from every start; no rows where the photographs show no polarized light.

    Parameters
    ----------
    case : Case
    pair : Pair
    most_evaluations : int
        Of a solve to the minimum.
    """
    with threadpool_limits(1, "blas"):
        scene = _found(take(case, pair))
        if not scene.scene.signal:
            return []
        courses = {start: _course(scene, start, most_evaluations) for start in start_names()}
        lowest = min((course.end for course in courses.values()), key=lambda point: point.value)
        way = courses[COLD].points[0].value - lowest.value
        return [_row(case, pair, start, scene, _Judged(course, lowest, way)) for start, course in courses.items()]


def _found(taken: Taken) -> _Scene:
    clock = Clock()
    noise, growth = measured_noise(taken.capture)
    scene = find_scene(taken.capture, taken.told, noise).scene
    return _Scene(taken, scene, noise, growth, clock.read())


def _course(scene: _Scene, start: str, most_evaluations: int) -> _Course:
    course, clock = _Course(), Clock()
    problem = Problem(scene.capture, scene.scene, scene.noise, Weights(), growth=scene.growth)
    layers = take_start(problem, start)
    objective = problem.compiled(layers)
    z = objective.coordinates(layers)
    course.before = clock.read()

    def evaluate(z: Any) -> tuple[float, Any]:
        value, gradient = objective.value_and_grad(z)
        seconds = clock.read()
        with clock.paused():
            # Looking at the layers overwrites the gradient's buffer.
            gradient = gradient.copy()
            found, terms = objective.solution(z)
            quality = scene.psnr(problem.canvas.crop(found))
            misfit = terms["misfit"].value / problem.misfit_of_noise
            course.points.append(Point(value, misfit, *quality, seconds))
        return value, gradient

    stopping = StoppingRule(max_evaluations=most_evaluations, relative_change=_CONVERGED_CHANGE)
    get_solver("lbfgs").minimize(evaluate, z, stopping)
    return course


@dataclass(frozen=True)
class _Judged:
    """A course against the lowest point of all, and the way there from the cold start."""

    course: _Course
    lowest: Point
    way: float

    def gap(self, point: Point) -> float:
        return (point.value - self.lowest.value) / max(self.way, 1e-12)

    def arrival(self, *, gap: bool) -> int | None:
        """First evaluation within the gap, or near the final transmission."""
        least = self.lowest.transmission - NEAR_DB
        for i, point in enumerate(self.course.points):
            if self.gap(point) <= GAP if gap else point.transmission >= least:
                return i
        return None


def _row(case: Case, pair: Pair, start: str, scene: _Scene, judged: _Judged) -> Row:
    stopped, stopped_seconds = _stopped(scene, start)
    course = judged.course
    first, end = course.points[0], course.end
    enough = 0.5 * float(scene.capture.valid.sum())
    at = {name: judged.arrival(gap=name == "gap") for name in ("gap", "near")}
    counts = {f"evaluations_{name}": math.nan if i is None else float(i + 1) for name, i in at.items()}
    times = {name: None if i is None else course.points[i].seconds for name, i in at.items()}
    return Row(
        case.family, case.name, case.incidence_deg, case.taking.noise, pair.number, start, scene.scene.rung,
        first.transmission, first.reflection, *scene.psnr(stopped.layers), end.transmission, end.reflection,
        misfit_start=first.misfit,
        misfit_stopped=stopped.terms["misfit"].value / enough,
        status=stopped.solver.status.name,
        gap=judged.gap(end),
        short_db=judged.lowest.transmission - end.transmission,
        evaluations_stopped=float(stopped.solver.n_evaluations),
        **counts,
        cpu_scene=scene.seconds[1],
        cpu_start=course.before[1],
        **_clocks(scene.seconds, {"stopped": stopped_seconds, **times}),
        path=tuple(point.transmission for point in course.points[:_PATH]),
    )  # fmt: skip


def _clocks(before: tuple[float, float], times: dict[str, tuple[float, float] | None]) -> dict[str, float]:
    """Columns of elapsed and CPU seconds since the photographs were there."""
    return {
        f"{clock}_{name}": math.nan if seconds is None else before[i] + seconds[i]
        for i, clock in enumerate(("seconds", "cpu"))
        for name, seconds in times.items()
    }


def _stopped(scene: _Scene, start: str) -> tuple[Solution, tuple[float, float]]:
    """What `separate` does once the scene is found, and its seconds."""
    clock = Clock()
    solution = solve(scene.capture, scene.scene, scene.noise, Settings(init=start), Stages(), growth=scene.growth)
    return solution, clock.read()
