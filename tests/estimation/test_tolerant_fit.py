"""A pane before a lens is found where part of the scene is polarized itself."""

from __future__ import annotations

import math

import numpy as np
import pytest

from polaropt import SceneParameters, simulate
from polaropt.capture.capture import Capture
from polaropt.capture.polarization import stokes_images
from polaropt.estimation.ladder import find_scene
from polaropt.estimation.wide.blocks import PolarizedBlocks
from polaropt.estimation.wide.fits import fit_tolerant
from polaropt.numerics import turn_between
from tests.blends import blend

# Of one clear pane whose images lie in place.
BLIND = SceneParameters(None, None, 0.0)
SIZE = 192
SCENE = SceneParameters(45.0, 200.0, 0.0, focal_px=SIZE / 2 / math.tan(math.radians(20)))


def capture_with_metal(share: float) -> Capture:
    """A wide view of a pane; behind it a strip of the frame polarizes its light by half, across the pane's plane."""
    example = blend(45, SIZE, ghost_shift=0.0)
    layers = np.moveaxis(example.layers, 1, -1)
    scenes = (SCENE, SCENE.replace(transmission_polarization=(0.5, 70.0)))
    plain, metal = (simulate(layers[0], layers[1], scene, noise=0.005, bits=12, seed=1) for scene in scenes)
    intensities = plain.intensities.copy()
    strip = slice(SIZE // 3, SIZE // 3 + round(share * SIZE))
    intensities[..., strip, :] = metal.intensities[..., strip, :]
    return Capture.of_planes(intensities, plain.angles_deg)


@pytest.mark.parametrize("known", [False, True])
def test_a_polarized_strip_does_not_mislead_it(known: bool) -> None:
    capture = capture_with_metal(0.2)
    found = fit_tolerant(
        stokes_images(capture, 0.005), SceneParameters(40.0, 20.0, 0.0), SCENE.focal_px if known else None
    )
    assert found.explained > 0.8
    assert found.pane.edges_agree
    assert abs(found.pane.incidence_deg - 45) < 2
    assert abs(turn_between(found.pane.azimuth_deg, 200, 360.0)) < 2
    assert found.pane.focal_px == pytest.approx(SCENE.focal_px, rel=0.1)


def test_the_ladder_takes_it_and_says_so() -> None:
    found = find_scene(capture_with_metal(0.2), BLIND, 0.005)
    assert found.scene.rung == "perspective"
    assert abs(found.scene.incidence_deg - 45) < 2
    taken = next(tried for tried in found.tried if tried.taken)
    assert "may be polarized itself" in taken.reason


@pytest.mark.parametrize("light", ["transmission_polarization", "reflection_polarization"])
def test_a_pane_seen_from_far_whose_scene_is_polarized_is_not_taken_for_a_wide_view(light: str) -> None:
    example = blend(55, 128, ghost_shift=0.0, **{light: (0.5, 70.0)})
    found = find_scene(example.capture, BLIND, 0.005)
    assert found.scene.focal_px is None
    assert not found.scene.bent


def test_the_least_constant_misfit_is_that_of_the_best_azimuth() -> None:
    blocks = PolarizedBlocks(stokes_images(capture_with_metal(0.2), 0.005))
    blocks = blocks.trusted(np.linspace(0.1, 1, blocks.places.shape[1]))
    tried = min(blocks.constant_misfit(azimuth) for azimuth in np.arange(0, 180, 0.1))
    assert blocks.least_constant_misfit() == pytest.approx(tried, rel=1e-3)
