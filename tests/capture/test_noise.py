"""Noise of large captures, from a part of their pixels, and of mosaics, from their samples."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from polaropt import SceneParameters
from polaropt.capture.capture import Capture, RawSamples
from polaropt.capture.mosaic import sampling_of
from polaropt.capture.noise import measured_noise, noise_level, noise_of_blocks, noise_of_color_samples
from polaropt.separation import separate
from polaropt.simulation import Camera, cut, photograph_mosaic, shipped_photograph, simulated_mosaic
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


@pytest.mark.parametrize("angles_deg", [(0.0, 45.0, 90.0, 135.0), (0.0, 60.0, 120.0)])
@pytest.mark.parametrize("bits", [None, 8, 16])
def test_what_a_program_has_filled_tells_no_noise(angles_deg: tuple[float, ...], bits: int | None) -> None:
    # Six tenths of the frame were as quiet as nothing: layers without bounds came of it.
    capture = blend(60, 120, noise=0.005, angles_deg=angles_deg, color=False).capture
    values = np.clip(capture.intensities, 0, 1)
    values[..., 48:] = 0.1
    values = values if bits is None else digitized(values, bits)
    filled = Capture.of_planes(values.astype(np.float32), angles_deg)
    assert noise_level(filled) == pytest.approx(0.005, rel=0.1)
    assert measured_noise(filled)[1].shot == 0


@pytest.mark.parametrize("color", [False, True])
def test_samples_that_a_program_has_filled_tell_no_noise(color: bool) -> None:
    layers = [cut(shipped_photograph(name), (160, 160)) for name in ("astronaut", "coffee")]
    scene = SceneParameters(60.0, 25.0, 4.0)
    raw = photograph_mosaic(*layers, scene, Camera(noise=0.005, bits=12), color=color)
    whole = measured_noise(simulated_mosaic(raw, color))
    raw[:, 64:] = 0.1
    capture = simulated_mosaic(raw, color)
    filled = measured_noise(capture)
    assert filled[0] == pytest.approx(whole[0], rel=0.35)
    assert filled[1].read == pytest.approx(whole[1].read, rel=0.35)
    assert np.abs(separate(capture, scene).layers).max() < 2


def color_samples(noise: float, exposure: float = 1.0, side: int = 256) -> RawSamples:
    """Samples of a colour mosaic of two photographs behind a pane, as a lens images them."""
    images = [cut(shipped_photograph(name), (side, side), (0.5, 0.5)) for name in ("coffee", "astronaut")]
    camera = Camera(noise=noise, lens_blur_px=0.7, seed=1)
    raw = exposure * photograph_mosaic(images[0], images[1], SceneParameters(60.0, 30.0, 4.0), camera, color=True)
    return RawSamples(np.clip(raw, 0, 1), raw < 1, sampling_of(True)[0])


@pytest.mark.parametrize("noise", [0.002, 0.005, 0.02])
@pytest.mark.parametrize("exposure", [1.0, 1.6])
def test_the_noise_of_a_colour_mosaics_samples_is_told_from_its_detail(noise: float, exposure: float) -> None:
    assert noise_of_color_samples(color_samples(noise, exposure)) == pytest.approx(exposure * noise, rel=0.1)


def test_the_noise_of_a_colour_mosaic_that_is_nearly_all_clipped_is_left_open() -> None:
    samples = color_samples(0.005)
    nearly_all = np.ones_like(samples.valid)
    nearly_all[:24, :24] = False
    assert noise_of_color_samples(replace(samples, valid=~nearly_all)) is None
