"""Noise that grows with the light: found where it does, ignored where it does not, and used."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.ndimage import gaussian_filter

from polaropt import separate
from polaropt.capture.capture import Capture
from polaropt.capture.mosaic import SONY_CELL, sampling_of
from polaropt.capture.noise import NoiseModel, measured_noise, noise_classes, noise_level, noise_model
from polaropt.capture.reading.frames import mosaic_capture
from polaropt.errors import InputError
from polaropt.optics.scene import SceneParameters
from polaropt.simulation import Camera, cut, photograph_mosaic, shipped_photograph, simulated_mosaic
from polaropt.simulation.metrics import psnr_db
from polaropt.simulation.simulator import digitized, simulate
from polaropt.solving.objective import Weights
from polaropt.solving.problem import Problem
from polaropt.solving.starts import take_start
from tests.blends import blend


def noisy(read: float, shot: float, *, size: int = 160, bits: int | None = None, seed: int = 0) -> Capture:
    """A ramp behind a pane, in all brightnesses."""
    ramp = np.linspace(0.05, 1.2, size)[None, :] * np.linspace(0.5, 1, size)[:, None]
    scene = SceneParameters(60.0, 20.0, 3.0)
    return simulate(ramp, ramp[::-1], scene, noise=read, bits=bits, seed=seed, shot_noise=shot)


@settings(max_examples=12, deadline=None)
@given(st.floats(0.001, 0.01), st.floats(2e-4, 2e-3), st.sampled_from([None, 10, 12]), st.integers(0, 99))
def test_read_and_shot_noise_are_found(read, shot, bits, seed):
    capture = noisy(read, shot, bits=bits, seed=seed)
    found = noise_model(capture, noise_level(capture))
    assert found.shot == pytest.approx(shot, rel=0.15)
    middle = float(np.median(capture.intensities))
    assert found.read**2 + found.shot * middle == pytest.approx(read**2 + shot * middle, rel=0.1)


@settings(max_examples=12, deadline=None)
@given(st.floats(0.001, 0.05), st.sampled_from([None, 8, 12]), st.integers(0, 99))
def test_constant_noise_has_one_level(read, bits, seed):
    capture = noisy(read, 0.0, bits=bits, seed=seed)
    level = noise_level(capture)
    assert noise_model(capture, level) == NoiseModel(level, 0.0)


def test_rounding_is_no_shot_noise():
    capture = noisy(0.0, 0.0, bits=8)
    assert noise_model(capture, noise_level(capture)).shot == 0


def test_three_photographs_tell_no_growth():
    capture = noisy(0.003, 1e-3)
    three = Capture.of_planes(capture.intensities[:3], capture.angles_deg[:3])
    assert noise_model(three, 0.01) == NoiseModel(0.01)


def mosaic_of(color: bool, shot: float = 0.0, cell_order: tuple[float, ...] = SONY_CELL) -> Capture:
    """Two photographs behind a pane, on a sensor."""
    images = [gaussian_filter(shipped_photograph(name)[:296, :448], (0.5, 0.5, 0)) for name in ("chelsea", "coffee")]
    photographs = simulate(images[0], images[1], SceneParameters(60.0, 30.0, 4.0), noise=0.0).intensities
    photographs = photographs if color else photographs.mean(axis=1, keepdims=True)
    raw = sampling_of(color, cell_order)[0].sample(photographs)
    variance = 0.004**2 + shot * np.maximum(raw, 0)
    raw = digitized(raw + np.sqrt(variance) * np.random.default_rng(1).standard_normal(raw.shape), 12)
    sensor = "color" if color else "mono"
    return mosaic_capture(
        raw.astype(np.float32), sensor=sensor, cell_order=cell_order, pair_gain=1.0, white_level=1.0, gamma=1.0
    )


@pytest.mark.parametrize("color", [False, True])
def test_detail_of_a_mosaic_is_no_shot_noise(color):
    """What aliases in its cells grows with the light, too."""
    level, model = measured_noise(mosaic_of(color))
    assert level == pytest.approx(0.004, rel=0.15)
    assert model == NoiseModel(level)


@pytest.mark.parametrize("color", [False, True])
def test_shot_noise_of_a_mosaic_is_found(color):
    _, model = measured_noise(mosaic_of(color, 5e-4))
    assert model.shot == pytest.approx(5e-4, rel=0.2)
    assert model.read < 0.006


def test_rounding_of_a_mosaic_is_no_shot_noise():
    """Where it is more than the noise, its spread goes with the detail."""
    images = [cut(shipped_photograph(name), (256, 256), (0.5, 0.5)) for name in ("coffee", "astronaut")]
    camera = Camera(noise=0.001, lens_blur_px=0.7, bits=6, seed=1)
    raw = photograph_mosaic(images[0], images[1], SceneParameters(60.0, 30.0, 4.0), camera, color=False)
    level, model = measured_noise(simulated_mosaic(raw, False))
    assert model == NoiseModel(level)


def test_where_diagonals_of_a_cell_are_no_pairs_its_noise_has_one_level():
    """What alternates from pixel to pixel is polarized light there."""
    level, model = measured_noise(mosaic_of(False, 5e-4, (0.0, 90.0, 45.0, 135.0)))
    assert model == NoiseModel(level)


def test_classes_hold_the_noise_of_their_pixels():
    capture = noisy(0.003, 1e-3)
    model = NoiseModel(0.003, 1e-3)
    classes = noise_classes(capture, model)
    exact = np.sqrt(model.variance(capture.intensities.mean(axis=0)))
    np.testing.assert_allclose(classes.images()[0], exact, rtol=0.25)
    np.testing.assert_allclose(classes.images()[0].mean(), exact.mean(), rtol=0.02)
    assert exact.min() < classes.typical < exact.max()
    assert noise_classes(capture, NoiseModel(0.003)) is None


@pytest.mark.parametrize("clip", [False, True])
@pytest.mark.parametrize("varies", [False, True])
def test_the_compiled_misfit_is_the_readable_one(clip, varies):
    example = blend(60, 48, focal_px=90.0, ghost_shift=0.0) if varies else blend(60, 48)
    valid = example.capture.valid.copy()
    valid[:2, :, 10:20, 10:30] &= not clip
    capture = Capture.of_planes(example.capture.intensities, example.capture.angles_deg, valid)
    problem = Problem(capture, example.scene, 0.005, Weights(), growth=NoiseModel(0.003, 1e-3))
    start = take_start(problem, "closed-form")
    compiled, readable = problem.compiled(start), problem.readable(start)
    elsewhere = start + np.random.default_rng(0).normal(0, 0.01, start.shape).astype(np.float32)
    z = np.array(compiled.coordinates(elsewhere))
    (value, gradient), (expected, slope) = compiled.value_and_grad(z), readable.value_and_grad(z)
    assert value == pytest.approx(expected, rel=1e-4)
    np.testing.assert_allclose(gradient, slope, atol=2e-3 * np.abs(slope).max())


def test_separation_gains_where_the_noise_grows(monkeypatch):
    scene = blend(60, 128).scene
    example = blend(60, 128, noise=0.003, shot_noise=2e-3)
    informed = separate(example.capture, scene)
    assert informed.diagnostics.noise_model.shot == pytest.approx(2e-3, rel=0.2)
    level = informed.diagnostics.noise
    monkeypatch.setattr("polaropt.estimation.motion.measured_noise", lambda capture: (level, NoiseModel(level)))
    blunt = separate(example.capture, scene)
    of_both = [[psnr_db(result.layers[i], example.layers[i], 8) for i in (0, 1)] for result in (informed, blunt)]
    gains = np.subtract(*of_both)
    assert gains[0] > 0.5
    assert gains[1] > 0.5


def test_stated_errors_follow_the_light():
    example = blend(60, 128, noise=0.003, shot_noise=2e-3)
    result = separate(example.capture, example.scene)
    total = example.capture.intensities.mean(axis=(0, 1))
    dark, bright = total < np.quantile(total, 0.2), total > np.quantile(total, 0.8)
    stated = result.uncertainty[0].mean(axis=0)
    assert stated[bright].mean() > 1.3 * stated[dark].mean()
    within = np.abs(result.layers - example.layers) <= 2 * result.uncertainty
    assert (within.reshape(2, -1).mean(axis=1) >= 0.9).all()


@pytest.mark.parametrize("shot", [-1e-3, np.nan, np.inf])
def test_shot_noise_is_a_variance(shot):
    with pytest.raises(InputError, match="shot noise"):
        noisy(0.005, shot)


def test_nothing_but_shot_noise_leaves_black_pixels_some():
    capture = noisy(0.0, 2e-3)
    dark = np.where(np.arange(160) < 40, np.float32(0), capture.intensities)
    capture = capture.replace(intensities=dark.astype(np.float32))
    level = noise_level(capture)
    model = noise_model(capture, level)
    assert model.shot > 0
    assert model.read >= 0.09 * level
    assert noise_classes(capture, model).sigmas.min() > 0
