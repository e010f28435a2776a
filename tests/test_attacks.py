"""What attacks came to is kept in the form of all results, and added up."""

from __future__ import annotations

import json
from pathlib import Path

from studies.kit.page import RESULTS
from tests import attacks
from tests.documents import document_of

TOLD = {"commit": "a" * 40, "modified": False, "sources": "0" * 16}


def test_rows_of_several_runs_are_added_up(tmp_path: Path) -> None:
    told = attacks.begun({})
    for seed, tried in ((1, 30), (2, 40)):
        row = {"what": "damaged files", "seed": seed, "tried": tried, "failed": seed - 1, "which": ["a", "b"]}
        attacks.add(tmp_path, "fuzz", told | TOLD, row)
    attacks.add(tmp_path, "fuzz", told | TOLD, {"what": "lines", "seed": 3, "tried": 7, "failed": 0, "which": []})
    document = document_of(tmp_path / "attacks" / "fuzz.json")
    assert [row["tried"] for row in document["results"]] == [30, 40, 7]
    assert document["metadata"]["command"].startswith("python -m tests.")
    assert (tmp_path / "attacks" / "fuzz.md").read_text().splitlines() == [
        "| what | seed | tried | failed | commit |",
        "| --- | --- | --- | --- | --- |",
        "| damaged files | 1 | 30 | 0 | aaaaaaaaa |",
        "| damaged files | 2 | 40 | 1 | aaaaaaaaa |",
        "| damaged files, all |  | 70 | 1 |  |",
        "| lines | 3 | 7 | 0 | aaaaaaaaa |",
    ]


def test_kept_tables_are_those_of_their_rows() -> None:
    for file in (RESULTS / attacks.FOLDER).glob("*.json"):
        assert file.with_suffix(".md").read_text() == attacks.table(json.loads(file.read_text())["results"])
        document_of(file)
