"""Captures from a table: a row each, with files, angles and options of its own."""

from __future__ import annotations

import csv
from collections import Counter
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from pathlib import Path, PurePosixPath

from polaropt.batch.group import Group, angles_in_name, distinct
from polaropt.errors import InputError

TABLE = ".csv"
_NAME, _FILES, _FILE = "name", "files", "file"
_BETWEEN = ";"
_OTHER_MARKS = (";", "\t", "|")
"""What programs of tables set columns apart by where a comma is a decimal point, or are told to."""


@dataclass(frozen=True)
class Entry:
    """A row of a table: files of a capture, and the options that differ from those of all, as they are typed."""

    group: Group
    options: Mapping[str, str]
    line: int


def read_table(path: Path, options: Collection[str]) -> tuple[Entry, ...]:
    """Captures of a table with a head.

    Columns: ``files`` (set apart by ";") or ``file``, ``file2``, ``file3``...; ``name``; and any option. Paths are
    relative to the table's folder. Empty fields say nothing.

    Parameters
    ----------
    path : Path
    options : collection of str
        Names of options that a row may set, as they are called in Python.

    Raises
    ------
    InputError
        The table, a column or a row cannot be used.
    """
    try:
        with path.open(encoding="utf-8-sig", newline="") as file:
            reader = csv.DictReader(file)
            head = list(reader.fieldnames or ())
            rows = [(reader.line_num, row) for row in reader]
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise InputError(f"{path}: cannot be read as a table ({error}); save it as CSV in UTF-8") from None
    columns = {name: (name or "").strip().lstrip("-").replace("-", "_") for name in head}
    # Spreadsheets leave columns at the end that have no name and hold nothing.
    _check_columns(path, [columns[name] for name in head if columns[name]], options)
    entries = []
    for line, row in rows:
        if None in row or any(value and not columns[name] for name, value in row.items()):
            raise InputError(f"{path}, line {line}: holds more fields than the head; set files apart by {_BETWEEN!r}")
        fields = {columns[name]: (value or "").strip() for name, value in row.items() if (value or "").strip()}
        if fields:
            entries.append(_entry(path, line, fields))
    if not entries:
        raise InputError(f"{path}: holds no captures; give a row for each")
    names = distinct(entry.group for entry in entries)
    return tuple(Entry(group, entry.options, entry.line) for group, entry in zip(names, entries, strict=True))


def _is_file(column: str) -> bool:
    return column == _FILES or (column.startswith(_FILE) and not column[len(_FILE) :].strip("_0123456789"))


def _check_columns(path: Path, columns: Collection[str], options: Collection[str]) -> None:
    alone = next(iter(columns)) if len(columns) == 1 else ""
    between = next((mark for mark in _OTHER_MARKS if mark in alone), None)
    if between is not None:
        raise InputError(f"{path}: its columns are set apart by {between!r}; save it as CSV, with commas between them")
    if not any(map(_is_file, columns)):
        raise InputError(f"{path}: has no column {_FILES!r}; give the files of each capture, set apart by {_BETWEEN!r}")
    twice = next((name for name, count in Counter(columns).items() if count > 1), None)
    if twice is not None:
        raise InputError(f"{path}: has the column {twice!r} twice; leave one out")
    unknown = [name for name in columns if not _is_file(name) and name not in {_NAME, *options}]
    if unknown:
        known = ", ".join([_NAME, _FILES, *sorted(options)])
        raise InputError(f"{path}: there is no column {unknown[0]!r}; known are: {known}")


def _entry(path: Path, line: int, fields: Mapping[str, str]) -> Entry:
    listed = [part.strip() for name, text in fields.items() if _is_file(name) for part in text.split(_BETWEEN)]
    files = tuple(path.parent / name for name in listed if name)
    if not files:
        raise InputError(f"{path}, line {line}: names no file")
    name = fields.get(_NAME) or _name_of(files)
    if Path(name).is_absolute() or ".." in Path(name).parts or not Path(name).parts:
        raise InputError(f"{path}, line {line}: the name {name!r} leaves the output folder; give a name below it")
    name = PurePosixPath(*Path(name).parts).as_posix()
    options = {key: text for key, text in fields.items() if key != _NAME and not _is_file(key)}
    return Entry(Group(name, files), options, line)


def _name_of(files: tuple[Path, ...]) -> str:
    """What the files' names have in common."""
    named = {told[0][0] if (told := angles_in_name(file)) else "" for file in files}
    if len(files) > 1 and len(named) == 1 and "" not in named:
        return named.pop()
    first = files[0].stem
    length = max(n for n in range(len(first) + 1) if all(file.stem.startswith(first[:n]) for file in files))
    return first[:length].rstrip(" ._-0") or files[0].parent.name or first if len(files) > 1 else first
