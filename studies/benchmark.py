"""The benchmark: time to a gap, kernels against the memory, blind against known, memory and imports, in one run.

Run ``polaropt study benchmark -o OUT`` (``--quick`` for a look, ``--full`` for the largest size, too). Ratios are of
runs in the same process, interleaved; a run that was broken off goes on with what is left. OUT gets
``benchmark.json``, ``benchmark.csv``, ``benchmark.md`` and the work-precision charts.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from rich.console import Console

from polaropt.errors import InputError
from studies import (
    benchmark_imports,
    benchmark_kernels,
    benchmark_memory,
    benchmark_pipeline,
    benchmark_solvers,
)
from studies.benchmark_chart import draw
from studies.benchmark_record import Measurement, Place, Record
from studies.benchmark_scenes import example
from studies.benchmark_tables import tables
from studies.benchmark_targets import target_table
from studies.kit.records import write_tables
from studies.kit.run import Effort, effort_of, run_jobs, study_parser, tell, workers_of
from studies.photographs import Photographs, Size

TABLES = (
    benchmark_imports.TABLE,
    benchmark_memory.TABLE,
    benchmark_kernels.TABLE,
    benchmark_pipeline.BLIND,
    benchmark_pipeline.RUNNING_ON,
    benchmark_solvers.TABLE,
)
_SMALL, _MIDDLE, _LARGE = Size(256, 256), Size(512, 512), Size(1024, 1224)


@dataclass(frozen=True)
class Pace:
    """How often and how long things run.

    Attributes
    ----------
    rounds : Rounds
        Of the race.
    kernels : Effort
    repeats : int
        Of whole separations.
    imports : int
    """

    rounds: benchmark_solvers.Rounds
    kernels: benchmark_kernels.Effort
    repeats: int
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
    largest_cap_seconds : float
    """

    pace: Pace
    sizes: tuple[Size, ...]
    kernel_sizes: tuple[Size, ...]
    largest: Size | None = None
    running_on: Size = _SMALL
    blind: Size = _MIDDLE
    memory: Size = _LARGE
    largest_cap_seconds: float = 20.0


PLANS: dict[Effort, Plan] = {
    # Small images, which the figures asked for do not mean.
    "quick": Plan(
        Pace(
            benchmark_solvers.Rounds(1, 0.15, 0.15, 1, reference_evaluations=25), benchmark_kernels.Effort(3, 32), 1, 1
        ),
        sizes=(Size(48, 48),),
        kernel_sizes=(Size(96, 128),),
        running_on=Size(48, 48),
        blind=Size(64, 96),
        memory=Size(64, 96),
    ),
    "default": Plan(
        Pace(benchmark_solvers.Rounds(5, 30.0, 10.0, 1), benchmark_kernels.Effort(15, 256), 5, 11),
        sizes=(_SMALL, _MIDDLE),
        kernel_sizes=(_MIDDLE,),
    ),
    "full": Plan(
        Pace(benchmark_solvers.Rounds(5, 30.0, 10.0, 1), benchmark_kernels.Effort(9, 256), 5, 11),
        sizes=(_SMALL, _MIDDLE),
        kernel_sizes=(_MIDDLE, _LARGE),
        largest=_LARGE,
    ),
}


@dataclass(frozen=True)
class Job:
    """The measurements of one place.

    Attributes
    ----------
    table, case : str
    size : Size or None
        None where no image is involved.
    photographs : Photographs
    pace : Pace
    """

    table: str
    case: str
    size: Size | None
    photographs: Photographs
    pace: Pace


