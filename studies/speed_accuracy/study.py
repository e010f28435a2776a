"""Seconds against accuracy of every method, solver, start, rung and tolerance; the defaults against the Pareto front.

Run ``polaropt study speed_accuracy -o OUT``. At 256x256 all settings are crossed on a few scenes; there, at 512x512
and at 1224x1024 one setting at a time is changed from the default. Seconds are those of the processor, all threads
together, with one thread for torch and BLAS: so much work is done, whoever else works on the machine.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

from pandas import DataFrame

from polaropt.separation import separate
from studies.camera import Sample, take
from studies.kit.frames import markdown, values_of, where
from studies.kit.run import Effort, effort_of, publish, run_study, study_parser
from studies.kit.timing import Threads
from studies.photographs import Photographs, Size, n_pairs_of, sized_pair
from studies.scenes import SCENES
from studies.scores import LAYERS
from studies.speed_accuracy.figures import CROSSED, ONE, figures
from studies.speed_accuracy.marks import Mark, beaten_by, default_of, front, marks, scenes_of, with_ways
from studies.speed_accuracy.page import write_page
from studies.speed_accuracy.runs import Timed, measure_memory, run_ways
from studies.ways import SMALL_ONLY, Way, crossed, one_at_a_time, other_methods, tolerances

NAME = "speed_accuracy"
PLAIN = ("10 deg", "40 deg", "60 deg", "70 deg", "80 deg", "85 deg")
OTHERS = ("wide lens, 45 deg of view", "wide lens with ghosts", "bent pane, 45 deg of view", "screen behind")
FEW = ("60 deg", "wide lens with ghosts", "screen behind")
# Minutes on large images.
_SLOW_METHODS = ("multiscale physical",)
_LARGEST_FOR_SLOW = 256 * 256
_WARM = Size(48, 48)
# Of those that beat the defaults, so many are named.
_MOST = 4


@dataclass(frozen=True)
class Job:
    """One scene of `studies.scenes` by its name, run in all ways of a part: `ONE` or `CROSSED`, with these tolerances.

    Of the ways the memory is measured as well where it is asked for.
    """

    photos: str | None
    part: str
    size: Size
    scene: str
    pair: int
    repeats: int = 1
    memory: bool = False
    tolerances: tuple[float, ...] = ()

    def sample(self) -> Sample:
        """The scene as it is photographed."""
        return take(SCENES[self.scene], sized_pair(Photographs(self.photos, self.pair), self.size))


@dataclass(frozen=True)
class Row:
    """One way on one scene.

    Attributes
    ----------
    part : str
        "one at a time" or "crossed".
    size, scene, pair
        The frame as "256x256", the scene's name, the pair's number.
    method, solver, start, rung, relative_change
        The way, see `studies.ways.Way`.
    transmission, reflection : float
        PSNR in dB, 16 px at the border left out.
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
    size: str
    scene: str
    pair: int
    method: str
    solver: str
    start: str
    rung: str
    relative_change: float
    transmission: float = math.nan
    reflection: float = math.nan
    elapsed: tuple[float, ...] = ()
    cpu: tuple[float, ...] = ()
    evaluations: int = 0
    taken: str = ""
    peak_mb: float = math.nan
    not_run: str = ""


@dataclass(frozen=True)
class Step:
    """Scenes of one size, run so often; whether the first also tells the memory."""

    size: Size
    scenes: tuple[str, ...]
    repeats: int
    memory: bool = True


@dataclass(frozen=True)
class Plan:
    """What is run one setting at a time, and where all settings are crossed, with so many tolerances."""

    one: tuple[Step, ...]
    crossed: Step
    tolerances: int = 3


PLANS: dict[Effort, Plan] = {
    "quick": Plan(
        # The memory of such small images tells nothing.
        (Step(Size(48, 48), FEW[:1], 1, memory=False), Step(Size(64, 96), FEW[2:], 1, memory=False)),
        Step(Size(48, 48), FEW[:1], 1, memory=False),
        tolerances=1,
    ),
    "default": Plan(
        (Step(Size(256, 256), FEW, 3), Step(Size(512, 512), FEW[:2], 3)),
        Step(Size(256, 256), FEW[:1], 1, memory=False),
    ),
    "full": Plan(
        (
            Step(Size(256, 256), (*PLAIN, *OTHERS), 3),
            Step(Size(512, 512), FEW, 3),
            Step(Size(1024, 1224), FEW[:2], 2),
        ),
        Step(Size(256, 256), FEW[:2], 1, memory=False),
    ),
}


def jobs_of(photos: str | None, effort: Effort, n_pairs: int) -> list[Job]:
    """All scenes, each with its pair, in turn."""
    plan = PLANS[effort]
    values = tolerances()[: plan.tolerances]
    steps = [*((ONE, step, ()) for step in plan.one), (CROSSED, plan.crossed, values)]
    return [
        Job(photos, part, step.size, scene, i % n_pairs, step.repeats, step.memory and i == 0, changes)
        for part, step, changes in steps
        for i, scene in enumerate(step.scenes)
    ]


def run(job: Job) -> list[Row]:
    """Run one scene in every way."""
    sample = job.sample()
    small = job.size.height * job.size.width <= _LARGEST_FOR_SLOW
    methods = tuple(way for way in other_methods() if small or way.method not in _SLOW_METHODS)
    ways = crossed(job.tolerances) if job.part == CROSSED else (*one_at_a_time(), *methods)
    # Threads of torch that wait would count as work.
    with Threads(torch=1, blas=1).set():
        _warm_up(job.scene)
        timed = run_ways(sample, ways, job.repeats)
        if job.memory:
            measure_memory(sample, timed)
    return [_row(job, way, runs) for way, runs in timed.items()]


