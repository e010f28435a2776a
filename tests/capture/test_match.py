"""Photographs that lie beside each other, or are not equally sharp, are made to agree."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from scipy.ndimage import fourier_gaussian, fourier_shift

from polaropt import Capture, SceneParameters, Separation, SeparationWarning, separate, simulate
from polaropt.capture import (
    Matching,
    find_mistakes,
    look_swapped_in_place,
    match_photographs,
    shifts_in_the_middle,
)
from polaropt.cli.app import main
from polaropt.reporting import inspect_capture
from polaropt.simulation.metrics import psnr_db
from tests.captured import written_photographs

SIDE, KEPT, NOISE = 160, 24, 0.004
SCENE = SceneParameters(60.0, 25.0, 4.0)
PANE = ["--incidence", "60", "--azimuth", "25", "--shift", "4"]
ALIKE = np.zeros((4, 2))
SHARP = np.zeros(4)


@cache
def pictures() -> tuple[np.ndarray, np.ndarray]:
    """Detailed pictures (h, w, 3), larger than what is kept of them."""
    from skimage import data

    wide = SIDE + 2 * KEPT
    return data.coffee()[60 : 60 + wide, 140 : 140 + wide] / 255, data.astronaut()[:wide, 100 : 100 + wide] / 255


@cache
def exact(scene: SceneParameters, n: int) -> Capture:
    """Photographs without noise of the larger pictures."""
    return simulate(*pictures(), scene, angles_deg=tuple(180 / n * np.arange(n)), bits=None, noise=0.0)


def taken(
    shifts: np.ndarray = ALIKE, blurs: np.ndarray = SHARP, scene: SceneParameters = SCENE, n: int = 4
) -> tuple[Capture, np.ndarray]:
    """Photographs moved by shifts (k, 2) and blurred by Gaussians, with noise; the layers of the first one's place."""
    clean = exact(scene, n)
    photographs = clean.intensities.astype(np.float64)
    for k in range(n):
        for channel in range(3):
            spectrum = np.fft.fft2(photographs[k, channel])
            moved = fourier_gaussian(fourier_shift(spectrum, shifts[k]), blurs[k])
            photographs[k, channel] = np.fft.ifft2(moved).real
    inside = (..., slice(KEPT, -KEPT), slice(KEPT, -KEPT))
    noisy = photographs[inside] + NOISE * np.random.default_rng(1).standard_normal(photographs[inside].shape)
    layers = np.stack([np.moveaxis(picture, -1, 0)[inside] for picture in pictures()])
    return Capture.of_planes(np.clip(noisy, 0, 1).astype(np.float32), clean.angles_deg), layers


@cache
def agreeing() -> Separation:
    """What is separated of photographs that agree."""
    return separate(taken()[0], SCENE)


def matched(capture: Capture) -> Matching:
    found = match_photographs(capture, NOISE)
    assert found is not None
    return found


def test_photographs_that_agree_are_left_as_they_are():
    assert match_photographs(taken()[0], NOISE) is None


@pytest.mark.parametrize("n", [3, 4, 5])
def test_shifts_are_found_to_a_few_hundredths_of_a_pixel(n):
    shifts = np.array([[0.0, 0.0], [0.15, -0.1], [-0.2, 0.3], [0.05, 0.2], [-0.1, -0.1]])[:n]
    found = matched(taken(shifts, np.zeros(n), n=n)[0])
    np.testing.assert_allclose(found.transfer.shifts_px, shifts, atol=0.03)
    assert not found.transfer.blurred


@pytest.mark.parametrize(("k", "blur"), [(0, 0.7), (3, 1.5)])
def test_the_photograph_that_is_less_sharp_is_found(k, blur):
    found = matched(taken(blurs=np.where(np.arange(4) == k, blur, 0.0))[0])
    expected = np.where(np.arange(4) == k, blur, 0.0)
    np.testing.assert_allclose(found.transfer.blurs_px, expected, atol=0.1)
    assert not found.transfer.shifts_px.any()


def test_what_was_undone_is_as_if_it_had_never_been():
    shifts, blurs = np.array([[0.0, 0.0], [0.2, -0.1], [-0.1, 0.3], [0.1, 0.1]]), np.array([0.0, 0.0, 0.9, 0.0])
    sharp = taken()[0].intensities
    before = taken(shifts, blurs)[0]
    after = matched(before).capture.intensities
    inner = (..., slice(16, -16), slice(16, -16))
    for k in (1, 2):
        assert np.std((after - sharp)[k][inner]) < NOISE < 0.6 * np.std((before.intensities - sharp)[k][inner])


@pytest.mark.parametrize(
    ("shifts", "blurs"),
    [
        (np.array([[0.0, 0.0], [0.2, -0.1], [-0.2, 0.2], [0.1, 0.1]]), SHARP),
        (ALIKE, np.array([0.0, 0.8, 0.0, 0.0])),
    ],
    ids=["beside each other", "one out of focus"],
)
def test_layers_are_nearly_those_of_photographs_that_agree(shifts, blurs):
    capture, layers = taken(shifts, blurs)
    aim = psnr_db(agreeing().layers[0], layers[0], 16)
    left = psnr_db(separate(capture, SCENE, match_photographs=False).layers[0], layers[0], 16)
    result = separate(capture, SCENE)
    assert result.matching is not None
    assert psnr_db(result.layers[0], layers[0], 16) > max(aim - 2.5, left + 2)


