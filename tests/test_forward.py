"""The engine against the physics it states and against a slow version of itself, bounce by bounce."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from polaropt import PSE, SceneParameters
from polaropt.fresnel import brewster_angle_deg
from polaropt.stokes import analyzer_matrix, dolp_aolp, stokes_from_intensities, stokes_vector
from tests.checks import Array, assert_adjoint
from tests.test_shift import slow_shift

ANGLES = (0.0, 45.0, 90.0, 135.0)
RANDOM = np.random.default_rng(1)


def rotation(azimuth_deg: float) -> Array:
    """Eq. (2): Stokes vectors of the plate's frame to those of the camera's."""
    double = math.radians(2 * azimuth_deg)
    cos, sin = math.cos(double), math.sin(double)
    return np.array([[1, 0, 0], [0, cos, -sin], [0, sin, cos]])


def mueller(parallel: float, perpendicular: float, third: float) -> Array:
    """Linear part of the Mueller matrix of an interface, basis (s0, s1', s2')."""
    mean, half = (parallel + perpendicular) / 2, (parallel - perpendicular) / 2
    return np.array([[mean, half, 0], [half, mean, 0], [0, 0, third]])


def interface_matrices(incidence: float, before: float, after: float) -> tuple[Array, Array]:
    """Mueller matrices of reflection and transmission between two media."""
    refracted = math.asin(before * math.sin(incidence) / after)
    cos_i, cos_t = math.cos(incidence), math.cos(refracted)
    r_s = (before * cos_i - after * cos_t) / (before * cos_i + after * cos_t)
    r_p = (after * cos_i - before * cos_t) / (after * cos_i + before * cos_t)
    t_s, t_p = 1 + r_s, (1 + r_p) * before / after
    flux = after * cos_t / (before * cos_i)
    return mueller(r_p**2, r_s**2, r_p * r_s), flux * mueller(t_p**2, t_s**2, t_p * t_s)


def shift_stokes(stokes: Array, dx: float, dy: float) -> Array:
    flat = stokes.reshape(-1, *stokes.shape[-2:])
    return np.stack([slow_shift(plane, dx, dy) for plane in flat]).reshape(stokes.shape)


def slow_forward(layers: Array, scene: SceneParameters, angles_deg: tuple[float, ...], n_ghosts: int) -> Array:
    """Eqs. (3)-(5) on Stokes images (2, 3, ..., h, w), one ray after the other."""
    incidence_deg, azimuth_deg, ghost_shift = scene.values()
    outside, n = math.radians(incidence_deg), scene.refractive_index
    inside = math.asin(math.sin(outside) / n)
    r1, t1 = interface_matrices(outside, 1.0, n)
    r2, t2 = interface_matrices(inside, n, 1.0)
    direction = math.cos(math.radians(azimuth_deg)), -math.sin(math.radians(azimuth_deg))
    ideal_mirror = np.diag([1.0, 1.0, -1.0])

    def through(matrix: Array, stokes: Array) -> Array:
        return np.tensordot(matrix, stokes, axes=1)

    def displaced(stokes: Array, k: int, step: float = ghost_shift) -> Array:
        return shift_stokes(stokes, k * step * direction[0], k * step * direction[1])

    own = ghost_shift if scene.transmission_ghost_shift is None else scene.transmission_ghost_shift

    local = [through(rotation(-azimuth_deg), layer) for layer in layers]
    local[1] = through(ideal_mirror, local[1])
    seen = through(r1, local[1])
    if scene.single_surface:
        return through(analyzer_matrix(angles_deg) @ rotation(azimuth_deg), seen + through(t1, local[0]))
    ray = through(t1, local[0])
    for k in range(n_ghosts + 1):
        seen = seen + displaced(through(t2, ray), k, own)
        ray = through(r2, through(r2, ray))
    ray = through(r2, through(t1, local[1]))
    for k in range(1, n_ghosts + 1):
        seen = seen + displaced(through(t2, ray), k - 1 if scene.literal_eq3 else k)
        ray = through(r2, through(r2, ray))
    return through(analyzer_matrix(angles_deg) @ rotation(azimuth_deg), seen)


def constantly_polarized(layers: Array, scene: SceneParameters) -> Array:
    light = [stokes_vector(*scene.transmission_polarization), stokes_vector(*scene.reflection_polarization)]
    return np.stack([np.multiply.outer(light[i], layers[i]) for i in (0, 1)])


SCENES = [
    (SceneParameters(60, 30, 1.7), 20),
    (SceneParameters(10, 200, -2.3, n_bounces=3), 3),
    (SceneParameters(85, 90, 4.0, n_bounces=10, reflection_polarization=(0.4, 20)), 10),
    (SceneParameters(40, 123, 0.0, 1.33, transmission_polarization=(0.7, 100)), 20),
    (SceneParameters(53, 90, 5.0, 1.33, single_surface=True, reflection_polarization=(0.2, 70)), 0),
    (SceneParameters(65, -20, 2.5, n_bounces=10, literal_eq3=True, reflection_polarization=(1.0, 5)), 10),
    (SceneParameters(70, 0, 40.5, 1.7, n_bounces=4, transmission_polarization=(0.3, 10)), 4),
    (SceneParameters(0, 12, 1.0, n_bounces=2, reflection_polarization=(0.8, 33)), 2),
    (SceneParameters(60, 30, 1.7, 1.0), 1),
    (SceneParameters(75, 30, 1.7, n_bounces=6, transmission_ghost_shift=-0.6), 6),
    (SceneParameters(70, 30, 0.0, transmission_ghost_shift=2.0, transmission_polarization=(0.7, 100)), 40),
    (SceneParameters(70, 30, 2.5, n_bounces=3, transmission_ghost_shift=0.0, literal_eq3=True), 3),
    (SceneParameters(53, 90, 5.0, 1.33, single_surface=True, transmission_ghost_shift=3.0), 0),
]


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


TORCH_SCENES = [scene for scene, _ in SCENES]


@pytest.mark.parametrize("scene", TORCH_SCENES)
def test_torch_tensors_give_what_arrays_give(scene: SceneParameters) -> None:
    torch = pytest.importorskip("torch")
    pse = PSE(scene, ANGLES)
    layers, light, photographs = RANDOM.random((2, 3, 8, 9)), RANDOM.random((2, 3, 8, 9)), RANDOM.random((4, 8, 9))
    for function, x in ((pse.forward, layers), (pse.forward_stokes, light), (pse.adjoint, photographs)):
        found = function(torch.asarray(x))
        assert found.dtype == torch.float64
        np.testing.assert_allclose(found.numpy(), function(x), atol=1e-13)
        assert function(torch.asarray(x, dtype=torch.float32)).dtype == torch.float32


@pytest.mark.parametrize("scene", TORCH_SCENES)
def test_torch_differentiates_the_engine(scene: SceneParameters) -> None:
    torch = pytest.importorskip("torch")
    pse = PSE(scene, ANGLES)
    layers = torch.rand((2, 5, 6), dtype=torch.float64, requires_grad=True)
    photographs = torch.rand((4, 5, 6), dtype=torch.float64, requires_grad=True)
    (gradient,) = torch.autograd.grad(pse.forward(layers), layers, photographs)
    torch.testing.assert_close(gradient, pse.adjoint(photographs))
    (gradient,) = torch.autograd.grad(pse.adjoint(photographs), photographs, layers)
    torch.testing.assert_close(gradient, pse.forward(layers))
    light = torch.rand((2, 3, 4, 3), dtype=torch.float64, requires_grad=True)
    assert torch.autograd.gradcheck(pse.forward_stokes, (light,))


def test_torch_tensors_stay_on_their_device() -> None:
    torch = pytest.importorskip("torch")
    pse = PSE(SceneParameters(60, 33, 1.7, reflection_polarization=(0.2, 10)), ANGLES)
    # Tensors on "meta" hold nothing, and refuse to meet those of any other device.
    for function, shape in ((pse.forward, (2, 3, 8, 9)), (pse.forward_stokes, (2, 3, 8, 9)), (pse.adjoint, (4, 8, 9))):
        assert function(torch.empty(shape, device="meta")).device.type == "meta"


@pytest.mark.parametrize("shape", [(3, 8, 9), (2, 8), (4, 3, 8, 9)])
def test_layers_of_another_shape_are_refused(shape: tuple[int, ...]) -> None:
    pse = PSE(SceneParameters(), (0, 45, 90))
    for function in (pse.forward, pse.components, pse.forward_stokes):
        with pytest.raises(ValueError, match="expected"):
            function(np.zeros(shape))
    with pytest.raises(ValueError, match=r"expected \(3,"):
        pse.adjoint(np.zeros((4, 8, 9)))
