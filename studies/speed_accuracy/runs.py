"""The ways of one scene, run and timed: interleaved, so that what disturbs the machine disturbs all of them.

Where the pane stands is found once per rung and round, whatever solver, start and tolerance follow: their seconds are
those of the rung's own separation, less its solve, and of the solve. Rungs that find the same scene share its solves.
A raw mosaic is read anew in each round, once for each resolution; its seconds are in all ways that begin with it.
"""

from __future__ import annotations

import math
import resource
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import NamedTuple, TypeVar

import numpy as np

from polaropt.capture import NoiseModel
from polaropt.errors import InputError
from polaropt.estimation import still_photographs
from polaropt.optics import SceneParameters
from polaropt.progress import Stages
from polaropt.solving import Settings, Solution, solve
from solvers.base import MissingPackage
from studies.camera import Sample
from studies.kit.timing import peak_above
from studies.scores import LAYERS, psnr
from studies.ways import DEFAULT, Images, Layers, Method, NotRun, Way, method_of, read_mosaic

Made = TypeVar("Made")

_OF_THE_SOLVE = ("Closed form", "Setting up", "Solving")
# What takes longer than this is run once: the chart's axis is logarithmic.
_SLOW_SECONDS = 3.0


class Seconds(NamedTuple):
    """By the clock, and of all threads together."""

    elapsed: float
    cpu: float

    def after(self, other: Seconds) -> Seconds:
        """Of both, one after the other."""
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
    peak_mb: float = math.nan
    not_run: str = ""

    @property
    def over(self) -> bool:
        """Whether it need not run again."""
        return bool(self.not_run) or any(run.cpu > _SLOW_SECONDS for run in self.seconds)


def run_ways(sample: Sample, ways: Sequence[Way], repeats: int) -> dict[Way, Timed]:
    """Run every way of a scene `repeats` times, round by round."""
    timed = {way: Timed() for way in ways}
    for _ in range(repeats):
        here = _Round(sample)
        for way, runs in timed.items():
            if runs.over:
                continue
            try:
                here.run(way, runs)
            except (InputError, MissingPackage, NotRun) as reason:
                runs.not_run = str(reason)
    return timed


def measure_memory(sample: Sample, timed: dict[Way, Timed]) -> None:
    """Run every way once more and note the most memory that it takes above its photographs."""
    for way, runs in timed.items():
        if not runs.not_run:
            seen = read_mosaic(sample, way.resolution if way.ours else method_of(way).resolution)
            runs.peak_mb = peak_above(partial(way.separation if way.ours else way.layers, seen))


class _Found(NamedTuple):
    """What a rung finds, the rung taken and the seconds of all but the solve."""

    scene: SceneParameters
    rung: str
    noise: tuple[float, NoiseModel]
    seconds: Seconds


class _Round:
    """One round of all ways, which share what they have in common."""

    def __init__(self, sample: Sample) -> None:
        self._sample = sample
        self._read: dict[str, tuple[Sample, Seconds]] = {}
        self._found: dict[tuple[str, str], _Found | InputError] = {}
        self._solved: dict[tuple[object, ...], tuple[dict[str, float], int, Seconds]] = {}

    def run(self, way: Way, runs: Timed) -> None:
        """Run a way; raises InputError where its rung does not suit the photographs."""
        if way.ours:
            self._run_solve(way, runs)
            return
        method = method_of(way)
        if method.way is None:
            self._run_method(method, runs)
        else:
            self._run_solve(method.way, runs)

    def _run_solve(self, way: Way, runs: Timed) -> None:
        found = self._find(way.rung, way.resolution)
        key = (found.scene, replace(way, rung=""))
        if key not in self._solved:
            solution, seconds = _clocked(partial(self._solve, found, way))
            levels = _levels(self._sample, (solution.layers[0], solution.layers[1]))
            self._solved[key] = levels, solution.solver.n_evaluations, seconds
        runs.levels, runs.evaluations, solving = self._solved[key]
        runs.rung = found.rung
        runs.seconds.append(solving.after(found.seconds))

    def _run_method(self, method: Method, runs: Timed) -> None:
        sample, reading = self._sample_at(method.resolution)
        layers, seconds = _clocked(partial(method.run, sample))
        runs.levels = _levels(sample, layers)
        runs.seconds.append(seconds.after(reading))

    def _sample_at(self, resolution: str) -> tuple[Sample, Seconds]:
        if resolution not in self._read:
            self._read[resolution] = _clocked(partial(read_mosaic, self._sample, resolution))
        return self._read[resolution]

    def _find(self, rung: str, resolution: str) -> _Found:
        key = (rung, resolution)
        if key not in self._found:
            try:
                self._found[key] = self._separated(rung, resolution)
            except InputError as reason:
                self._found[key] = reason
        found = self._found[key]
        if isinstance(found, InputError):
            raise found
        return found

    def _separated(self, rung: str, resolution: str) -> _Found:
        """Separate by default on this rung; what its solve takes is not counted."""
        sample, reading = self._sample_at(resolution)
        result = replace(DEFAULT, rung=rung).separation(sample)
        elapsed, cpu = (
            sum(seconds for stage, seconds in clock.items() if stage not in _OF_THE_SOLVE)
            for clock in (result.seconds, result.cpu_seconds)
        )
        still = still_photographs(sample.capture).for_layers()
        noise = still.noise, still.growth
        return _Found(result.scene, result.scene.rung, noise, Seconds(elapsed, cpu).after(reading))

    def _solve(self, found: _Found, way: Way) -> Solution:
        noise, growth = found.noise
        settings = Settings(solver=way.solver, device=way.device or None, init=way.start, stopping=way.stopping)
        sample, _ = self._sample_at(way.resolution)
        return solve(sample.capture, found.scene, noise, settings, Stages(), growth=growth)


def _levels(sample: Sample, layers: Layers) -> dict[str, float]:
    shown = zip(LAYERS, layers, sample.layers, strict=True)
    return {name: psnr(enlarged(layer, true.shape), true) for name, layer, true in shown if layer is not None}


def enlarged(layer: Images, shape: tuple[int, ...]) -> Images:
    """A layer as planes (channel, h, w); that of a mosaic's cells by cubic splines in all pixels of the sensor."""
    from scipy.ndimage import zoom

    planes = layer.reshape(shape[0], *layer.shape[-2:])
    if planes.shape == shape:
        return planes
    factors = (1, shape[-2] / planes.shape[-2], shape[-1] / planes.shape[-1])
    # The middle of a cell is the middle of its pixels.
    return np.asarray(zoom(planes, factors, order=3, mode="nearest", grid_mode=True), dtype=np.float32)


def _clocked(call: Callable[[], Made]) -> tuple[Made, Seconds]:
    began = (time.perf_counter(), _cpu_seconds())
    made = call()
    return made, Seconds(time.perf_counter() - began[0], _cpu_seconds() - began[1])


def _cpu_seconds() -> float:
    """Of this process, and of those that it has started and that are over: one method has its own interpreter."""
    others = resource.getrusage(resource.RUSAGE_CHILDREN)
    return time.process_time() + others.ru_utime + others.ru_stime
