"""Ghosts of a pane that varies over the frame: found where there are any, and told."""

from __future__ import annotations

import math

import pytest

from polaropt import SceneParameters, separate
from polaropt.capture.polarization import stokes_images
from polaropt.estimation.ladder import find_scene
from polaropt.estimation.wide.ghosts import VaryingSpectra
from polaropt.optics.engine import bounces_that_show
from polaropt.simulation.metrics import psnr_db
from tests.optics.test_varying import seen_wide

BLIND = SceneParameters(None, None, None)
FOCAL = 80 / math.tan(math.radians(22.5))


@pytest.mark.parametrize(("azimuth_deg", "ghost_shift"), [(20.0, 5.3), (100.0, -7.0), (290.0, 5.3)])
def test_the_shift_is_found_with_its_sense(azimuth_deg: float, ghost_shift: float) -> None:
    capture, _, scene = seen_wide(160, FOCAL, azimuth_deg, ghost_shift)
    found = VaryingSpectra(stokes_images(capture, 0.005), scene).likeliest_shift()
    assert found.shows
    assert found.pixels == pytest.approx(ghost_shift, abs=0.4)


@pytest.mark.parametrize("azimuth_deg", [20.0, 290.0])
def test_bounces_in_place_show_no_shift(azimuth_deg: float) -> None:
    capture, _, scene = seen_wide(160, FOCAL, azimuth_deg)
    assert not VaryingSpectra(stokes_images(capture, 0.005), scene).likeliest_shift().shows


def test_blind_the_ghosts_of_a_wide_lens_are_taken_out() -> None:
    capture, layers, scene = seen_wide(160, FOCAL, ghost_shift=6.0)
    result = separate(capture, BLIND, model="perspective")
    assert result.scene.ghost_shift == pytest.approx(6.0, abs=0.4)
    assert "double images" in " ".join(tried.reason for tried in result.tried if tried.taken)
    in_place = separate(capture, scene.replace(ghost_shift=0.0))
    assert psnr_db(result.layers[1], layers[1], 16) > psnr_db(in_place.layers[1], layers[1], 16) + 1


@pytest.mark.parametrize("turn_deg", [-2.5, 2.5])
def test_ghosts_tell_how_steep_a_pane_stands(turn_deg: float) -> None:
    capture, _, scene = seen_wide(160, FOCAL, ghost_shift=6.0)
    incidence = scene.incidence_deg
    spectra = VaryingSpectra(stokes_images(capture, 0.005), scene.replace(incidence_deg=incidence + turn_deg))
    told = spectra.incidence(6.0)
    assert told is not None
    assert abs(told[0] + turn_deg) < 2 * told[1]
    assert told[1] < 2


def test_a_shift_that_is_given_stays() -> None:
    capture, _, _ = seen_wide(128, 150.0, ghost_shift=6.0)
    found = find_scene(capture, BLIND.replace(ghost_shift=5.5), 0.005, "perspective")
    assert (found.scene.rung, found.scene.ghost_shift) == ("perspective", 5.5)


def test_more_bounces_show_in_less_noise_and_where_the_pane_is_seen_more_steeply() -> None:
    near, far = (SceneParameters(55.0, 30.0, 4.0, focal_px=focal) for focal in (100.0, 1e6))
    kept = [bounces_that_show(scene, noise, (80, 80)) for scene, noise in ((near, 0.005), (far, 0.005), (far, 0.0005))]
    assert kept[0] > kept[1]
    assert kept[2] > kept[1]
    assert bounces_that_show(far, 0.005, (80, 80)) == bounces_that_show(far.replace(focal_px=None), 0.005, (80, 80))
    assert bounces_that_show(near.replace(ghost_shift=0.0), 0.005, (80, 80)) == 1
