"""The benchmark: time to a gap, kernels against the memory, blind against known, raw mosaics, memory and imports.

Run ``polaropt study benchmark -o OUT`` (``--quick`` for a look, ``--full`` for the largest size, too). Ratios are of
runs in the same process, interleaved.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

from polaropt.errors import InputError
from studies.benchmark.figures import figures
from studies.benchmark.kernels import measure_kernels
from studies.benchmark.mosaics import KINDS, measure_mosaic
from studies.benchmark.processes import measure_imports, measure_memory
from studies.benchmark.race import INCIDENCES_DEG, Rounds, measure_race
from studies.benchmark.rows import BLIND, IMPORTS, KERNELS, MEMORY, MOSAICS, RACE, RUNNING_ON, TABLES, Place, Row
from studies.benchmark.separations import measure_blind, measure_running_on
from studies.benchmark.tables import tables
from studies.camera import Sample, take
from studies.kit.records import read_metadata
from studies.kit.run import Effort, effort_of, publish, run_study, study_parser
from studies.photographs import Photographs, Size, sized_pair
from studies.scenes import protocol

NAME = "benchmark"
INCIDENCE_DEG = 60.0
"""Where it is not the subject."""
RUNNING_ON_DEG = (10.0, 20.0, 85.0)
MEMORY_REPEATS = 3
"""At most: processes of their own differ by 1 %."""
_SMALL, _MIDDLE, _LARGE = Size(256, 256), Size(512, 512), Size(1024, 1224)
_SENSOR = Size(2048, 2448)
"""Of the usual polarization cameras."""


@dataclass(frozen=True)
class Pace:
    """How often things run: the race, the kernels and the length of their vectors, whole separations, imports."""

    rounds: Rounds
    kernels: int
    vector_mib: int
    separations: int
    imports: int


@dataclass(frozen=True)
class Plan:
    """What is run at which sizes.

    Attributes
    ----------
    pace : Pace
    sizes : tuple of Size
        Of the race in all cases.
    kernel_sizes : tuple of Size
    largest : Size or None
        Of a race in the hard case alone, which goes on for at most `largest_cap_seconds`: the slow ones are then after
        a few evaluations far enough behind.
    running_on, blind, memory : Size
    mosaics : tuple of Size
        Of raw mosaics, of all `kinds`.
    kinds : tuple of str
        See `studies.benchmark.mosaics.KINDS`.
    largest_cap_seconds : float
    """

    pace: Pace
    sizes: tuple[Size, ...]
    kernel_sizes: tuple[Size, ...]
    largest: Size | None = None
    running_on: Size = _SMALL
    blind: Size = _MIDDLE
    memory: Size = _LARGE
    mosaics: tuple[Size, ...] = (_MIDDLE, _LARGE)
    kinds: tuple[str, ...] = tuple(KINDS)
    largest_cap_seconds: float = 20.0


_DEFAULT = Plan(Pace(Rounds(5, 30.0, 10.0, 1), 15, 256, 5, 11), (_SMALL, _MIDDLE), (_MIDDLE,))
PLANS: dict[Effort, Plan] = {
    # Small images, which the figures asked for do not mean.
    "quick": Plan(
        Pace(Rounds(1, 0.15, 0.15, 1, reference_evaluations=25), 3, 32, 1, 1),
        sizes=(Size(48, 48),),
        kernel_sizes=(Size(96, 128),),
        running_on=Size(48, 48),
        blind=Size(64, 96),
        memory=Size(64, 96),
        mosaics=(Size(128, 128), Size(192, 192)),
        kinds=("mono",),
    ),
    "default": _DEFAULT,
    "full": replace(
        _DEFAULT,
        pace=replace(_DEFAULT.pace, kernels=9),
        kernel_sizes=(_MIDDLE, _LARGE),
        largest=_LARGE,
        mosaics=(_MIDDLE, _LARGE, _SENSOR),
    ),
}


@dataclass(frozen=True)
class Job:
    """The measurements of one place; without a size no image is involved."""

    table: str
    case: str
    size: Size | None
    incidence_deg: float
    photographs: Photographs
    pace: Pace


def sample_of(photographs: Photographs, incidence_deg: float, size: Size) -> Sample:
    """One scene of the protocol at the size of a photograph."""
    return take(protocol(incidence_deg), sized_pair(photographs, size))


def jobs_of(plan: Plan, photographs: Photographs, wanted: Sequence[str] = TABLES) -> list[Job]:
    """All that is to be done for the tables that are wanted, the short ones first."""
    places: list[tuple[str, str, Size | None, float]] = [
        (IMPORTS, "", None, INCIDENCE_DEG),
        (MEMORY, "", plan.memory, INCIDENCE_DEG),
        (BLIND, "", plan.blind, INCIDENCE_DEG),
        *((MOSAICS, kind, size, INCIDENCE_DEG) for kind in plan.kinds for size in plan.mosaics),
        *((RUNNING_ON, f"{incidence:g} degrees", plan.running_on, incidence) for incidence in RUNNING_ON_DEG),
        *((KERNELS, "", size, INCIDENCE_DEG) for size in plan.kernel_sizes),
        *((RACE, case, size, incidence) for size in plan.sizes for case, incidence in INCIDENCES_DEG.items()),
    ]
    jobs = [Job(*place, photographs, plan.pace) for place in places if place[0] in wanted]
    if plan.largest is not None and RACE in wanted:
        pace = replace(plan.pace, rounds=replace(plan.pace.rounds, cap_seconds=plan.largest_cap_seconds))
        jobs.append(Job(RACE, "hard", plan.largest, INCIDENCES_DEG["hard"], photographs, pace))
    return jobs


def run(job: Job) -> list[Row]:
    """Measure what one job asks for."""
    pace = job.pace
    place = Place(job.table, job.case, "" if job.size is None else str(job.size))
    if job.size is None:
        return measure_imports(place, pace.imports)
    place.say("scene")
    if job.table == MOSAICS:
        return measure_mosaic(place, sized_pair(job.photographs, job.size), min(pace.separations, MEMORY_REPEATS))
    sample = sample_of(job.photographs, job.incidence_deg, job.size)
    measure: dict[str, Callable[[], list[Row]]] = {
        MEMORY: lambda: measure_memory(place, sample, min(pace.separations, MEMORY_REPEATS)),
        BLIND: lambda: measure_blind(place, sample, pace.separations),
        RUNNING_ON: lambda: measure_running_on(place, sample, pace.rounds.reference_evaluations),
        KERNELS: lambda: measure_kernels(place, sample, pace.kernels, pace.vector_mib),
        RACE: lambda: measure_race(place, sample, pace.rounds),
    }
    return measure[job.table]()


def _size(text: str) -> Size:
    width, _, height = text.partition("x")
    return Size(int(height or width), int(width))


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the benchmark."""
    parser = study_parser(__doc__)
    parser.add_argument("--pair", type=int, default=0, help="Number of the pair of photographs; one is taken.")
    parser.add_argument("--tables", help=f"Comma separated, of: {', '.join(TABLES)}.")
    parser.add_argument("--sizes", help="Of the time to the gap, such as 256,512,1224x1024 (width x height).")
    parser.add_argument("--cap", type=float, help="Seconds after which a solve is broken off.")
    options = parser.parse_args(arguments)
    plan = PLANS[effort_of(options)]
    wanted = [name.strip() for name in options.tables.split(",")] if options.tables else TABLES
    if unknown := set(wanted) - set(TABLES):
        parser.error(f"unknown tables {', '.join(sorted(unknown))}; there are: {', '.join(TABLES)}")
    if options.sizes:
        plan = replace(plan, sizes=tuple(_size(text) for text in options.sizes.split(",")), largest=None)
    if options.cap:
        rounds = replace(plan.pace.rounds, cap_seconds=options.cap)
        plan = replace(plan, pace=replace(plan.pace, rounds=rounds), largest_cap_seconds=options.cap)
    jobs = jobs_of(plan, Photographs(options.photos, options.pair), wanted)
    try:
        frame = run_study(NAME, run, jobs, Row, options)
    except InputError as error:
        parser.error(str(error))
    metadata = read_metadata(options.out / f"{NAME}.json")
    publish(NAME, options, tables(frame, metadata), figures(frame), dpi=130)
