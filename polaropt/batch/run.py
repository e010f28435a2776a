"""A batch: what is left of it is done, each capture by itself, and all that ended is summed up."""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

from polaropt.batch.cluster import ClusterLost, Place, WorkerDied, connected, count_cores, done, local_cluster
from polaropt.batch.job import (
    DISAGREES,
    DONE,
    FAILED,
    REPORT,
    TOO_LARGE,
    Job,
    Row,
    estimate_files,
    scene_of_row,
    separate_files,
)
from polaropt.batch.journal import SCENES, Journal
from polaropt.batch.shared_scene import SharedScene, combine_scenes
from polaropt.batch.sheet import write_sheet
from polaropt.batch.summary import write_summary
from polaropt.capture import result_file
from polaropt.errors import InputError
from polaropt.reporting import json_values

SCENE = "scene.json"
Told = Callable[[int, int, str], None]
"""Takes how many captures have ended, how many of them failed, and what is done with them."""


@dataclass(frozen=True)
class Outcome:
    """How a batch ended.

    Attributes
    ----------
    rows : tuple of Row
        Of all captures in the order of the jobs; of a batch that was interrupted those that ended.
    reused : int
        Captures that an earlier run had done.
    interrupted : bool
        Whether captures are left.
    """

    rows: tuple[Row, ...]
    reused: int = 0
    interrupted: bool = False

    @property
    def summed_up(self) -> bool:
        """Whether the summary and the contact sheet are written."""
        return bool(self.rows) or not self.interrupted

    @property
    def failed(self) -> tuple[Row, ...]:
        """Captures without layers."""
        return tuple(row for row in self.rows if row.status != DONE)


def run_batch(
    jobs: Sequence[Job],
    folder: Path,
    place: Place,
    told: Told | None = None,
    *,
    parquet: bool = False,
    shared_scene: bool = False,
) -> Outcome:
    """Separate captures and write ``summary.csv`` and ``index.html`` beside their folders.

    Parameters
    ----------
    jobs : sequence of Job
        Their names differ.
    folder : Path
        Of all results.
    place : Place
        Who works.
    told : callable, optional
        Called with how many have ended, how many of them failed, and what is done.
    parquet : bool
        Whether the summary is written as ``summary.parquet``, too.
    shared_scene : bool
        Whether the pane stands still against the camera: its scene is then estimated from all captures together, and
        each is separated with it. ``scene.json`` tells it, and where captures disagree.

    Raises
    ------
    InputError
        The folder cannot be written, another run writes into it, or a scheduler does not answer.
    """
    with Journal(folder) as journal:
        rows: dict[str, Row] = {}
        doubts: dict[str, str] = {}
        reused, lost, interrupted = 0, False, False
        try:
            if shared_scene:
                jobs, doubts = _sharing(jobs, folder, place, told)
            rows = {job.name: row for job in jobs if (row := journal.finished(job)) is not None}
            reused = len(rows)
            left = [job for job in jobs if job.name not in rows]
            counted = _Counted(told, reused, "Separating")

            def ended(row: Row, job: Job) -> None:
                row = replace(row, folder=Path(job.folder).relative_to(folder.absolute()).as_posix())
                if row.status == FAILED and os.path.exists(Path(job.folder) / REPORT):
                    row = replace(row, message=f"{row.message}; its folder holds results of an earlier run")
                journal.add(row)
                rows[row.name] = row
                counted(row)

            _work(separate_files, left, place, ended)
        except KeyboardInterrupt:
            interrupted = True
        except ClusterLost:
            lost = True
        in_order = (rows[job.name] for job in jobs if job.name in rows)
        told_rows = tuple(_doubted(row, doubts.get(row.name, "")) for row in in_order)
        outcome = Outcome(told_rows, reused, interrupted or lost)
        # What is there tells more than nothing, where it ended before any capture was looked for.
        if outcome.summed_up:
            write_summary(folder, outcome.rows, parquet=parquet)
            write_sheet(folder, outcome.rows)
    if lost:
        raise InputError(f"{place.scheduler or place.scheduler_file}: the scheduler is gone; the same command goes on")
    return outcome


class _Counted:
    """Tells how many captures have ended, and how many of them failed."""

    def __init__(self, told: Told | None, ended: int, what: str) -> None:
        self._told, self._ended, self._failed, self._what = told, ended, 0, what
        self._tell()

    def __call__(self, row: Row) -> None:
        self._ended += 1
        self._failed += row.status == FAILED
        self._tell()

    def _tell(self) -> None:
        if self._told is not None:
            self._told(self._ended, self._failed, self._what)


