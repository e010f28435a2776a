"""The engine against the physics it states and against a slow version of itself, bounce by bounce."""

from __future__ import annotations

from types import ModuleType
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from polaropt import PSE, SceneParameters
from polaropt.optics import engine
from polaropt.optics.fresnel import brewster_angle_deg
from polaropt.optics.stokes import dolp_aolp, stokes_from_intensities
from tests.bounces import SCENES, constantly_polarized, slow_forward
from tests.checks import Array, assert_adjoint

ANGLES = (0.0, 45.0, 90.0, 135.0)
RANDOM = np.random.default_rng(1)


@pytest.mark.parametrize(("scene", "n_ghosts"), SCENES)
@pytest.mark.parametrize("shape", [(5, 6), (2, 7, 4)])
def test_forward_equals_mueller_matrices_bounce_by_bounce(
    scene: SceneParameters, n_ghosts: int, shape: tuple[int, ...]
) -> None:
    layers = RANDOM.random((2, *shape))
    angles_deg = (5.0, 50.0, 110.0)
    expected = slow_forward(constantly_polarized(layers, scene), scene, angles_deg, n_ghosts)
    np.testing.assert_allclose(PSE(scene, angles_deg).forward(layers), expected, atol=1e-12)


@pytest.mark.parametrize(("scene", "n_ghosts"), SCENES)
def test_forward_stokes_equals_mueller_matrices_bounce_by_bounce(scene: SceneParameters, n_ghosts: int) -> None:
    light = RANDOM.standard_normal((2, 3, 2, 5, 6))
    expected = slow_forward(light, scene, ANGLES, n_ghosts)
    np.testing.assert_allclose(PSE(scene, ANGLES).forward_stokes(light), expected, atol=1e-12)


@pytest.mark.parametrize(("scene", "n_ghosts"), SCENES)
def test_forward_stokes_equals_forward_for_constant_polarization(scene: SceneParameters, n_ghosts: int) -> None:
    layers = RANDOM.random((2, 3, 8, 9))
    pse = PSE(scene, ANGLES)
    np.testing.assert_allclose(pse.forward_stokes(constantly_polarized(layers, scene)), pse.forward(layers), atol=1e-13)


@pytest.mark.parametrize("incidence_deg", [20, 60, 80])
def test_all_bounces_equal_two_hundred(incidence_deg: float) -> None:
    layers = RANDOM.random((2, 20, 21))
    scene = SceneParameters(incidence_deg, 70, 1.3, reflection_polarization=(0.3, 60))
    expected = PSE(scene.replace(n_bounces=200), ANGLES).forward(layers)
    np.testing.assert_allclose(PSE(scene, ANGLES).forward(layers), expected, atol=1e-11)


@given(
    height=st.integers(1, 12),
    width=st.integers(1, 12),
    channels=st.sampled_from([(), (3,)]),
    ghost_shift=st.one_of(st.just(0.0), st.floats(-8, 8), st.integers(-4, 4).map(float), st.floats(-400, 400)),
    azimuth_deg=st.one_of(st.sampled_from([0.0, 45.0, 90.0, 180.0, 270.0]), st.floats(-360, 360)),
    incidence_deg=st.floats(0, 89),
    dolp=st.sampled_from([0.0, 0.5]),
    options=st.sampled_from(
        [{}, {"n_bounces": 3}, {"single_surface": True}, {"literal_eq3": True}, {"transmission_ghost_shift": 1.3}]
    ),
)
def test_adjoint_is_the_transpose_of_forward(
    height: int,
    width: int,
    channels: tuple[int, ...],
    ghost_shift: float,
    azimuth_deg: float,
    incidence_deg: float,
    dolp: float,
    options: dict[str, Any],
) -> None:
    scene = SceneParameters(incidence_deg, azimuth_deg, ghost_shift, transmission_polarization=(dolp, 20), **options)
    pse = PSE(scene, (0, 50, 100, 150, 160))
    assert_adjoint(pse.forward, pse.adjoint, (2, *channels, height, width))
    assert_adjoint(pse.entries, pse.entries_adjoint, (2, *channels, height, width))


