"""Seconds against accuracy of every method, solver, start, rung and tolerance; the defaults against the Pareto front.

Run ``polaropt study speed_accuracy -o OUT``. At 256x256 all settings are crossed on a few scenes; there, at 512x512
and at 1224x1024 one setting at a time is changed from the default. Seconds are those of the processor, all threads
together, with one thread for torch and BLAS: so much work is done, whoever else works on the machine.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

from polaropt.separation import separate
from studies.camera import Sample, take
from studies.kit.records import row_of, write_tables
from studies.kit.run import Effort, effort_of, run_jobs, study_parser, workers_of
from studies.kit.timing import Threads
from studies.photographs import Pair, Photographs, Size, n_pairs_of, sized_pair
from studies.scenes import SCENES
from studies.speed_accuracy_figures import draw
from studies.speed_accuracy_page import write_page
from studies.speed_accuracy_rows import Row
from studies.speed_accuracy_runs import Timed, measure_memory, run_ways
from studies.speed_accuracy_tables import tables
from studies.ways import Way, crossed, one_at_a_time, other_methods, tolerances

ONE, CROSSED = "one at a time", "crossed"
PLAIN = ("10 deg", "40 deg", "60 deg", "70 deg", "80 deg", "85 deg")
OTHERS = ("wide lens, 45 deg of view", "wide lens with ghosts", "bent pane, 45 deg of view", "screen behind")
FEW = ("60 deg", "wide lens with ghosts", "screen behind")
# Minutes on large images.
_SLOW_METHODS = ("multiscale physical",)
_LARGEST_FOR_SLOW = 256 * 256
_WARM = Size(48, 48)


@dataclass(frozen=True)
class Job:
    """One scene.

    Attributes
    ----------
    photos : str or None
    part : str
        `ONE` or `CROSSED`.
    size : Size
    scene : str
        An incidence of the paper's protocol, or a family of `studies.model_ladder`.
    pair : int
    repeats : int
    memory : bool
        Whether memory is measured, too.
    tolerances : tuple of float
        That are crossed with all else.
    """

    photos: str | None
    part: str
    size: Size
    scene: str
    pair: int
    repeats: int = 1
    memory: bool = False
    tolerances: tuple[float, ...] = ()


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
    one = [
        Job(photos, ONE, step.size, scene, number % n_pairs, step.repeats, step.memory and number == 0)
        for step in plan.one
        for number, scene in enumerate(step.scenes)
    ]
    values = tolerances()[: plan.tolerances]
    both = [
        Job(photos, CROSSED, plan.crossed.size, scene, number % n_pairs, tolerances=values)
        for number, scene in enumerate(plan.crossed.scenes)
    ]
    return one + both


def run(job: Job) -> list[Row]:
    """Run one scene in every way."""
    sample = _sample(job)
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
    return Row(
        job.part,
        str(job.size),
        job.scene,
        job.pair,
        way.method,
        way.solver,
        way.start,
        way.rung,
        way.relative_change,
        elapsed=tuple(seconds.elapsed for seconds in runs.seconds),
        cpu=tuple(seconds.cpu for seconds in runs.seconds),
        evaluations=runs.evaluations,
        taken=runs.rung,
        peak_mb=runs.peak_mb,
        not_run=runs.not_run,
        **runs.levels,
    )


def _sample(job: Job) -> Sample:
    return scene_sample(job.scene, sized_pair(Photographs(job.photos, job.pair), job.size))


def scene_sample(name: str, pair: Pair) -> Sample:
    """Photographs of a scene by its name, with both layers (2, channel, h, w) and the true pane."""
    return take(SCENES[name], pair)


@lru_cache(maxsize=len(PLAIN) + len(OTHERS))
def _warm_up(scene: str) -> None:
    """Load every package and compiled pass, once per process and scene; CasADi has neither to load."""
    sample = scene_sample(scene, sized_pair(Photographs(), _WARM))
    separate(sample.capture)
    if scene == FEW[0]:
        ways = [way for way in (*one_at_a_time(), *other_methods()) if way.solver != "casadi"]
        run_ways(sample, ways, 1)
    else:
        _warm_up(FEW[0])


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the tables and write them with all rows and charts."""
    parser = study_parser(__doc__)
    options = parser.parse_args(arguments)
    effort = effort_of(options)
    # The pairs' number does not depend on the frame's size.
    n_pairs = n_pairs_of(options, len(PLAIN) + len(OTHERS), 64, 32)
    jobs = jobs_of(options.photos, effort, n_pairs)
    made = run_jobs(run, jobs, options.out / "speed_accuracy.json", {}, workers_of(options))
    rows = [row_of(Row, row) for row in made]
    text = tables(rows)
    print(text)
    write_tables(options.out, "speed_accuracy", made, text)
    draw(rows, options.out)
    write_page(rows, options.out)


if __name__ == "__main__":
    main()
