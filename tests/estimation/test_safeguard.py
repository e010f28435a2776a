"""Photographs with something wrong: it is named for what it is, and the pane is found all the same."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from polaropt import Capture, SceneParameters, SeparationWarning, StoppingRule, separate
from polaropt.capture import checks
from polaropt.capture.capture import ANGLES_DEG
from polaropt.capture.checks import Mistakes, find_mistakes, identity_ratio
from polaropt.capture.noise import noise_level
from polaropt.estimation.safeguard import (
    CheckedScene,
    correction,
    linear,
    mended,
    scene_source,
    with_incidence_checked,
)
from polaropt.numerics import turn_between
from polaropt.simulation.metrics import psnr_db
from polaropt.simulation.simulator import exact_photographs
from tests.blends import blend
from tests.shifted import shifted_blend

BLIND = SceneParameters(None, None, None)
APART = np.array([[0, 0], [0.6, 0.8], [0, 0], [-0.6, -0.8]])


def encoded(capture, gamma):
    return Capture.of_planes(np.clip(capture.intensities, 0, 1) ** (1 / gamma), capture.angles_deg)


@pytest.mark.parametrize("noise", [0.002, 0.01, 0.03])
@pytest.mark.parametrize("incidence", [20, 60, 80])
def test_nothing_is_found_wrong_with_good_photographs(incidence, noise):
    capture = blend(incidence, 96, noise=noise).capture
    assert find_mistakes(capture) == Mistakes()
    assert mended(capture, Mistakes()) is capture


def test_the_noise_is_that_of_the_photographs_that_the_scene_is_estimated_from():
    capture = encoded(blend(60, 96, noise=0.01).capture, 2.2)
    assert scene_source(capture, 0.0123, Mistakes()) == (capture, capture, 0.0123)
    source, smooth, noise = scene_source(capture, 0.0123, Mistakes(gamma=2.2))
    assert smooth is source
    assert source is not capture
    assert noise == pytest.approx(noise_level(source))


@pytest.mark.parametrize("degree", [0.4, 1.0])
@pytest.mark.parametrize("layer", ["transmission_polarization", "reflection_polarization"])
def test_polarized_light_is_no_encoding(layer, degree):
    capture = blend(60, 128, **{layer: (degree, 10.0)}).capture
    assert identity_ratio(capture) == pytest.approx(1, abs=0.05)
    assert find_mistakes(capture) == Mistakes()


def test_three_photographs_break_no_identity():
    assert identity_ratio(blend(60, 64, angles_deg=(0, 60, 120)).capture) == 1


@pytest.mark.parametrize("distance", [0.2, 0.5, 5.0])
def test_movement_is_seen(distance):
    mistakes = find_mistakes(shifted_blend(60, 112, distance * APART).capture)
    # The second and the fourth photograph lie twice as far apart; beyond a pixel the look is a hint of the size.
    assert mistakes == Mistakes(shift_px=pytest.approx(2 * distance, rel=0.15 if distance < 1 else 0.5))
    assert mistakes.moved == (2 * distance > 0.5)


def test_what_moves_by_a_quarter_of_a_pixel_is_no_movement():
    assert find_mistakes(shifted_blend(60, 112, 0.125 * APART).capture) == Mistakes()


def test_the_pane_is_found_in_spite_of_movement():
    example = shifted_blend(60, 112, 5.0 * APART)
    result = separate(example.capture, BLIND)
    assert result.scene.incidence_deg == pytest.approx(60, abs=4)
    assert result.layers.shape == example.layers.shape
    nothing = psnr_db(example.capture.stokes[0], example.layers[0], 16)
    assert psnr_db(result.layers[0], example.layers[0], 16) > nothing


@pytest.mark.parametrize(("ratio", "measured", "shift"), [(1.16, 0.31, 0.31), (1.16, 0.29, 0.0), (1.14, 0.31, 0.0)])
def test_where_the_identity_is_clearly_broken_a_sharper_look_tells_movement(ratio, measured, shift, monkeypatch):
    monkeypatch.setattr(checks, "identity_ratio", lambda capture: ratio)
    monkeypatch.setattr(checks, "measure_shifts", lambda capture: SimpleNamespace(certain=True, largest=measured))
    assert find_mistakes(blend(60, 64).capture).shift_px == shift
    assert (Mistakes(shift_px=0.49).moved, Mistakes(shift_px=0.51).moved) == (False, True)


def test_the_cells_of_a_mosaic_are_not_moved():
    capture = shifted_blend(60, 96, 2 * APART).capture
    capture = capture.with_origin(layout="mono mosaic", sample_type="uint8")
    assert not find_mistakes(capture).moved


def test_photographs_too_far_apart_stay_where_they_are():
    random = np.random.default_rng(0)
    capture = Capture(random.random((4, 32, 32)))
    assert mended(capture, Mistakes(shift_px=1.0)) is capture


def test_an_encoding_is_seen_and_the_pane_is_found_in_spite_of_it():
    gamma, example = 2.2, blend(60, 96, noise=0.003)
    capture = encoded(example.capture, gamma)
    assert find_mistakes(capture).gamma == pytest.approx(gamma, rel=0.15)
    result = separate(capture, BLIND)
    # 63 degrees where contrasts are taken as they are.
    assert result.scene.incidence_deg == pytest.approx(60, abs=1.5)
    # What such a camera would show without glass.
    behind = 2 * (example.layers[0] / 2) ** (1 / gamma)
    assert psnr_db(result.layers[0], behind, 16) > psnr_db(capture.stokes[0], behind, 16) + 3


@pytest.mark.parametrize(
    ("ratio", "error", "seen"),
    [
        (1.03, 0.17, True),
        (1.01, 0.17, False),
        (1.03, 0.18, False),
        (1.16, 0.22, True),
        (1.14, 0.22, False),
        (1.16, 0.24, False),
    ],
)
def test_an_exponent_accuses_where_it_is_sure_or_the_identity_is_clearly_broken(ratio, error, seen, monkeypatch):
    monkeypatch.setattr(checks, "identity_ratio", lambda capture: ratio)
    monkeypatch.setattr(checks, "fit_gamma", lambda capture, blocks: checks.GammaFit(2.0, error))
    assert find_mistakes(blend(60, 64).capture).gamma == (2.0 if seen else 1.0)


def test_linear_photographs_are_the_encoded_ones_raised():
    capture = blend(60, 64).capture
    raised = linear(capture, 2.0)
    bright = capture.intensities > 0.01
    np.testing.assert_allclose(raised.intensities[bright], capture.intensities[bright] ** 2, rtol=1e-5)
    np.testing.assert_array_equal(raised.valid, capture.valid)


@pytest.mark.parametrize(("told", "doubtful"), [(40.0, True), (63.0, False)])
def test_an_incidence_that_was_given_is_kept_and_doubted_where_it_is_far_off(told, doubtful):
    capture = blend(60, 128).capture
    result = separate(capture, SceneParameters(told, None, None), stopping=StoppingRule(max_evaluations=3))
    assert result.scene.incidence_deg == told
    assert (SeparationWarning.INCIDENCE_DOUBTFUL in result.diagnostics.warnings) == doubtful
    assert turn_between(result.scene.azimuth_deg, 25) == pytest.approx(0, abs=3)


def test_without_an_incidence_there_is_nothing_to_doubt():
    capture, asked = blend(60, 96).capture, SceneParameters(None, 25.0, None)
    assert with_incidence_checked(capture, asked, 0.005) == CheckedScene(asked)


def test_the_correction_is_what_turns_polarized_light_into_transmission():
    scene = SceneParameters(60.0, 0.0, 0.0)
    behind, mirrored = np.random.default_rng(0).random((2, 20, 20))
    s0, s1, _ = Capture.of_planes(
        exact_photographs(np.stack([behind, mirrored]).astype(np.float32), scene, ANGLES_DEG)
    ).stokes
    np.testing.assert_allclose(s0 + correction(scene) * s1, behind, atol=1e-5)