def _sharing(
    jobs: Sequence[Job], folder: Path, place: Place, told: Told | None
) -> tuple[Sequence[Job], dict[str, str]]:
    """Jobs with the scene that all captures tell together, and what is said of those that disagree."""
    with Journal(folder, SCENES) as journal:
        rows = {job.name: row for job in jobs if (row := journal.estimated(job)) is not None}
        counted = _Counted(told, len(rows), "Finding the scene")

        def ended(row: Row, job: Job) -> None:
            journal.add(row)
            rows[row.name] = row
            counted(row)

        _work(estimate_files, [job for job in jobs if job.name not in rows], place, ended)
    estimates = [scene_of_row(rows[job.name]) for job in jobs]
    if not any(estimates):
        # Why is said of each.
        return jobs, {}
    shared = combine_scenes(estimates)
    _write_shared(folder / SCENE, shared, jobs)
    return [_with_scene(job, shared, rows[job.name].shape) for job in jobs], _doubts(jobs, shared)


def _write_shared(path: Path, shared: SharedScene, jobs: Sequence[Job]) -> None:
    """The scene, with the size of its pixels as ``report.json`` tells it, and what captures say of it."""
    size = {} if shared.shape is None else dict(zip(("height", "width"), shared.shape, strict=True))
    document = {
        "input": size,
        "scene": {"rung": shared.scene.rung, **json_values(shared.scene)},
        "errors": json_values(shared.errors),
        "captures": shared.n_captures,
        "disagreements": [
            {"capture": jobs[one.capture].name, "field": one.field, "sigmas": json_values(one.sigmas)}
            for one in shared.disagreements
        ],
    }
    with result_file(path) as work:
        work.write_text(json.dumps(document, indent=2, allow_nan=False) + "\n", encoding="utf-8")


def _with_scene(job: Job, shared: SharedScene, shape: tuple[int, int] | None) -> Job:
    if shape is None:  # it could not be read
        return job
    try:
        known = shared.seen_by(shape)
    except InputError as error:
        return replace(job, problem=str(error))
    separating = {**job.options.separating, "scene": known.scene, "scene_errors": known.errors, "thickness_px": None}
    return replace(job, options=replace(job.options, separating=separating))


def _doubts(jobs: Sequence[Job], shared: SharedScene) -> dict[str, str]:
    """What is said of captures that disagree with the others."""
    found: dict[str, list[str]] = {}
    for one in shared.disagreements:
        words = "asks for another model" if one.field == "rung" else f"{one.field} by {one.sigmas:.1f} standard errors"
        found.setdefault(jobs[one.capture].name, []).append(words)
    return {name: f"disagrees with the shared scene: {', '.join(words)}" for name, words in found.items()}


def _doubted(row: Row, doubt: str) -> Row:
    if not doubt or row.status != DONE:
        return row
    return replace(row, message=doubt, warnings=(*row.warnings, DISAGREES))


def _work(work: Callable[..., Row], jobs: Sequence[Job], place: Place, ended: Callable[[Row, Job], None]) -> None:
    """All jobs; those that need more memory than a process of ours has, and those at whose work processes died, are
    done at the end, one at a time."""
    if not jobs:
        return
    alone: list[Job] = []
    if len(jobs) == 1 and not place.elsewhere:
        place = Place()

    def last(items: Sequence[Job], client: Any) -> None:
        for job, result in done(work, items, client, at_once=1):
            ended(result if isinstance(result, Row) else _failure(job, result), job)

    with connected(place) as client:
        for job, result in done(partial(work, memory=place.memory), jobs, client):
            if isinstance(result, Row) and result.status != TOO_LARGE:
                ended(result, job)
            elif client is not None and isinstance(result, Row | WorkerDied):
                alone.append(job)
            else:
                ended(_failure(job, result), job)
        if alone and place.elsewhere:
            last(alone, client)
    if alone and not place.elsewhere:
        with local_cluster(1, count_cores(), None) as client:
            last(alone, client)


def _failure(job: Job, result: Any) -> Row:
    """The row of a job that came back without one."""
    if isinstance(result, WorkerDied):
        message = "the processes that worked on it died one after another, perhaps for lack of memory"
    elif isinstance(result, Row):
        message = "there is not enough memory"
    else:
        message = f"unexpected {type(result).__name__}: {result}"
    return Row(job.name, job.files, FAILED, f"{job.files[0]}: {' '.join(message.split())}", key=job.key())
