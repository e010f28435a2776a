"""What no two layers make behind a pane with ghosts: noise alone where the pane is the true one, whatever they show."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as some

from polaropt import SceneParameters
from polaropt.capture import StokesImages, stokes_images
from polaropt.estimation.polarized import light
from polaropt.estimation.polarized.cross_relation import CrossRelation
from polaropt.estimation.polarized.light import INCIDENCE, SHIFT, Candidate, coordinates_of
from polaropt.estimation.polarized.search import fit_polarized
from polaropt.simulation import Camera, photograph_pair
from studies.photographs import pairs_of
from tests.points import point_of

BLIND = SceneParameters(None, None, None)
NOISE = 0.003
BOTH = SceneParameters(
    74.0, 25.0, 6.3, transmission_polarization=(0.5, 140.0), reflection_polarization=(0.6, 70.0)
)  # fmt: skip


@cache
def stokes_of(scene: SceneParameters, size: int = 160, alike: bool = False) -> StokesImages:
    photographs = pairs_of(None, size)[0]
    layers = photographs.transmission, photographs.transmission if alike else photographs.reflection
    capture = photograph_pair(*layers, scene, Camera(noise=NOISE), margin=photographs.margin)
    return stokes_images(capture, NOISE)


def tolerance(n: float) -> float:
    """Four standard errors of the mean square of so many normal numbers."""
    return 4 * math.sqrt(2 / n)


@settings(max_examples=8, deadline=None)
@given(
    incidence=some.floats(35.0, 78.0),
    azimuth=some.floats(0.0, 180.0),
    shift=some.floats(2.0, 12.0),
    degrees=some.tuples(some.floats(0.0, 0.9), some.floats(0.0, 0.9)),
)
def test_the_true_pane_leaves_nothing_but_noise(
    incidence: float, azimuth: float, shift: float, degrees: tuple[float, float]
) -> None:
    behind, mirrored = zip(degrees, (140.0, 95.0), strict=True)
    scene = SceneParameters(
        incidence, azimuth, shift, transmission_polarization=behind, reflection_polarization=mirrored
    )  # fmt: skip
    left, n = CrossRelation(stokes_of(scene), BLIND).left(point_of(scene))
    assert left == pytest.approx(1.0, abs=tolerance(n))


def test_nothing_is_assumed_of_the_layers_which_may_be_the_same() -> None:
    left, n = CrossRelation(stokes_of(BOTH, alike=True), BLIND).left(point_of(BOTH))
    assert left == pytest.approx(1.0, abs=tolerance(n))


@pytest.mark.parametrize("off_deg", [-2.0, -1.0, 1.0, 2.0])
def test_other_incidences_that_show_the_same_in_place_leave_light(off_deg: float) -> None:
    true = point_of(BOTH)
    coordinates = coordinates_of(true, BLIND)
    coordinates[INCIDENCE] += off_deg
    other = light.point_of(coordinates, Candidate(true, True, True), BLIND)
    relation = CrossRelation(stokes_of(BOTH), BLIND)
    # Twenty in log likelihood: more than six standard errors.
    assert relation.misfit(other) > relation.misfit(true) + 20


def test_ghosts_on_the_other_side_leave_light() -> None:
    true, relation = point_of(BOTH), CrossRelation(stokes_of(BOTH), BLIND)
    other = true.copy()
    other[SHIFT] *= -1
    assert relation.left(other)[0] > 2 * relation.left(true)[0]


def test_pixels_that_were_not_measured_count_nowhere_that_their_ghosts_come_to() -> None:
    stokes = stokes_of(BOTH)
    images, valid = np.array(stokes.images), stokes.valid.copy()
    images[..., 60:70, 50:75] += 0.2
    valid[..., 60:70, 50:75] = False
    true = point_of(BOTH)
    spoilt = CrossRelation(replace(stokes, images=images), BLIND).left(true)
    left, n = CrossRelation(replace(stokes, images=images, valid=valid), BLIND).left(true)
    assert n < spoilt[1]
    assert left == pytest.approx(1.0, abs=tolerance(n))
    assert spoilt[0] > left + tolerance(n)


@pytest.mark.parametrize("shift", [40.0, -60.0, 500.0])
def test_ghosts_too_far_for_the_frame_say_nothing(shift: float) -> None:
    point = point_of(BOTH)
    point[SHIFT] = shift
    relation = CrossRelation(stokes_of(BOTH), BLIND)
    assert relation.left(point) == (1.0, 0.0)
    assert relation.misfit(point) == 0.0


def test_a_frame_of_few_pixels_says_nothing() -> None:
    stokes = stokes_of(BOTH)
    few = replace(stokes, images=np.array(stokes.images)[..., :12, :12], valid=stokes.valid[..., :12, :12])
    assert CrossRelation(few, BLIND).left(point_of(BOTH)) == (1.0, 0.0)


def test_strong_ghosts_tell_the_incidence_where_both_layers_are_polarized() -> None:
    # By tiles and coarse light alone, which have to guess what the layers look like, it was 0.7 degrees off.
    fit = fit_polarized(stokes_of(BOTH, 192), BLIND, BOTH)
    assert fit is not None
    assert fit.scene.incidence_deg == pytest.approx(74.0, abs=0.4)
