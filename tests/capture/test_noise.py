"""Noise of large captures, from a part of their pixels."""

from __future__ import annotations

import numpy as np
import pytest

from polaropt.capture.capture import Capture
from polaropt.capture.noise import noise_level, noise_of_blocks
from polaropt.separation import separate
from polaropt.simulation.simulator import digitized
from tests.blends import blend


def rounded(capture: Capture, bits: int) -> Capture:
    return Capture.of_planes(digitized(capture.intensities, bits).astype(np.float32), capture.angles_deg)


def test_a_large_capture_is_sampled_all_over() -> None:
    rng = np.random.default_rng(0)
    sigma = np.linspace(0.004, 0.012, 900)[:, None]
    images = 0.4 + 0.2 * np.sin(np.arange(900) / 40) + sigma * rng.standard_normal((4, 900, 900))
    found = noise_level(Capture(images.astype(np.float32)))
    few = noise_level(Capture(images[:, ::3, ::3].astype(np.float32)))
    assert found == pytest.approx(few, rel=0.02)
    assert found == pytest.approx(0.0078, rel=0.05)


@pytest.mark.parametrize("bits", [5, 6])
def test_rounding_errors_of_neighbours_are_alike(bits: int) -> None:
    exact, capture = blend(60, 128, noise=0).capture, rounded(blend(60, 128, noise=0.001).capture, bits)
    noise = noise_level(capture)
    assert noise >= 0.99 / (2**bits - 1) / np.sqrt(12)
    errors = capture.stokes[1:] - exact.stokes[1:]
    in_blocks = 8 * errors.reshape(2, -1, 16, 8, 16, 8).mean(axis=(-3, -1)).std() / np.sqrt(2)
    assert 1.1 * noise < noise_of_blocks(capture, noise) < 1.5 * in_blocks


def test_where_the_noise_hides_the_grey_levels_blocks_know_as_much_as_white_noise_lets_them() -> None:
    capture = rounded(blend(60, 128, noise=0.005).capture, 8)
    assert noise_of_blocks(capture, noise_level(capture)) == noise_level(capture)
    three = blend(60, 64, angles_deg=(0, 60, 120)).capture
    assert noise_of_blocks(three, 0.005) == 0.005


def test_coarse_grey_levels_make_no_wide_lens_of_a_plain_pane() -> None:
    capture = rounded(blend(60, 128, noise=0.001).capture, 6)
    found = separate(capture).scene
    assert not found.varies
    assert found.incidence_deg == pytest.approx(60, abs=2)
