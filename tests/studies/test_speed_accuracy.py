"""Speed against accuracy: the front, what beats the defaults, profiles, agreement with `separate`, mosaics, GPU."""

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

from polaropt.optics import SceneParameters
from polaropt.separation import separate
from polaropt.simulation.metrics import psnr_db
from solvers.base import StoppingRule
from studies.kit.frames import frame_of
from studies.photographs import Size
from studies.scores import BORDER_PX, LAYERS
from studies.speed_accuracy import gpu, jobs, study
from studies.speed_accuracy.figures import figures, place_labels
from studies.speed_accuracy.jobs import FEW, Job, Row
from studies.speed_accuracy.marks import (
    ON_GPU,
    ONE,
    SUBJECTS,
    Mark,
    beaten_by,
    compared,
    front,
    marks,
    paired,
    ratios,
    share_within,
    with_ways,
)
from studies.speed_accuracy.runs import enlarged, run_ways
from studies.speed_accuracy.tables import answer, verdict
from studies.ways import (
    AT_CELLS,
    BILINEAR,
    CELL,
    CLOSED_FORM,
    DEFAULT,
    KNOWN,
    MOSAIC_METHODS,
    TRAINED_ON_SHIPPED,
    Way,
    alone,
    crossed,
    one_at_a_time,
    other_methods,
    read_mosaic,
    solvers,
    solves,
    tolerances,
)

# One pane without tint; how several and dark ones are found is tested elsewhere.
CLEAR = SceneParameters(None, None, None)
SCIPY, GHOSTS = replace(DEFAULT, solver="scipy"), replace(DEFAULT, rung="ghosts")


def mark(way: Way, seconds: float, transmission: float, reflection: float = 20.0) -> Mark:
    return Mark(way, seconds, seconds, seconds, seconds, transmission, reflection, 5.0, math.nan)


def row(way: Way, scene: str, seconds: float, transmission: float, **more) -> Row:
    settings = (way.method, way.solver, way.start, way.rung, way.relative_change, way.resolution, way.device)
    return Row(ONE, "", "64x64", scene, 0, *settings, transmission, 20.0, (seconds,), (seconds,), **more)


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
    assert answer([default, *as_good, told], LAYERS) == "yes"
    assert answer([default, *better], LAYERS) == "no: solver scipy (+0 % s, +0.10 dB, +0.00 dB) and 1 more"
    assert "beaten by solver scipy (-10 % s" in verdict([default, better[0]], LAYERS)


def test_means_are_of_ways_that_ran_on_all_scenes():
    rows = [row(way, scene, 1.0, 40.0) for way in (DEFAULT, SCIPY) for scene in ("a", "b")]
    rows[-1] = row(SCIPY, "b", math.nan, math.nan, not_run="too large")
    assert [one.way for one in marks(frame(rows))] == [DEFAULT]


def test_pairs_compare_with_the_default_on_the_same_scenes():
    rows = [row(DEFAULT, "a", 1.0, 40.0), row(SCIPY, "a", 2.0, 41.0), row(DEFAULT, "b", 10.0, 30.0)]
    rows += [row(SCIPY, "b", 5.0, 30.5), row(GHOSTS, "b", 10.0, 33.0)]
    found = {one.way: one for one in paired(frame(rows))}
    assert (found[DEFAULT].seconds, found[DEFAULT].transmission) == (1, 0)
    assert (found[SCIPY].seconds, found[SCIPY].transmission) == pytest.approx((1, 0.75))
    # It was not tried on the other.
    assert (found[GHOSTS].seconds, found[GHOSTS].transmission) == pytest.approx((1, 3))
    failed = row(GHOSTS, "a", math.nan, math.nan, not_run="too large")
    assert {one.way for one in paired(frame([*rows, failed]))} == {DEFAULT, SCIPY}


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
    sample = replace(Job(None, ONE, Size(48, 48), FEW[0], 0).sample(), hint=CLEAR)
    ways = (DEFAULT, replace(DEFAULT, solver="scipy", start="cold", rung="pixelwise"))
    timed = run_ways(sample, ways, 1)
    for way in ways:
        result = separate(sample.capture, CLEAR, solver=way.solver, init=way.start, model=way.rung)
        expected = [psnr_db(result.layers[i], sample.layers[i], BORDER_PX) for i in (0, 1)]
        assert [timed[way].levels[layer] for layer in LAYERS] == pytest.approx(expected, abs=1e-3)
        assert timed[way].evaluations == result.solver.n_evaluations
        assert timed[way].rung == result.scene.rung


def test_of_a_raw_mosaic_a_way_reaches_what_separate_reaches_in_all_pixels_of_the_sensor():
    sample = replace(Job(None, ONE, Size(64, 64), FEW[0], 0, "mono").sample(), hint=CLEAR)
    closed = Way(CLOSED_FORM)
    timed = run_ways(sample, (DEFAULT, AT_CELLS, closed), 1)
    cells = read_mosaic(sample, CELL)
    default = separate(sample.capture, CLEAR)
    results = {
        DEFAULT: default,
        AT_CELLS: separate(cells.capture, CLEAR),
        closed: separate(sample.capture, default.scene, stopping=alone(DEFAULT).stopping),
    }
    assert cells.capture.shape == (32, 32)
    assert cells.scene.ghost_shift == pytest.approx(sample.scene.ghost_shift / 2)
    for way, result in results.items():
        expected = [psnr_db(enlarged(result.layers[i], (1, 64, 64)), sample.layers[i], BORDER_PX) for i in (0, 1)]
        assert [timed[way].levels[layer] for layer in LAYERS] == pytest.approx(expected, abs=1e-3)
        assert timed[way].evaluations == result.solver.n_evaluations


