"""The ways of one scene, run and timed: interleaved, so that what disturbs the machine disturbs all of them.

Where the pane stands is found once per rung and round, whatever solver, start and tolerance follow: their seconds are
those of the rung's own separation, less its solve, and of the solve. Rungs that find the same scene share its solves.
"""

from __future__ import annotations

import resource
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import TypeVar

from polaropt.capture import NoiseModel, measured_noise
from polaropt.errors import InputError
from polaropt.optics import SceneParameters
from polaropt.progress import Stages
from polaropt.solving import Settings, Solution, solve
from solvers.base import MissingPackage
from studies.camera import Sample
from studies.kit.timing import peak_above
from studies.scores import psnr
from studies.speed_accuracy_rows import LAYERS
from studies.ways import DEFAULT, Layers, NotRun, Way

Made = TypeVar("Made")

_OF_THE_SOLVE = ("Closed form", "Setting up", "Solving")
# What takes longer than this is run once: the chart's axis is logarithmic.
_SLOW_SECONDS = 3.0


@dataclass(frozen=True)
class Seconds:
    """Elapsed, and of all threads together."""

    elapsed: float
    cpu: float

    def __add__(self, other: Seconds) -> Seconds:
        return Seconds(self.elapsed + other.elapsed, self.cpu + other.cpu)


@dataclass
class Timed:
    """How near a way comes to the true layers, and the seconds of every run.

    Attributes
    ----------
    levels : dict of str to float
        PSNR in dB of each layer that it shows.
    rung : str
        That was taken.
    evaluations : int
    seconds : list of Seconds
    peak_mb : float
    not_run : str
        Why; empty if it was.
    """

    levels: dict[str, float] = field(default_factory=dict)
    rung: str = ""
    evaluations: int = 0
    seconds: list[Seconds] = field(default_factory=list)
    peak_mb: float = float("nan")
    not_run: str = ""

    @property
    def over(self) -> bool:
        """Whether it need not run again."""
        return bool(self.not_run) or any(run.cpu > _SLOW_SECONDS for run in self.seconds)


@dataclass(frozen=True)
class _Found:
    """What a rung finds, the rung taken and the seconds of all but the solve."""

    scene: SceneParameters
    rung: str
    noise: tuple[float, NoiseModel]
    seconds: Seconds


@dataclass(frozen=True)
class _Solved:
    """What a solve reached, and the seconds of it alone."""

    levels: dict[str, float]
    evaluations: int
    seconds: Seconds


def run_ways(sample: Sample, ways: Sequence[Way], repeats: int) -> dict[Way, Timed]:
    """Run every way `repeats` times, round by round.

    Parameters
    ----------
    sample : Sample
        The scene.
    ways : sequence of Way
    repeats : int
    """
    timed = {way: Timed() for way in ways}
    for _ in range(repeats):
        found: dict[str, _Found | str] = {}
        solved: dict[tuple[object, ...], _Solved] = {}
        for way, all_runs in timed.items():
            if all_runs.over:
                continue
            try:
                if way.ours:
                    _run_ours(sample, way, all_runs, found, solved)
                else:
                    layers, seconds = _clocked(partial(way.layers, sample))
                    all_runs.levels = _levels(sample, layers)
                    all_runs.seconds.append(seconds)
            except (InputError, MissingPackage, NotRun) as reason:
                all_runs.not_run = str(reason)
    return timed


def measure_memory(sample: Sample, timed: dict[Way, Timed]) -> None:
    """Run every way once more and note the most memory that it takes above its photographs."""
    for way, runs in timed.items():
        if not runs.not_run:
            runs.peak_mb = peak_above(_whole(sample, way))


def _whole(sample: Sample, way: Way) -> Callable[[], object]:
    return partial(way.separation if way.ours else way.layers, sample)


def _run_ours(
    sample: Sample,
    way: Way,
    runs: Timed,
    found: dict[str, _Found | str],
    solved: dict[tuple[object, ...], _Solved],
) -> None:
    if way.rung not in found:
        try:
            found[way.rung] = _find(sample, way.rung)
        except InputError as reason:
            found[way.rung] = str(reason)
    here = found[way.rung]
    if isinstance(here, str):
        raise InputError(here)
    key = (here.scene, way.solver, way.start, way.relative_change)
    if key not in solved:
        solution, seconds = _clocked(partial(_solve, sample, here, way))
        levels = _levels(sample, (solution.layers[0], solution.layers[1]))
        solved[key] = _Solved(levels, solution.solver.n_evaluations, seconds)
    runs.rung, runs.levels, runs.evaluations = here.rung, solved[key].levels, solved[key].evaluations
    runs.seconds.append(here.seconds + solved[key].seconds)


def _find(sample: Sample, rung: str) -> _Found:
    """Separate by default on this rung; what its solve takes is not counted."""
    result = replace(DEFAULT, rung=rung).separation(sample)
    elapsed, cpu = (
        sum(seconds for stage, seconds in clock.items() if stage not in _OF_THE_SOLVE)
        for clock in (result.seconds, result.cpu_seconds)
    )
    return _Found(result.scene, result.scene.rung, measured_noise(sample.capture), Seconds(elapsed, cpu))


def _solve(sample: Sample, found: _Found, way: Way) -> Solution:
    noise, growth = found.noise
    settings = Settings(solver=way.solver, init=way.start, stopping=way.stopping)
    return solve(sample.capture, found.scene, noise, settings, Stages(), growth=growth)


def _levels(sample: Sample, layers: Layers) -> dict[str, float]:
    shown = zip(LAYERS, layers, sample.layers, strict=True)
    return {name: psnr(layer, true) for name, layer, true in shown if layer is not None}


def _clocked(call: Callable[[], Made]) -> tuple[Made, Seconds]:
    began = (time.perf_counter(), _cpu_seconds())
    made = call()
    return made, Seconds(time.perf_counter() - began[0], _cpu_seconds() - began[1])


def _cpu_seconds() -> float:
    """Of this process, and of those that it has started and that are over: one method has its own interpreter."""
    others = resource.getrusage(resource.RUSAGE_CHILDREN)
    return time.process_time() + others.ru_utime + others.ru_stime
