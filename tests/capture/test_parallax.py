"""Both layers of photographs taken from the hand are found where each shows them, and moved onto their places."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from scipy.ndimage import fourier_shift

from polaropt import Capture, SceneParameters, SeparationWarning, StoppingRule, inspect, separate, simulate
from polaropt.capture import LayerShifts, Matching, match_photographs, noise_level
from polaropt.cli.app import main
from polaropt.estimation import still_photographs
from polaropt.separation import scene_case
from polaropt.simulation.metrics import psnr_db
from studies.photographs import pairs_of
from tests.captured import written_photographs

SIDE, KEPT, NOISE = 160, 24, 0.004
SCENE = SceneParameters(70.0, 25.0, 0.0)
PANE = ["--incidence", "70", "--azimuth", "25", "--shift", "0"]
# Of one clear pane.
BLIND = SceneParameters(None, None, None)
QUICK = StoppingRule(max_evaluations=3)
STILL = np.zeros((4, 2))
BEHIND = np.array([[0.0, 0.0], [0.4, -0.7], [-0.5, 0.2], [0.9, 0.6]])
MIRRORED = np.array([[0.0, 0.0], [1.6, 0.3], [-1.2, 1.5], [-0.4, -1.3]])


@cache
def pictures() -> np.ndarray:
    """Detailed pictures (2, h, w, 3), larger than what is kept of them."""
    from skimage import data

    wide = SIDE + 2 * KEPT
    coffee, astronaut = data.coffee()[60 : 60 + wide, 140 : 140 + wide], data.astronaut()[:wide, 100 : 100 + wide]
    return np.stack([coffee, astronaut]) / 255


@cache
def of_layer(layer: int, scene: SceneParameters) -> np.ndarray:
    """Photographs without noise (k, 3, h, w) of one of the pictures, the other black."""
    alone = pictures() * (np.arange(2) == layer)[:, None, None, None]
    return simulate(*alone, scene, bits=None, noise=0.0).intensities.astype(np.float64)


def taken(
    behind: np.ndarray = STILL, mirrored: np.ndarray = STILL, scene: SceneParameters = SCENE, noise: float = NOISE
) -> tuple[Capture, np.ndarray]:
    """Photographs in which both layers have moved by shifts (k, 2); the layers of the first one's place."""
    photographs = np.zeros_like(of_layer(0, scene))
    for layer, shifts in enumerate((behind, mirrored)):
        for k, channel in np.ndindex(photographs.shape[:2]):
            spectrum = fourier_shift(np.fft.fft2(of_layer(layer, scene)[k, channel]), shifts[k])
            photographs[k, channel] += np.fft.ifft2(spectrum).real
    inside = (..., slice(KEPT, -KEPT), slice(KEPT, -KEPT))
    noisy = photographs[inside] + noise * np.random.default_rng(1).standard_normal(photographs[inside].shape)
    layers = np.moveaxis(pictures(), -1, 1)[inside]
    return Capture(np.moveaxis(np.clip(noisy, 0, 1), 1, -1), (0.0, 45.0, 90.0, 135.0)), layers


def matched(capture: Capture) -> Matching:
    found = match_photographs(capture, NOISE)
    assert found is not None
    return found


def layers_of(matching: Matching) -> LayerShifts:
    assert matching.transfer.layers is not None
    return matching.transfer.layers.seen_by(SCENE.azimuth_deg)


@pytest.mark.parametrize(("behind", "mirrored"), [(BEHIND, MIRRORED), (STILL, MIRRORED), (BEHIND, STILL)])
def test_the_shifts_of_both_layers_are_found_to_a_tenth_of_a_pixel(behind, mirrored):
    layers = layers_of(matched(taken(behind, mirrored)[0]))
    np.testing.assert_allclose(layers.shifts_px, [behind, mirrored], atol=0.1)


def test_the_pane_shows_by_how_layers_that_move_are_polarized():
    # Of glass at 70 degrees, all bounces together: (R_s - R_p) over (2 - R_s - R_p) and (R_s + R_p).
    layers = layers_of(matched(taken(BEHIND, 2 * MIRRORED)[0]))
    np.testing.assert_allclose(layers.polarized, [0.26, -0.70], atol=0.05)
    assert abs((layers.azimuth_deg - SCENE.azimuth_deg + 45) % 90 - 45) < 0.5


def test_moved_back_photographs_are_as_if_the_camera_had_stood_still():
    still, _ = taken()
    before = taken(BEHIND, MIRRORED)[0]
    matching = matched(before)
    inner = (..., slice(16, -16), slice(16, -16))
    for k in (1, 2, 3):
        after = np.std((matching.capture.intensities - still.intensities)[k][inner])
        assert after < 2 * NOISE < 0.5 * np.std((before.intensities - still.intensities)[k][inner])
    np.testing.assert_allclose(matching.capture.intensities[0], still.intensities[0], atol=1e-5)


