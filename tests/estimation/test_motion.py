"""What moves between the photographs is found by their closure, and costs what stands still little."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import pytest
from scipy.ndimage import binary_dilation, binary_erosion

from polaropt import Capture, SceneParameters, separate
from polaropt.capture import align, measured_noise
from polaropt.estimation import motion_shows, moving_pixels, still_photographs
from polaropt.estimation.safeguard import linear
from polaropt.judging import SeparationWarning
from polaropt.simulation import psnr_db
from polaropt.solving import inpainted
from tests.blends import Blend, blend
from tests.captured import photographed
from tests.moving import SIDE, TOP, column, thing, walked_by
from tests.shifted import shifted_blend

SIZE = 128
ANGLES = (0.0, 45.0, 90.0, 135.0)
BLIND = SceneParameters(None, None, None)
JUMP, LARGE = 40, 240
"""How far a thing goes from one photograph to the next where it never is in the same place, and sides that hold it."""


@lru_cache(maxsize=8)
def still(noise: float = 0.005, **how) -> Blend:
    return blend(size=SIZE, noise=noise, **how)


@lru_cache(maxsize=8)
def large(**how) -> Blend:
    return blend(size=LARGE, **how)


def middle(margin: int) -> np.ndarray:
    return np.pad(np.ones((LARGE - 2 * margin,) * 2, bool), margin)


def moving_in(capture: Capture) -> np.ndarray | None:
    return moving_pixels(capture, *measured_noise(capture))


@pytest.mark.parametrize("color", [True, False])
@pytest.mark.parametrize("noise", [0.001, 0.005, 0.02])
def test_what_walks_by_is_found(color, noise):
    moving = walked_by(still(noise, color=color))
    found = moving_in(moving.capture)
    assert found is not None
    assert found[moving.where].mean() > 0.97
    assert not found[~binary_dilation(moving.where, iterations=16)].any()


def gained(capture: Capture) -> Capture:
    gains = np.array([1, 1.02, 0.99, 1.03], np.float32)[:, None, None, None]
    return Capture.of_planes(capture.intensities * gains, ANGLES)


def quantized(capture: Capture) -> Capture:
    return Capture.of_planes(np.round(capture.intensities * 255) / 255, ANGLES)


def clipped(capture: Capture) -> Capture:
    return Capture.of_planes(np.clip(2.5 * capture.intensities, 0, 1), ANGLES)


def hot(capture: Capture) -> Capture:
    """Defects: a pixel in a thousand is bright in one photograph."""
    images = capture.intensities.copy()
    images[2, ..., np.random.default_rng(0).random(images.shape[-2:]) < 1e-3] = 0.9
    return Capture.of_planes(images, ANGLES)


@pytest.mark.parametrize("changed", [lambda it: it, gained, quantized, clipped, hot])
def test_nothing_is_said_to_move_where_nothing_does(changed):
    assert moving_in(changed(still().capture)) is None


@pytest.mark.parametrize("how", [{"noise": 0.002}, {"noise": 0.03}, {"noise": 0.001, "shot_noise": 1e-3}])
def test_neither_is_noise(how):
    assert moving_in(still(**how).capture) is None


def test_neither_is_what_aligning_leaves():
    shifts = np.array([[0, 0], [2.3, -1.6], [-1.4, 3.2], [0.7, 1.5]])
    assert moving_in(align(shifted_blend(60, SIZE, shifts).capture)) is None


def test_photographs_that_stand_still_are_left_as_they_are():
    capture = still().capture
    photographs = still_photographs(capture)
    assert photographs.capture is capture
    assert photographs.moving is None
    assert photographs.moving_share == 0


def test_an_encoding_is_not_taken_for_motion():
    encoded = linear(still().capture, 1 / 2.2)
    photographs = still_photographs(encoded)
    assert photographs.moving is None
    assert photographs.mistakes.encoded


def test_only_more_than_three_photographs_taken_in_turn_can_tell():
    assert motion_shows(still().capture)
    assert not motion_shows(photographed((64, 64), (0, 60, 120)))
    assert not motion_shows(still().capture.with_origin(layout="mono mosaic"))


def test_what_stands_still_is_separated_as_well_as_without_motion():
    scene = still()
    moving = walked_by(scene)
    result = separate(moving.capture, BLIND)
    assert SeparationWarning.MOVING in result.diagnostics.warnings
    assert result.diagnostics.moving == pytest.approx(result.moving.mean())
    assert result.scene.incidence_deg == pytest.approx(60, abs=1)
    undisturbed = separate(scene.capture, scene.scene)
    assert undisturbed.moving is None
    still_part = ~binary_dilation(moving.where, iterations=2)
    with_motion, without = (
        psnr_db(it.layers[0][..., still_part], scene.layers[0][..., still_part]) for it in (result, undisturbed)
    )
    assert with_motion > without - 1.5


def test_the_transmission_shows_what_moves_once():
    """As the photograph along the plane of incidence saw it, in which the glass reflects least."""
    scene = still()
    result = separate(walked_by(scene).capture, scene.scene)
    places = [result.layers[0][..., TOP : TOP + SIDE, column(k) : column(k) + SIDE] for k in range(4)]
    likeness = [float(np.corrcoef(thing(scene).ravel(), place.ravel())[0, 1]) for place in places]
    # The azimuth is 25 degrees: the photograph at 45 is nearest.
    assert int(np.argmax(likeness)) == 1
    assert likeness[1] > 0.95


@pytest.mark.parametrize("azimuth_deg", [0.0, 22.5, 25.0], ids=lambda azimuth: f"azimuth {azimuth:g}")
def test_who_is_elsewhere_in_each_photograph_vanishes(azimuth_deg):
    """Also where two photographs differ in the same way by what moves: along an azimuth of 0 or 22.5 degrees."""
    scene = large(azimuth_deg=azimuth_deg)
    moving, undisturbed = walked_by(scene, JUMP), separate(scene.capture, scene.scene)
    result = separate(moving.capture, BLIND)
    assert result.moving is not None
    assert result.moving[moving.where].mean() > 0.97
    for layer, alone, truth in zip(result.layers, undisturbed.layers, scene.layers, strict=True):
        inside = moving.where & middle(16)
        assert psnr_db(layer[..., inside], truth[..., inside]) > psnr_db(alone[..., inside], truth[..., inside]) - 5


@pytest.mark.parametrize("scene", [{}, {"focal_px": 150.0}, {"angles_deg": (0.0, 36.0, 72.0, 108.0, 144.0)}], ids=str)
def test_only_the_photograph_that_saw_what_moves_is_left_out(scene):
    scene = large(**scene)
    moving = walked_by(scene, JUMP)
    kept = inpainted(moving.capture, binary_dilation(moving.where, iterations=6), scene.scene, 0.005)
    left_out = ~kept.valid.all(axis=1)
    inside = np.array([binary_erosion(place, iterations=3) for place in moving.seen_by])
    assert left_out[inside].mean() > 0.98
    assert not left_out[~np.array([binary_dilation(place, iterations=8) for place in moving.seen_by])].any()
    # It holds what it would have seen.
    off = np.abs(kept.planes - scene.capture.planes).mean(axis=1)
    assert off[inside].mean() < 0.01


def test_where_two_places_of_a_thing_meet_the_other_photographs_tell_the_layers():
    scene = large(azimuth_deg=10.0)
    moving = walked_by(scene, SIDE - 6)
    kept = inpainted(moving.capture, binary_dilation(moving.where, iterations=6), scene.scene, 0.005)
    both = np.array([binary_erosion(moving.seen_by[k] & moving.seen_by[k + 1]) for k in range(3)])
    left_out = ~kept.valid.all(axis=1)
    for k, where in enumerate(both):
        np.testing.assert_array_equal(left_out[:, where].mean(axis=1) > 0.5, np.isin(np.arange(4), (k, k + 1)))


def test_before_a_wide_lens_what_moves_is_as_one_photograph_saw_it():
    scene = still(focal_px=150.0)
    moving = walked_by(scene)
    held = inpainted(moving.capture, moving.where, scene.scene, 0.005)
    off = np.abs(held.intensities - moving.capture.intensities)[..., moving.where].mean(axis=(1, 2))
    assert off.argmin() == 1
    assert off[1] < 0.005
    np.testing.assert_array_equal(held.intensities[..., ~moving.where], moving.capture.intensities[..., ~moving.where])
