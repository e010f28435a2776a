"""Gradients in small windows: the directions of the layers in what is seen, and the incidence."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from polaropt import SceneParameters
from polaropt.capture import Capture, plate_frame, stokes_images
from polaropt.estimation import find_scene
from polaropt.estimation.flat.ghost_overlap import images_with_ghosts_in_place, without_borders
from polaropt.estimation.flat.gradients import LEAST_SHOWN, GradientWindows, PaneGradients, incidence_by_gradients
from polaropt.numerics import block_mean
from polaropt.simulation import Camera, photograph_pair
from studies.photographs import pairs_of

NOISE = 0.004
AZIMUTH_DEG = 25.0


def photographed(scene: SceneParameters, noise: float = NOISE, pair: int = 0) -> Capture:
    photographs = pairs_of(None, 192)[pair]
    frames = (photographs.transmission, photographs.reflection)
    return photograph_pair(*frames, scene, Camera(noise=noise), margin=photographs.margin)


def frame_of(scene: SceneParameters, noise: float = NOISE, pair: int = 0):
    return plate_frame(stokes_images(photographed(scene, noise, pair), noise), AZIMUTH_DEG)


@settings(max_examples=15, deadline=None)
@given(st.floats(0.1, 1.2), st.floats(0.4, 1.2), st.integers(0, 100))
def test_directions_of_layers_that_vary_for_themselves_are_the_likeliest(first: float, apart: float, seed: int) -> None:
    rng = np.random.default_rng(seed)
    # Each layer's contrast is its own in every part of the frame.
    strength = np.kron(rng.uniform(0.3, 30, (2, 16, 16)), np.ones((6, 6)))
    layers = rng.standard_normal((2, 96, 96)) * strength
    mixing = np.array([[math.cos(a), math.sin(a)] for a in (first, first + apart)]).T
    seen = np.einsum("il,lhw->ihw", mixing, layers) + rng.standard_normal((2, 96, 96))
    windows = GradientWindows(seen[:, None].astype(np.float32), np.ones((1, 96, 96), dtype=bool))
    best = float(windows.cost(*windows.directions((0.0, math.pi))[0])[0])
    true = float(windows.cost(first, first + apart)[0])
    beside = [float(windows.cost(first + move, first + apart + move)[0]) for move in (-0.25, 0.25)]
    assert windows.certainty * (true - best) < 3
    assert min(beside) > true


@settings(max_examples=10, deadline=None)
@given(st.floats(0.5, 1.5), st.integers(0, 1000))
def test_where_one_layer_is_smooth_noise_does_not_drive_the_directions_apart(contrast: float, seed: int) -> None:
    rng, n = np.random.default_rng(seed), 60
    # A sky over a landscape, before which what is mirrored is hardly more than noise but at one side.
    strength = np.zeros((2, 1, n, 1)), np.full((1, 1, 1, n), contrast)
    strength[0][0, :, 40:], strength[1][..., :15] = 60.0, 3 * contrast
    layers = np.stack([power[0] * rng.standard_normal((3, n, n)) for power in strength])
    first, second = math.radians(53), math.radians(73)
    mixing = np.array([[math.cos(angle), math.sin(angle)] for angle in (first, second)]).T
    seen = np.einsum("il,lchw->ichw", mixing, layers) + rng.standard_normal((2, 3, n, n))
    windows = GradientWindows(seen.astype(np.float32), np.ones((3, n, n), dtype=bool), LEAST_SHOWN)
    others = windows.cost(first, np.radians(np.arange(60.0, 95.0)))
    assert windows.certainty * (float(windows.cost(first, second)[0]) - float(others.min())) < 3


@pytest.mark.parametrize("incidence_deg", [45.0, 62.0, 78.0])
@pytest.mark.parametrize("shift", [0.0, 6.0])
def test_gradients_tell_the_incidence(incidence_deg: float, shift: float) -> None:
    scene = SceneParameters(incidence_deg, AZIMUTH_DEG, shift)
    told = incidence_by_gradients(frame_of(scene), scene.replace(incidence_deg=incidence_deg + 1.5))
    assert told is not None
    assert abs(told[0] - incidence_deg) < max(3 * told[1], 0.3)
    assert told[1] < 1


def test_they_tell_it_of_several_panes_and_of_another_index() -> None:
    for scene in (
        SceneParameters(55.0, AZIMUTH_DEG, 0.0, n_panes=2),
        SceneParameters(55.0, AZIMUTH_DEG, 0.0, refractive_index=1.8),
    ):
        told = incidence_by_gradients(frame_of(scene), scene.replace(incidence_deg=56.0))
        assert told is not None
        assert abs(told[0] - 55) < max(3 * told[1], 0.3)


def test_where_noise_drowns_what_is_mirrored_they_tell_nothing() -> None:
    scene = SceneParameters(15.0, AZIMUTH_DEG, 0.0)
    assert incidence_by_gradients(frame_of(scene, 0.02), scene) is None
    assert incidence_by_gradients(frame_of(scene, 0.02), scene.replace(incidence_deg=0.0)) is None


@pytest.mark.parametrize("pair", [0, 1])
def test_ghosts_are_brought_into_place(pair: int) -> None:
    scene = SceneParameters(60.0, AZIMUTH_DEG, 7.0)
    apart, together = (frame_of(part, 0.001, pair) for part in (scene, scene.replace(ghost_shift=0.0)))
    moved = images_with_ghosts_in_place(apart, scene)
    here, there = (without_borders(block_mean(np.asarray(part.images), 2)) for part in (together, apart))
    left, right = (float(np.square(images - here)[..., 8:-8, 8:-8].mean()) for images in (moved, there))
    assert left < 0.2 * right


def test_the_truth_is_likelier_than_a_wrong_incidence_by_more_than_chance() -> None:
    scene = SceneParameters(60.0, AZIMUTH_DEG, 0.0)
    gradients = PaneGradients(frame_of(scene), scene)
    true, *wrong = (gradients.cost(angle) for angle in (60.0, 57.0, 63.0))
    assert min(wrong) - true > 3


def test_blind_they_make_steep_panes_exact() -> None:
    for pair in range(3):
        capture = photographed(SceneParameters(80.0, AZIMUTH_DEG, 0.0), pair=pair)
        found = find_scene(capture, SceneParameters(None, None, 0.0), NOISE)
        assert found.scene.incidence_deg == pytest.approx(80, abs=0.25)
        assert found.errors.incidence_deg is not None
        assert found.errors.incidence_deg < 0.3


def test_gradients_along_one_line_have_no_spread_to_be_divided_by() -> None:
    """A factor of their covariance, which is none, ended in a traceback: of photographs that are all the same."""
    ramp = np.broadcast_to(np.arange(20, dtype=np.float32), (1, 20, 20))
    for second in (0 * ramp, ramp):
        windows = GradientWindows(np.stack([ramp, second]), np.ones((1, 20, 20), bool))
        assert np.isfinite(windows.cost(0.3, 1.2)).all()