def test_blocks_of_a_large_image_join_without_seams() -> None:
    pse = PSE(SceneParameters(60, 33, 6.3), ANGLES)
    assert_adjoint(pse.forward, pse.adjoint, (2, 301, 307))
    layers = RANDOM.random((2, 301, 307))
    stacked = np.stack([layers, layers[..., ::-1, :]], axis=1)
    np.testing.assert_array_equal(pse.forward(stacked)[:, 0], pse.forward(layers))
    rows = slice(90, 211)
    np.testing.assert_allclose(
        pse.forward(layers)[:, 150], pse.forward(layers[:, rows])[:, 150 - rows.start], atol=1e-12
    )


def test_numpy_takes_planes_one_by_one_and_other_libraries_all_at_once() -> None:
    rows = range(3, 3 + 2 * engine._BLOCK, engine._BLOCK)
    ends = [(start, min(start + engine._BLOCK, 4 + engine._BLOCK)) for start in rows]
    assert list(engine._blocks(2, 3, 4 + engine._BLOCK, np)) == [(plane, *end) for plane in range(2) for end in ends]
    assert list(engine._blocks(2, 3, 4 + engine._BLOCK, ModuleType("another"))) == [(slice(None), 3, 4 + engine._BLOCK)]


def test_batches_go_through_as_one() -> None:
    layers = RANDOM.random((2, 4, 3, 8, 9))
    pse = PSE(SceneParameters(60, 33, 1.5), ANGLES)
    np.testing.assert_array_equal(pse.forward(layers)[:, 2], pse.forward(layers[:, 2]))
    assert_adjoint(pse.forward, pse.adjoint, layers.shape)


def test_components_add_up_to_the_photographs() -> None:
    layers = RANDOM.random((2, 3, 9, 8))
    pse = PSE(SceneParameters(60, 33, 1.5, reflection_polarization=(0.2, 10)), ANGLES)
    components = pse.components(layers)
    assert components.shape == (2, 4, 3, 9, 8)
    np.testing.assert_allclose(components.sum(axis=0), pse.forward(layers), atol=1e-14)
    np.testing.assert_allclose(components[0], pse.forward(layers * np.array([1, 0])[:, None, None, None]), atol=1e-14)


def stokes_of(layers: Array, scene: SceneParameters) -> Array:
    return np.asarray(stokes_from_intensities(PSE(scene, ANGLES).forward(layers), ANGLES))


def only(layer: int) -> Array:
    layers = np.zeros((2, 6, 6))
    layers[layer] = 1
    return layers


def test_level_water_reflects_horizontally_polarized_light() -> None:
    dolp, aolp = dolp_aolp(stokes_of(only(1), SceneParameters(50, 90, 0, 1.33, single_surface=True)))
    assert dolp.min() > 0.9
    np.testing.assert_allclose((aolp + 90) % 180, 90, atol=1e-9)


def test_water_at_brewster_polarizes_completely_and_a_vertical_polarizer_removes_the_reflection() -> None:
    scene = SceneParameters(brewster_angle_deg(1.33), 90, 0, 1.33, single_surface=True)
    dolp, _ = dolp_aolp(stokes_of(only(1), scene))
    np.testing.assert_allclose(dolp, 1)
    np.testing.assert_allclose(PSE(scene, [90]).forward(only(1)), 0, atol=1e-15)


def test_transmitted_light_is_polarized_across_the_reflected() -> None:
    scene = SceneParameters(60, 25, 0)
    _, reflected = dolp_aolp(stokes_of(only(1), scene))
    _, transmitted = dolp_aolp(stokes_of(only(0), scene))
    np.testing.assert_allclose(transmitted, 25)
    np.testing.assert_allclose(reflected, 115)


