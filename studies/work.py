"""Work through a study's jobs: what is done already is not done again, and processes share the rest (Dask)."""

from __future__ import annotations

import hashlib
import json
import logging
import math
import signal
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, TypeVar

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

from studies.record import earlier_rows, metadata, write_document

# Rows are written at least this often, and at the end.
_WRITE_SECONDS = 5.0

Run = Callable[[Any], Sequence[Any]]
Row = TypeVar("Row")


@dataclass(frozen=True)
class Hands:
    """Who works.

    Attributes
    ----------
    workers : int
        Processes on this machine; 1: this process alone, as times want it.
    scheduler : str or None
        Address of a Dask scheduler whose workers do it instead.
    """

    workers: int = 1
    scheduler: str | None = None


def job_key(job: Any) -> str:
    """Short name of a job (a dataclass of plain values): the same in every run."""
    text = json.dumps(asdict(job), sort_keys=True, default=str)
    return hashlib.sha256(text.encode()).hexdigest()[:12]


def run_jobs(
    run: Run, jobs: Sequence[Any], path: Path, settings: dict[str, Any], hands: Hands = Hands()
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
    hands : Hands

    Raises
    ------
    SystemExit
        It was interrupted from the keyboard; what was made is written.
    """
    keys = {job_key(job): job for job in jobs}
    path.parent.mkdir(parents=True, exist_ok=True)
    told = metadata(settings, _processes(hands))
    made: dict[str, list[dict[str, Any]]] = {}
    for row in earlier_rows(path, told):
        made.setdefault(row["job"], []).append(row)
    left = [(key, job) for key, job in keys.items() if key not in made]
    written = time.monotonic()
    try:
        with _progress(len(keys), len(keys) - len(left)) as advance:
            for key, rows in _finished(run, left, hands):
                made[key] = [{"job": key, **_plain(asdict(row))} for row in rows]
                advance()
                if time.monotonic() - written > _WRITE_SECONDS:
                    write_document(path, told, _in_order(made, keys))
                    written = time.monotonic()
    except KeyboardInterrupt:
        if made:
            write_document(path, told, _in_order(made, keys))
        raise SystemExit(f"stopped after {len(made)} jobs; the same command goes on with what is left") from None
    write_document(path, told, _in_order(made, keys))
    return [row for key in keys for row in made[key]]


def _processes(hands: Hands) -> str:
    return str(hands.workers) if hands.scheduler is None else "those of a Dask scheduler"


def _in_order(made: dict[str, list[dict[str, Any]]], keys: Iterable[str]) -> list[dict[str, Any]]:
    """All rows there are, those of these jobs first and in their order."""
    first = dict.fromkeys(keys)
    return [row for key in (*first, *(key for key in made if key not in first)) for row in made.get(key, [])]


def row_of(kind: type[Row], document: dict[str, Any]) -> Row:
    """A row (a dataclass) from its JSON: lists are tuples again, null is not a number."""
    values = {name: value for name, value in document.items() if name != "job"}
    for name, value in values.items():
        if isinstance(value, list):
            values[name] = tuple(value)
        elif value is None and kind.__annotations__[name] == "float":
            values[name] = math.nan
    return kind(**values)


def _finished(run: Run, left: Sequence[tuple[str, Any]], hands: Hands) -> Iterator[tuple[str, Sequence[Any]]]:
    if not left:
        return
    if hands.workers == 1 and hands.scheduler is None:
        for key, job in left:
            yield key, run(job)
        return
    with _client(hands) as client:
        from distributed import as_completed

        futures = {client.submit(run, job, pure=False): key for key, job in left}
        for future, rows in as_completed(futures, with_results=True):
            yield futures[future], rows


@contextmanager
def _client(hands: Hands) -> Iterator[Any]:
    """A Dask client; its own processes have one thread each, so that they share the cores."""
    from distributed import Client, LocalCluster

    if hands.scheduler is not None:
        with Client(hands.scheduler) as client:
            yield client
        return
    import dask

    with (
        dask.config.set({"distributed.nanny.pre-spawn-environ.OMP_NUM_THREADS": 1}),
        LocalCluster(
            n_workers=hands.workers, threads_per_worker=1, dashboard_address=None, silence_logs=logging.ERROR
        ) as cluster,
        Client(cluster) as client,
    ):
        client.run(_leave_interruptions)
        yield client


def _leave_interruptions() -> None:
    """Do not mind an interruption from the keyboard: who started this process does, and ends it."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)


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


def _plain(row: dict[str, Any]) -> dict[str, Any]:
    """JSON knows no NaN: what was not measured is null."""
    return {name: None if value != value else value for name, value in row.items()}
