"""What of a batch is done: a line for each capture that ended, so that a run goes on where another one stopped."""

from __future__ import annotations

import json
import os
from collections.abc import Iterable, Iterator
from contextlib import suppress
from dataclasses import asdict, fields
from pathlib import Path
from types import TracebackType
from typing import Any

from polaropt.batch.job import DONE, ESTIMATED, REPORT, Job, Row
from polaropt.errors import InputError

_TUPLES = ("files", "warnings", "shape")
"""Of a row; JSON has lists."""
JOURNAL, SCENES = "batch.jsonl", "scenes.jsonl"


class Journal:
    """Rows of captures that ended, in a file that grows by a line each.

    Parameters
    ----------
    folder : Path
        Of all results; made if it does not exist.
    name : str
        Of the file.

    Raises
    ------
    InputError
        The folder cannot be written, or another run writes into it.
    """

    def __init__(self, folder: Path, name: str = JOURNAL) -> None:
        try:
            folder.mkdir(parents=True, exist_ok=True)
            self._file = (folder / name).open("a+", encoding="utf-8", errors="backslashreplace")
        except OSError as error:
            raise InputError(f"{folder}: cannot be written ({error.strerror}); choose another output folder") from None
        _lock(self._file, folder)
        self._file.seek(0)
        # A run that was killed may have left half a line.
        text = self._file.read()
        if text and not text.endswith("\n"):
            self._file.write("\n")
        self._rows = {row.name: row for row in _rows_of(text.splitlines())}

    def __enter__(self) -> Journal:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        # What a full disk did not take is told already.
        with suppress(OSError):
            self._file.close()

    def names(self) -> tuple[str, ...]:
        """Captures of which there is a row."""
        return tuple(self._rows)

    def finished(self, job: Job) -> Row | None:
        """The row of a job that was done with the same files and options, and whose results are there."""
        row = self._rows.get(job.name)
        there = (
            row is not None
            and row.status == DONE
            and row.key == job.key()
            and os.path.isfile(Path(job.folder) / REPORT)
        )
        return row if there else None

    def estimated(self, job: Job) -> Row | None:
        """The row of a job whose scene was estimated with the same files and options."""
        row = self._rows.get(job.name)
        # Rows of earlier versions tell no shape.
        there = row is not None and row.status == ESTIMATED and row.shape is not None and row.key == job.key()
        return row if there else None

    def add(self, row: Row) -> None:
        """Keep a row, also if the machine stops after this."""
        self._rows[row.name] = row
        try:
            self._file.write(json.dumps(asdict(row)) + "\n")
            self._file.flush()
        except OSError as error:
            raise InputError(
                f"{self._file.name}: cannot be written ({error.strerror}); the same command goes on"
            ) from None


def _rows_of(lines: Iterable[str]) -> Iterator[Row]:
    known = {one.name for one in fields(Row)}
    for line in lines:
        try:
            values: Any = json.loads(line)
            if isinstance(values, dict) and known >= values.keys() >= {"name", "files", "status"}:
                tuples = {name: tuple(values[name]) for name in _TUPLES if values.get(name) is not None}
                yield Row(**{**values, **tuples})
        except (ValueError, TypeError, RecursionError):  # the last line of a run that was killed, or no line of ours
            continue


def _lock(file: Any, folder: Path) -> None:
    """Keep other runs out, as long as this process lives."""
    try:
        import fcntl
    except ImportError:  # Windows
        return
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        file.close()
        raise InputError(f"{folder}: another run writes into it; wait for its end, or choose another folder") from None
    except OSError:  # file systems without locks
        return
