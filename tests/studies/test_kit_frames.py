"""Rows become frames, and frames tables."""

from __future__ import annotations

import math
import subprocess
import sys
from dataclasses import dataclass

import numpy as np
import pytest
from pandas import DataFrame

from studies.kit.frames import (
    across,
    frame_of,
    joined,
    label,
    largest,
    markdown,
    mean,
    median,
    n_with,
    summary,
    values_of,
    where,
)


@dataclass(frozen=True)
class Row:
    scene: str
    pair: int
    level: float
    found: float | None
    good: bool
    warnings: tuple[str, ...]


ROWS = [
    Row("b", 0, 1.0, None, True, ("GRAZING",)),
    Row("b", 1, 2.0, 3.0, False, ()),
    Row("a", 0, math.nan, 5.0, True, ("GRAZING", "SATURATED")),
]


def test_columns_have_the_types_of_their_fields():
    for rows in (ROWS, []):
        frame = frame_of(Row, rows)
        assert list(frame) == ["scene", "pair", "level", "found", "good", "warnings"]
        assert (frame.level.dtype, frame.found.dtype, frame.good.dtype) == (np.float64, np.float64, np.bool_)
    assert frame_of(Row, ROWS).warnings.iloc[2] == ("GRAZING", "SATURATED")


def test_rows_come_from_their_json_as_well():
    documents = [
        {"job": "0", "scene": "a", "pair": 0, "level": None, "found": None, "good": True, "warnings": ["GRAZING"]}
    ]
    (row,) = frame_of(Row, documents).itertuples(index=False)
    assert math.isnan(row.level)
    assert math.isnan(row.found)
    assert row.warnings == ("GRAZING",)


def test_a_summary_has_a_line_for_each_group_in_the_order_of_the_rows():
    cells = {
        "level": mean("level"),
        "middle": median("found", ".1f"),
        "most": largest("pair", "d"),
        "grazing": lambda part: f"{n_with(part, 'warnings', 'GRAZING')}/{len(part)}",
    }
    table = summary(frame_of(Row, ROWS), {"scene": "scene"}, cells)
    assert markdown(table, "lr").splitlines() == [
        "| scene | level | middle | most | grazing |",
        "|---|---:|---:|---:|---:|",
        "| b | 1.50 | 3.0 | 1 | 1/2 |",
        "| a | nan | 5.0 | 0 | 1/1 |",
    ]


def test_groups_are_made_by_several_columns():
    table = summary(frame_of(Row, ROWS), {"scene": "scene", "pair": "pair"}, {"": mean("level")})
    assert markdown(table).splitlines()[1:3] == ["|---|---|---|", "| b | 0 | 1.00 |"]


def test_values_stand_side_by_side_and_a_dash_where_there_are_no_rows():
    cells = across("pair", (0, 1), joined(mean("level"), mean("found", ".0f")), "pair {}".format)
    table = summary(frame_of(Row, ROWS), {"scene": "scene"}, cells)
    assert markdown(table).splitlines()[0] == "| scene | pair 0 | pair 1 |"
    assert markdown(table).splitlines()[2:] == ["| b | 1.00 / nan | 2.00 / 3 |", "| a | nan / 5 | - |"]


def test_rows_are_chosen_and_values_listed_once():
    frame = frame_of(Row, ROWS)
    assert values_of(frame, "scene") == ["b", "a"]
    assert values_of(frame, "scene", "pair") == [("b", 0), ("b", 1), ("a", 0)]
    assert list(where(frame, scene="b", pair=1).level) == [2.0]


@pytest.mark.parametrize(("value", "words"), [(0.005, "0.005"), (60.0, "60"), (3, "3"), ("a", "a")])
def test_numbers_have_as_few_digits_as_they_need(value, words):
    assert label(value) == words


def test_a_bar_in_a_cell_does_not_end_it():
    assert markdown(DataFrame({"a": ["1 | 2"]})).splitlines()[-1] == "| 1 / 2 |"


def test_polaropt_does_not_load_pandas():
    code = "import sys, polaropt, polaropt.separation, polaropt.cli.app; print('pandas' in sys.modules)"
    ran = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert ran.stdout.strip() == "False"