def test_layers_of_cells_are_enlarged_in_place():
    down, right = np.mgrid[:32, :32].astype(np.float32)
    sensor = np.stack([down + 2 * right, 3 * down - right])
    cells = sensor.reshape(2, 16, 2, 16, 2).mean(axis=(2, 4))
    np.testing.assert_allclose(enlarged(cells, sensor.shape)[:, 8:-8, 8:-8], sensor[:, 8:-8, 8:-8], atol=0.01)
    assert enlarged(sensor[0], (1, 32, 32)).shape == (1, 32, 32)


def test_others_are_given_photographs_that_were_interpolated_from_the_raw_mosaic():
    sample = Job(None, ONE, Size(64, 64), FEW[0], 0, "color").sample()
    seen = read_mosaic(sample, BILINEAR).capture
    assert seen.samples is None
    assert seen.intensities.shape == (4, 3, 64, 64)
    ways = other_methods(mosaic=True)
    assert {method.resolution for method in MOSAIC_METHODS.values()} == {"bilinear", "LMMSE"}
    assert {f"{BILINEAR}, per pixel", CLOSED_FORM} <= {way.method for way in ways}
    assert AT_CELLS in one_at_a_time(mosaic=True)
    assert AT_CELLS not in one_at_a_time()


def test_an_interpolation_is_not_judged_on_photographs_that_it_was_trained_on(monkeypatch):
    monkeypatch.setattr(jobs, "one_at_a_time", lambda mosaic: (DEFAULT,))
    monkeypatch.setattr(jobs, "other_methods", lambda mosaic: tuple(map(Way, TRAINED_ON_SHIPPED)))
    rows = jobs.run(Job(None, ONE, Size(64, 64), FEW[0], 0, "mono"))
    assert [bool(row.not_run) for row in rows] == [False, *(True for _ in TRAINED_ON_SHIPPED)]


def test_photographs_and_mosaics_are_run_in_all_sizes_the_largest_in_few_ways():
    default = study.jobs_of(None, "default", 4)
    sizes = {sensor: {str(job.size) for job in default if job.sensor == sensor} for sensor in SUBJECTS}
    assert sizes[""] == sizes["color"] == {"256x256", "512x512", "1224x1024", "2448x2048"}
    assert sizes["mono"] == {"256x256", "512x512", "1224x1024"}
    for job in default:
        assert job.choice == {"1224x1024": "solves", "2448x2048": "solvers"}.get(str(job.size), "all")
    assert {job.sensor for job in study.jobs_of(None, "quick", 4)} == set(SUBJECTS)
    for mosaic in (False, True):
        assert {DEFAULT, Way(CLOSED_FORM), SCIPY} < set(solvers(mosaic)) < set(solves(mosaic))
        assert set(solves(mosaic)) < {*one_at_a_time(mosaic), *other_methods(mosaic)}


def test_without_a_gpu_the_study_says_so(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(gpu, "there", lambda: False)
    gpu.main(["--quick", "-o", str(tmp_path)])
    assert gpu.NO_GPU in capsys.readouterr().out
    assert [path.name for path in tmp_path.iterdir()] == [f"{gpu.NAME}.md"]


def test_on_a_gpu_seconds_are_by_the_clock():
    [job, *_] = gpu.jobs_of(None, "quick", device="cpu")
    rows = jobs.run(job)
    assert [(row.part, row.solver, row.device) for row in rows] == [
        (ON_GPU, DEFAULT.solver, ""), (ON_GPU, DEFAULT.solver, "cpu"), (ON_GPU, "torch", ""), (ON_GPU, "torch", "cpu"),
    ]  # fmt: skip
    assert [row.transmission for row in rows[1:]] == pytest.approx([rows[0].transmission] * 3, abs=0.1)
    text = gpu.table(frame_of(Row, [replace(row, elapsed=(2.0, 3.0), cpu=(9.0, 9.0)) for row in rows]))
    assert "| solver torch, device cpu | 2.5 (2 to 3) | 1.00 |" in text


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
def test_the_study_is_one_command(tmp_path, monkeypatch, capsys, told_pane, png_alone):
    small = study.Step(Size(64, 64), FEW[:1])
    plan = study.Plan((replace(small, memory=True), replace(small, sensor="color")), ())
    monkeypatch.setitem(study.PLANS, "quick", plan)
    monkeypatch.setattr(jobs, "other_methods", lambda mosaic: other_methods(mosaic)[:2])
    monkeypatch.setattr(jobs, "one_at_a_time", lambda mosaic: (DEFAULT, AT_CELLS if mosaic else SCIPY))
    drawn = [f"speed_{name}" for name in ("one_at_a_time_color_64x64", "profiles", "memory")]
    monkeypatch.setattr(study, "figures", lambda frame: {name: figures(frame)[name] for name in drawn})
    study.main(["--quick", "-o", str(tmp_path)])
    said = capsys.readouterr().out
    assert "| **default** |" in said
    # One of full photographs and one of mosaics.
    assert said.count("the defaults are") == 6
    assert "all sizes against the defaults" in said
    assert all(f"{SUBJECTS[sensor]} | 64x64 | 4, one at a time | 1 |" in said for sensor in ("", "color"))
    for name in drawn:
        assert (tmp_path / f"{name}.png").stat().st_size > 10_000
    rows = document_of(tmp_path / "speed_accuracy.json")["results"]
    assert [row["sensor"] for row in rows] == [""] * 4 + ["color"] * 4
    page = tmp_path / "speed_accuracy.html"
    assert page.stat().st_size < 2_000_000
    assert "http" not in page.read_text(encoding="utf-8").split("<script")[0]
    assert "bk-Tabs" in dom_of(page, tmp_path)
