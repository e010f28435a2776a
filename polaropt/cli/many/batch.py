"""``polaropt batch``: many captures, each as ``separate`` does it."""

from __future__ import annotations

import os
from collections import Counter
from dataclasses import dataclass, fields
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from polaropt.cli.command import DOUBTFUL, SOME_FAILED, Interrupted, count_bar, say, say_json, with_texts
from polaropt.cli.options import LadderOptions, PaneOptions, ReadingOptions
from polaropt.cli.separate import FolderOptions, SolveOptions, separating
from polaropt.errors import InputError

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from polaropt.batch import Entry, Job, Leftover, Options, Outcome, Place


_MANY = "Many captures"
_CALLED = {"earlier": "scene"}
"""Options that are called otherwise than in Python."""
_PATHS = ("scene", "analyzer")
# Failures and files that are named on the screen; all stand in the summary.
_NAMED = 5


@dataclass(frozen=True, kw_only=True)
class BatchOptions:
    """What the captures are, who works, and what is written."""

    sources: Annotated[
        list[str],
        typer.Argument(
            metavar="SOURCE",
            help="Folders (all that is in them and below), patterns such as 'shots/*.png', files, or tables (CSV) with "
            "a row for each capture: the column files (set apart by ;), name, and any option of reading, the pane and "
            "solving. Files are named from the table's folder.",
            show_default=False,
        ),
    ]
    group: Annotated[
        str | None,
        typer.Option(
            metavar="RULE",
            help="Which files are one capture: a pattern such as '{name}_{angle}.tif'; each (a file, as of mosaics); "
            "folder (all photographs of a folder, in the order of their names). Default: angles at the end of names "
            "are found (_000, -45, I90, 135deg), all other files are mosaics or stacks.",
            rich_help_panel=_MANY,
        ),
    ] = None
    layers_only: Annotated[
        bool,
        typer.Option(
            "--layers-only",
            metavar="",
            help="Write layers, report.json and thumbnail alone, as --write layers.",
            rich_help_panel=_MANY,
        ),
    ] = False
    shared_scene: Annotated[
        bool,
        typer.Option(
            "--shared-scene",
            metavar="",
            help="The pane stands still against the camera: one scene is estimated from all captures together, told in "
            "scene.json, and where a capture disagrees.",
            rich_help_panel=_MANY,
        ),
    ] = False
    workers: Annotated[
        int | None,
        typer.Option(
            metavar="N",
            help="Processes of this machine; they share its cores and memory. Default: one per core (1 without the "
            "extra 'batch').",
            rich_help_panel=_MANY,
        ),
    ] = None
    scheduler: Annotated[
        str | None,
        typer.Option(
            metavar="ADDRESS",
            help="Dask scheduler, such as tcp://host:8786, whose workers work instead. They must see the same files.",
            rich_help_panel=_MANY,
        ),
    ] = None
    scheduler_file: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE", help="The file in which a Dask scheduler tells its address.", rich_help_panel=_MANY
        ),
    ] = None
    dashboard: Annotated[
        bool,
        typer.Option(
            "--dashboard",
            metavar="",
            help="Serve Dask's page of the processes, for this machine alone; its address is told.",
            rich_help_panel=_MANY,
        ),
    ] = False
    parquet: Annotated[
        bool,
        typer.Option(
            "--parquet",
            metavar="",
            help="Write summary.parquet beside summary.csv (package pyarrow).",
            rich_help_panel=_MANY,
        ),
    ] = False

    def place(self) -> Place:
        """Who works."""
        from polaropt.batch import place_for

        file = None if self.scheduler_file is None else str(self.scheduler_file)
        if file is not None and not os.path.isfile(file):
            raise InputError(f"{file}: no such file; a Dask scheduler writes it with --scheduler-file")
        return place_for(self.workers, self.scheduler, file, self.dashboard)


@dataclass(frozen=True)
class _Chosen:
    """The options that a row of a table may change."""

    reading: ReadingOptions
    pane: PaneOptions
    ladder: LadderOptions
    solving: SolveOptions

    @classmethod
    def names(cls) -> set[str]:
        groups = (ReadingOptions, PaneOptions, LadderOptions, SolveOptions)
        return {_CALLED.get(one.name, one.name) for group in groups for one in fields(group)}

    def changed(self, options: Mapping[str, str], folder: Path) -> _Chosen:
        """With options as they are typed; files are relative to a folder."""
        typed = {name: str(folder / text) if name in _PATHS else text for name, text in options.items()}
        names = {called: name for name, called in _CALLED.items()}
        texts = {names.get(name, name): text for name, text in typed.items()}
        return _Chosen(
            with_texts(self.reading, texts),
            with_texts(self.pane, texts),
            with_texts(self.ladder, texts),
            with_texts(self.solving, texts),
        )

    def options(self, *, layers_only: bool, uncertainty: bool) -> Options:
        from polaropt.batch import Options

        chosen = separating(self.pane, self.ladder, self.solving)
        if self.pane.earlier is not None:  # scaled to each capture when that is read
            chosen["scene"] = str(self.pane.earlier.absolute())
        self.reading.check(self.pane)
        reading = self.reading.arguments()
        if reading["analyzer"] is not None:
            reading["analyzer"] = str(reading["analyzer"].absolute())
        return Options(reading, chosen, self.reading.align, self.reading.relative, layers_only, uncertainty)


