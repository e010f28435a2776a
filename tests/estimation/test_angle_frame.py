"""Angles that count from elsewhere or the other way: found where the image tells, else nothing is said."""

from __future__ import annotations

import json
import math
from pathlib import Path

import pytest
from skimage.data import astronaut, rocket

from polaropt import Capture, SceneParameters, SeparationWarning, StoppingRule, find_start_angle, separate, simulate
from polaropt.capture.capture import ANGLES_DEG
from polaropt.capture.files.write import write_capture
from polaropt.cli.app import main
from polaropt.estimation.angles import AngleMistake, angle_mistake, ghost_direction
from polaropt.estimation.flat.estimate import estimate_scene
from polaropt.estimation.ladder import find_scene
from polaropt.estimation.wide.fits import fit_perspective
from polaropt.numerics import turn_between
from polaropt.reporting.words import start_sentence
from polaropt.simulation.metrics import psnr_db
from studies.camera import take
from studies.photographs import shipped_pairs
from studies.scenes import SCENES
from tests.blends import blend
from tests.optics.test_varying import seen_wide

OPEN = SceneParameters(None, None, None)
NOISE = 0.005
# Ghosts that are to tell a direction for certain need more of a frame than those that are only seen.
SIZE, SMALL = 176, 128


def counted(capture: Capture, turned_deg: float = 0.0, sense: int = 1) -> Capture:
    """The same photographs with their angles counted from another start, or the other way."""
    angles = tuple((sense * angle - turned_deg) % 180 for angle in capture.angles_deg)
    return Capture.of_planes(capture.intensities, angles, capture.valid)


def apart(first_deg: float, second_deg: float) -> float:
    return abs(turn_between(first_deg, second_deg))


def mistake(capture: Capture, model: str = "ghosts") -> AngleMistake | None:
    found = find_scene(capture, OPEN, NOISE, model)
    return angle_mistake(capture, NOISE, found.scene, found.estimate, found.unexplained)


@pytest.mark.parametrize(("incidence", "azimuth", "turned"), [(45, 110, 52.0), (60, 25, 90.0)])
def test_ghosts_tell_where_the_angles_start(incidence: float, azimuth: float, turned: float) -> None:
    example = blend(incidence, SIZE, azimuth_deg=azimuth, ghost_shift=7.0, color=False)
    found = find_start_angle(counted(example.capture, turned))
    assert found.origin is not None
    assert found.origin.start_deg is not None
    assert apart(found.origin.start_deg, turned) < 5
    assert all(apart(a, b) < 5 for a, b in zip(found.angles_deg, example.capture.angles_deg, strict=True))
    assert f"{found.origin.start_deg:+.0f} deg" in start_sentence(found)


def test_a_separation_from_an_unknown_start_is_as_good() -> None:
    example = blend(60, SMALL, ghost_shift=7.0, color=False)
    relative = find_start_angle(counted(example.capture, 52))
    reached = [separate(capture, OPEN).layers for capture in (example.capture, relative)]
    for layer in (0, 1):
        absolute, found = (psnr_db(layers[layer], example.layers[layer], 12) for layers in reached)
        assert found > absolute - 0.3


@pytest.mark.parametrize(("incidence", "shift"), [(60, 0.0), (25, 4.0), (45, 0.0)])
def test_without_clear_ghosts_the_azimuth_stays_relative(incidence: float, shift: float) -> None:
    example = blend(incidence, 128, ghost_shift=shift)
    relative = find_start_angle(counted(example.capture, 40))
    assert relative.start_unknown
    assert relative.angles_deg == counted(example.capture, 40).angles_deg
    assert "do not tell" in start_sentence(relative)
    scene = find_scene(relative, OPEN, NOISE).scene
    assert scene.rung == "pixelwise"
    assert apart(scene.azimuth_deg, example.scene.azimuth_deg - 40) < 1


def test_an_unknown_start_leaves_no_wide_lens_to_find() -> None:
    capture, _, _ = seen_wide(96, focal_px=112.0)
    relative = find_start_angle(counted(capture, 40))
    assert relative.start_unknown
    found = find_scene(relative, OPEN, NOISE)
    assert found.scene.rung == "pixelwise"
    assert {"perspective", "curved"}.isdisjoint(tried.rung for tried in found.tried)


