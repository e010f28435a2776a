"""The page of results: it shows what is kept, and nothing else."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest

from studies.catalogue import STUDIES
from studies.kit.captions import caption
from studies.kit.page import PAGE, RESULTS, keep, kept_states, page, write_index
from studies.kit.records import metadata, write_document

TABLE = "| a | b |\n|---|---|\n| 1 | 2 |"


MACHINE = {"cores": 2, "cpu": "Fast (family 1)"}


def write_run(
    out: Path, study: str, commit: str = "a" * 40, sources: str = "0" * 16, *, modified: bool = False
) -> Path:
    """A folder as a study leaves it."""
    folder = out / study
    folder.mkdir(parents=True)
    header = {"command": f"polaropt study {study} -o OUT", "machine": MACHINE, "commit": commit, "sources": sources}
    write_document(folder / f"{study}.json", {**header, "modified": modified}, [{"a": 1}])
    (folder / f"{study}.md").write_text(TABLE + "\n")
    return out


@pytest.fixture
def out(tmp_path: Path) -> Path:
    write_run(tmp_path / "out", "peers")
    folder = tmp_path / "out" / "peers"
    (folder / "peers.svg").write_text("<svg/>")
    (folder / "large.csv").write_bytes(bytes(800_000))
    return folder.parent


def test_small_results_are_kept_in_the_place_of_earlier_ones(out: Path, tmp_path: Path) -> None:
    results = tmp_path / "results"
    (results / "peers").mkdir(parents=True)
    (results / "peers" / "old.md").write_text("old")
    assert keep([out], results) == ["peers"]
    assert sorted(file.name for file in (results / "peers").iterdir()) == ["peers.json", "peers.md"]


def test_the_page_shows_table_and_command_between_its_marks(out: Path, tmp_path: Path) -> None:
    results = tmp_path / "results"
    keep([out], results)
    made = page("Before.\n\n<!-- peers/peers.md -->\nold\n<!-- end -->\n\nAfter.\n", results)
    assert "old" not in made
    assert TABLE in made
    assert "`polaropt study peers -o OUT`, on 2 cores (Fast), commit aaaaaaaaa." in made
    assert made.startswith("Before.\n")
    assert made.endswith("After.\n")
    assert page(made, results) == made


def test_numbers_stand_at_the_right_and_words_at_the_left(tmp_path: Path) -> None:
    out = write_run(tmp_path / "out", "peers")
    lines = ["# All", "", "| theta | instead | T / R | gained |  |", "|---|---|---|---|---|"]
    lines += ["| 10 |  | 42.41 / 25.16 | +0.1 |  |", "| 20 | one bounce | 42.40 / 24.95 |  | too few |"]
    (out / "peers" / "peers.md").write_text("\n".join(lines) + "\n\nWords | beside it.\n")
    shown = write_index(out).read_text()
    head = re.search(r"<thead>.*?</thead>", shown, re.DOTALL)
    assert head is not None
    at_right = re.findall(r'<th style="text-align:right">(.*?)</th>', head[0])
    assert at_right == ["T / R", "gained"]
    assert re.findall(r"<th>(.*?)</th>", head[0]) == ["theta", "instead", ""]
    assert "Words | beside it." in shown


def test_a_part_of_a_study_names_its_own_command(out: Path, tmp_path: Path) -> None:
    results = tmp_path / "results"
    keep([out], results)
    (results / "peers" / "part.md").write_text(TABLE)
    write_document(results / "peers" / "part.json", metadata({}) | {"command": "polaropt study peers --part"}, [])
    assert "`polaropt study peers --part`" in page("<!-- peers/part.md -->\n<!-- end -->\n", results)


def test_a_study_that_was_run_again_stands_beside_those_of_an_earlier_commit(out: Path, tmp_path: Path) -> None:
    results = tmp_path / "results"
    keep([out], results)
    other = write_run(tmp_path / "other", "coverage", commit="b" * 40, sources="1" * 16)
    assert keep([other], results) == ["coverage"]
    assert kept_states(results) == {"commit aaaaaaaaa": ["peers"], "commit bbbbbbbbb": ["coverage"]}


def test_results_of_code_that_is_no_commit_are_refused(tmp_path: Path) -> None:
    changed = write_run(tmp_path / "changed", "peers", modified=True)
    with pytest.raises(SystemExit, match="changed without a commit"):
        keep([changed], tmp_path / "results")


def test_a_run_that_has_not_come_to_its_end_is_refused(out: Path, tmp_path: Path) -> None:
    results = tmp_path / "results"
    keep([out], results)
    begun = write_run(tmp_path / "begun", "peers")
    (begun / "peers" / "peers.md").unlink()
    with pytest.raises(SystemExit, match="has not come to its end"):
        keep([begun], results)
    assert (results / "peers" / "peers.md").is_file()


def test_what_is_kept_is_no_run_to_keep(out: Path, tmp_path: Path) -> None:
    results = tmp_path / "results"
    keep([out], results)
    with pytest.raises(SystemExit, match="results holds what is kept"):
        keep([tmp_path / "out" / ".." / "results"], results)
    assert (results / "peers" / "peers.md").read_text().strip() == TABLE


def test_the_page_says_which_code_its_results_come_from(out: Path, tmp_path: Path) -> None:
    results, text = tmp_path / "results", "<!-- code state -->\n<!-- end -->\n"
    keep([out], results)
    assert "All results on this page come from commit aaaaaaaaa." in page(text, results)
    # The same sources in a later commit are the same code.
    write_run(results, "coverage", commit="b" * 40)
    assert "All results on this page come from commit aaaaaaaaa." in page(text, results)
    write_run(results, "stability", commit="c" * 40, sources="1" * 16)
    made = page(text, results)
    assert "come from several commits" in made
    assert "commit ccccccccc (stability)" in made
    assert page(made, results) == made


def test_rows_are_kept_however_many(out: Path, tmp_path: Path) -> None:
    file, rows = out / "peers" / "peers.json", [{"a": i} for i in range(100_000)]
    write_document(file, json.loads(file.read_text())["metadata"], rows)
    assert file.stat().st_size > 1_000_000
    keep([out], tmp_path / "results")
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


def test_a_first_study_that_fails_leaves_an_index_of_nothing(tmp_path: Path) -> None:
    assert "<section" not in write_index(tmp_path / "new").read_text()


def test_the_index_shows_tables_figures_and_data(tmp_path: Path) -> None:
    folder = tmp_path / "stability"
    folder.mkdir()
    (folder / "stability.md").write_text("# Stability\n\n| a | b |\n|---|---|\n| 1 | <2 |\n")
    header = metadata({}) | {"command": "polaropt study stability -o OUT"}
    write_document(folder / "stability.json", header, [{"job": "0", "square": 9}])
    for name in ("map.svg", "map.png", "look.html"):
        (folder / name).write_text("{}")
    page = write_index(tmp_path).read_text()
    assert ">&lt;2</td>" in page
    assert "<h3>Stability</h3>" in page
    assert "<code>polaropt study " in page
    assert 'src="stability/map.svg"' in page
    assert '<iframe src="stability/look.html"' in page
    assert "map.png" not in page
    assert 'href="stability/stability.json"' in page
    assert "paper_protocol" not in page


def test_every_kept_figure_says_what_it_shows():
    figures = [path.stem for path in RESULTS.glob("*/*.png")]
    assert figures
    for name in figures:
        assert caption(name) != name.replace("_", " "), name
        assert len(caption(name).split()) > 6


def test_links_can_be_read_in_the_dark(out: Path):
    style = write_index(out).read_text()
    assert "prefers-color-scheme: dark) { a { color:" in style