def test_what_a_photograph_does_not_show_at_the_edges_is_not_valid():
    shifts = np.array([[0.0, 0.0], [2.0, 0.0], [0.0, 0.0], [0.0, -1.0]])
    valid = matched(taken(shifts)[0]).capture.valid
    assert valid[[0, 2]].all()
    assert not valid[1, :, -2:].any()
    assert valid[1, :, :-2].all()
    assert not valid[3, :, :, 0].any()
    assert valid[3, :, :, 1:].all()


def test_photographs_that_lie_far_apart_are_left_to_be_aligned():
    # A quarter of the frame's shorter side.
    shifts = np.array([[0.0, 0.0], [SIDE / 4 + 1, 0.0], [0.0, 0.0], [0.0, 0.0]])
    assert match_photographs(taken(shifts)[0], NOISE) is None


def test_photographs_ten_pixels_beside_each_other_are_separated_as_if_they_agreed():
    shifts = np.array([[0.0, 0.0], [6.3, -4.1], [-3.2, 5.4], [2.5, 7.8]])
    capture, layers = taken(shifts)
    assert matched(capture).transfer.shifts_px == pytest.approx(shifts, abs=0.03)
    result = separate(capture, SCENE)
    for layer, truth, aim in zip(result.layers, layers, agreeing().layers, strict=True):
        assert psnr_db(layer, truth, 16) > psnr_db(aim, truth, 16) - 2.5


def test_pixels_beside_those_that_are_not_valid_are_not_valid():
    capture, _ = taken(np.array([[0.0, 0.0], [0.2, -0.1], [-0.2, 0.2], [0.1, 0.1]]))
    valid = np.ones(capture.intensities.shape, dtype=bool)
    valid[1, :, 80, 80] = False
    kept = matched(capture.replace(valid=valid)).capture.valid
    assert not kept[1, :, 79:82, 79:82].any()
    assert kept[0].all()
    assert kept[1, :, 80, 84].all()


def test_light_that_is_polarized_by_itself_is_taken_for_no_blur():
    scene = SCENE.replace(ghost_shift=0.0, transmission_polarization=(0.5, 60.0))
    assert match_photographs(taken(scene=scene)[0], NOISE) is None


def test_what_no_blur_explains_is_taken_for_none():
    # The negative of a part of one photograph: all others seemed blurred by several pixels.
    capture = taken()[0]
    photographs = capture.intensities.copy()
    photographs[1, :, 30:60, 20:80] = 1 - photographs[1, :, 30:60, 20:80]
    assert match_photographs(capture.replace(intensities=photographs), NOISE) is None


def test_three_photographs_and_small_ones_tell_no_blur():
    assert match_photographs(taken(np.zeros((3, 2)), np.array([0.0, 0.8, 0.0]), n=3)[0], NOISE) is None
    small = taken(blurs=np.array([0.0, 0.8, 0.0, 0.0]))[0].part(slice(48), slice(48))
    assert match_photographs(small, NOISE) is None


def test_the_command_says_so_and_can_be_told_not_to(tmp_path, capsys):
    capture, _ = taken(blurs=np.array([0.0, 0.9, 0.0, 0.0]))
    files = written_photographs(capture, tmp_path)
    assert main(["estimate", *files, *PANE]) == 0
    assert "made as sharp as the sharpest, which these were not: 2 (a Gaussian of 0.9" in capsys.readouterr().out
    assert main(["estimate", *files, *PANE, "--no-match"]) == 0
    assert "sharp" not in capsys.readouterr().out
    assert main(["inspect", *files]) == 0
    assert "not equally sharp, least so 2 (a Gaussian of 0.9" in capsys.readouterr().out


def test_shifts_that_break_the_closure_as_an_exchange_would_are_undone_and_no_files_called_swapped() -> None:
    # Both pairs of crossed polarizers lie in places of their own, so that one of either pair has what the other has.
    shifts, scene = np.array([[0.0, 0.0], [0.2, 1.6], [0.0, 0.1], [0.1, 1.5]]), SCENE.replace(incidence_deg=40.0)
    capture, layers = taken(shifts, scene=scene)
    assert find_mistakes(capture).swapped
    assert not look_swapped_in_place(capture, shifts_in_the_middle(capture))
    result = separate(capture, scene)
    assert result.matching is not None
    np.testing.assert_allclose(result.matching.transfer.shifts_px, shifts, atol=0.03)
    assert SeparationWarning.ANGLES_SWAPPED not in result.diagnostics.warnings
    aim = psnr_db(separate(taken(scene=scene)[0], scene).layers[0], layers[0], 16)
    assert psnr_db(result.layers[0], layers[0], 16) > aim - 2.5
    assert inspect_capture(capture).swapped_deg == ()


def test_photographs_in_a_wrong_order_that_lie_beside_each_other_are_still_called_swapped() -> None:
    shifts = np.array([[0.0, 0.0], [0.3, -0.2], [0.2, 0.4], [0.0, 0.3]])
    capture = taken(shifts)[0]
    wrong = capture.replace(intensities=capture.intensities[[0, 2, 1, 3]])
    assert look_swapped_in_place(wrong, shifts_in_the_middle(wrong))
    assert separate(wrong, SCENE).matching is None
    assert inspect_capture(wrong).swapped_deg
