"""The pane's series of ghosts."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from polaropt.optics.fresnel import interface, interface_images
from polaropt.optics.plate import (
    Plate,
    _interpolated,
    ghost_sum,
    ghost_weights,
    ghosts_that_matter,
    ghosts_until,
    images_that_show,
    in_place_correction,
    in_place_reflectance,
    plate_at,
)
from polaropt.optics.scene import SceneParameters

GRID = [(n, incidence) for n in (1.0, 1.33, 1.5) for incidence in (0.0, 20.0, 56.0, 70.0, 85.0, 89.9)]


def scene(incidence_deg: float, index: float = 1.5, **changes: object) -> SceneParameters:
    return SceneParameters(incidence_deg, 0.0, 2.0, index).replace(**changes)


@pytest.mark.parametrize("single_surface", [False, True])
@pytest.mark.parametrize("n_ghosts", [None, 0, 3])
@pytest.mark.parametrize(("index", "incidence_deg"), GRID)
def test_a_lossless_pane_keeps_all_light(
    index: float, incidence_deg: float, n_ghosts: int | None, single_surface: bool
) -> None:
    weights = ghost_weights(scene(incidence_deg, index, single_surface=single_surface), n_ghosts)
    np.testing.assert_allclose(weights.sum(axis=(0, 1))[:2], 1, atol=1e-12)


@pytest.mark.parametrize(("index", "incidence_deg"), GRID[:-1])
def test_all_bounces_equal_two_hundred(index: float, incidence_deg: float) -> None:
    everything = ghost_weights(scene(incidence_deg, index))
    many = ghost_weights(scene(incidence_deg, index, n_bounces=200))
    z = 0.9 * np.exp(0.7j)
    filtered, expected = (np.einsum("lke,k->le", w, z ** np.arange(w.shape[1])) for w in (everything, many))
    np.testing.assert_allclose(filtered, expected, atol=2e-11 if incidence_deg < 89 else 1e-2)


@pytest.mark.parametrize(("index", "incidence_deg"), GRID)
def test_weights_follow_the_closed_form(index: float, incidence_deg: float) -> None:
    rho, tau = (np.array(entries) for entries in interface(incidence_deg, index))
    weights = ghost_weights(scene(incidence_deg, index))
    z = 0.8 * np.exp(-0.4j)
    transmitted, reflected = np.einsum("lke,k->le", weights, z ** np.arange(weights.shape[1]))
    np.testing.assert_allclose(transmitted, tau**2 / (1 - rho**2 * z), atol=1e-11)
    sign = np.array([1, 1, -1])
    np.testing.assert_allclose(reflected, sign * (rho + tau**2 * rho * z / (1 - rho**2 * z)), atol=1e-11)


@pytest.mark.parametrize(("index", "incidence_deg"), GRID)
@pytest.mark.parametrize("single_surface", [False, True])
def test_bounces_in_place_sum_to_the_reflectance_of_the_pane(
    index: float, incidence_deg: float, single_surface: bool
) -> None:
    weights = ghost_weights(scene(incidence_deg, index, ghost_shift=0.0, single_surface=single_surface))
    assert weights.shape == (2, 1, 3)
    reflectance = in_place_reflectance(incidence_deg, index, single_surface)
    np.testing.assert_allclose(weights[1, 0, :2], reflectance, atol=1e-12)
    np.testing.assert_allclose(weights[0, 0, :2], 1 - np.array(reflectance), atol=1e-12)


def test_shift_zero_sums_the_bounces_that_the_scene_has() -> None:
    shifted = ghost_weights(scene(70, n_bounces=3))
    in_place = ghost_weights(scene(70, n_bounces=3, ghost_shift=0.0))
    np.testing.assert_allclose(in_place, shifted.sum(axis=1, keepdims=True))


def test_single_surface_is_one_interface() -> None:
    reflection, transmission = interface(53, 1.33)
    weights = ghost_weights(scene(53, 1.33, single_surface=True))
    np.testing.assert_allclose(weights[0, 0], transmission)
    np.testing.assert_allclose(weights[1, 0], [*reflection[:2], -reflection[2]])


@pytest.mark.parametrize("n_bounces", [0, 1, 10])
def test_a_truncated_series_has_that_many_ghosts(n_bounces: int) -> None:
    rho, tau = (np.array(entries) for entries in interface(65, 1.5))
    weights = ghost_weights(scene(65, n_bounces=n_bounces))
    assert weights.shape == (2, n_bounces + 1, 3)
    for k in range(n_bounces + 1):
        np.testing.assert_allclose(weights[0, k], tau**2 * rho ** (2 * k), atol=1e-15)
        reflected = tau**2 * rho ** (2 * k - 1) if k else rho
        np.testing.assert_allclose(weights[1, k], reflected * [1, 1, -1], atol=1e-15)


@pytest.mark.parametrize("n_bounces", [None, 0, 1, 10])
def test_literal_eq3_moves_the_ghosts_of_the_reflection_one_step_back(n_bounces: int | None) -> None:
    physical = ghost_weights(scene(65, n_bounces=n_bounces))
    literal = ghost_weights(scene(65, n_bounces=n_bounces, literal_eq3=True))
    np.testing.assert_array_equal(literal[0], physical[0])
    np.testing.assert_allclose(literal[1].sum(axis=0), physical[1].sum(axis=0))
    if n_bounces != 0:
        np.testing.assert_allclose(literal[1, 0], physical[1, 0] + physical[1, 1])
        np.testing.assert_allclose(literal[1, 1:-1], physical[1, 2:])


def test_grazing_incidence_needs_more_ghosts() -> None:
    counts = [ghosts_that_matter(scene(incidence_deg), 1e-6) for incidence_deg in (10, 60, 85, 89.9)]
    assert counts == sorted(counts)
    assert ghosts_that_matter(scene(60), 0.04) == 1
    # Weights fall by about half per ghost at 85 deg.
    assert counts[2] == pytest.approx(20, abs=4)


def test_first_ghost_of_the_reflection_rivals_the_direct_light() -> None:
    direct, ghost = ghost_weights(scene(50))[1, :2, :2].sum(axis=1)
    assert 0.7 < ghost / direct < 0.9


PLATES = [{}, {"n_bounces": 0}, {"n_bounces": 3}, {"single_surface": True}, {"literal_eq3": True}]
Z = 0.8 * np.exp(-0.4j)


@pytest.mark.parametrize("changes", PLATES)
@pytest.mark.parametrize(("index", "incidence_deg"), GRID)
def test_the_series_are_the_sum_of_their_ghosts(index: float, incidence_deg: float, changes: dict[str, Any]) -> None:
    plate = plate_at(incidence_deg, scene(incidence_deg, index, **changes))
    weights = plate.weights(2000)
    expected = np.einsum("lke,k->le", weights, Z ** np.arange(weights.shape[1]))
    np.testing.assert_allclose(np.stack(plate.at(Z)), expected, atol=1e-12)
    np.testing.assert_allclose(np.stack(plate.in_place()), weights.sum(axis=1), atol=1e-12)
    np.testing.assert_allclose(np.stack(plate.at(1.0)), np.stack(plate.in_place()), atol=1e-12)


@pytest.mark.parametrize("changes", [{}, {"n_bounces": 0}, {"single_surface": True}])
@pytest.mark.parametrize("incidence_deg", [0.0, 40.0, 70.0, 85.0])
def test_all_forms_of_the_series_agree(incidence_deg: float, changes: dict[str, Any]) -> None:
    plate = plate_at(incidence_deg, scene(incidence_deg, **changes))
    cleared = plate.cleared()
    layers = zip(cleared[:2], plate.series, plate.at(Z), plate.in_place(), strict=True)
    for (a, b), series, expected, in_place in layers:
        np.testing.assert_allclose((a + b * Z) / (1 - cleared.ratio * Z), expected[:2], atol=1e-15)
        np.testing.assert_allclose(series.direct + series.ghost * Z / (1 - series.ratio * Z), expected, atol=1e-15)
        np.testing.assert_allclose(series.in_place, in_place, atol=1e-14)


def test_ghosts_of_a_frequency_are_summed_in_real_arithmetic() -> None:
    phase, ratio = np.linspace(0, 6, 25), 0.4
    z = np.exp(-1j * phase)
    ghosts = ghost_sum(ratio, np.cos(phase), np.sin(phase))
    np.testing.assert_allclose(ghosts.real + 1j * ghosts.imag, z / (1 - ratio * z), atol=1e-15)
    np.testing.assert_allclose(ghosts.squared, np.abs(z / (1 - ratio * z)) ** 2, atol=1e-14)


def test_entries_may_be_those_of_every_pixel() -> None:
    cosine = np.cos(np.radians([[20.0, 50.0], [70.0, 85.0]]))
    plate = Plate(*interface_images(cosine, 1.5))
    for place in np.ndindex(cosine.shape):
        alone = plate_at(float(np.degrees(np.arccos(cosine[place]))), scene(0))
        for images, entries in zip(plate.at(Z), alone.at(Z), strict=True):
            np.testing.assert_allclose(images[:, *place], entries, atol=1e-13)
        np.testing.assert_allclose(plate.weights(4)[..., *place], alone.weights(4), atol=1e-13)


@pytest.mark.parametrize("incidence_deg", [10.0, 45.0, 75.0])
def test_two_plates_in_place_reflect_as_stokes_found(incidence_deg: float) -> None:
    """Systems add as R = R_1 + T_1^2 R_2 / (1 - R_1 R_2), and m clear plates reflect 2 m R / (1 + (2 m - 1) R)."""
    rho = np.array(interface(incidence_deg, 1.5).reflection[:2])
    transmitted, reflected = (part[:2] for part in plate_at(incidence_deg, scene(incidence_deg)).in_place())
    both = reflected + transmitted**2 * reflected / (1 - reflected**2)
    np.testing.assert_allclose(both, 4 * rho / (1 + 3 * rho), atol=1e-15)


def test_grazing_incidence_cancels_nothing() -> None:
    transmitted, reflected = plate_at(89.99999999999999, scene(89.99999999999999)).in_place()
    assert np.isfinite(transmitted).all()
    np.testing.assert_allclose(np.abs(reflected), 1)
    assert (transmitted > 0).all()


@pytest.mark.parametrize("incidence_deg", [0.0, 60.0, 85.0])
def test_of_tinted_glass_ghosts_carry_what_is_left_of_them(incidence_deg: float) -> None:
    rho, tau = (np.array(entries) for entries in interface(incidence_deg, 1.5))
    left = math.exp(-2 * 0.3)
    plate = Plate(rho, tau, passed_twice=left)
    for n_ghosts in (0, 1, 5):
        np.testing.assert_allclose(plate.weights(n_ghosts).sum(axis=1), plate.in_place(), atol=1e-12)
    transmitted, reflected = plate.weights(50)
    for k in (1, 2, 3):
        np.testing.assert_allclose(transmitted[k], tau**2 * rho ** (2 * k) * left**k, atol=1e-15)
        np.testing.assert_allclose(reflected[k], tau**2 * rho ** (2 * k - 1) * left**k, atol=1e-15)
    np.testing.assert_allclose(plate.at(Z), np.einsum("lke,k->le", plate.weights(900), Z ** np.arange(901)), atol=1e-12)
    for series, expected in zip(plate.series, plate.at(Z), strict=True):
        np.testing.assert_allclose(series.direct + series.ghost * Z / (1 - series.ratio * Z), expected, atol=1e-14)


def test_the_series_of_a_surface_that_mirrors_nothing_is_its_direct_light() -> None:
    plate = Plate(np.zeros(3), np.ones(3), single_surface=True)
    for series, direct in zip(plate.series, (1, 0), strict=True):
        np.testing.assert_array_equal(series.direct, direct)
        np.testing.assert_array_equal([series.ghost, series.ratio], 0)


def test_between_the_cosines_of_a_table_weights_are_linear() -> None:
    grid = np.array([0.2, 0.4, 0.6, 0.8])
    table = np.random.default_rng(0).random((2, 5, 3, 4))
    np.testing.assert_allclose(_interpolated(table, grid, grid), table)
    cosine = np.array([[0.25, 0.5], [0.7, 0.78]])
    found = _interpolated(table, cosine, grid)
    for place in np.ndindex(cosine.shape):
        expected = [np.interp(cosine[place], grid, row) for row in table.reshape(-1, 4)]
        np.testing.assert_allclose(found[..., *place].ravel(), expected)


def test_the_correction_is_that_of_the_whole_pane_s_reflectance() -> None:
    brewster = math.degrees(math.atan(1.5))
    # There nothing is mirrored but what is polarized.
    assert in_place_correction(brewster, 1.5, True) == pytest.approx(1)
    assert in_place_correction(brewster, 1.5, False, 3) == pytest.approx(1)
    for tint in (0.0, 0.4):
        par, perp = in_place_reflectance(40.0, 1.5, False, 2, tint)
        assert in_place_correction(40.0, 1.5, False, 2, tint) == pytest.approx((perp + par) / (perp - par))
    assert in_place_reflectance(40.0, 1.5, False, 2, 0.4) < in_place_reflectance(40.0, 1.5, False, 2)


def test_what_mirrors_nothing_has_one_ghost_and_a_mirror_many() -> None:
    assert ghosts_until(0.0) == ghosts_until(-1.0) == ghosts_until(1e-9, 1e-3) == 1
    assert ghosts_until(1.0) == ghosts_until(0.999999) > 50
    # Each ghost carries 1 % of the one before.
    assert ghosts_until(0.1, 0.9e-4) == 3
    assert ghosts_until(0.1, 1.1e-4) == 2


def test_of_two_panes_more_images_show_the_fainter_they_may_be() -> None:
    window = scene(60.0, n_panes=2, gap_shift=3.3)
    counts = [images_that_show(window, share) for share in (0.5, 0.1, 0.01, 0.001)]
    assert counts[0] == 0
    assert counts == sorted(set(counts))