def test_angles_that_count_the_other_way_or_from_elsewhere() -> None:
    capture = blend(45, SIZE, azimuth_deg=110, ghost_shift=7.0).capture
    assert mistake(capture) is None
    assert mistake(counted(capture, sense=-1)) is AngleMistake.REVERSED
    assert mistake(counted(capture, 90)) is AngleMistake.ROTATED
    assert mistake(find_start_angle(counted(capture, 52))) is None


@pytest.mark.parametrize(("low_passed", "said"), [(False, AngleMistake.ROTATED), (True, None)])
def test_cells_of_a_mosaic_tell_no_direction_of_ghosts(low_passed: bool, said: AngleMistake | None) -> None:
    """Their low pass has one of its own."""
    capture = counted(blend(45, SIZE, azimuth_deg=110, ghost_shift=7.0).capture, 90)
    found = find_scene(capture, OPEN, NOISE)
    capture = capture.with_origin(low_passed=low_passed)
    assert angle_mistake(capture, NOISE, found.scene, found.estimate, found.unexplained) is said


@pytest.mark.parametrize(("incidence", "shift"), [(15, 0.0), (45, -4.0), (75, 0.0), (85, -4.0)])
def test_azimuths_that_are_their_own_mirror_image_are_no_mistake(incidence: float, shift: float) -> None:
    capture = blend(incidence, 96, azimuth_deg=90, ghost_shift=shift).capture
    assert mistake(counted(capture, sense=-1)) is None


@pytest.mark.parametrize("incidence", [15, 75])
def test_without_ghosts_nothing_is_said(incidence: float) -> None:
    capture = blend(incidence, 128, ghost_shift=0.0).capture
    assert mistake(counted(capture, 33)) is None


@pytest.mark.parametrize(
    "name", ["field of view (deg): 0", "bend of the pane (deg): 1", "incidence and noise: 40 deg, noise 0.005"]
)
def test_one_thing_of_parallel_edges_is_no_ghost(name: str) -> None:
    tower = shipped_pairs(128, 64)[1]
    capture = take(SCENES[name], tower).capture
    found = find_scene(capture, OPEN, NOISE)
    assert angle_mistake(capture, NOISE, found.scene, found.estimate, found.unexplained) is None
    incidence, azimuth, _ = found.scene.values()
    assert not ghost_direction(capture, NOISE, incidence, azimuth).shift_error_px < 0.4


def test_ghosts_of_a_pane_have_the_same_shift_in_every_part_of_the_frame() -> None:
    example = blend(60, SIZE, ghost_shift=7.0)
    assert ghost_direction(example.capture, NOISE, 60.0, 25.0).shift_error_px < 0.2


def test_a_single_tile_tells_no_direction() -> None:
    found = ghost_direction(blend(60, 64, ghost_shift=7.0).capture, NOISE, 60.0, 25.0)
    assert math.isinf(found.shift_error_px)
    assert not found.certain


def test_before_a_wide_lens_the_azimuth_turns_the_right_way_only() -> None:
    capture, _, _ = seen_wide(128, focal_px=150.0, azimuth_deg=3.0)
    assert mistake(capture, "perspective") is None
    assert mistake(counted(capture, sense=-1), "perspective") is AngleMistake.REVERSED


def test_the_separation_warns() -> None:
    """Of one mistake: of either one the limits are held where those of all warnings are."""
    reversed_ = counted(blend(60, SIZE, ghost_shift=7.0).capture, sense=-1)
    said = separate(reversed_, OPEN, stopping=StoppingRule(max_evaluations=3)).diagnostics.warnings
    assert SeparationWarning.ANGLES_REVERSED in said


@pytest.fixture(scope="module")
def turned_file(tmp_path_factory: pytest.TempPathFactory) -> str:
    path = tmp_path_factory.mktemp("turned") / "turned.tiff"
    write_capture(counted(blend(60, SMALL, ghost_shift=7.0, color=False).capture, 52), path)
    return str(path)