def jobs_of(plan: Plan, photographs: Photographs, wanted: Sequence[str] = TABLES) -> list[Job]:
    """All that is to be done for the tables that are wanted, the short ones first."""
    places: list[tuple[str, str, Size | None]] = [
        (benchmark_imports.TABLE, "", None),
        (benchmark_memory.TABLE, "", plan.memory),
        (benchmark_pipeline.BLIND, "", plan.blind),
    ]
    places += [
        (benchmark_pipeline.RUNNING_ON, f"{incidence:g} degrees", plan.running_on)
        for incidence in benchmark_pipeline.INCIDENCES_DEG
    ]
    places += [(benchmark_kernels.TABLE, "", size) for size in plan.kernel_sizes]
    places += [
        (benchmark_solvers.TABLE, case, size) for size in plan.sizes for case in benchmark_solvers.INCIDENCES_DEG
    ]
    jobs = [Job(*place, photographs, plan.pace) for place in places if place[0] in wanted]
    if plan.largest is not None and benchmark_solvers.TABLE in wanted:
        pace = replace(plan.pace, rounds=replace(plan.pace.rounds, cap_seconds=plan.largest_cap_seconds))
        jobs.append(Job(benchmark_solvers.TABLE, "hard", plan.largest, photographs, pace))
    return jobs


def run(job: Job) -> list[Measurement]:
    """Measure what one job asks for."""
    pace, size = job.pace, job.size
    place = Place(job.table, job.case, "" if size is None else str(size))

    def say(what: str) -> None:
        tell(f"{', '.join(filter(None, (place.table, place.case, place.size)))}: {what}")

    if size is None:
        return benchmark_imports.measure(place, pace.imports, say)
    if job.table == benchmark_solvers.TABLE:
        return benchmark_solvers.measure(place, job.photographs, size, pace.rounds, say)
    if job.table == benchmark_pipeline.RUNNING_ON:
        scene = example(job.photographs, float(job.case.split()[0]), size)
        return benchmark_pipeline.measure_running_on(place, scene, pace.rounds.reference_evaluations, say)
    if job.table == benchmark_kernels.TABLE:
        scene = example(job.photographs, benchmark_kernels.INCIDENCE_DEG, size)
        return benchmark_kernels.measure(place, scene, pace.kernels, say)
    if job.table == benchmark_memory.TABLE:
        scene = example(job.photographs, benchmark_memory.INCIDENCE_DEG, size)
        return benchmark_memory.measure(place, scene, min(pace.repeats, 3), say)
    scene = example(job.photographs, benchmark_pipeline.BLIND_INCIDENCE_DEG, size)
    return benchmark_pipeline.measure_blind(place, scene, pace.repeats, say)


def report(record: Record, console: Console) -> str:
    """Print the tables; all of them as Markdown, with the machine above."""
    found = [target_table(record), *tables(record)]
    for table in found:
        table.show(console)
    return _where(record) + "\n\n" + "\n".join(table.markdown() for table in found)


def _where(record: Record) -> str:
    data = record.metadata
    machine, threads = data["machine"], data["threads"]
    libraries = ", ".join(f"{name} {version}" for name, version in data["libraries"].items() if version)
    modified = ", modified" if data["modified"] else ""
    return (
        f"{machine['cpu']}, {machine['cores']} cores, {machine['memory_gib']} GiB; GPU: {data['gpu'] or 'not asked'}; "
        f"{data['system']}; Python {data['python']}; {libraries}; threads: polaropt {threads['polaropt']}, "
        f"torch {threads['torch']}; commit {data['commit'][:12] or 'unknown'}{modified}."
    )


def _size(text: str) -> Size:
    width, _, height = text.partition("x")
    return Size(int(height or width), int(width))


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the benchmark, print the tables and write them with all rows and charts."""
    parser = study_parser(__doc__)
    parser.add_argument("--pair", type=int, default=0, help="number of the pair of photographs; one is taken")
    parser.add_argument("--tables", help=f"comma separated, of: {', '.join(TABLES)}")
    parser.add_argument("--sizes", help="of the time to the gap, such as 256,512,1224x1024 (width x height)")
    parser.add_argument("--cap", type=float, help="seconds after which a solve is broken off")
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
    path = options.out / "benchmark.json"
    try:
        made = run_jobs(
            run, jobs_of(plan, Photographs(options.photos, options.pair), wanted), path, {}, workers_of(options)
        )
    except InputError as error:
        parser.error(str(error))
    record = Record.read(path, made)
    write_tables(options.out, "benchmark", made, report(record, Console()))
    for case in benchmark_solvers.INCIDENCES_DEG:
        draw(record, case, options.out / ("work_precision" if case == "hard" else f"work_precision_{case}"))


if __name__ == "__main__":
    main()
