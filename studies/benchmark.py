"""The benchmark: time to a gap, kernels against the memory, blind against known, memory and imports, in one run.

Run ``python -m studies.benchmark -o OUT`` (``--quick`` for a look, ``--full`` for figures to publish). Ratios are of
runs in the same process, interleaved; a run that was broken off goes on with what is left. OUT gets
``benchmark.json``, ``benchmark.md`` and the work-precision charts.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

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
from studies.benchmark_scenes import Photographs, Size, example
from studies.benchmark_tables import tables
from studies.benchmark_targets import target_table

TABLES = (
    benchmark_imports.TABLE,
    benchmark_memory.TABLE,
    benchmark_kernels.TABLE,
    benchmark_pipeline.BLIND,
    benchmark_pipeline.RUNNING_ON,
    benchmark_solvers.TABLE,
)

Tell = Callable[[str], None]


@dataclass(frozen=True)
class Settings:
    """What is run, how often and at which sizes."""

    photographs: Photographs
    tables: tuple[str, ...]
    rounds: benchmark_solvers.Rounds
    sizes: tuple[Size, ...]
    kernel_sizes: tuple[Size, ...]
    kernels: benchmark_kernels.Effort
    running_on: Size
    blind: Size
    memory: Size
    repeats: int
    imports: int


@dataclass(frozen=True)
class Task:
    """What yields the measurements of one place."""

    place: Place
    run: Callable[[Place, Tell], list[Measurement]]


def default_settings(photographs: Photographs) -> Settings:
    """An hour or two on two cores; most of it looks for the lowest value and waits for the slow ones."""
    small, middle, large = Size(256, 256), Size(512, 512), Size(1024, 1224)
    return Settings(
        photographs,
        TABLES,
        benchmark_solvers.Rounds(5, 120.0, 20.0, 1),
        sizes=(small, middle, large),
        kernel_sizes=(middle, large),
        kernels=benchmark_kernels.Effort(15, 256),
        running_on=small,
        blind=middle,
        memory=large,
        repeats=5,
        imports=11,
    )


def full_settings(photographs: Photographs) -> Settings:
    """Hours: slow solvers run three times, and longer."""
    rounds = benchmark_solvers.Rounds(7, 400.0, 20.0, 3)
    return replace(default_settings(photographs), rounds=rounds, repeats=9, imports=21)


def quick_settings(photographs: Photographs) -> Settings:
    """Less than a minute: small images, which the figures asked for do not mean."""
    small, large = Size(64, 64), Size(96, 128)
    return Settings(
        photographs,
        TABLES,
        benchmark_solvers.Rounds(2, 0.5, 0.5, 1, reference_evaluations=60),
        sizes=(small, large),
        kernel_sizes=(large,),
        kernels=benchmark_kernels.Effort(5, 32),
        running_on=small,
        blind=large,
        memory=large,
        repeats=1,
        imports=3,
    )


def tasks(settings: Settings) -> list[Task]:
    """All that is to be done, the short ones first."""
    found = [*_whole_tasks(settings), *_kernel_tasks(settings), *_race_tasks(settings)]
    return [task for task in found if task.place.table in settings.tables]


def _whole_tasks(settings: Settings) -> list[Task]:
    photographs = settings.photographs

    def imports(place: Place, tell: Tell) -> list[Measurement]:
        return benchmark_imports.measure(place, settings.imports, tell)

    def memory(place: Place, tell: Tell) -> list[Measurement]:
        scene = example(photographs, benchmark_memory.INCIDENCE_DEG, settings.memory)
        return benchmark_memory.measure(place, scene, min(settings.repeats, 3), tell)

    def blind(place: Place, tell: Tell) -> list[Measurement]:
        scene = example(photographs, benchmark_pipeline.BLIND_INCIDENCE_DEG, settings.blind)
        return benchmark_pipeline.measure_blind(place, scene, settings.repeats, tell)

    found = [
        Task(Place(benchmark_imports.TABLE, "", ""), imports),
        Task(Place(benchmark_memory.TABLE, "", str(settings.memory)), memory),
        Task(Place(benchmark_pipeline.BLIND, "", str(settings.blind)), blind),
    ]
    for incidence in benchmark_pipeline.INCIDENCES_DEG:
        place = Place(benchmark_pipeline.RUNNING_ON, f"{incidence:g} degrees", str(settings.running_on))
        found.append(Task(place, _running_on(settings, incidence)))
    return found


def _running_on(settings: Settings, incidence_deg: float) -> Callable[[Place, Tell], list[Measurement]]:
    def run(place: Place, tell: Tell) -> list[Measurement]:
        scene = example(settings.photographs, incidence_deg, settings.running_on)
        return benchmark_pipeline.measure_running_on(place, scene, settings.rounds.reference_evaluations, tell)

    return run


def _kernel_tasks(settings: Settings) -> list[Task]:
    def kernels(size: Size) -> Callable[[Place, Tell], list[Measurement]]:
        def run(place: Place, tell: Tell) -> list[Measurement]:
            scene = example(settings.photographs, benchmark_kernels.INCIDENCE_DEG, size)
            return benchmark_kernels.measure(place, scene, settings.kernels, tell)

        return run

    return [Task(Place(benchmark_kernels.TABLE, "", str(size)), kernels(size)) for size in settings.kernel_sizes]


def _race_tasks(settings: Settings) -> list[Task]:
    def race(size: Size) -> Callable[[Place, Tell], list[Measurement]]:
        def run(place: Place, tell: Tell) -> list[Measurement]:
            return benchmark_solvers.measure(place, settings.photographs, size, settings.rounds, tell)

        return run

    return [
        Task(Place(benchmark_solvers.TABLE, case, str(size)), race(size))
        for size in settings.sizes
        for case in benchmark_solvers.INCIDENCES_DEG
    ]


def run_all(settings: Settings, out: Path, console: Console) -> Record:
    """Do what is left to do, writing after each task."""
    out.mkdir(parents=True, exist_ok=True)
    record = Record(out / "benchmark.json", asdict(settings))
    todo = tasks(settings)
    columns = (TextColumn("{task.fields[what]}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn())
    with Progress(*columns, console=console, transient=True) as progress:
        bar = progress.add_task("", total=len(todo), what="")
        for task in todo:
            place = task.place
            name = ", ".join(filter(None, (place.table, place.case, place.size)))

            def tell(what: str, name: str = name) -> None:
                progress.update(bar, what=f"{name}: {what}")

            if not record.has(place):
                record.add(task.run(place, tell))
            progress.advance(bar)
    return record


def write_report(record: Record, out: Path, console: Console) -> None:
    """Print the tables and write them with the charts."""
    found = [target_table(record), *tables(record)]
    for table in found:
        table.show(console)
    text = "# Benchmark\n\n" + _where(record) + "\n\n" + "\n".join(table.markdown() for table in found)
    (out / "benchmark.md").write_text(text, encoding="utf-8")
    charts = draw(record, "hard", out / "work_precision") + draw(record, "easy", out / "work_precision_easy")
    for file in (out / "benchmark.json", out / "benchmark.md", *charts):
        console.print(f"wrote {file}", soft_wrap=True)


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


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    effort = parser.add_mutually_exclusive_group()
    effort.add_argument("--quick", action="store_true", help="less than a minute, on small images")
    effort.add_argument("--full", action="store_true", help="hours: slow solvers run longer, and more than once")
    parser.add_argument("--photos", help="folder of photographs (default: those inside scikit-image)")
    parser.add_argument("--pair", type=int, default=0, help="number of the pair of photographs")
    parser.add_argument("--tables", help=f"comma separated, of: {', '.join(TABLES)}")
    parser.add_argument("--sizes", help="of the time to the gap, such as 256,512,1224x1024 (width x height)")
    parser.add_argument("--cap", type=float, help="seconds after which a solve is broken off")
    parser.add_argument("-o", "--out", type=Path, required=True, help="folder for tables, rows (JSON) and charts")
    return parser


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the benchmark."""
    parser = _parser()
    options = parser.parse_args(arguments)
    make = quick_settings if options.quick else full_settings if options.full else default_settings
    settings = make(Photographs(options.photos, options.pair))
    if options.tables:
        settings = replace(settings, tables=tuple(name.strip() for name in options.tables.split(",")))
        if unknown := set(settings.tables) - set(TABLES):
            parser.error(f"unknown tables {', '.join(sorted(unknown))}; there are: {', '.join(TABLES)}")
    if options.sizes:
        settings = replace(settings, sizes=tuple(_size(text) for text in options.sizes.split(",")))
    if options.cap:
        settings = replace(settings, rounds=replace(settings.rounds, cap_seconds=options.cap))
    console = Console()
    try:
        write_report(run_all(settings, options.out, console), options.out, console)
    except InputError as error:
        parser.error(str(error))


if __name__ == "__main__":
    main()
