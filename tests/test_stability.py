"""The stability study's scenes are what their names say, and its scores count what they claim."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace

import numpy as np
import pytest

from polaropt.simulation.simulator import exact_photographs
from studies import stability
from studies.protocol import shipped_pairs
from studies.stability_capture import bent_photographs, take
from studies.stability_methods import BASELINES, MINIMUM, NOTHING, Row, baseline, methods
from studies.stability_scenes import BLIND, Case, Taking, cases
from studies.stability_scores import AUTO, judge, score
from tests.documents import document_of

PAIR = shipped_pairs(size=48, margin=48)[0]
EASY = Case("family", 0, easy=True)


def row(case, method, transmission, detail=0.9, warnings=()):
    return Row(case.family, case.name, case.value, 0, 0, method, transmission, 20, detail, "", None, None, 0, warnings)


def judged(auto, nothing=25.0, minimum=25.0, *, facts=Taking(), **of_row):  # noqa: B008 (frozen)
    """One scene beside an easy end of 45 dB."""
    case = Case("family", 1, taking=facts)
    rows = [row(EASY, AUTO, 45), row(EASY, NOTHING, 25), row(EASY, MINIMUM, 25)]
    rows += [row(case, AUTO, auto, **of_row), row(case, NOTHING, nothing), row(case, MINIMUM, minimum)]
    (part,) = (part for part in judge(rows, [EASY, case]) if part.row.method == AUTO and part.row.value == 1)
    return part


def test_about_150_scenes_each_with_its_name_and_every_family_with_one_easy_end():
    scenes = cases()
    assert 140 <= len(scenes) <= 170
    assert len({case.name for case in scenes}) == len(scenes)
    assert set(Counter(case.family for case in scenes if case.easy).values()) == {1}
    assert {case.family for case in cases(quick=True)} == {case.family for case in scenes}
    assert {case.name for case in cases(quick=True)} <= {case.name for case in scenes}


def test_the_easy_ends_of_the_camera_are_the_engine_and_noise():
    taken = take(replace(EASY, taking=Taking(noise=0.001, bits=16)), PAIR)
    expected = exact_photographs(np.moveaxis(np.stack([PAIR.transmission, PAIR.reflection]), -1, 1), taken.scene,
                                 taken.capture.angles_deg)  # fmt: skip
    residual = taken.capture.intensities - PAIR.cropped(expected)
    assert float(residual.std()) == pytest.approx(0.001, rel=0.1)
    assert taken.told == BLIND


def test_what_is_told_wrongly_is_off_by_what_the_scene_says():
    for case in cases():
        if "told wrongly" in case.family:
            taken = take(case, PAIR)
            name = {"i": "incidence_deg", "a": "azimuth_deg", "g": "ghost_shift"}[case.family[0]]
            assert getattr(taken.told, name) - getattr(taken.scene, name) == pytest.approx(case.value)


def test_a_pane_that_is_not_bent_is_flat():
    scene = take(Case("f", 0, ghosts=False), PAIR).scene
    layers = np.random.default_rng(0).random((2, 3, 20, 30)).astype(np.float32)
    flat = exact_photographs(layers, scene, (0.0, 45.0, 90.0, 135.0))
    np.testing.assert_allclose(bent_photographs(layers, scene, 0.0, (0.0, 45.0, 90.0, 135.0)), flat, atol=1e-6)


def test_an_encoded_capture_is_the_linear_one_encoded():
    linear, encoded = (take(replace(EASY, taking=Taking(gamma=gamma, bits=16)), PAIR) for gamma in (1.0, 2.0))
    dark = linear.capture.intensities < 0
    difference = encoded.capture.intensities**2 * np.where(dark, -1, 1) - linear.capture.intensities
    assert np.abs(difference[~dark]).max() < 1e-3
    # Without glass a photograph is half the layer.
    np.testing.assert_allclose((encoded.layers / 2) ** 2, linear.layers / 2, atol=1e-6)


def test_clipped_pixels_are_as_many_as_asked_for():
    taken = take(replace(EASY, taking=Taking(clipped=0.2)), PAIR)
    beyond = (taken.layers[0] > 1.9).any(axis=0).mean()
    assert beyond == pytest.approx(0.2, abs=0.02)


def test_photographs_lie_apart_as_far_as_asked_for():
    still, moved = (take(replace(EASY, taking=Taking(shift_px=shift)), PAIR).capture for shift in (0.0, 5.0))
    np.testing.assert_array_equal(still.intensities[[0, 2]], moved.intensities[[0, 2]])
    # 3 px down and 4 to the right.
    assert np.abs(moved.intensities[1, :, 3:, 4:] - still.intensities[1, :, :-3, :-4]).mean() < 0.03


def test_components_that_are_told_their_scale_beat_doing_nothing_where_bounces_are_in_place():
    taken = take(Case("f", 0, incidence_deg=70.0, ghosts=False), PAIR)
    errors = {name: np.square(baseline(name, taken.capture, taken.layers)[0] - taken.layers[0]).mean()
              for name in BASELINES}  # fmt: skip
    assert errors["FastICA"] < 0.5 * errors[NOTHING]


def test_a_transmission_fails_against_doing_nothing_and_against_the_easy_end():
    assert not judged(24.95).worse
    assert judged(24.8).worse
    assert judged(30.0).far
    assert not judged(32.0).far
    assert not judged(30.0, nothing=20.0, minimum=20.0).far
    assert judged(40.0, detail=0.2).reflection_lost
    assert not judged(40.0).failed


def test_only_what_speaks_of_the_failure_announces_it():
    assert judged(20.0, warnings=("MODEL_DOES_NOT_EXPLAIN",)).announced
    assert not judged(20.0, warnings=("REFLECTION_NOT_IDENTIFIABLE", "SATURATED")).announced
    assert judged(40.0, detail=0.1, warnings=("REFLECTION_NOT_IDENTIFIABLE",)).announced
    assert not judged(40.0, detail=0.1, warnings=("SATURATED",)).announced


def test_a_warning_without_failure_is_false_unless_it_is_true_of_the_scene():
    assert judged(40.0, warnings=("GAMMA_ENCODED",)).false_alarm
    encoded = judged(40.0, warnings=("GAMMA_ENCODED",), facts=Taking(gamma=1.5))
    assert not encoded.false_alarm
    assert encoded.strictly_false
    assert not judged(40.0, warnings=("SATURATED",)).strictly_false


def test_scores_are_shares():
    parts = [judged(20.0), judged(20.0, warnings=("GRAZING",)), judged(40.0), judged(40.0, warnings=("GRAZING",))]
    found = score(parts)
    assert (found.recall, found.false_share, found.worse, found.least_gain) == (0.5, 0.5, 2, -5.0)


def test_the_study_is_one_command_and_draws_what_it_has(tmp_path, capsys):
    stability.main(["--families", "bits", "--quick", "--methods", AUTO, "-o", str(tmp_path)])
    told = capsys.readouterr().out
    assert "separations by `auto`" in told
    assert (tmp_path / "stability.md").read_text().strip() == told.strip()
    assert (tmp_path / "stability.csv").exists()
    for name in ("transmission", "reflection", "warnings"):
        assert (tmp_path / f"stability_{name}.png").stat().st_size > 5000
    document = document_of(tmp_path / "stability.json")
    assert {row["method"] for row in document["results"]} == {AUTO, NOTHING, MINIMUM}
    assert AUTO in methods()
