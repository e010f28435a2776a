"""Studies work through their jobs, go on where they were broken off, and share the work among processes."""

from __future__ import annotations

import json
import math
from contextlib import contextmanager
from dataclasses import dataclass

import pytest
from distributed import Client

from studies.kit.frames import frame_of
from studies.kit.records import row_of
from studies.kit.run import Workers, _client, job_key, publish, run_jobs, run_study, study_parser


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


def test_rows_come_in_the_jobs_order(tmp_path):
    rows = run_jobs(squared, JOBS, tmp_path / "out" / "squares.json", {})
    assert [row_of(Result, row) for row in rows] == [squared(job)[0] for job in JOBS]


@pytest.mark.filterwarnings("default")
def test_processes_of_a_study_give_the_same_and_obey_nobody_else(tmp_path, monkeypatch):
    """Any user of the machine could run code in them: they listened without authentication."""

    @contextmanager
    def attacked(workers):
        with _client(workers) as client:
            address = client.scheduler.address
            assert address.startswith("tls://127.0.0.1")
            with pytest.raises((OSError, TypeError)):
                Client(address.replace("tls", "tcp"), timeout=2)
            refused.append(address)
            yield client

    refused = []
    monkeypatch.setattr("studies.kit.run._client", attacked)
    rows = run_jobs(squared, JOBS, tmp_path / "squares.json", {}, Workers(2))
    assert [row_of(Result, row) for row in rows] == [squared(job)[0] for job in JOBS]
    assert len(refused) == 1


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


def test_a_study_is_run_and_published(tmp_path, capsys):
    options = study_parser("Squares.").parse_args(["-o", str(tmp_path)])
    frame = run_study("squares", squared, JOBS, Result, options)
    assert frame.equals(frame_of(Result, [squared(job)[0] for job in JOBS]))
    publish("squares", options, "| a |", {})
    assert capsys.readouterr().out == "| a |\n"
    assert (tmp_path / "squares.md").read_text() == "| a |\n"
    assert (tmp_path / "squares.csv").read_text().splitlines()[0] == "job,number,square,names"
    assert json.loads((tmp_path / "squares.json").read_text())["metadata"]["threads"]["processes"] == "1"
