"""A ghost shift of its own for each layer: found where the capture tells it, and only there."""

from __future__ import annotations

import pytest

from polaropt import SceneParameters, separate
from polaropt.estimation.flat.estimate import estimate_scene
from polaropt.simulation.metrics import psnr_db
from tests.blends import blend


@pytest.mark.parametrize(("incidence_deg", "own"), [(65.0, 3.0), (75.0, 9.0)])
def test_near_and_far_scenes_are_told_apart(incidence_deg: float, own: float) -> None:
    example = blend(incidence_deg, 160, ghost_shift=6.0, transmission_ghost_shift=own)
    found = estimate_scene(example.capture).scene
    assert found.incidence_deg == pytest.approx(incidence_deg, abs=1)
    assert found.ghost_shift == pytest.approx(6, abs=0.3)
    assert found.transmission_ghost_shift == pytest.approx(own, abs=0.5)


@pytest.mark.parametrize(("incidence_deg", "ghost_shift"), [(60.0, 0.0), (70.0, 6.0), (80.0, 6.0)])
def test_layers_at_one_distance_share_their_shift(incidence_deg: float, ghost_shift: float) -> None:
    example = blend(incidence_deg, 160, ghost_shift=ghost_shift)
    assert estimate_scene(example.capture).scene.transmission_ghost_shift is None


def test_faint_ghosts_of_the_transmission_tell_nothing() -> None:
    example = blend(40, 160, ghost_shift=6.0, transmission_ghost_shift=3.0)
    assert estimate_scene(example.capture).scene.transmission_ghost_shift is None


def test_a_shift_that_was_given_holds_for_both() -> None:
    example = blend(70, 160, ghost_shift=6.0, transmission_ghost_shift=3.0)
    found = estimate_scene(example.capture, SceneParameters(None, None, 6.0)).scene
    assert (found.ghost_shift, found.transmission_ghost_shift) == (6, None)


def test_both_layers_gain() -> None:
    example = blend(75, 160, ghost_shift=7.0, transmission_ghost_shift=3.0)
    own = separate(example.capture, example.scene)
    shared = separate(example.capture, example.scene.replace(transmission_ghost_shift=None))
    for i, least in ((0, 0.3), (1, 2.0)):
        quality = [psnr_db(result.layers[i], example.layers[i], 16) for result in (own, shared)]
        assert quality[0] > quality[1] + least
