"""The page of results: it shows what is kept, and nothing else."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest

from studies.catalogue import STUDIES
from studies.record import write_document
from studies.results_page import PAGE, RESULTS, keep, page

TABLE = "| a | b |\n|---|---|\n| 1 | 2 |"


@pytest.fixture
def out(tmp_path: Path) -> Path:
    """A folder as a study leaves it."""
    folder = tmp_path / "out" / "peers"
    folder.mkdir(parents=True)
    machine = {"cores": 2, "cpu": "Fast (family 1)"}
    write_document(folder / "peers.json", {"command": "polaropt study peers -o OUT", "machine": machine}, [{"a": 1}])
    (folder / "peers.md").write_text(TABLE + "\n")
    (folder / "peers.svg").write_text("<svg/>")
    (folder / "large.csv").write_bytes(bytes(800_000))
    return folder.parent


def test_small_results_are_kept_in_the_place_of_earlier_ones(out: Path, tmp_path: Path) -> None:
    results = tmp_path / "results"
    (results / "peers").mkdir(parents=True)
    (results / "peers" / "old.md").write_text("old")
    assert keep(out, results) == ["peers"]
    assert sorted(file.name for file in (results / "peers").iterdir()) == ["peers.json", "peers.md"]


def test_the_page_shows_table_and_command_between_its_marks(out: Path, tmp_path: Path) -> None:
    results = tmp_path / "results"
    keep(out, results)
    made = page("Before.\n\n<!-- peers/peers.md -->\nold\n<!-- end -->\n\nAfter.\n", results)
    assert "old" not in made
    assert TABLE in made
    assert "`polaropt study peers -o OUT`, on 2 cores (Fast)." in made
    assert made.startswith("Before.\n")
    assert made.endswith("After.\n")
    assert page(made, results) == made


def test_rows_are_kept_however_many(out: Path, tmp_path: Path) -> None:
    file, rows = out / "peers" / "peers.json", [{"a": i} for i in range(100_000)]
    write_document(file, json.loads(file.read_text())["metadata"], rows)
    assert file.stat().st_size > 1_000_000
    keep(out, tmp_path / "results")
    kept = tmp_path / "results" / "peers" / "peers.json"
    assert json.loads(kept.read_text()) == json.loads(file.read_text())
    assert kept.stat().st_size < file.stat().st_size


def test_the_page_in_the_repository_is_that_of_its_results() -> None:
    text = PAGE.read_text(encoding="utf-8")
    assert page(text) == text


def test_every_study_has_results_and_a_place_on_the_page() -> None:
    text = PAGE.read_text(encoding="utf-8")
    for study in STUDIES:
        document = RESULTS / study.name / f"{study.name}.json"
        assert json.loads(document.read_text(encoding="utf-8"))["results"]
        assert re.search(rf"<!-- {study.name}/[\w.]+ -->", text)
