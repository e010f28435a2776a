"""Studies work through their jobs, go on where they were broken off, and share the work among processes."""

from __future__ import annotations

import json
import math
from dataclasses import dataclass

import pytest

from studies.index_page import write_index
from studies.work import Hands, job_key, row_of, run_jobs


@dataclass(frozen=True)
class Square:
    number: int


@dataclass(frozen=True)
class Result:
    number: int
    square: float
    names: tuple[str, ...]


def squared(job: Square) -> list[Result]:
    return [Result(job.number, job.number**2, ("a", "b"))]


def undefined(job: Square) -> list[Result]:
    return [Result(job.number, math.nan, ())]


def broken(job: Square) -> list[Result]:
    raise RuntimeError("must not be run again")


JOBS = [Square(number) for number in (3, 1, 2)]


@pytest.mark.parametrize("hands", [Hands(), pytest.param(Hands(2), id="two processes")])
@pytest.mark.filterwarnings("default")
def test_rows_come_in_the_jobs_order_whoever_works(tmp_path, hands):
    rows = run_jobs(squared, JOBS, tmp_path / "out" / "squares.json", {}, hands)
    assert [row_of(Result, row) for row in rows] == [squared(job)[0] for job in JOBS]


def test_what_is_done_is_not_done_again(tmp_path):
    path = tmp_path / "squares.json"
    run_jobs(squared, JOBS[:2], path, {})
    run_jobs(squared, JOBS[2:], path, {})
    rows = run_jobs(broken, JOBS, path, {})
    assert [row["square"] for row in rows] == [9, 1, 4]
    assert len(json.loads(path.read_text())["results"]) == 3


def test_what_was_made_before_an_interruption_is_kept(tmp_path):
    def interrupted(job):
        if job == JOBS[2]:
            raise KeyboardInterrupt
        return squared(job)

    path = tmp_path / "squares.json"
    with pytest.raises(SystemExit, match="stopped after 2 jobs; the same command goes on"):
        run_jobs(interrupted, JOBS, path, {})
    assert [row["square"] for row in run_jobs(squared, JOBS, path, {})] == [9, 1, 4]
    assert [row["square"] for row in run_jobs(broken, JOBS[:2], path, {})] == [9, 1]


def test_rows_of_other_settings_do_not_count(tmp_path):
    path = tmp_path / "squares.json"
    run_jobs(squared, JOBS, path, {"size": 1})
    with pytest.raises(RuntimeError):
        run_jobs(broken, JOBS, path, {"size": 2})


def test_what_was_not_measured_is_null_and_comes_back_as_nan(tmp_path):
    (row, *_) = run_jobs(undefined, JOBS, tmp_path / "squares.json", {})
    assert row["square"] is None
    assert math.isnan(row_of(Result, row).square)


def test_a_job_is_known_by_its_values():
    assert job_key(Square(1)) == job_key(Square(1)) != job_key(Square(2))


def test_a_first_study_that_fails_leaves_an_index_of_nothing(tmp_path):
    assert "<section" not in write_index(tmp_path / "new").read_text()


def test_the_index_shows_tables_figures_and_data(tmp_path):
    folder = tmp_path / "stability"
    folder.mkdir()
    (folder / "stability.md").write_text("# Stability\n\n| a | b |\n|---|---|\n| 1 | <2 |\n")
    run_jobs(squared, JOBS, folder / "stability.json", {})
    for name in ("map.svg", "map.png", "look.html"):
        (folder / name).write_text("{}")
    page = write_index(tmp_path).read_text()
    assert "<td>&lt;2</td>" in page
    assert "<h3>Stability</h3>" in page
    assert "<code>polaropt study " in page
    assert 'src="stability/map.svg"' in page
    assert '<iframe src="stability/look.html"' in page
    assert "map.png" not in page
    assert 'href="stability/stability.json"' in page
    assert "paper_protocol" not in page
