"""Speed against accuracy: the front, what beats the defaults, profiles, ways that agree with `separate`, the page."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pandas import DataFrame

from tests.browser import dom_of
from tests.documents import document_of

pytest.importorskip("torch")
pytest.importorskip("matplotlib")
pytest.importorskip("bokeh")

from polaropt.separation import separate
from polaropt.simulation.metrics import psnr_db
from solvers.base import StoppingRule
from studies.kit.frames import frame_of
from studies.photographs import Size
from studies.scores import BORDER_PX, LAYERS
from studies.speed_accuracy import study
from studies.speed_accuracy.figures import ONE, place_labels
from studies.speed_accuracy.marks import Mark, beaten_by, compared, front, marks, ratios, share_within, with_ways
from studies.speed_accuracy.runs import run_ways
from studies.speed_accuracy.study import FEW, Job, Row, verdict
from studies.ways import DEFAULT, KNOWN, Way, crossed, one_at_a_time, other_methods, tolerances

SCIPY, GHOSTS = replace(DEFAULT, solver="scipy"), replace(DEFAULT, rung="ghosts")


def mark(way: Way, seconds: float, transmission: float, reflection: float = 20.0) -> Mark:
    return Mark(way, seconds, seconds, seconds, seconds, transmission, reflection, 5.0, math.nan)


def row(way: Way, scene: str, seconds: float, transmission: float, **more) -> Row:
    settings = (way.method, way.solver, way.start, way.rung, way.relative_change)
    return Row(ONE, "64x64", scene, 0, *settings, transmission, 20.0, (seconds,), (seconds,), **more)


def frame(rows: list[Row]) -> DataFrame:
    return with_ways(frame_of(Row, rows))


def test_the_default_is_what_separate_does_by_itself():
    assert one_at_a_time()[0] == DEFAULT
    assert DEFAULT.stopping == StoppingRule()
    assert DEFAULT.label == "default"
    assert {way.factor for way in one_at_a_time()} == {"", "solver", "start", "rung", "tolerance"}
    assert replace(DEFAULT, rung=KNOWN).label == KNOWN
    assert DEFAULT in crossed(tolerances())


def test_ways_that_are_told_something_are_not_blind():
    blind = {way.method for way in other_methods() if way.blind}
    assert {"plain intensity", "closed form alone"} <= blind
    assert "FastICA" not in blind
    assert not replace(DEFAULT, rung=KNOWN).blind


@given(st.lists(st.tuples(st.floats(0.01, 10), st.floats(10, 50)), min_size=1, max_size=12))
def test_nothing_off_the_front_is_both_faster_and_better(points):
    found = [mark(replace(DEFAULT, rung=str(i)), *point) for i, point in enumerate(points)]
    chosen = front(found, "transmission")
    assert [one.seconds for one in chosen] == sorted(one.seconds for one in chosen)
    for one in found:
        better = [
            other for other in found
            if other.seconds <= one.seconds and other.transmission >= one.transmission
            and (other.seconds, other.transmission) != (one.seconds, one.transmission)
        ]  # fmt: skip
        assert (one in chosen) <= (not better)
        assert better or any((one.seconds, one.transmission) == (other.seconds, other.transmission) for other in chosen)


def test_only_what_is_clearly_better_beats_the_default():
    default = mark(DEFAULT, 1.0, 40.0)
    as_good = [mark(SCIPY, 0.97, 40.005), mark(SCIPY, 0.5, 39.9), mark(SCIPY, 2.0, 41.0)]
    better = [mark(SCIPY, 0.9, 40.0), mark(SCIPY, 1.0, 40.1)]
    told = mark(replace(DEFAULT, rung=KNOWN), 0.1, 45.0)
    for other in (*as_good, told):
        assert beaten_by([default, other], LAYERS) == []
    for other in better:
        assert beaten_by([default, other], LAYERS) == [other]
    assert "on the front" in verdict([default, *as_good, told], LAYERS)
    assert "beaten by solver scipy (-10 % s" in verdict([default, better[0]], LAYERS)


def test_means_are_of_ways_that_ran_on_all_scenes():
    rows = [row(way, scene, 1.0, 40.0) for way in (DEFAULT, SCIPY) for scene in ("a", "b")]
    rows[-1] = row(SCIPY, "b", math.nan, math.nan, not_run="too large")
    assert [one.way for one in marks(frame(rows))] == [DEFAULT]


def test_profiles_count_the_scenes_solved_within_a_factor_of_the_fastest():
    rows = [row(DEFAULT, "a", 2.0, 40.0), row(GHOSTS, "a", 1.0, 40.1)]
    rows += [row(DEFAULT, "b", 1.0, 40.0), row(GHOSTS, "b", 0.5, 30.0)]
    ways = compared(frame(rows), "rung")
    assert ways == [DEFAULT, GHOSTS]
    ratio = ratios(frame(rows), ways)
    np.testing.assert_array_equal(ratio[DEFAULT], [2, 1])
    np.testing.assert_array_equal(ratio[GHOSTS], [1, math.inf])
    np.testing.assert_array_equal(share_within(ratio[DEFAULT], np.array([1.0, 2.0])), [0.5, 1])


def test_a_way_reaches_what_separate_reaches_with_its_settings():
    sample = Job(None, ONE, Size(48, 48), FEW[0], 0).sample()
    ways = (DEFAULT, replace(DEFAULT, solver="scipy", start="cold", rung="pixelwise"))
    timed = run_ways(sample, ways, 1)
    for way in ways:
        result = separate(sample.capture, solver=way.solver, init=way.start, model=way.rung)
        expected = [psnr_db(result.layers[i], sample.layers[i], BORDER_PX) for i in (0, 1)]
        assert [timed[way].levels[layer] for layer in LAYERS] == pytest.approx(expected, abs=1e-3)
        assert timed[way].evaluations == result.solver.n_evaluations
        assert timed[way].rung == result.scene.rung


def test_labels_keep_off_points_and_one_another():
    from matplotlib.figure import Figure
    from matplotlib.text import Text

    figure = Figure(figsize=(4, 4))
    axes = figure.subplots()
    axes.set(xlim=(0, 1), ylim=(0, 1))
    place_labels(axes, [(0.5, 0.5 + 0.001 * i, str(i)) for i in range(8)] + [(2.0, 0.5, "out of sight")])
    figure.draw_without_rendering()
    # Without the lines that lead to the points.
    boxes = [Text.get_window_extent(text) for text in axes.texts]
    assert len(boxes) == 8
    assert not any(a.overlaps(b) for i, a in enumerate(boxes) for b in boxes[:i])


@pytest.mark.filterwarnings("default")
def test_the_study_is_one_command(tmp_path, monkeypatch, capsys):
    small = study.Step(Size(48, 48), FEW[:1], 1)
    plan = study.Plan((small,), replace(small, scenes=()))
    monkeypatch.setitem(study.PLANS, "quick", plan)
    monkeypatch.setattr(study, "_warm_up", lambda scene: None)
    monkeypatch.setattr(study, "other_methods", lambda: other_methods()[:2])
    monkeypatch.setattr(study, "one_at_a_time", lambda: (DEFAULT, SCIPY, replace(SCIPY, start="cold")))
    study.main(["--quick", "-o", str(tmp_path)])
    assert "| **default** |" in capsys.readouterr().out
    for name in ("one_at_a_time_48x48", "profiles", "memory"):
        assert (tmp_path / f"speed_{name}.png").stat().st_size > 10_000
    assert len(document_of(tmp_path / "speed_accuracy.json")["results"]) == 5
    page = tmp_path / "speed_accuracy.html"
    assert page.stat().st_size < 2_000_000
    assert "http" not in page.read_text(encoding="utf-8").split("<script")[0]
    assert "bk-Tabs" in dom_of(page, tmp_path)