@pytest.mark.parametrize("n_ghosts", [None, 0, 1])
@pytest.mark.parametrize("options", [{}, {"single_surface": True}, {"ghost_shift": 0.0}, {"literal_eq3": True}])
def test_two_white_scenes_give_unpolarized_white(options: dict[str, Any], n_ghosts: int | None) -> None:
    scene = SceneParameters(65, 33, 2.2).replace(**options)
    np.testing.assert_allclose(PSE(scene, ANGLES, n_ghosts).forward(np.ones((2, 6, 6))), 0.5, atol=1e-11)


@pytest.mark.parametrize("options", [{}, {"single_surface": True}, {"ghost_shift": 0.0}])
def test_at_normal_incidence_nothing_depends_on_the_azimuth(options: dict[str, Any]) -> None:
    light = RANDOM.standard_normal((2, 3, 6, 6))
    scene = SceneParameters(0, 0, 0.0).replace(**options)
    expected = PSE(scene, ANGLES).forward_stokes(light)
    for azimuth_deg in (30, 90, 200):
        found = PSE(scene.replace(azimuth_deg=azimuth_deg), ANGLES).forward_stokes(light)
        np.testing.assert_allclose(found, expected, atol=1e-14)


@pytest.mark.parametrize("azimuth_deg", [0, 37, 90])
def test_a_mirror_image_keeps_its_polarization_at_normal_incidence(azimuth_deg: float) -> None:
    scene = SceneParameters(0, azimuth_deg, 0.0, reflection_polarization=(0.6, 25))
    dolp, aolp = dolp_aolp(stokes_of(only(1), scene))
    np.testing.assert_allclose(dolp, 0.6)
    np.testing.assert_allclose(aolp, 25)


def test_adding_half_a_turn_flips_the_ghosts() -> None:
    layers = RANDOM.random((2, 9, 10))
    there = PSE(SceneParameters(60, 30, 2.5), ANGLES).forward(layers)
    np.testing.assert_allclose(PSE(SceneParameters(60, 210, -2.5), ANGLES).forward(layers), there, atol=1e-13)
    assert np.abs(PSE(SceneParameters(60, 210, 2.5), ANGLES).forward(layers) - there).max() > 1e-2


@pytest.mark.parametrize(("azimuth_deg", "place"), [(0, (10, 13)), (90, (7, 10)), (180, (10, 7)), (270, (13, 10))])
def test_ghosts_lie_along_the_azimuth_with_y_up(azimuth_deg: float, place: tuple[int, int]) -> None:
    layers = np.zeros((2, 21, 21))
    layers[1, 10, 10] = 1
    photographs = PSE(SceneParameters(50, azimuth_deg, 3.0), ANGLES).forward(layers).sum(axis=0)
    ghosts = {(10, 13), (7, 10), (10, 7), (13, 10)}
    assert photographs[place] > 0.7 * photographs[10, 10]
    assert all(photographs[other] < 1e-12 for other in ghosts - {place})


def test_literal_eq3_puts_the_first_ghost_on_the_direct_reflection() -> None:
    layers = np.zeros((2, 5, 21))
    layers[1, 2, 5] = 1
    scene = SceneParameters(50, 0, 3.0, n_bounces=10)
    physical, literal = (
        PSE(which, ANGLES).forward(layers).sum(axis=0) for which in (scene, scene.replace(literal_eq3=True))
    )
    assert literal[2, 5] == pytest.approx(physical[2, 5] + physical[2, 8])
    assert literal[2, 8] == pytest.approx(physical[2, 11])


def test_edges_go_on_beyond_the_frame() -> None:
    layers = np.broadcast_to(np.array([0.3, 0.8])[:, None, None], (2, 7, 8))
    for ghost_shift in (0.0, 3.3, -50.0):
        photographs = PSE(SceneParameters(60, 20, ghost_shift), ANGLES).forward(layers)
        np.testing.assert_allclose(photographs, photographs[:, :1, :1] * np.ones((7, 8)), atol=1e-13)


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_dtypes_are_kept(dtype: type) -> None:
    pse = PSE(SceneParameters(60, 33, 6.3, reflection_polarization=(0.1, 0)), ANGLES)
    layers = RANDOM.random((2, 3, 24, 31)).astype(dtype)
    photographs = pse.forward(layers)
    stokes = pse.forward_stokes(np.repeat(layers[:, None], 3, axis=1))
    assert [x.dtype for x in (photographs, stokes, pse.adjoint(photographs), pse.components(layers))] == [dtype] * 4
    np.testing.assert_allclose(photographs, pse.forward(layers.astype(np.float64)), atol=2e-7)