def batch_command(
    batch: BatchOptions,
    capture: ReadingOptions,
    pane: PaneOptions,
    ladder: LadderOptions,
    solving: SolveOptions,
    folder: FolderOptions,
) -> None:
    """Separate many captures: folders, patterns, tables.

    Each capture gets a folder of its own with the files that separate writes and a thumbnail; beside them are written
    summary.csv (a row for each capture, those that failed included) and index.html (a contact sheet, for a browser).

    The same command again does what is left: captures that are new, that failed, or whose files or options changed. A
    capture that fails is named and does not stop the others.

    Exit code 0: all are separated; 1: one is warned of (--strict); 3: one or more failed; 2: the call is wrong; 130:
    interrupted.
    """
    from polaropt.batch import check_parquet, run_batch

    place = batch.place()
    if batch.parquet:
        check_parquet()
    if batch.shared_scene and pane.earlier is not None:
        raise InputError("--scene gives the whole pane; leave it or --shared-scene out")
    chosen = _Chosen(capture, pane, ladder, solving)
    jobs, leftovers = _jobs(batch, chosen, folder)
    silent = folder.json or folder.quiet
    with count_bar(len(jobs), "Separating", not silent) as told:
        outcome = run_batch(jobs, folder.output, place, told, parquet=batch.parquet, shared_scene=batch.shared_scene)
    if folder.json:
        say_json(_document(folder.output, jobs, outcome, leftovers))
    elif not folder.quiet:
        say(*_sentences(folder.output, jobs, outcome, leftovers))
    if outcome.interrupted:
        left = len(jobs) - len(outcome.rows)
        raise Interrupted(f"{left} of {len(jobs)} captures are left, the same command goes on with them")
    if outcome.failed:
        raise typer.Exit(SOME_FAILED)
    if folder.strict and any(row.warnings for row in outcome.rows):
        raise typer.Exit(DOUBTFUL)


def _jobs(batch: BatchOptions, chosen: _Chosen, folder: FolderOptions) -> tuple[list[Job], tuple[Leftover, ...]]:
    """All captures of all sources, in their order; their names differ."""
    from polaropt.batch import TABLE, Job, distinct, group_sources, read_table

    tables = [source for source in batch.sources if source.lower().endswith(TABLE)]
    others = [source for source in batch.sources if source not in tables]
    output = folder.output

    def options_of(changed: _Chosen) -> Options:
        layers_only = batch.layers_only or folder.write == "layers"
        return changed.options(layers_only=layers_only, uncertainty=folder.uncertainty)

    common = options_of(chosen)
    found: list[tuple[Any, Options]] = []
    leftovers: tuple[Leftover, ...] = ()
    if others:
        grouping = group_sources(
            others,
            chosen.reading.angles_deg,
            batch.group,
            output=output,
            headless=chosen.reading.shape is not None,
        )
        found += [(group, common) for group in grouping.groups]
        leftovers = grouping.leftovers
    for table in tables:
        for entry in read_table(Path(table), _Chosen.names()):
            found.append(
                (entry.group, _options_of(entry, Path(table), chosen, options_of) if entry.options else common)
            )
    groups = list(distinct(group for group, _ in found))
    jobs = [
        Job(
            group.name,
            tuple(str(file.absolute()) for file in group.files),
            str((output / group.name).absolute()),
            options,
            group.problem,
        )
        for group, (_, options) in zip(groups, found, strict=True)
    ]
    if not jobs:
        first = leftovers[0]
        raise InputError(f"{first.file}: {first.reason}; nothing groups into captures, see --group")
    return jobs, leftovers


def _options_of(entry: Entry, table: Path, chosen: _Chosen, options_of: Callable[[_Chosen], Options]) -> Options:
    try:
        return options_of(chosen.changed(entry.options, table.parent))
    except InputError as error:
        raise InputError(f"{table}, line {entry.line}: {error}") from None


def _sentences(output: Path, jobs: list[Job], outcome: Outcome, leftovers: tuple[Leftover, ...]) -> list[str]:
    from polaropt.batch import DONE

    failed = outcome.failed
    lines = [f"{len(outcome.rows) - len(failed)} of {len(jobs)} captures are separated."]
    if outcome.reused:
        lines[0] = f"{lines[0][:-1]}, {outcome.reused} of them before."
    lines += [f"! {row.name}: {row.message}" for row in failed[:_NAMED]]
    if len(failed) > _NAMED:
        lines.append(f"! ... and {len(failed) - _NAMED} more; summary.csv names all.")
    doubted = [row for row in outcome.rows if row.status == DONE and row.message]
    lines += [f"! {row.name}: {row.message}" for row in doubted[:_NAMED]]
    if warned := _warned(outcome):
        told = ", ".join(f"{name} in {number}" for name, number in warned.items())
        lines.append(f"ATTENTION: {told} of {len(outcome.rows)} captures; summary.csv tells which.")
    lines += [f"! {left.file}: {left.reason}; left out." for left in leftovers[:_NAMED]]
    if len(leftovers) > _NAMED:
        lines.append(f"! ... and {len(leftovers) - _NAMED} more files; --json names all.")
    if outcome.summed_up:
        lines.append(f"Written to {output}: summary.csv, index.html, and a folder for each capture.")
    return lines


def _warned(outcome: Outcome) -> dict[str, int]:
    """How many captures each warning is of, most first."""
    return dict(Counter(warning for row in outcome.rows for warning in row.warnings).most_common())


def _document(output: Path, jobs: list[Job], outcome: Outcome, leftovers: tuple[Leftover, ...]) -> dict[str, Any]:
    return {
        "output": str(output),
        "captures": len(jobs),
        "separated": len(outcome.rows) - len(outcome.failed),
        "reused": outcome.reused,
        "interrupted": outcome.interrupted,
        "warnings": _warned(outcome),
        "failed": [{"name": row.name, "files": list(row.files), "message": row.message} for row in outcome.failed],
        "left_out": [{"file": str(left.file), "reason": left.reason} for left in leftovers],
    }