def test_the_command_line_finds_the_start_and_tells(
    turned_file: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    pane = ["--incidence", "60", "--shift", "7", "--panes", "1", "--model", "ghosts"]
    relative = ["--angles", "relative", *pane]
    assert main(["separate", turned_file, *relative, "-o", str(tmp_path), "--max-evaluations", "3"]) == 0
    assert "Start of the angles: +52 deg" in capsys.readouterr().out.replace("+51", "+52").replace("+53", "+52")
    report = json.loads((tmp_path / "report.json").read_text())
    assert apart(report["input"]["start_deg"], 52) < 3
    assert apart(report["scene"]["azimuth_deg"], 25) < 3
    assert main(["estimate", turned_file, "--angles", "relative,0,45,90,135", *pane]) == 0
    assert "Start of the angles" in capsys.readouterr().out


@pytest.mark.parametrize("angles", ["relatively", "relative,x", "relative,0,x"])
def test_no_such_angles(turned_file: str, angles: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["inspect", turned_file, "--angles", angles]) == 2
    assert "numbers separated by commas" in capsys.readouterr().err


def test_a_capture_is_not_asked_about_a_scene_that_was_given() -> None:
    capture = counted(blend(60, 96).capture, 40)
    assert angle_mistake(capture, NOISE, SceneParameters(60.0, 345.0, 0.0), None) is None


def test_the_angles_are_checked_with_the_pane_of_the_scene(monkeypatch: pytest.MonkeyPatch) -> None:
    asked = []

    def fit(stokes, focal_px=None, plain=OPEN):
        asked.append(plain)
        return fit_perspective(stokes, focal_px, plain)

    monkeypatch.setattr("polaropt.estimation.angles.fit_perspective", fit)
    water = SceneParameters(40.0, 70.0, 0.0, 1.33, single_surface=True)
    example = blend(60, 96, ghost_shift=0.0)
    estimate = estimate_scene(example.capture, noise=NOISE)
    angle_mistake(example.capture, NOISE, water, estimate, unexplained=3.0)
    assert asked == [SceneParameters(40.0, -70.0, 0.0, 1.33, single_surface=True)]


def test_patterns_that_turn_ghosts_a_little_do_not_turn_the_angles() -> None:
    behind, mirrored = astronaut()[226:386, 193:353], rocket()[22:182, 13:173]
    capture = simulate(behind, mirrored, SceneParameters(63.9, 96.87, -4.0), noise=0.002)
    found = ghost_direction(capture, 0.002, 63.9, 96.87)
    assert abs(found.start_deg) > 5
    assert not found.elsewhere


def test_ghosts_are_looked_for_behind_a_pane_of_the_scenes_index() -> None:
    example = blend(55.0, SIZE, ghost_shift=7.0, refractive_index=2.2)
    told = ghost_direction(example.capture, NOISE, 55.0, 25.0, example.scene)
    assert apart(told.direction_deg, 25.0) < 1.5
    assert told.gain > ghost_direction(example.capture, NOISE, 55.0, 25.0).gain


@pytest.mark.parametrize(
    ("incidence", "shift", "azimuth", "asked"),
    [
        (65.0, 8.0, 70.0, OPEN),
        (50.0, 6.0, 25.0, OPEN.replace(n_panes=1, absorption=0.0)),
        (70.0, 10.0, 70.0, OPEN.replace(n_panes=1, absorption=None)),
    ],
    ids=["not two panes", "known to be one", "not tinted"],
)
def test_a_polarizer_that_is_a_little_turned_is_told_and_makes_no_other_window(
    incidence: float, shift: float, azimuth: float, asked: SceneParameters
) -> None:
    turned = tuple((angle + 8.0) % 180 for angle in ANGLES_DEG)
    example = blend(incidence, 192, azimuth_deg=azimuth, ghost_shift=shift, color=False, angles_deg=turned)
    capture = example.capture.replace(angles_deg=ANGLES_DEG)
    found = find_scene(capture, asked, NOISE)
    assert (found.scene.n_panes, found.scene.absorption) == (1, 0)
    assert angle_mistake(capture, NOISE, found.scene, found.estimate) is AngleMistake.ROTATED
