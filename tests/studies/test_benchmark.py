"""The benchmark: its clock, its judge, its figures, and the whole of it in one command."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from tests.documents import document_of

pytest.importorskip("torch")
pytest.importorskip("matplotlib")

from polaropt.solving.objective import Weights
from polaropt.solving.problem import Problem
from solvers.base import Status, StopSolving
from studies.benchmark import mosaics, processes, study, tables
from studies.benchmark.judge import Finish, Judge, Limits, Recorder, Verdict, find_finish
from studies.benchmark.kernels import traffic_bytes
from studies.benchmark.race import OURS, SCIPY_AUTOGRAD, TORCH_AUTOGRAD, Rounds, contestants, race
from studies.benchmark.rows import MOSAICS, TABLES, Place, Row
from studies.benchmark.study import sample_of
from studies.benchmark.tables import Target, figure, ratio, with_spread
from studies.kit.frames import frame_of
from studies.kit.timing import Threads
from studies.photographs import Photographs, Size
from studies.scores import both_psnr

SIZE = Size(48, 56)


@pytest.fixture(scope="module")
def judge():
    return Judge(sample_of(Photographs(), 60.0, SIZE))


@pytest.fixture(scope="module")
def finish(judge):
    return find_finish(judge, 200)


def test_scenes_need_not_be_square():
    sample = sample_of(Photographs(), 20.0, SIZE)
    assert str(SIZE) == "56x48"
    assert sample.capture.shape[-2:] == (48, 56)
    assert sample.layers.shape == (2, 3, 48, 56)
    assert both_psnr(sample.layers, sample.layers) == (200, 200)


def test_the_judge_sees_the_objective_that_the_solvers_see(judge):
    start = judge.start("closed-form")
    verdict = judge.verdict(start)
    fresh = Problem(judge.sample.capture, judge.sample.scene, judge.noise, Weights())
    objective = fresh.compiled(start)
    assert verdict.value == pytest.approx(objective.value_and_grad(objective.coordinates(start))[0], rel=1e-5)
    expected = both_psnr(fresh.canvas.crop(start), judge.sample.layers)
    assert (verdict.transmission_db, verdict.reflection_db) == pytest.approx(expected, abs=1e-3)


def test_the_gap_runs_from_the_cold_start_to_the_lowest_value(judge, finish):
    assert finish.gap(judge.verdict(judge.cold)) == pytest.approx(1)
    assert finish.gap(finish.best) == 0
    lower = Verdict(finish.best.value - 1, 40.0, 30.0)
    assert finish.lowered([lower]).best is lower
    assert finish.lowered([judge.verdict(judge.cold)]).best is finish.best


def test_a_run_arrives_where_gap_and_transmission_are_right():
    finish = Finish(Verdict(100.0, 40.0, 30.0), 1100.0)
    assert finish.near(Verdict(0, 39.95, 0))
    assert finish.near(Verdict(0, 40.05, 0))
    assert not finish.near(Verdict(0, 40.2, 0))
    assert finish.gap(Verdict(101.0, 0, 0)) == pytest.approx(1e-3)


def test_a_recorder_stops_at_its_limits(judge, finish):
    recorder = Recorder(judge, finish, Limits(60.0, 2))
    recorder.set_up()
    recorder.evaluated(2.0, lambda: judge.cold)
    # A point that is no better is not looked at.
    with pytest.raises(StopSolving):
        recorder.evaluated(3.0, lambda: pytest.fail("not the lowest"))
    assert len(recorder.run.points) == 2
    assert recorder.run.points[0].verdict == recorder.run.points[1].verdict
    assert recorder.run.arrival(finish) is None


@pytest.mark.parametrize("contestant", contestants(), ids=lambda contestant: contestant.name)
def test_every_contestant_goes_down(contestant, judge, finish):
    # Threads that wait actively take forever where cores are shared.
    run = race(replace(contestant, threads=Threads(1, 1)), judge, finish, Limits(20.0, 20))
    assert run.note == ""
    assert run.set_up[0] >= 0
    assert run.status in (Status.CONVERGED, Status.EVALUATION_LIMIT, Status.TIME_LIMIT)
    gaps = [finish.gap(point.verdict) for point in run.points]
    seconds = [point.seconds for point in run.points]
    assert gaps[-1] < 0.5 * gaps[0]
    assert np.all(np.diff(seconds) > 0)


def test_polaropt_arrives_in_few_evaluations_from_both_starts(judge, finish):
    ours = [contestant for contestant in contestants() if contestant.solver == OURS]
    assert [contestant.init for contestant in ours] == ["closed-form", "cold"]
    for contestant in ours:
        arrival = race(contestant, judge, finish, Limits(30.0)).arrival(finish)
        assert arrival is not None
        assert arrival < 30


def test_the_slow_ones_start_cold_too():
    named = {contestant.name for contestant in contestants()}
    assert {
        f"{rival}, {init}" for rival in (SCIPY_AUTOGRAD, TORCH_AUTOGRAD) for init in ("cold", "closed-form")
    } <= named


def test_the_bound_counts_layers_gradient_and_data():
    sample = sample_of(Photographs(), 60.0, SIZE)
    problem = Problem(sample.capture, sample.scene, 0.005, Weights())
    height, width = problem.canvas.shape
    expected = 4 * (3 * 6 * height * width + 6 * 48 * 56)
    assert traffic_bytes(problem) == expected


def test_a_measurement_tells_its_median_and_spread():
    place = Place("table", "case", "size")
    measured = place.measured("who", "what", "s", [3.0, 1.0, 2.0])
    assert (measured.median, measured.low, measured.high) == (2, 1, 3)
    assert math.isnan(place.measured("who", "what", "s", []).median)


def test_ratios_are_taken_within_rounds():
    place = Place("t", "c", "s")
    theirs, ours = place.measured("a", "q", "s", [10, 30]), place.measured("b", "q", "s", [1, 2])
    assert ratio(theirs, ours) == (10, 15)
    assert ratio(place.measured("a", "q", "s", [30]), ours) == (20,)
    assert ratio(place.measured("a", "q", "s", []), ours) == ()


def test_figures_have_three_digits():
    assert [figure(value) for value in (0.012345, 1.5, 123.4, 2e-5, 0.0, math.nan)] == [
        "0.0123", "1.50", "123", "2e-05", "0", "-",
    ]  # fmt: skip
    assert with_spread([1.0, 3.0, 2.0], ">=") == ">= 2.00 (1.00..3.00)"


@pytest.mark.parametrize(
    ("target", "outcome"),
    [
        (Target("t", "", (70.0,), 60, 120, True), "reached"),
        (Target("t", "", (70.0,), 80, 120, True), "missed"),
        (Target("t", "", (70.0,), 80, 120, True, ">="), "not told"),
        (Target("t", "", (130.0,), 60, 120, True, ">="), "beyond"),
        (Target("t", "", (1.0,), 4, 2), "beyond"),
        (Target("t", "", (20.0,), 30, 15, False, ">="), "not told"),
        (Target("t", "", (40.0,), 30, 15, False, ">="), "missed"),
        (Target("t", "", (), 30, 15), "not measured"),
    ],
)
def test_figures_asked_for_are_compared(target, outcome):
    assert target.row()[-1] == outcome


def test_growth_is_the_power_of_the_pixels():
    sizes = {"512x512": (2.0, 3.0, 100.0), "1024x1024": (16.0, 12.0, 300.0)}
    rows = [
        Place(MOSAICS, "mono", size).measured("mono", quantity, "", [value])
        for size, values in sizes.items()
        for quantity, value in zip((mosaics.WALL, mosaics.CPU, mosaics.PEAK), values, strict=True)
    ]
    title, _, table = tables._mosaics(frame_of(Row, rows))
    assert title == "Raw mosaics"
    assert list(table["growth"]) == ["-", "1.50"]
    assert list(table["growth of CPU"]) == ["-", "1.00"]


def test_what_is_asked_of_a_raw_mosaic_is_compared_at_the_sensor_s_size():
    place = Place(MOSAICS, "color, cell", tables._MOSAIC_SIZE)
    rows = [place.measured("c", mosaics.WALL, "s", [7.0]), place.measured("c", mosaics.PEAK, "MB", [3100.0])]
    found = [target.row() for target in tables._of_mosaics(frame_of(Row, rows))]
    assert [(row[-3], row[-2], row[-1]) for row in found] == [("<= 7.50", "-", "reached"), ("<= 3000", "-", "missed")]


def test_an_unknown_table_is_refused(tmp_path, capsys):
    with pytest.raises(SystemExit):
        study.main(["--tables", "nonsense", "-o", str(tmp_path)])
    assert "there are: imports" in capsys.readouterr().err


def few_contestants():
    """One of each kind: ours, a rival on the compiled objective, one with automatic derivatives."""
    there = contestants()
    rivals = [one for one in there if one.solver.endswith("scipy")][:1] + there[-1:]
    return [*(one for one in there if one.solver == OURS)][:1] + rivals


def once(run):
    """Start each program once: what it tells of another scene, and in the next round, has the same form."""
    said = {}

    def ran(command):
        program = tuple(command[:3])
        if program not in said:
            said[program] = run(command)
        return said[program]

    return ran


def test_the_benchmark_is_one_command(tmp_path, monkeypatch, capsys, told_pane, png_alone):
    rounds = Rounds(1, 0.2, 0.2, 1, reference_evaluations=20)
    quick = study.PLANS["quick"]
    pace = replace(quick.pace, rounds=rounds, imports=1, vector_mib=4)
    sizes = {"blind": SIZE, "memory": SIZE, "mosaics": (Size(64, 64),)}
    plan = replace(quick, pace=pace, kernel_sizes=(SIZE,), **sizes)
    monkeypatch.setitem(study.PLANS, "quick", plan)
    monkeypatch.setattr("studies.benchmark.race.contestants", few_contestants)
    monkeypatch.setattr("studies.benchmark.race._CHOICES", (Threads(1, 1),))
    monkeypatch.setattr(study, "RUNNING_ON_DEG", (10.0,))
    monkeypatch.setattr(processes, "_run", once(processes._run))
    study.main(["--quick", "--sizes", "48", "-o", str(tmp_path)])
    assert "Against the figures asked for" in capsys.readouterr().out
    document = document_of(tmp_path / "benchmark.json")
    assert {row["table"] for row in document["results"]} == set(TABLES)
    report = (tmp_path / "benchmark.md").read_text()
    for title in (
        "Time to gap 1e-3: hard",
        "Objective and gradient",
        "Running on",
        "Raw mosaics",
        "Peak memory",
        "Imports",
    ):
        assert f"## {title}" in report
    for name in ("work_precision.png", "work_precision_easy.png"):
        assert (tmp_path / name).stat().st_size > 10_000


def test_tables_that_are_not_wanted_are_not_measured():
    jobs = study.jobs_of(study.PLANS["quick"], Photographs(), ["imports"])
    assert [(job.table, job.size) for job in jobs] == [("imports", None)]
    assert {job.table for job in study.jobs_of(study.PLANS["full"], Photographs())} == set(TABLES)
