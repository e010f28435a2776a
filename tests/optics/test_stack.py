"""Windows of several panes, and tinted ones."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from polaropt import PSE, InputError, SceneParameters, simulate
from polaropt.optics.engine import VaryingPSE, engine_for
from polaropt.optics.fresnel import interface
from polaropt.optics.plate import double_images, in_place_reflectance, plate_at
from polaropt.optics.stack import before_in_place, faces, image_weights, passages
from tests.checks import assert_adjoint

ANGLES = (0.0, 45.0, 90.0, 135.0)
RANDOM = np.random.default_rng(1)
WINDOW = SceneParameters(60.0, 30.0, 1.7, n_panes=2, gap_shift=3.4, gap_azimuth_deg=40.0)


def bounced(rho: float, tau: float, z: list[complex], n_bounces: int) -> tuple[complex, complex]:
    """What a row of faces passes and mirrors of a ray from the front, bounce by bounce; once and back is z."""
    n = len(z) + 1
    # Light on its way down to face k, and up to it from behind; what passes a gap once takes the root of z.
    once = np.sqrt(np.array(z, complex))
    down, up = np.zeros(n + 1, complex), np.zeros(n + 1, complex)
    down[0], passed, mirrored = 1, 0j, 0j
    for _ in range(n_bounces):
        lower, upper = np.zeros(n + 1, complex), np.zeros(n + 1, complex)
        for k in range(n):
            below, above = tau * down[k] + rho * up[k], rho * down[k] + tau * up[k]
            if k == n - 1:
                passed += below
            else:
                lower[k + 1] += once[k] * below
            if k == 0:
                mirrored += above
            else:
                upper[k - 1] += once[k - 1] * above
        down, up = lower, upper
    return passed / np.prod(once), mirrored


@pytest.mark.parametrize("n_panes", [1, 2, 3])
@pytest.mark.parametrize("incidence_deg", [10.0, 60.0, 75.0])
def test_the_star_product_equals_bounce_by_bounce(n_panes: int, incidence_deg: float) -> None:
    pane, gap = 0.9 * np.exp(-0.7j), np.exp(-0.4j)
    reflection, transmission = interface(incidence_deg, 1.5)
    steps = passages(2 * n_panes, pane, gap)
    for rho, tau in zip(reflection, transmission, strict=True):
        system = faces(rho, tau, steps)
        expected = bounced(rho, tau, steps, 400)
        np.testing.assert_allclose([system.passed, system.mirrored], expected, atol=1e-12)


@pytest.mark.parametrize("n_panes", [1, 2, 3, 5])
@pytest.mark.parametrize("incidence_deg", [0.0, 45.0, 56.7, 85.0, 89.9])
def test_clear_panes_in_place_reflect_as_stokes_found(n_panes: int, incidence_deg: float) -> None:
    rho = np.array(interface(incidence_deg, 1.52).reflection[:2])
    found = in_place_reflectance(incidence_deg, 1.52, False, n_panes)
    np.testing.assert_allclose(found, 2 * n_panes * rho / (1 + (2 * n_panes - 1) * rho), atol=1e-12)


@given(
    incidence_deg=st.floats(0, 89.5),
    n_panes=st.integers(1, 3),
    shifts=st.tuples(st.floats(-5, 5), st.floats(-5, 5)),
    direction_deg=st.one_of(st.none(), st.floats(-180, 180)),
    n_ghosts=st.sampled_from([None, 0, 5]),
)
def test_clear_panes_keep_all_light(
    incidence_deg: float,
    n_panes: int,
    shifts: tuple[float, float],
    direction_deg: float | None,
    n_ghosts: int | None,
) -> None:
    scene = SceneParameters(
        incidence_deg, 20.0, shifts[0], n_panes=n_panes, gap_shift=shifts[1], gap_azimuth_deg=direction_deg
    )
    images = double_images(scene, n_ghosts)
    np.testing.assert_allclose(images.weights.sum(axis=(0, 1))[:2], 1, atol=1e-9)
    assert images.places[0] == (0, 0)


@pytest.mark.parametrize("absorption", [0.0, 0.4])
@pytest.mark.parametrize("n_panes", [1, 2, 3])
def test_images_in_space_are_the_response_per_frequency(n_panes: int, absorption: float) -> None:
    scene = WINDOW.replace(n_panes=n_panes, absorption=absorption)
    images = double_images(scene, None)
    k_x, k_y = 0.7, -0.3
    places = np.array(images.places)
    phases = np.exp(-1j * (places @ [k_x, k_y]))
    azimuth, gap = (math.radians(angle) for angle in (30.0, 40.0))
    z = np.exp(-1.7j * (k_x * math.cos(azimuth) - k_y * math.sin(azimuth)))
    z_gap = np.exp(-3.4j * (k_x * math.cos(gap) - k_y * math.sin(gap)))
    expected = plate_at(60.0, scene).at(z, z_gap)
    signs = [np.ones(3), np.array([1, 1, -1])]
    for found, exact, sign in zip(np.einsum("lke,k->le", images.weights, phases), expected, signs, strict=True):
        np.testing.assert_allclose(found * sign, exact, atol=1e-6)


def test_a_window_of_one_pane_is_the_pane() -> None:
    reflection, transmission = (np.array(entries) for entries in interface(60.0, 1.5))
    weights = image_weights(reflection, transmission, 2, 1.0)
    expected = plate_at(60.0, SceneParameters(60.0, 0.0, 2.0)).weights(weights.shape[1] - 1)
    np.testing.assert_allclose(weights[:, :, 0], expected, atol=1e-14)
    np.testing.assert_allclose(weights[:, :, 1:], 0, atol=1e-14)


@given(
    height=st.integers(1, 12),
    width=st.integers(1, 12),
    shifts=st.tuples(st.floats(-8, 8), st.floats(-8, 8)),
    direction_deg=st.one_of(st.none(), st.floats(-180, 180)),
    options=st.sampled_from([{}, {"n_panes": 3}, {"absorption": 0.5}, {"transmission_ghost_shift": 1.3}]),
)
def test_the_adjoint_is_the_transpose(
    height: int, width: int, shifts: tuple[float, float], direction_deg: float | None, options: dict[str, Any]
) -> None:
    scene = WINDOW.replace(ghost_shift=shifts[0], gap_shift=shifts[1], gap_azimuth_deg=direction_deg, **options)
    pse = PSE(scene, (0, 50, 100))
    assert_adjoint(pse.forward, pse.adjoint, (2, height, width))


@pytest.mark.parametrize("ghosts", [False, True])
def test_before_a_wide_lens_each_pixel_has_its_own_window(ghosts: bool) -> None:
    scene = WINDOW.replace(focal_px=40.0)
    if not ghosts:
        scene = scene.replace(ghost_shift=0.0, gap_shift=0.0)
    pse = VaryingPSE(scene, ANGLES)
    assert_adjoint(pse.forward, pse.adjoint, (2, 9, 12))
    far = scene.replace(focal_px=1e9)
    layers = RANDOM.random((2, 9, 12))
    expected = PSE(far.replace(focal_px=None), ANGLES, n_ghosts=30).forward(layers)
    np.testing.assert_allclose(VaryingPSE(far, ANGLES, n_ghosts=30).forward(layers), expected, atol=1e-5)
    if not ghosts:
        mixture = pse.mixtures(9, 12)[:, :, 4, 6]
        assert mixture[0].sum() == pytest.approx(1, abs=1e-6)


def test_two_panes_in_place_look_like_one_at_a_steeper_angle() -> None:
    two, one = (np.array(in_place_reflectance(45.0, 1.52, False, n)) for n in (2, 1))
    steeper = np.array(in_place_reflectance(56.9, 1.52, False))
    assert abs(two - steeper).max() < 0.045 < abs(two - one).max()


def test_tint_dims_the_ghosts_and_not_the_direct_light() -> None:
    def ratio(absorption: float) -> float:
        weights = double_images(SceneParameters(45.0, 0.0, 3.0, 1.52, absorption=absorption)).weights
        return float(weights[1, 1, 1] / weights[1, 0, 1])

    assert [ratio(-math.log(share)) for share in (1.0, 0.5)] == pytest.approx([0.82, 0.205], abs=0.02)


def test_the_transmission_is_what_is_seen_through_the_tint() -> None:
    tinted = SceneParameters(45.0, 0.0, 0.0, n_panes=2, absorption=0.4)
    layers = np.stack([np.full((16, 16), 0.5), np.zeros((16, 16))])
    taken = simulate(*layers, tinted, noise=0.0).intensities
    seen = PSE(tinted, ANGLES).forward(layers * math.exp(-0.8))
    np.testing.assert_allclose(taken, seen, atol=1e-6)


def test_fewer_images_are_kept_in_more_noise() -> None:
    few, many = (engine_for(WINDOW, ANGLES, noise, (64, 64)) for noise in (0.02, 0.001))
    assert isinstance(few, PSE)
    assert isinstance(many, PSE)
    assert 2 < len(few.displacements) < len(many.displacements) < 60


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"n_panes": 0}, "n_panes"),
        ({"n_panes": 2.5}, "n_panes"),
        ({"n_panes": 99}, "n_panes"),
        ({"absorption": -0.1}, "absorption"),
        ({"absorption": math.inf}, "absorption"),
        ({"gap_shift": math.nan}, "gap_shift"),
        ({"gap_shift": 1e9}, "gap_shift"),
        ({"gap_azimuth_deg": math.inf}, "gap_azimuth_deg"),
        ({"n_panes": 2, "n_bounces": 3}, "single pane"),
        ({"n_panes": 2, "single_surface": True}, "single surface"),
    ],
)
def test_a_window_outside_its_range_is_refused(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=message):
        SceneParameters(**changes)


def test_what_is_to_be_found_is_one_clear_pane_at_first() -> None:
    asked = SceneParameters(60.0, 0.0, 2.0, n_panes=None, gap_shift=None, absorption=None)
    assert not asked.complete
    assert asked.plainest == SceneParameters(60.0, 0.0, 2.0)
    assert asked.plainest.complete


@pytest.mark.parametrize("absorption", [0.0, 0.4])
@pytest.mark.parametrize("incidence_deg", [10.0, 60.0, 85.0, 89.9])
def test_in_place_the_star_product_is_the_same(incidence_deg: float, absorption: float) -> None:
    rho, tau = (np.array(entries)[:2] for entries in interface(incidence_deg, 1.5))
    steps = passages(6, math.exp(-2 * absorption), 1.0)
    found, expected = faces(rho, tau, steps, before_in_place), faces(rho, tau, steps)
    np.testing.assert_allclose(found, expected, rtol=1e-9)


@pytest.mark.parametrize(("incidence_deg", "side"), [(10.0, 16), (60.0, 32), (88.0, 256)])
def test_as_many_images_are_looked_at_as_carry_light(incidence_deg: float, side: int) -> None:
    rho, tau = (np.array(entries) for entries in interface(incidence_deg, 1.5))
    found = image_weights(rho, tau, 4, 1.0)
    assert found.shape[1:3] == (side, side)
    assert image_weights(rho, tau, 4, 1.0, side=16).shape[1:3] == (16, 16)
    if side < 256:
        far = image_weights(rho, tau, 4, 1.0, side=128)
        np.testing.assert_allclose(found, far[:, :side, :side], atol=1e-9)