def test_layers_are_nearly_those_of_a_camera_that_stood_still():
    scene = SCENE.replace(ghost_shift=4.0)
    capture, layers = taken(BEHIND, MIRRORED, scene)
    aim = separate(taken(scene=scene)[0], scene)
    result, left = separate(capture, BLIND), separate(capture, scene, match_photographs=False)
    for layer, behind_by in ((0, 2.5), (1, 3.5)):
        reached = psnr_db(result.layers[layer], layers[layer], 16)
        assert reached > psnr_db(aim.layers[layer], layers[layer], 16) - behind_by
        assert reached > psnr_db(left.layers[layer], layers[layer], 16) + 5
    assert not result.diagnostics.warnings
    assert abs(result.scene.incidence_deg - 70) < 1.5


def test_half_a_pixel_is_not_taken_for_a_photograph_out_of_focus():
    # Blurs explain half of what these leave unexplained; both layers in places of their own all of it.
    pair, margin = pairs_of(None, 192, 64)[3], 64
    scene = SceneParameters(70.0, 135.0)
    mirrored = np.array([[0.0, 0.0], [-0.13, -0.37], [0.16, 0.4], [-0.08, -0.19]])
    black = np.zeros_like(pair.transmission)
    behind, before = (
        simulate(*layers, scene, bits=None, noise=0.0).intensities.astype(np.float64)
        for layers in ((pair.transmission, black), (black, pair.reflection))
    )
    for k, channel in np.ndindex(before.shape[:2]):
        before[k, channel] = np.fft.ifft2(fourier_shift(np.fft.fft2(before[k, channel]), mirrored[k])).real
    photographs = (behind + before)[..., margin:-margin, margin:-margin]
    photographs *= 0.97 / photographs.max()
    photographs += 0.006 * np.random.default_rng(1).standard_normal(photographs.shape)
    capture = Capture(np.moveaxis(np.clip(photographs, 0, 1), 1, -1), (0.0, 45.0, 90.0, 135.0))
    # Edges that disagree pass for noise, too.
    matching = match_photographs(capture, noise_level(capture))
    assert not matching.transfer.blurred
    found = matching.transfer.layers.seen_by(scene.azimuth_deg)
    # The last photograph, along the plane of incidence, hardly shows what is mirrored.
    np.testing.assert_allclose(found.shifts_px[1, :3], mirrored[:3], atol=0.15)


def test_a_layer_is_named_by_how_the_pane_lies():
    matching = scene_case(taken(STILL, MIRRORED)[0], BLIND).matching
    assert matching is not None
    np.testing.assert_allclose(matching.transfer.layers.shifts_px, [STILL, MIRRORED], atol=0.1)


@pytest.mark.parametrize(
    "change",
    [
        {},
        {"transmission_polarization": (0.5, 60.0)},
        {"reflection_polarization": (0.4, 100.0)},
        {"transmission_polarization": (0.3, 10.0), "reflection_polarization": (0.4, 100.0)},
        {"ghost_shift": 5.0},
    ],
    ids=["plain", "screen", "sky", "both", "double images"],
)
def test_layers_that_lie_in_place_are_not_moved(change):
    assert match_photographs(taken(scene=SCENE.replace(**change))[0], NOISE) is None


def test_gains_are_taken_for_no_movement():
    capture = taken()[0]
    gains = np.array([1.0, 1.02, 0.98, 1.01], dtype=np.float32)[:, None, None, None]
    assert match_photographs(capture.replace(intensities=gains * capture.intensities), NOISE) is None


def test_layers_that_have_moved_far_are_left_where_they_are():
    found = match_photographs(taken(STILL, 8 * MIRRORED)[0], NOISE)
    assert found is None or found.transfer.layers is None


def test_what_moving_back_brings_in_from_beyond_the_frame_is_not_valid_and_not_clipped():
    capture = taken(STILL, MIRRORED)[0]
    valid = matched(capture).capture.valid
    assert not valid[..., :2].any()
    assert not valid[..., -2:, :].any()
    assert valid[..., 5:-5, 5:-5].all()
    assert separate(capture, SCENE, stopping=QUICK).diagnostics.clipped == 0


def test_the_command_tells_how_far_each_layer_was_moved(tmp_path, capsys):
    capture, _ = taken(STILL, MIRRORED)
    files = written_photographs(capture, tmp_path)
    assert main(["estimate", *files, *PANE]) == 0
    assert "each layer by itself" in capsys.readouterr().out
    assert main(["estimate", *files, *PANE, "--no-match"]) == 0
    assert "each layer" not in capsys.readouterr().out
    assert main(["inspect", *files]) == 0
    assert "each layer lies elsewhere by itself" in capsys.readouterr().out


def test_layers_that_move_are_taken_for_no_things_that_do():
    capture = taken(STILL, 4 * MIRRORED)[0]
    assert still_photographs(capture).moving is not None
    result = separate(capture, SCENE, stopping=QUICK)
    assert result.matching is not None
    assert result.matching.transfer.layers is not None
    assert result.moving is None
    assert SeparationWarning.MOVING not in result.diagnostics.warnings
    inspection = inspect(capture)
    assert inspection.layer_shifts_px
    assert inspection.moving_share == 0