def test_float32_keeps_every_ghost_that_it_can_tell_from_nothing() -> None:
    layers = RANDOM.random((2, 64, 65)).astype(np.float32)
    pse = PSE(SceneParameters(85, 33, 3.3), ANGLES)
    np.testing.assert_allclose(pse.forward(layers), pse.forward(layers.astype(np.float64)), atol=4e-7)


def test_whole_numbers_are_not_rounded_on_the_way() -> None:
    layers = RANDOM.integers(0, 255, (2, 8, 9), dtype=np.uint8)
    pse = PSE(SceneParameters(60, 33, 1.3), ANGLES)
    photographs = pse.forward(layers)
    assert photographs.dtype == np.float32
    np.testing.assert_allclose(photographs, pse.forward(layers.astype(np.float64)), rtol=1e-5)
    assert pse.adjoint(RANDOM.integers(0, 255, (4, 8, 9))).dtype == np.float32


@pytest.mark.parametrize("incidence_deg", [0.0, 89.9, 89.99999999999999])
@pytest.mark.parametrize("index", [1.0, 1.5])
@pytest.mark.parametrize("options", [{}, {"n_bounces": 0}, {"single_surface": True}, {"ghost_shift": 0.0}])
def test_limiting_scenes_stay_finite(incidence_deg: float, index: float, options: dict[str, Any]) -> None:
    pse = PSE(SceneParameters(incidence_deg, 10, 1.2, index).replace(**options), ANGLES)
    photographs = pse.forward(RANDOM.random((2, 6, 7)))
    assert np.all(np.isfinite(photographs))
    assert np.all(np.isfinite(pse.adjoint(photographs)))


def test_no_glass_shows_the_transmission_alone() -> None:
    layers = RANDOM.random((2, 6, 7))
    photographs = PSE(SceneParameters(70, 10, 1.2, refractive_index=1.0), ANGLES).forward(layers)
    np.testing.assert_allclose(photographs, np.broadcast_to(layers[0] / 2, (4, 6, 7)), atol=1e-13)


def test_inputs_are_left_as_they_are() -> None:
    layers = RANDOM.random((2, 6, 7))
    photographs = RANDOM.random((4, 6, 7))
    copies = layers.copy(), photographs.copy()
    for ghost_shift in (0.0, 2.5):
        pse = PSE(SceneParameters(60, 10, ghost_shift), ANGLES)
        pse.forward(layers), pse.adjoint(photographs)
    np.testing.assert_array_equal(layers, copies[0])
    np.testing.assert_array_equal(photographs, copies[1])


@pytest.mark.parametrize("shape", [(3, 8, 9), (2, 8), (4, 3, 8, 9)])
def test_layers_of_another_shape_are_refused(shape: tuple[int, ...]) -> None:
    pse = PSE(SceneParameters(), (0, 45, 90))
    for function in (pse.forward, pse.components, pse.forward_stokes):
        with pytest.raises(ValueError, match="expected"):
            function(np.zeros(shape))
    with pytest.raises(ValueError, match=r"expected \(3,"):
        pse.adjoint(np.zeros((4, 8, 9)))


@pytest.mark.parametrize(("incidence_deg", "most"), [(60.0, 100), (89.5, 20), (89.9999999, 1)])
def test_images_that_a_frame_does_not_tell_apart_are_one(incidence_deg, most):
    engine = PSE(SceneParameters(incidence_deg, 30.0, 3.0), (0.0, 45.0, 90.0, 135.0))
    places, weights = engine.distinct_images(24, 30)
    assert len(places) == weights.shape[1] <= min(most, len(engine.displacements))
    np.testing.assert_allclose(weights.sum(axis=1), engine.taps.sum(axis=1), atol=1e-7)
