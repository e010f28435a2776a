"""Scores: of the pixels that count, and of a pane however its azimuth is counted."""

from __future__ import annotations

from dataclasses import astuple

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from polaropt.optics.scene import SceneParameters
from studies.scores import both_psnr, fitted, fitted_psnr, pane_errors, psnr, psnr_and_ssim, ssim

RANDOM = np.random.default_rng(0)
ALL = np.ones((40, 40), bool)


@pytest.mark.parametrize(
    ("found", "errors"),
    [((61, 30, 5.5), (1, 0, 0.5)), ((60, 210, -5), (0, 0, 0)), ((60, 209, -5), (0, 1, 0)), ((60, 120, 5), (0, 90, 0))],
)
def test_a_turned_azimuth_with_a_turned_shift_is_the_same_scene(found, errors):
    scene = SceneParameters(*map(float, found))
    assert astuple(pane_errors(scene, SceneParameters(60.0, 30.0, 5.0))) == pytest.approx(errors)


@settings(deadline=None, max_examples=20)
@given(st.floats(0.1, 5), st.floats(-1, 1))
def test_the_best_gain_and_offset_undo_any_other(gain, offset):
    truth = RANDOM.random((3, 40, 40)).astype(np.float32)
    np.testing.assert_allclose(fitted(gain * truth + np.float32(offset), truth), truth, atol=1e-4)
    noisy = truth + np.float32(0.1) * RANDOM.standard_normal(truth.shape).astype(np.float32)
    other = np.float32(gain) * noisy + np.float32(offset)
    assert fitted_psnr(other, truth, ALL) >= psnr(other, truth, ALL) - 1e-6
    assert fitted_psnr(other, truth, ALL) == pytest.approx(fitted_psnr(noisy, truth, ALL), abs=0.01)


def test_pixels_that_are_not_seen_do_not_count():
    truth = RANDOM.random((3, 64, 64)).astype(np.float32)
    spoilt, seen = truth.copy(), np.ones((64, 64), bool)
    spoilt[:, 20:30], seen[20:30] = 9, False
    assert psnr(spoilt, truth, seen) == pytest.approx(90, abs=1)
    assert ssim(truth, truth, seen) == pytest.approx(1)
    assert psnr(spoilt, truth, np.zeros_like(seen)) == 0


def test_an_error_of_a_tenth_is_20_db():
    truth = RANDOM.random((2, 3, 48, 48)).astype(np.float32)
    layers = truth + np.float32(0.1)
    assert both_psnr(layers, truth) == pytest.approx((20, 20), abs=1e-4)
    assert both_psnr(layers, truth, np.ones((48, 48), bool)) == pytest.approx((20, 20), abs=1e-4)
    assert psnr_and_ssim(layers, truth)[:2] == both_psnr(layers, truth)
    assert all(0.5 < likeness < 1 for likeness in psnr_and_ssim(layers, truth)[2:])
