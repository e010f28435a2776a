"""Random scenes are told by their numbers, and judged as the study says."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from pandas import concat

from polaropt.optics import SceneParameters
from polaropt.separation import separate
from studies.camera import photograph
from studies.kit.frames import frame_of
from studies.photographs import shipped_pairs
from studies.random_windows import study
from studies.random_windows.comparison import changes, earlier
from studies.random_windows.judging import TARGETS, judged, numbers_found, width
from studies.random_windows.results import figures, tables
from studies.random_windows.separations import Job, Row, run
from studies.random_windows.windows import FAMILIES, FIT, JUDGE, numbers_of, window_of
from studies.scenes import Taking
from studies.scores import psnr

SIZE = 96
MANY = [window_of(number, SIZE) for number in (*numbers_of(FIT, 10), *numbers_of(JUDGE, 10))]


def test_a_number_tells_the_scene_whatever_was_drawn_before():
    assert window_of(37, SIZE) == window_of(37, SIZE)
    assert [window.number for window in MANY] == sorted({window.number for window in MANY}, key=lambda n: (n % 2, n))
    first, second = (window_of(3, 48).sample(None, 48) for _ in range(2))
    np.testing.assert_array_equal(first.capture.intensities, second.capture.intensities)


@pytest.mark.parametrize("first", [1, 640, 1001])
def test_later_numbers_are_new_scenes_of_the_same_half_and_families(first):
    for half in (FIT, JUDGE):
        later = [window_of(number, SIZE) for number in numbers_of(half, 2, first)]
        assert {window.half for window in later} == {half}
        assert min(window.number for window in later) in (first, first + 1)
        families = [window.family for window in later]
        assert {family: families.count(family) for family in FAMILIES} == dict.fromkeys(FAMILIES, 2)


def test_either_half_has_as_many_of_each_family():
    for half in (FIT, JUDGE):
        families = [window.family for window in MANY if window.half == half]
        assert {family: families.count(family) for family in FAMILIES} == dict.fromkeys(FAMILIES, 10)


def test_the_scenes_are_over_everything():
    scenes, takings = [window.scene for window in MANY], [window.taking for window in MANY]
    incidences = [scene.values()[0] for scene in scenes]
    assert 10 <= min(incidences) < 15
    assert 80 < max(incidences) <= 85
    assert all(abs(scene.values()[2]) <= 20 and 1.33 <= scene.refractive_index <= 1.9 for scene in scenes)
    assert all(0.002 <= taking.noise <= 0.03 and 6 <= taking.bits <= 16 for taking in takings)
    assert {scene.n_panes for scene in scenes} == {1, 2, 3}
    assert {window.rung for window in MANY} == {"pixelwise", "ghosts", "perspective", "curved", "polarized"}


@pytest.mark.parametrize(
    ("shift", "gap", "rung"), [(0.4, 0.0, "pixelwise"), (-0.6, 0.0, "ghosts"), (0.0, 4.0, "ghosts")]
)
def test_double_images_closer_than_half_a_pixel_are_none(shift, gap, rung):
    pane = SceneParameters(60.0, 0.0, shift, n_panes=2 if gap else 1, gap_shift=gap)
    assert dataclasses.replace(MANY[0], scene=pane).rung == rung


PAIR = shipped_pairs(size=48, margin=24)[0]
PANE = SceneParameters(60.0, 20.0, 0.0)


def test_what_something_crosses_is_not_judged_and_the_rest_is_as_it_was():
    still = photograph(PAIR, PANE, Taking(noise=0.0, bits=16))
    crossed = photograph(PAIR, PANE, Taking(noise=0.0, bits=16, moving_side=0.25, moving_step=0.1))
    assert 0.04 < 1 - crossed.unclipped.mean() < 0.3
    away = np.abs(crossed.capture.intensities - still.capture.intensities).max(axis=(0, 1))
    assert away[crossed.unclipped].max() < 2e-3 < 0.05 < away.max()
    np.testing.assert_array_equal(crossed.layers, still.layers)


@pytest.mark.parametrize("sensor", ["mono", "color"])
def test_a_polarization_camera_sees_the_same_scene_at_once(sensor):
    """In one mosaic, of layers as its lens images them; nothing moves, and no other number of the scene changes."""
    number = next(number for number in range(0, 64, 2) if window_of(number, 384).family == "moving")
    still, seen = window_of(number, 384), window_of(number, 384, sensor)
    assert seen.scene == still.scene
    assert seen.taking.moving_side == 0
    assert dataclasses.replace(
        seen.taking, sensor="", lens_blur_px=0.0, moving_side=still.taking.moving_side,
        moving_step=still.taking.moving_step,
    ) == still.taking  # fmt: skip
    pair = shipped_pairs(64, 40)[0]
    taking = Taking(noise=0.0, bits=16, sensor=sensor, lens_blur_px=0.7)
    sample = photograph(pair, SceneParameters(60.0, 30.0, 4.0), taking)
    assert sample.capture.samples is not None
    assert sample.capture.color == (sensor == "color")
    layers = separate(sample.capture, sample.scene).layers.reshape(sample.layers.shape)
    assert psnr(layers[0], sample.layers[0]) > 25
    # Sharper layers than the lens images are not what is seen.
    sharp = photograph(pair, sample.scene, dataclasses.replace(taking, lens_blur_px=0.0)).layers
    assert psnr(layers[0], sharp[0]) < psnr(layers[0], sample.layers[0])


def test_shot_noise_grows_with_the_light_and_is_the_drawn_noise_at_white():
    plain, shot = window_of(34, SIZE), window_of(34, SIZE, shot_noise=True)
    assert shot.scene == plain.scene
    assert shot.taking.noise_at_white == pytest.approx(plain.taking.noise)
    assert 0 < shot.taking.noise <= plain.taking.noise / 2
    pair, still = shipped_pairs(SIZE, SIZE // 2)[0], Taking(noise=0.0, bits=16)
    light = photograph(pair, shot.scene, still).capture.intensities
    noisy = photograph(pair, shot.scene, dataclasses.replace(still, shot_noise=0.02**2)).capture.intensities
    bright = light > np.median(light)
    spread = [np.std((noisy - light)[part]) / np.sqrt(light[part].mean()) for part in (bright, ~bright)]
    np.testing.assert_allclose(spread, 0.02, rtol=0.05)


def test_gains_are_of_photographs_and_the_true_transmission_is_seen_through_the_tint():
    plain = photograph(PAIR, PANE, Taking(noise=0.0, bits=16))
    brighter = photograph(PAIR, PANE, Taking(noise=0.0, bits=16, gains=(1.0, 0.9, 1.0, 1.0)))
    ratio = brighter.capture.intensities.mean(axis=(1, 2, 3)) / plain.capture.intensities.mean(axis=(1, 2, 3))
    assert ratio == pytest.approx([1, 0.9, 1, 1], abs=1e-3)
    tinted = photograph(PAIR, PANE.replace(absorption=0.5), Taking(noise=0.0, bits=16))
    np.testing.assert_allclose(tinted.layers[0], plain.layers[0] * np.exp(-0.5), rtol=1e-5)


BLANK = {"str": "", "int": 1, "float": 0.0, "float | None": None, "tuple[str, ...]": (), "tuple[float, ...]": ()}


def judged_row(transmission, known=40.0, nothing=25.0, *, warnings=(), made="ghosts", rung="ghosts", **more):
    values = {field.name: BLANK[str(field.type)] for field in dataclasses.fields(Row)}
    values |= {"transmission": transmission, "known_transmission": known, "intensity": nothing, "detail": 0.9}
    values |= {"incidence_deg": 60.0, "known_detail": 0.9, "warnings": warnings, "made": made, "rung": rung}
    return judged(frame_of(Row, [Row(**(values | {"family": "plain"} | more))]))


def only(*arguments, **more):
    (row,) = judged_row(*arguments, **more).itertuples()
    return row


def test_a_failure_is_announced_by_what_is_wrong():
    assert not only(37.1).failed
    assert only(36.9).silent
    for nothing in ("POLARIZED_SOURCE", "SATURATED", "REFLECTION_NOT_IDENTIFIABLE"):
        assert only(36.9, warnings=(nothing,)).silent
    assert not only(36.9, warnings=("SATURATED", "MODEL_DOES_NOT_EXPLAIN")).silent
    assert only(24.0, nothing=25.0).worse_silent
    assert not only(24.0, nothing=25.0, warnings=("AXIS_DOUBTFUL",)).worse_silent


def test_a_warning_is_false_where_nothing_fails_and_it_is_not_true():
    assert only(39.0, warnings=("MODEL_DOES_NOT_EXPLAIN",)).false_alarm
    assert not only(39.0, warnings=("MODEL_DOES_NOT_EXPLAIN",), moving=0.2).false_alarm
    assert not only(36.0, warnings=("AXIS_DOUBTFUL",)).false_alarm
    assert not only(39.0, warnings=("POLARIZED_SOURCE",), sky=0.3).false_alarm
    assert not only(39.0, warnings=("POLARIZATION_DOUBTFUL",), sky=0.3, panes=1).false_alarm
    assert only(39.0, warnings=("POLARIZATION_DOUBTFUL",), sky=0.3, panes=1, shift_px=5.0).false_alarm


def test_a_rung_is_adequate_that_was_made_or_a_lower_one_that_does():
    assert only(30.0).adequate
    assert only(39.2, rung="pixelwise").adequate
    assert not only(38.8, rung="pixelwise").adequate
    assert not only(39.9, rung="curved").adequate
    assert not only(38.0, panes=2).adequate


def test_numbers_are_held_against_their_stated_errors():
    frame = judged_row(39.0, parameters=("incidence_deg", "azimuth_deg"), away=(1.0, 3.0), stated=(1.0, 1.0))
    assert numbers_found(frame).sigmas.tolist() == [1.0, 3.0]
    assert width(numbers_found(frame)) == pytest.approx(0.337)
    measured = {target.words: target.counted(frame) for target in TARGETS}
    assert measured["truths within two stated errors (of 99 % they would be too wide)"] == (1, 2)
    assert measured["T within 3 dB of the scene known"] == (1, 1)


def test_chances_are_held_against_what_fails():
    frame = concat([judged_row(30.0, chance=0.9), judged_row(39.0, chance=1.0), judged_row(39.0, chance=0.01)])
    table = tables(frame)
    assert "| 0.8 to 1 | 2 | 1.9 | 1 |" in table
    assert "| 0 to 0.02 | 1 | 0.0 | 0 |" in table


def test_a_wrong_pane_that_a_bright_reflection_hides_is_announced():
    (row,) = judged(frame_of(Row, run(Job(192, None, 192)))).itertuples()
    assert not row.silent


def test_the_study_is_one_command_and_tells_all_of_one_scene(tmp_path, capsys, monkeypatch, told_pane, png_alone):
    monkeypatch.setattr(study, "figures", lambda frame: {"random_windows": figures(frame)["random_windows"]})
    study.main(["--quick", "--families", "strong", "-o", str(tmp_path)])
    told = capsys.readouterr().out
    assert (tmp_path / "random_windows.md").read_text().strip() == told.strip()
    assert "| strong noise | 1 |" in told
    assert (tmp_path / "random_windows.png").stat().st_size > 5000
    study.main(["--quick", "--only", "4", "-o", str(tmp_path)])
    told = capsys.readouterr().out
    assert told.startswith("scene 4 (strong noise, to fit)")
    assert (tmp_path / "scene_4.txt").read_text() == told
    assert (tmp_path / "scene_4.png").is_file()


def test_what_a_change_gained_and_lost_is_told_of_the_scenes_that_both_runs_have(tmp_path):
    before = concat([judged_row(36.0, number=1), judged_row(39.0, number=3), judged_row(39.0, number=5)])
    after = concat([judged_row(38.5, number=1), judged_row(39.4, number=3), judged_row(30.0, number=7)])
    told = changes(before, after)
    assert "2 scenes that both have." in told
    assert "| within 3 dB of the scene known | 1 | 2 |" in told
    assert (
        "| 1 | plain | 36.0 | 38.5 | 0.0 | 0.0 | now: within 3 dB of the scene known; no longer: failures in silence |"
        in told
    )
    assert "| 3 | plain |" not in told
    assert changes(before, after[after.number == 7]).endswith("0 scenes that both have.")


def test_an_earlier_run_is_read_from_what_it_kept(tmp_path, monkeypatch, told_pane, png_alone):
    monkeypatch.setattr(study, "figures", lambda frame: {})
    options = ["--quick", "--families", "plain", "--per-family", "1", "-o", str(tmp_path)]
    study.main([*options, "--from", "1600"])
    kept = earlier(tmp_path)
    assert kept.number.tolist() == [window_of(1600, SIZE).number]
    study.main([*options, "--from", "1600", "--against", str(tmp_path)])
    assert "1 scenes that both have." in (tmp_path / "changes.md").read_text()
