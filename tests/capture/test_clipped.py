"""Clipped pixels: what is around them loses little, and they are filled with what the layers would have given."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from polaropt import separate
from polaropt.capture import ANGLES_DEG, planes_last
from polaropt.capture.capture import Capture
from polaropt.capture.polarization import stokes_images
from polaropt.estimation.flat.estimate import estimate_scene
from polaropt.inversion import filled, worth_filling
from polaropt.inversion.closed_form import plate_entries
from polaropt.optics import engine_for
from polaropt.optics.engine import PSE
from polaropt.optics.scene import SceneParameters
from polaropt.simulation import simulate
from solvers.base import Status
from studies.camera import photograph
from studies.photographs import shipped_pairs
from studies.scenes import Taking
from studies.scores import both_psnr
from tests.blends import blend
from tests.captured import mono_capture

_CLIPPED = 0.05


@pytest.mark.parametrize("incidence_deg", [40.0, 80.0])
def test_unclipped_pixels_lose_at_most_half_a_decibel(incidence_deg):
    pair = shipped_pairs(160, 96)[0]
    found = []
    for headroom in (True, False):
        scene = SceneParameters(incidence_deg, 25.0, 5.0)
        sample = photograph(pair, scene, Taking(clipped=_CLIPPED, headroom=headroom))
        found.append(both_psnr(separate(sample.capture, scene).layers, sample.layers, sample.unclipped))
    assert 0.9 < sample.unclipped.mean() < 0.97
    assert np.subtract(*found).max() <= 0.5


def test_gaps_are_filled_with_what_is_expected_and_white_at_least():
    example = blend(60, 32)
    seen = np.minimum(example.capture.intensities, 1).copy()
    seen[:2, :, 4:8, 4:8] = 1.0
    valid = seen < 1
    valid[3, :, 20:24] = False
    capture = Capture.of_planes(seen, valid=valid)
    expected = PSE(example.scene, capture.angles_deg).forward(example.layers.astype(np.float32))
    whole = filled(capture, expected)
    assert whole.valid.all()
    np.testing.assert_array_equal(whole.intensities[valid], seen[valid])
    np.testing.assert_array_equal(whole.intensities[3, :, 20:24], expected[3, :, 20:24])
    assert (whole.intensities[:2, :, 4:8, 4:8] >= 1).all()
    assert not capture.valid.all()


@pytest.mark.parametrize(("share", "worth"), [(0.0, False), (0.001, False), (0.01, True)])
def test_filling_is_for_more_than_a_few_pixels(share, worth):
    valid = np.random.default_rng(0).uniform(size=(4, 64, 64)) >= share
    assert worth_filling(Capture(np.random.default_rng(1).uniform(0.1, 0.9, (4, 64, 64)), valid=valid)) is worth


def test_three_photographs_tell_a_pixel_its_stokes_vector():
    example = blend(60, 32, noise=0.0)
    whole = stokes_images(example.capture, 0.005).images
    valid = np.ones_like(example.capture.valid)
    valid[1, :, 8:16, 8:16] = False
    wrong = np.where(valid, example.capture.intensities, 1.0)
    part = stokes_images(Capture.of_planes(wrong, valid=valid), 0.005)
    assert part.valid.all()
    np.testing.assert_allclose(part.images, whole, atol=2e-5)


@pytest.mark.parametrize("incidence_deg", [40.0, 60.0])
def test_the_scene_is_found_beside_clipped_pixels(incidence_deg):
    pair = shipped_pairs(160, 96)[0]
    sample = photograph(pair, SceneParameters(incidence_deg, 25.0, 5.0), Taking(clipped=_CLIPPED))
    found = estimate_scene(sample.capture).scene
    assert found.incidence_deg == pytest.approx(incidence_deg, abs=1.5)
    assert found.ghost_shift == pytest.approx(5.0, abs=0.3)


def test_photographs_that_hardly_tell_a_pixel_do_not_amplify_its_noise():
    example = blend(60, 48, azimuth_deg=0.0)
    valid = np.ones_like(example.capture.valid)
    # At azimuth 0 the photographs at 45 and 135 degrees are the same mixture of both entries.
    valid[::2, :, 20:24, 20:24] = False
    capture = Capture.of_planes(example.capture.intensities, valid=valid)
    whole, part = (entries_of(c, example.scene) for c in (example.capture, capture))
    off = np.abs(part - whole)[..., 20:24, 20:24]
    assert off.max() < 0.3
    np.testing.assert_allclose(part[..., :16, :], whole[..., :16, :], atol=1e-6)


def entries_of(capture: Capture, scene: SceneParameters) -> np.ndarray:
    return plate_entries(capture, PSE(scene, capture.angles_deg))


def test_values_that_clip_are_no_darker_than_they_were_also_if_a_gain_was_divided_out():
    example = blend(60, 32)
    seen = np.minimum(example.capture.intensities, 0.9).copy()
    seen[:, :, 4:8, 4:8] = 1.0
    valid = seen < 1
    # The 45/135 pair of a camera reads brighter.
    seen[1::2] /= 1.02
    valid[1, :, 20:24] = False
    whole = filled(Capture.of_planes(seen, valid=valid), np.full_like(seen, 0.5))
    np.testing.assert_array_equal(whole.intensities[:, :, 4:8, 4:8].max(axis=0), 1.0)
    assert (whole.intensities >= np.where(valid, 0, seen))[:, :, 4:8, 4:8].all()
    assert (whole.intensities[1, :, 20:24] == 0.5).all()


def test_where_all_photographs_clip_their_light_stays_as_polarized_as_is_expected():
    example = blend(60, 32)
    seen = np.minimum(example.capture.intensities, 0.9).copy()
    seen[:, :, 4:8, 4:8] = 1.0
    expected = np.stack([np.full((3, 32, 32), light, np.float32) for light in (0.8, 0.7, 0.4, 0.5)])
    whole = filled(Capture.of_planes(seen, valid=seen < 1), expected).intensities[:, :, 4:8, 4:8]
    np.testing.assert_allclose(whole, (expected / 0.4)[:, :, 4:8, 4:8], rtol=1e-6)


def test_a_bright_cloud_that_clips_makes_no_bright_reflection():
    """Photographs near it are all as bright as white: filled from there they would not be polarized."""
    bright, dark = (blend(60, 96, azimuth_deg=10.0).layers[i].copy() for i in (0, 1))
    bright = 0.3 * bright
    bright[:2, 30:60, 30:60] += 3.0
    pane = SceneParameters(60.0, 10.0, 0.0)
    seen = simulate(planes_last(bright), planes_last(dark), pane, noise=0.003)
    result = separate(seen, pane)
    clipped = ~seen.valid.any(axis=0)
    assert clipped[:2, 34:56, 34:56].all()
    off = np.abs(result.layers[1] - dark)[clipped]
    assert off.mean() < 0.3
    assert (off < 2 * result.uncertainty[1][clipped] + 1e-3).mean() > 0.9
    assert result.reflection_known[40:50, 40:50].mean() < 0.5


def test_before_a_lens_a_lamp_that_clips_is_as_bright_as_its_rim_and_takes_no_light_from_around():
    pane = SceneParameters(50.0, 30.0, 0.0, focal_px=205.0)
    layers, lamp = before_a_lamp(128)
    photographs = engine_for(pane, ANGLES_DEG, 0.005, lamp.shape).forward(layers)
    around = gaussian_filter(lamp.astype(np.float32), 6) < 0.02
    noise = 0.005 * np.random.default_rng(0).standard_normal(lamp.shape)
    found = {}
    for gain in (1 / photographs.max(), 1.0):
        separated = separate(mono_capture(gain * photographs[:, 0] + noise), pane)
        found[gain] = both_psnr(separated.layers[:, None], gain * layers, around)
    assert (photographs >= 1).any(axis=(0, 1)).mean() > 0.02
    assert separated.transmission[lamp].mean() > 0.95 * layers[0, 0, lamp].mean()
    assert separated.solver.status is Status.CONVERGED
    assert np.subtract(*found.values()).max() < 2


def before_a_lamp(side: int) -> tuple[np.ndarray, np.ndarray]:
    """Grey layers whose transmission holds a bright disc, and where it is."""
    layers = 0.6 * shipped_pairs(side, side // 2)[1].layers.mean(axis=1, keepdims=True)
    rows, columns = np.mgrid[:side, :side] - side / 2
    lamp = columns**2 + (rows - 5) ** 2 < (0.12 * side) ** 2
    layers[0] += 2 * gaussian_filter(lamp.astype(np.float32), 2)
    return layers.astype(np.float32), lamp
