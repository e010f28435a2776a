"""Run a study: its options, its jobs on one process or several, its rows, tables and figures in a folder.

Jobs that are done already are not done again: rows of an earlier run with the same settings, sources and machine count.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

from polaropt.interruption import terminations
from solvers.kernels import core_count
from studies.kit.charts import write_figures
from studies.kit.frames import frame_of
from studies.kit.records import earlier_rows, metadata, plain, write_csv, write_document
from studies.kit.speech import StudyParser, say_tables

if TYPE_CHECKING:
    from pandas import DataFrame

Effort = Literal["quick", "default", "full"]
Run = Callable[[Any], Sequence[Any]]

WRITE_SECONDS = 5.0
"""Rows are written at least this often, and at the end: what an interruption may cost."""
_KEY_DIGITS = 12


def study_parser(docstring: str | None) -> argparse.ArgumentParser:
    """Parser with the options that every study has.

    Parameters
    ----------
    docstring : str or None
        Of the study's module; its first line is the description.
    """
    parser = StudyParser(description=(docstring or "").splitlines()[0])
    effort = parser.add_mutually_exclusive_group()
    effort.add_argument("--quick", action="store_true", help="Few and small scenes: to see that it runs, no result.")
    effort.add_argument("--full", action="store_true", help="All scenes and sizes.")
    parser.add_argument(
        "--photos", type=_folder, metavar="FOLDER", help="Folder of photographs. Default: those inside scikit-image."
    )
    parser.add_argument("--pairs", type=partial(_at_least, 1), metavar="N", help="Pairs of photographs at most.")
    parser.add_argument(
        "--workers",
        type=partial(_at_least, 0),
        default=1,
        metavar="N",
        help="Processes (0: one per core); times are only worth something with 1.",
    )
    parser.add_argument("--scheduler", metavar="ADDRESS", help="Dask scheduler whose workers do the work instead.")
    parser.add_argument(
        "-o", "--out", type=Path, required=True, metavar="FOLDER", help="Folder for rows, tables and figures."
    )
    return parser


def _at_least(least: int, text: str) -> int:
    if not text.lstrip("-").isdigit() or int(text) < least:
        raise argparse.ArgumentTypeError(f"is {text!r}; give a whole number from {least} on")
    return int(text)


def _folder(text: str) -> str:
    if not Path(text).is_dir():
        raise argparse.ArgumentTypeError(f"is {text!r}, which is no folder; check the name")
    return text


def effort_of(options: argparse.Namespace) -> Effort:
    """How much was asked for."""
    return "quick" if options.quick else "full" if options.full else "default"


@dataclass(frozen=True)
class Workers:
    """Who works.

    Attributes
    ----------
    processes : int
        On this machine; 1: this process alone, as times want it.
    scheduler : str or None
        Address of a Dask scheduler whose workers do it instead.
    """

    processes: int = 1
    scheduler: str | None = None

    def __str__(self) -> str:
        return str(self.processes) if self.scheduler is None else "those of a Dask scheduler"


def workers_of(options: argparse.Namespace) -> Workers:
    """Who works, as asked for."""
    return Workers(options.workers or core_count(), options.scheduler)


def run_study(
    name: str,
    run: Run,
    jobs: Sequence[Any],
    kind: type[Any],
    options: argparse.Namespace,
    settings: Mapping[str, Any] | None = None,
) -> DataFrame:
    """Run a study's jobs and write their rows as ``NAME.json`` and ``NAME.csv``.

    Parameters
    ----------
    name : str
        Of the study.
    run : callable
        From a job to its rows; a function of a module, so that other processes find it.
    jobs : sequence of dataclass
    kind : type
        Of the rows, a dataclass.
    options : argparse.Namespace
        Of `study_parser`.
    settings : mapping of str, optional
        What the rows depend on beside their jobs: a run with others does not go on with these rows.

    Returns
    -------
    DataFrame
        A column for each field of `kind`, a row for each row, in the jobs' order.
    """
    rows = run_jobs(run, jobs, options.out / f"{name}.json", dict(settings or {}), workers_of(options))
    write_csv(options.out / f"{name}.csv", rows)
    return frame_of(kind, rows)


def publish(
    name: str,
    options: argparse.Namespace,
    tables: str,
    figures: Mapping[str, Callable[[], Any]],
    dpi: int = 120,
) -> None:
    """Print a study's tables, write them as ``NAME.md``, and each figure as PNG and SVG.

    Parameters
    ----------
    name : str
    options : argparse.Namespace
    tables : str
        Markdown.
    figures : mapping of str to callable
        See `studies.kit.charts.write_figures`.
    dpi : int
        Of the PNG.
    """
    say_tables(tables)
    (options.out / f"{name}.md").write_text(tables + "\n", encoding="utf-8")
    write_figures(options.out, figures, dpi)


def job_key(job: Any) -> str:
    """Digest of a job (a dataclass of plain values): the same in every run."""
    text = json.dumps(asdict(job), sort_keys=True, default=str)
    return hashlib.sha256(text.encode()).hexdigest()[:_KEY_DIGITS]


def run_jobs(
    run: Run, jobs: Sequence[Any], path: Path, settings: dict[str, Any], workers: Workers = Workers()
) -> list[dict[str, Any]]:
    """Rows of all jobs, in the jobs' order; they are in the file `path` as soon as they are made.

    Parameters
    ----------
    run : callable
        From a job to its rows (dataclasses); a function of a module, so that other processes find it.
    jobs : sequence of dataclass
    path : Path
        JSON file; rows of an earlier run with the same settings, sources and machine are kept.
    settings : dict
    workers : Workers

    Raises
    ------
    SystemExit
        It was interrupted from the keyboard, or asked to end; what was made is written.
    """
    keys = {job_key(job): job for job in jobs}
    path.parent.mkdir(parents=True, exist_ok=True)
    header = metadata(settings, str(workers))
    made: dict[str, list[dict[str, Any]]] = {}
    for row in earlier_rows(path, header):
        made.setdefault(row["job"], []).append(row)
    left = [(key, job) for key, job in keys.items() if key not in made]
    written = time.monotonic()
    try:
        with terminations(), _progress(len(keys), len(keys) - len(left)) as advance:
            for key, rows in _finished(run, left, workers):
                made[key] = [{"job": key, **plain(asdict(row))} for row in rows]
                advance()
                if time.monotonic() - written > WRITE_SECONDS:
                    write_document(path, header, _in_order(made, keys))
                    written = time.monotonic()
    except KeyboardInterrupt:
        if made:
            write_document(path, header, _in_order(made, keys))
        raise SystemExit(f"stopped after {len(made)} jobs; the same command goes on with what is left") from None
    write_document(path, header, _in_order(made, keys))
    return [row for key in keys for row in made[key]]


def _in_order(made: dict[str, list[dict[str, Any]]], keys: Iterable[str]) -> list[dict[str, Any]]:
    """All rows there are, those of these jobs first and in their order."""
    first = dict.fromkeys(keys)
    return [row for key in (*first, *(key for key in made if key not in first)) for row in made.get(key, [])]


def _finished(run: Run, left: Sequence[tuple[str, Any]], workers: Workers) -> Iterator[tuple[str, Sequence[Any]]]:
    if not left:
        return
    if workers == Workers():
        for key, job in left:
            yield key, run(job)
        return
    with _client(workers) as client:
        from distributed import as_completed

        futures = {client.submit(run, job, pure=False): key for key, job in left}
        for future, rows in as_completed(futures, loop=client.loop, with_results=True):
            yield futures[future], rows


@contextmanager
def _client(workers: Workers) -> Iterator[Any]:
    """A Dask client; its own processes have one thread each, so that they share the cores, and obey nobody else."""
    if workers.scheduler is not None:
        from distributed import Client

        with Client(workers.scheduler) as client:
            yield client
        return
    from polaropt.batch import local_cluster

    with local_cluster(workers.processes, threads=1, memory=None) as client:
        yield client


# What is shown beside the bar of the jobs that this process works on.
_tellers: list[Callable[[str], None]] = []


def tell(what: str) -> None:
    """Say beside the progress bar what a long job is at; nothing is said in other processes."""
    for teller in _tellers:
        teller(what)


@contextmanager
def _progress(total: int, done: int) -> Iterator[Callable[[], None]]:
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn())
    console = Console(stderr=True)
    with Progress(*columns, TimeElapsedColumn(), TimeRemainingColumn(), console=console) as progress:
        task = progress.add_task("jobs", total=total, completed=done)
        _tellers.append(lambda what: progress.update(task, description=what))
        try:
            yield lambda: progress.advance(task)
        finally:
            _tellers.pop()
