"""Seconds against accuracy of every method, solver, start, rung and tolerance; the defaults against the Pareto front.

Run ``polaropt study speed_accuracy -o OUT``. Scenes are seen as four full photographs and as raw mosaics of a mono and
a colour sensor. At 256x256 all settings are crossed on a few scenes; there and at 512x512 one setting at a time is
changed from the default, at 1224x1024 what leaves the scene as it was found, at 2448x2048 the solver alone. Seconds are
those of the processor, all threads together, with one thread for torch and BLAS: so much work is done, whoever else
works on the machine. Where there is a GPU the solver torch works there as well, by the clock, see `gpu`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from studies.kit.run import Effort, effort_of, publish, run_study, study_parser
from studies.photographs import Size, n_pairs_of
from studies.scenes import Sensor
from studies.speed_accuracy import gpu
from studies.speed_accuracy.figures import figures
from studies.speed_accuracy.jobs import FEW, OTHERS, PLAIN, Choice, Job, Row, run
from studies.speed_accuracy.marks import CROSSED, ONE
from studies.speed_accuracy.page import write_page
from studies.speed_accuracy.tables import tables
from studies.ways import tolerances

NAME = "speed_accuracy"
SENSORS: tuple[Sensor, ...] = ("mono", "color")


@dataclass(frozen=True)
class Step:
    """Scenes of one size, run so often; whether the first also tells the memory.

    `sensor` and `choice` are those of `Job`; of crossed settings so many tolerances.
    """

    size: Size
    scenes: tuple[str, ...]
    repeats: int = 1
    memory: bool = False
    sensor: Sensor = ""
    choice: Choice = "all"
    tolerances: int = 0

    def of(self, sensor: Sensor) -> Step:
        """The same as raw mosaics of a sensor."""
        return replace(self, sensor=sensor)


@dataclass(frozen=True)
class Plan:
    """What is run one setting at a time, and where settings are crossed."""

    one: tuple[Step, ...]
    crossed: tuple[Step, ...]


# The memory of small images tells nothing.
_TINY = Step(Size(64, 64), FEW[:1])
_SMALL, _MIDDLE = Step(Size(256, 256), FEW, 2), Step(Size(512, 512), FEW[:2])
_LARGE = Step(Size(1024, 1224), FEW[:1], choice="solves")
_LARGEST = Step(Size(2048, 2448), FEW[:1], choice="solvers")
# Of one kind of scene alone a rung that is asked for would always win.
_CROSSED = Step(Size(256, 256), FEW)
PLANS: dict[Effort, Plan] = {
    "quick": Plan(
        (
            replace(_TINY, choice="solves"),
            *(replace(_TINY, sensor=sensor, choice="solvers") for sensor in SENSORS),
        ),
        (replace(_TINY, tolerances=1),),
    ),
    "default": Plan(
        (
            *(_SMALL, replace(_MIDDLE, memory=True), _LARGE, _LARGEST),
            *(step.of("mono") for step in (_SMALL, _MIDDLE, _LARGE)),
            *(step.of("color") for step in (_SMALL, _MIDDLE, _LARGE, _LARGEST)),
        ),
        (replace(_CROSSED, tolerances=1), replace(_CROSSED, scenes=FEW[:2], sensor="color", tolerances=1)),
    ),
    "full": Plan(
        tuple(
            step.of(sensor)
            for sensor in ("", *SENSORS)
            for step in (
                replace(_SMALL, scenes=(*PLAIN, *OTHERS), repeats=3, memory=True),
                replace(_MIDDLE, scenes=FEW, repeats=3, memory=True),
                replace(_LARGE, scenes=FEW[:2], repeats=2, memory=True, choice="all"),
                replace(_LARGEST, scenes=FEW[:2]),
            )
        ),
        tuple(replace(_CROSSED, sensor=sensor, tolerances=3) for sensor in ("", *SENSORS)),
    ),
}


def jobs_of(photos: str | None, effort: Effort, n_pairs: int) -> list[Job]:
    """All scenes, each with its pair, in turn."""
    plan = PLANS[effort]
    steps = [*((ONE, step) for step in plan.one), *((CROSSED, step) for step in plan.crossed)]
    return [
        Job(
            photos,
            part,
            step.size,
            scene,
            i % n_pairs,
            step.sensor,
            step.choice,
            step.repeats,
            step.memory and i == 0,
            tolerances()[: step.tolerances],
        )
        for part, step in steps
        for i, scene in enumerate(step.scenes)
    ]


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the study."""
    options = study_parser(__doc__).parse_args(arguments)
    # The pairs' number does not depend on the frame's size.
    n_pairs = n_pairs_of(options, len(PLAIN) + len(OTHERS), 64, 32)
    frame = run_study(NAME, run, jobs_of(options.photos, effort_of(options), n_pairs), Row, options)
    publish(NAME, options, tables(frame), figures(frame))
    write_page(frame, options.out)
    gpu.run_part(options)
