"""Rows of a study as a pandas DataFrame, and tables of it as Markdown: the one builder of tables.

A table is groups of rows and, for each group, cells: functions from the rows of a group to what stands there.

    >>> table = summary(frame, {"theta": "incidence_deg"}, {"T": mean("transmission"), "s": mean("seconds", ".1f")})
    >>> markdown(table)
"""

from __future__ import annotations

import math
from collections.abc import Callable, Hashable, Iterable, Mapping, Sequence
from dataclasses import fields
from typing import Any

import numpy as np
from pandas import DataFrame, Series

from studies.kit.records import row_of

Cell = Callable[[DataFrame], str]
"""What stands in a table for some rows."""


def frame_of(kind: type[Any], rows: Sequence[Any]) -> DataFrame:
    """Rows as a DataFrame, a column for each field; what was not measured is NaN.

    Parameters
    ----------
    kind : type
        Of the rows: a dataclass of numbers, words and tuples of them.
    rows : sequence
        Of this type, or as their JSON has them.
    """
    typed = [row_of(kind, row) if isinstance(row, dict) else row for row in rows]
    return DataFrame({field.name: _column(field.type, [getattr(row, field.name) for row in typed])
                      for field in fields(kind)})  # fmt: skip


def _column(annotation: Any, values: list[Any]) -> Series:
    """Floats are floats even where none was measured; tuples and words stay what they are."""
    name = str(getattr(annotation, "__name__", annotation))
    if name.split(" |")[0] == "float":
        return Series([math.nan if value is None else value for value in values], dtype=np.float64)
    return Series(values, dtype={"int": np.int64, "bool": np.bool_}.get(name, object))


def where(frame: DataFrame, **wanted: Hashable) -> DataFrame:
    """The rows whose columns have these values."""
    for name, value in wanted.items():
        frame = frame[frame[name] == value]
    return frame


def values_of(frame: DataFrame, *names: str) -> list[Any]:
    """The values of a column, or the tuples of several, each once and in the order in which they come."""
    if len(names) == 1:
        return list(dict.fromkeys(frame[names[0]]))
    return list(dict.fromkeys(frame[list(names)].itertuples(index=False, name=None)))


def mean(column: str, form: str = ".2f") -> Cell:
    """The mean of what was measured, as a cell."""
    return lambda part: f"{part[column].mean():{form}}"


def median(column: str, form: str = ".2f") -> Cell:
    """The median of what was measured, as a cell."""
    return lambda part: f"{part[column].median():{form}}"


def largest(column: str, form: str = ".2f") -> Cell:
    """The largest value, as a cell."""
    return lambda part: f"{part[column].max():{form}}"


def joined(*cells: Cell) -> Cell:
    """Several cells in one, such as of transmission and reflection."""
    return lambda part: " / ".join(cell(part) for cell in cells)


def n_with(frame: DataFrame, column: str, item: str) -> int:
    """In how many rows a column of tuples holds something, such as a warning's name."""
    return sum(item in items for items in frame[column])


def summary(frame: DataFrame, by: Mapping[str, str], cells: Mapping[str, Cell]) -> DataFrame:
    """A table: a line for each group of rows.

    Parameters
    ----------
    frame : DataFrame
    by : mapping of str to str
        From headings to the columns that make the groups; groups come in the order of their first rows.
    cells : mapping of str to callable
        From headings to cells.

    Returns
    -------
    DataFrame
        Of words, ready for `markdown`.
    """
    lines = []
    for key in values_of(frame, *by.values()):
        keys = key if len(by) > 1 else (key,)
        part = where(frame, **dict(zip(by.values(), keys, strict=True)))
        lines.append([*map(label, keys), *(cell(part) for cell in cells.values())])
    return DataFrame(lines, columns=[*by, *cells], dtype=object)


def across(
    column: str, values: Iterable[Hashable], cell: Cell, heading: Callable[[Any], str] | None = None
) -> dict[str, Cell]:
    """Cells side by side, one for each value of a column; "-" where a group has no such rows.

    Parameters
    ----------
    column : str
    values : iterable
    cell : callable
        From the rows of the group with this value.
    heading : callable, optional
        From values to headings. Default: numbers in as few digits as they have, words as they are.
    """

    def at(value: Hashable) -> Cell:
        def here(part: DataFrame) -> str:
            rows = where(part, **{column: value})
            return cell(rows) if len(rows) else "-"

        return here

    return {(heading or label)(value): at(value) for value in values}


def label(value: Any) -> str:
    """A number in as few digits as it has, a word as it is."""
    return f"{value:g}" if isinstance(value, float) else str(value)


def markdown(table: DataFrame, align: str = "") -> str:
    """A table as Markdown.

    Parameters
    ----------
    table : DataFrame
        Of words.
    align : str
        "l" or "r" for each column; the last stands for all that follow. Default: left.
    """
    sides = align.ljust(table.shape[1], (align or "l")[-1])
    rules = ["---:" if side == "r" else "---" for side in sides]
    lines = [list(map(str, table.columns)), *table.astype(str).to_numpy().tolist()]
    written = [f"| {' | '.join(cell.replace('|', '/') for cell in line)} |" for line in lines]
    return "\n".join([written[0], f"|{'|'.join(rules)}|", *written[1:]])
