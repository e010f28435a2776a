"""The second look at the incidence where ghosts are strong."""

from __future__ import annotations

import numpy as np
import pytest

from polaropt.capture.polarization import plate_frame, stokes_images
from polaropt.estimation.flat.estimate import estimate_scene
from polaropt.estimation.flat.ghost_overlap import coarse_overlap, refined_incidence
from polaropt.optics.scene import ghost_step
from tests.blends import blend


@pytest.mark.parametrize("off_deg", [-1.0, 1.0])
@pytest.mark.parametrize("incidence_deg", [70, 80])
def test_an_incidence_that_is_a_little_off_is_put_right(incidence_deg, off_deg):
    example = blend(incidence_deg, 160, ghost_shift=8.0)
    frame = plate_frame(stokes_images(example.capture, 0.005), example.scene.azimuth_deg)
    found, _ = refined_incidence(frame, example.scene.replace(incidence_deg=incidence_deg + off_deg))
    assert abs(found - incidence_deg) < 0.6


def test_layers_without_common_edges_overlap_least():
    layers = np.zeros((2, 64, 64), dtype=np.float32)
    layers[0, :, 20:] = 1
    layers[1, 40:, :] = 1
    apart = coarse_overlap(layers)
    layers[1] = layers[0]
    assert apart < 0.2
    assert coarse_overlap(layers) == pytest.approx(1)


def test_a_thickness_still_ties_the_shift():
    example = blend(72, 160, ghost_shift=ghost_step(72, 1.5, 6.0))
    scene = estimate_scene(example.capture, thickness_px=6.0).scene
    assert abs(scene.ghost_shift) == pytest.approx(ghost_step(scene.incidence_deg, 1.5, 6.0))


def test_a_given_incidence_is_left_alone():
    example = blend(75, 96)
    scene = example.scene.replace(ghost_shift=None)
    assert estimate_scene(example.capture, scene).scene.incidence_deg == 75
