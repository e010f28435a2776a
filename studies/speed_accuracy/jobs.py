"""One scene, seen as four full photographs or as a raw mosaic, in all ways of a part: its rows."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cache
from typing import Literal

from polaropt.separation import separate
from studies.camera import Sample, take
from studies.kit.timing import Threads
from studies.mosaic.demosaicking import LENS_BLUR_PX, trained
from studies.photographs import Photographs, Size, sized_pair
from studies.scenes import SCENES, Sensor
from studies.speed_accuracy.marks import CROSSED, ON_GPU, ONE
from studies.speed_accuracy.runs import Timed, measure_memory, run_ways
from studies.ways import (
    DEFAULT,
    SMALL_ONLY,
    TRAINED_ON_SHIPPED,
    Way,
    crossed,
    one_at_a_time,
    other_methods,
    solvers,
    solves,
)

Choice = Literal["all", "solves", "solvers"]
"""What is changed from the default: everything, all that leaves the scene as it was found, the solver alone."""

PLAIN = ("10 deg", "40 deg", "60 deg", "70 deg", "80 deg", "85 deg")
OTHERS = ("wide lens, 45 deg of view", "wide lens with ghosts", "bent pane, 45 deg of view", "screen behind")
FEW = ("60 deg", "wide lens with ghosts", "screen behind")
# Minutes on large images.
_SLOW_METHODS = ("multiscale physical",)
_LARGEST_FOR_SLOW = 256 * 256
_WARM = Size(64, 64)
_SEEN = "it is trained on the photographs inside scikit-image; name others with --photos"


@dataclass(frozen=True)
class Job:
    """One scene in all ways of a part.

    Attributes
    ----------
    photos : str or None
        Folder of photographs; None: those inside scikit-image.
    part : str
        `ONE`, `CROSSED` or `ON_GPU`.
    size : Size
    scene : str
        Its name in `studies.scenes`.
    pair : int
        Number of its photographs.
    sensor : {"", "mono", "color"}
        Of a polarization camera, which takes one raw mosaic; "": four full photographs.
    choice : str
        Which ways of the part `ONE`.
    repeats : int
    memory : bool
        Whether the memory of each way is measured, too.
    tolerances : tuple of float
        Of the part `CROSSED`.
    device : str
        Of the part `ON_GPU`.
    """

    photos: str | None
    part: str
    size: Size
    scene: str
    pair: int
    sensor: Sensor = ""
    choice: Choice = "all"
    repeats: int = 1
    memory: bool = False
    tolerances: tuple[float, ...] = ()
    device: str = ""

    def sample(self) -> Sample:
        """The scene as it is photographed; a polarization camera's lens blurs a little, as every lens does."""
        scene = SCENES[self.scene]
        if self.sensor:
            scene = replace(scene, taking=replace(scene.taking, sensor=self.sensor, lens_blur_px=LENS_BLUR_PX))
        return take(scene, sized_pair(Photographs(self.photos, self.pair), self.size))

    def ways(self) -> tuple[Way, ...]:
        """All that are asked for, whether or not they can run."""
        mosaic = bool(self.sensor)
        if self.part == CROSSED:
            return crossed(self.tolerances)
        if self.part == ON_GPU:
            by_torch = replace(DEFAULT, solver="torch")
            return tuple(replace(way, device=device) for way in (DEFAULT, by_torch) for device in ("", self.device))
        if self.choice != "all":
            return (solves if self.choice == "solves" else solvers)(mosaic)
        small = self.size.height * self.size.width <= _LARGEST_FOR_SLOW
        methods = (way for way in other_methods(mosaic) if small or way.method not in _SLOW_METHODS)
        return (*one_at_a_time(mosaic), *methods)


@dataclass(frozen=True)
class Row:
    """One way on one scene.

    Attributes
    ----------
    part : str
        "one at a time", "crossed" or "on a GPU".
    sensor : str
        See `Job`.
    size, scene, pair
        The frame as "256x256", the scene's name, the pair's number.
    method, solver, start, rung, relative_change, resolution, device
        The way, see `studies.ways.Way`.
    transmission, reflection : float
        PSNR in dB, 16 px at the border left out; of a mosaic in all pixels of its sensor.
    elapsed, cpu : tuple of float
        Seconds of every run: by the clock, and of all threads together.
    evaluations : int
    taken : str
        The rung that was taken.
    peak_mb : float
        Most memory above the photographs, 10^6 bytes; NaN where it was not measured.
    not_run : str
        Why; empty if it was.
    """

    part: str
    sensor: str
    size: str
    scene: str
    pair: int
    method: str
    solver: str
    start: str
    rung: str
    relative_change: float
    resolution: str
    device: str
    transmission: float = math.nan
    reflection: float = math.nan
    elapsed: tuple[float, ...] = ()
    cpu: tuple[float, ...] = ()
    evaluations: int = 0
    taken: str = ""
    peak_mb: float = math.nan
    not_run: str = ""


def run(job: Job) -> list[Row]:
    """Run one scene in every way."""
    sample, ways = job.sample(), job.ways()
    # A trained interpolation would know the photographs that it is judged on.
    seen = TRAINED_ON_SHIPPED if job.photos is None else ()
    # Threads of torch that wait would count as work; by the clock all may work.
    with (Threads() if job.part == ON_GPU else Threads(torch=1, blas=1)).set():
        # Seconds of what is so small tell nothing.
        if job.size.height > _WARM.height:
            _warm_up(job.scene, job.sensor, job.device)
        timed = run_ways(sample, [way for way in ways if way.method not in seen], job.repeats)
        if job.memory:
            measure_memory(sample, timed)
    return [_row(job, way, timed.get(way) or Timed(not_run=_SEEN)) for way in ways]


def _row(job: Job, way: Way, runs: Timed) -> Row:
    return Row(
        job.part, job.sensor, str(job.size), job.scene, job.pair,
        way.method, way.solver, way.start, way.rung, way.relative_change, way.resolution, way.device,
        elapsed=tuple(seconds.elapsed for seconds in runs.seconds), cpu=tuple(seconds.cpu for seconds in runs.seconds),
        evaluations=runs.evaluations, taken=runs.rung, peak_mb=runs.peak_mb, not_run=runs.not_run, **runs.levels,
    )  # fmt: skip


@cache
def _warm_up(scene: str, sensor: Sensor, device: str) -> None:
    """Load every package and compiled pass, once per process, scene and sensor; CasADi has neither to load."""
    small = Job(None, ON_GPU if device else ONE, _WARM, scene, 0, sensor, device=device)
    sample = small.sample()
    separate(sample.capture)
    if scene == FEW[0] or device:
        if sensor:
            trained(sensor == "color", LENS_BLUR_PX)
        run_ways(sample, [way for way in small.ways() if way.solver not in SMALL_ONLY], 1)
    else:
        _warm_up(FEW[0], sensor, device)
