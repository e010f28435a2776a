"""Simulated photographs."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from polaropt import PSE, InputError, SceneParameters, simulate
from polaropt.capture.capture import planes_first, planes_last
from polaropt.simulation.simulator import stack_layers

SCENE = SceneParameters(60, 33, 2.3)
RANDOM = np.random.default_rng(2)
LAYERS = RANDOM.random((2, 32, 40, 3))


def test_without_noise_it_is_the_engine() -> None:
    capture = simulate(*LAYERS, SCENE, (0, 60, 120), noise=0)
    expected = PSE(SCENE, (0, 60, 120)).forward(np.moveaxis(LAYERS, -1, 1))
    np.testing.assert_allclose(capture.intensities, expected, atol=1e-6)
    assert capture.angles_deg == (0, 60, 120)
    assert capture.intensities.dtype == np.float32


def test_grey_layers_have_no_channel_axis() -> None:
    assert simulate(*LAYERS[..., 0], SCENE).intensities.shape == (4, 32, 40)


def test_noise_has_the_asked_deviation_and_follows_the_seed() -> None:
    clean = simulate(*LAYERS, SCENE, noise=0).intensities
    noisy = simulate(*LAYERS, SCENE, noise=0.005, seed=3).intensities
    assert (noisy - clean).std() == pytest.approx(0.005, rel=0.03)
    np.testing.assert_array_equal(noisy, simulate(*LAYERS, SCENE, noise=0.005, seed=3).intensities)
    assert np.any(noisy != simulate(*LAYERS, SCENE, noise=0.005, seed=4).intensities)


@pytest.mark.parametrize("bits", [3, 8, 12])
def test_values_lie_on_the_steps_of_the_depth(bits: int) -> None:
    dark = LAYERS * np.linspace(0, 1, 40)[:, None]
    steps = simulate(*dark, SCENE, noise=0.01, bits=bits).intensities * (2**bits - 1)
    np.testing.assert_allclose(steps, np.round(steps), atol=1e-3)


def test_light_beyond_white_clips_and_is_not_trusted() -> None:
    bright = LAYERS.copy()
    bright[:, :10] = 5
    capture = simulate(*bright, SCENE)
    assert capture.intensities.max() == 1
    assert not capture.valid[:, :, :8].any()
    assert capture.valid[:, :, 14:].all()


def test_noise_in_the_dark_is_kept_as_far_as_a_capture_may_have_it() -> None:
    dark = 0.001 * LAYERS
    intensities = simulate(*dark, SCENE, noise=0.02).intensities
    assert -0.01 < intensities.min() < -0.008


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
def test_unsigned_images_are_white_at_their_largest_value(dtype: Any) -> None:
    whole = np.round(LAYERS * np.iinfo(dtype).max)
    expected = simulate(*(whole / np.iinfo(dtype).max), SCENE).intensities
    np.testing.assert_allclose(simulate(*whole.astype(dtype), SCENE).intensities, expected, atol=1e-6)


@pytest.mark.parametrize(
    ("layers", "options", "message"),
    [
        ((LAYERS[0], LAYERS[1, :-1]), {}, "shapes"),
        ((LAYERS[0, 0, 0], LAYERS[1, 0, 0]), {}, "shapes"),
        (LAYERS, {"noise": -0.1}, "noise"),
        (LAYERS, {"noise": math.nan}, "noise"),
        (LAYERS, {"bits": 0}, "bits"),
        (LAYERS, {"bits": 25}, "bits"),
        (LAYERS, {"angles_deg": (0, 90)}, "angles"),
        (LAYERS, {"angles_deg": (math.inf, math.inf)}, "angles"),
        (LAYERS, {"angles_deg": (0, 60, math.nan)}, "angle is not a number"),
    ],
)
def test_what_cannot_be_simulated_is_one_clear_line(layers: Any, options: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=message) as caught:
        simulate(*layers, SCENE, **options)
    assert "\n" not in str(caught.value)


def test_an_incomplete_scene_says_what_is_missing() -> None:
    with pytest.raises(InputError, match="ghost_shift"):
        simulate(*LAYERS, SCENE.replace(ghost_shift=None))


def test_planes_come_back() -> None:
    for image in (LAYERS[0].astype(np.float32), LAYERS[0, ..., 0].astype(np.float32)):
        np.testing.assert_array_equal(planes_last(planes_first(image)), image)
    assert stack_layers(*LAYERS).shape == (2, 3, 32, 40)