def _row(job: Job, way: Way, runs: Timed) -> Row:
    place = (job.part, str(job.size), job.scene, job.pair)
    return Row(
        *place, way.method, way.solver, way.start, way.rung, way.relative_change,
        elapsed=tuple(seconds.elapsed for seconds in runs.seconds), cpu=tuple(seconds.cpu for seconds in runs.seconds),
        evaluations=runs.evaluations, taken=runs.rung, peak_mb=runs.peak_mb, not_run=runs.not_run, **runs.levels,
    )  # fmt: skip


@lru_cache(maxsize=len(PLAIN) + len(OTHERS))
def _warm_up(scene: str) -> None:
    """Load every package and compiled pass, once per process and scene; CasADi has neither to load."""
    sample = Job(None, ONE, _WARM, scene, 0).sample()
    separate(sample.capture)
    if scene == FEW[0]:
        run_ways(sample, [way for way in (*one_at_a_time(), *other_methods()) if way.solver not in SMALL_ONLY], 1)
    else:
        _warm_up(FEW[0])


_NOTE = (
    "Seconds of the processor, all threads together, mean over scenes of the medians of repeats (least to largest), "
    "torch and BLAS on one thread; those of the single-image method hold the start of an interpreter of its own. "
    "Memory: most above the photographs. Front: nothing else that is told nothing of the truth is both faster and "
    "better. A method that is told something is not on it. A rung that is asked for saves the search for it, and wins "
    "where all scenes are of its kind."
)


def tables(frame: DataFrame) -> str:
    """Every way, and whether the defaults lie on the front; a table for each size and part."""
    frame = with_ways(frame)
    parts = values_of(frame, "part", "size")
    return "\n\n".join([_NOTE, *(_table(where(frame, part=part, size=size), part, size) for part, size in parts)])


def _table(frame: DataFrame, part: str, size: str) -> str:
    found = marks(frame)
    fronts = {layer: front(found, layer) for layer in LAYERS}
    default = default_of(found)
    # Of several hundred ways only those of interest.
    shown = [m for m in found if part != CROSSED or m is default or any(m in each for each in fronts.values())]
    names = ("way", "s", "times the default", "T", "R", "evaluations", "MB", "on the front of")
    lines = [_line(mark, default, fronts) for mark in sorted(shown, key=lambda mark: mark.seconds)]
    n_scenes = len(scenes_of(frame))
    scenes = f"{n_scenes} scene{'s' if n_scenes > 1 else ''} ({', '.join(values_of(frame, 'scene'))})"
    remarks = [*(verdict(found, layers) for layers in (LAYERS[:1], LAYERS[1:], LAYERS)), *_not_run(frame)]
    heading = f"### {size}, {part}: {len(found)} ways, {scenes}"
    return "\n".join([heading, "", markdown(DataFrame(lines, columns=list(names))), "", *remarks])


def _line(mark: Mark, default: Mark, fronts: dict[str, list[Mark]]) -> list[str]:
    seconds = f"{mark.seconds:.3g}" + (f" ({mark.low:.3g} to {mark.high:.3g})" if mark.high > mark.low else "")
    return [
        f"**{mark.way.label}**" if mark is default else mark.way.label,
        seconds,
        f"{mark.seconds / default.seconds:.2f}",
        *(_number(mark.level(layer), ".2f") for layer in LAYERS),
        _number(mark.evaluations or math.nan, ".1f"),
        _number(mark.peak_mb, ".0f"),
        ", ".join(layer[0].upper() for layer in LAYERS if mark in fronts[layer]),
    ]


def _number(value: float, form: str) -> str:
    return "" if math.isnan(value) else f"{value:{form}}"


def verdict(found: Sequence[Mark], layers: Sequence[str]) -> str:
    """Whether the defaults lie on the front of these layers, and if not, what beats them by how much."""
    default = default_of(found)
    better = sorted(beaten_by(found, layers), key=lambda mark: mark.seconds)
    what = " and ".join(layers)
    if not better:
        return f"- {what}: the defaults are on the front."
    by = "; ".join(
        f"{mark.way.label} ({100 * (mark.seconds / default.seconds - 1):+.0f} % s, "
        + ", ".join(f"{mark.level(layer) - default.level(layer):+.2f} dB" for layer in layers)
        + ")"
        for mark in better[:_MOST]
    )
    more = f" and {len(better) - _MOST} more" if len(better) > _MOST else ""
    return f"- {what}: the defaults are beaten by {by}{more}."


def _not_run(frame: DataFrame) -> list[str]:
    lines = []
    for reason, part in frame[frame.not_run != ""].groupby("not_run", sort=False):
        labels = list(dict.fromkeys(way.label for way in part.way))
        lines.append(f"- not run: {labels[0]}{f' and {len(labels) - 1} more' if len(labels) > 1 else ''}: {reason}")
    return lines


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the study."""
    options = study_parser(__doc__).parse_args(arguments)
    # The pairs' number does not depend on the frame's size.
    n_pairs = n_pairs_of(options, len(PLAIN) + len(OTHERS), 64, 32)
    frame = run_study(NAME, run, jobs_of(options.photos, effort_of(options), n_pairs), Row, options)
    publish(NAME, options, tables(frame), figures(frame))
    write_page(frame, options.out)
