"""A pane before a pinhole camera: its engine, its fit and the choice of it."""

from __future__ import annotations

import math
from functools import cache

import numpy as np
import pytest

import polaropt.solving.solution
from polaropt import SceneParameters, SeparationWarning, separate, simulate
from polaropt.capture.capture import Capture
from polaropt.capture.polarization import stokes_images
from polaropt.errors import InputError
from polaropt.estimation.ladder import find_scene
from polaropt.estimation.wide.fits import fit_perspective
from polaropt.numerics import turn_between
from polaropt.optics.engine import PSE, VaryingPSE
from polaropt.optics.geometry import pixel_grid, plane_normal, viewing_angles
from polaropt.simulation.metrics import psnr_db
from polaropt.solving.objective import Weights
from polaropt.solving.problem import Problem
from polaropt.solving.solution import tiles
from tests.blends import blend
from tests.checks import assert_adjoint
from tests.solving.test_fused import WEIGHTS, assert_equal

ANGLES = (0, 45, 90, 135)
BLIND = SceneParameters(None, None, None)
WIDE = 96 / 2 / math.tan(math.radians(22.5))


def seen_wide(size: int = 96, focal_px: float = WIDE, azimuth_deg: float = 200.0, ghost_shift: float = 0.0, **kwargs):
    """A blend whose incidence varies over the frame: photographs, layers and scene."""
    example = blend(55, size, ghost_shift=0.0, **kwargs)
    scene = SceneParameters(55.0, azimuth_deg, ghost_shift, focal_px=focal_px)
    layers = example.layers if example.layers.ndim == 3 else np.moveaxis(example.layers, 1, -1)
    return simulate(layers[0], layers[1], scene, noise=0.005, bits=12, seed=1), example.layers, scene


@pytest.mark.parametrize("single_surface", [False, True])
@pytest.mark.parametrize(
    "polarized", [{}, {"transmission_polarization": (0.6, 20.0), "reflection_polarization": (0.3, 70.0)}]
)
def test_from_far_away_it_is_the_plain_engine(single_surface, polarized):
    scene = SceneParameters(50, 30, 0.0, single_surface=single_surface, **polarized)
    layers = np.random.default_rng(0).random((2, 3, 20, 31))
    far = VaryingPSE(scene.replace(focal_px=1e7), ANGLES).forward(layers)
    np.testing.assert_allclose(far, PSE(scene, ANGLES).forward(layers), atol=2e-6)


@pytest.mark.parametrize("shape", [(17, 22), (2, 16, 15)])
def test_the_adjoint_is_the_transpose(shape):
    pse = VaryingPSE(SceneParameters(55, 100, 0.0, focal_px=20.0), ANGLES)
    assert_adjoint(pse.forward, pse.adjoint, (2, *shape))


GHOSTS = [{}, {"n_bounces": 2}, {"transmission_ghost_shift": -1.5}, {"reflection_polarization": (0.4, 30.0)}]


@pytest.mark.parametrize("options", GHOSTS)
@pytest.mark.parametrize("ghost_shift", [3.0, -4.3, 0.0])
def test_from_far_away_it_has_the_plain_engines_ghosts(ghost_shift, options):
    scene = SceneParameters(65, 30, ghost_shift, **options)
    layers = np.random.default_rng(0).random((2, 3, 20, 31))
    far = VaryingPSE(scene.replace(focal_px=1e7), ANGLES).forward(layers)
    np.testing.assert_allclose(far, PSE(scene, ANGLES).forward(layers), atol=2e-5)


@pytest.mark.parametrize("options", GHOSTS)
@pytest.mark.parametrize("shape", [(17, 22), (2, 16, 15)])
def test_the_adjoint_is_the_transpose_with_ghosts_too(shape, options):
    pse = VaryingPSE(SceneParameters(55, 100, 3.3, focal_px=20.0, **options), ANGLES)
    assert_adjoint(pse.forward, pse.adjoint, (2, *shape))


def test_ghosts_lie_along_the_azimuth_and_weigh_what_their_pixel_says():
    scene = SceneParameters(60, 0, 4.0, focal_px=30.0)
    layers = np.zeros((2, 21, 31))
    layers[1, 10, 12] = 1
    pse = VaryingPSE(scene, (0.0, 90.0))
    first = PSE(scene.replace(focal_px=None), (0.0, 90.0)).weights[1, 1, :2]
    seen = pse.forward(layers)[:, 10]
    assert set(np.flatnonzero(seen.sum(axis=0) > 1e-12)) == {12, 16, 20, 24, 28}
    x = 16 - 15.0
    local = SceneParameters(60 + math.degrees(math.atan(-x / 30)), 0, 4.0)
    np.testing.assert_allclose(seen[:, 16], PSE(local, (0.0, 90.0)).weights[1, 1, :2] / 2, rtol=1e-5)
    assert not np.allclose(seen[:, 16], first / 2, rtol=1e-2)


def test_torch_tensors_give_what_arrays_give():
    torch = pytest.importorskip("torch")
    pse = VaryingPSE(SceneParameters(55, 100, 3.3, focal_px=20.0), ANGLES)
    layers, photographs = np.random.default_rng(0).random((2, 3, 8, 9)), np.random.default_rng(1).random((4, 3, 8, 9))
    for function, x in ((pse.forward, layers), (pse.adjoint, photographs)):
        np.testing.assert_allclose(function(torch.asarray(x)).numpy(), function(x), atol=1e-12)


def test_components_add_up_to_the_photographs():
    pse = VaryingPSE(SceneParameters(55, 100, 0.0, focal_px=20.0), ANGLES)
    layers = np.random.default_rng(0).random((2, 3, 12, 14))
    np.testing.assert_allclose(pse.components(layers).sum(axis=0), pse.forward(layers), atol=1e-12)


def test_at_the_middle_incidence_and_azimuth_are_those_of_the_scene():
    cosine, cos, sin = viewing_angles(plane_normal(40, 250), 1 / 300, 0.0, 0.0)
    assert math.degrees(math.acos(cosine)) == pytest.approx(40)
    assert math.degrees(math.atan2(sin, cos)) % 360 == pytest.approx(500 % 360)


def test_the_incidence_changes_by_the_angle_of_view_along_the_azimuth():
    x, y = pixel_grid(101, 101, (50.0, 50.0))
    cosine, _, _ = viewing_angles(plane_normal(50, 0), math.tan(math.radians(20)) / 50, x, y)
    incidence = np.degrees(np.arccos(cosine))[50]
    np.testing.assert_allclose(incidence[[0, 50, 100]], [70, 50, 30], atol=1e-6)


@pytest.mark.parametrize("color", [False, True])
def test_compiled_and_readable_objective_agree(color):
    capture, _, scene = seen_wide(33, focal_px=40.0, color=color)
    assert_equal(Problem(capture, scene, 0.005, WEIGHTS))


@pytest.mark.parametrize(("ghost_shift", "options"), [*((3.7, options) for options in GHOSTS), (-20.0, {})])
def test_they_agree_where_there_are_ghosts(ghost_shift, options):
    capture, _, scene = seen_wide(33, focal_px=40.0, ghost_shift=ghost_shift)
    assert_equal(Problem(capture, scene.replace(**options), 0.005, WEIGHTS, center=(12.0, 19.0)))


def test_they_agree_with_masked_pixels_outliers_and_an_axis_off_the_middle():
    capture, _, scene = seen_wide(33, focal_px=40.0)
    valid = np.random.default_rng(1).random(capture.intensities.shape) > 0.3
    masked = Capture.of_planes(capture.intensities, ANGLES, valid)
    assert_equal(Problem(masked, scene, 0.005, WEIGHTS, center=(3.0, 50.0)))
    assert_equal(Problem(masked, scene, 0.005, WEIGHTS, robust=True, center=(3.0, 50.0)))


@pytest.mark.parametrize("init", ["closed-form", "per-pixel", "cold"])
def test_a_known_pane_is_separated_from_every_start(init):
    capture, layers, scene = seen_wide()
    result = separate(capture, scene, init=init)
    assert psnr_db(result.layers[0], layers[0], 8) > psnr_db(capture.stokes[0], layers[0], 8) + 10
    assert result.diagnostics.warnings == ()
    residual = result.components.sum(axis=0) - capture.intensities
    assert residual.std() == pytest.approx(0.005, rel=0.3)


SHIFTED = seen_wide(96, focal_px=112.0, ghost_shift=5.3, color=False)


@cache
def taken_out(init="closed-form"):
    """What a separation makes of ghosts before a wide lens."""
    capture, _, scene = SHIFTED
    return separate(capture, scene, init=init)


@pytest.mark.parametrize("init", ["closed-form", "per-pixel"])
def test_ghosts_before_a_wide_lens_are_taken_out(init):
    capture, layers, scene = SHIFTED
    result, in_place = taken_out(init), separate(capture, scene.replace(ghost_shift=0.0), init=init)
    gain = [psnr_db(result.layers[i], layers[i], 16) - psnr_db(in_place.layers[i], layers[i], 16) for i in (0, 1)]
    assert gain[0] > 0
    assert gain[1] > 2
    residual = result.components.sum(axis=0) - capture.intensities
    assert residual.std() == pytest.approx(0.005, rel=0.3)


def test_the_closed_form_is_near_what_the_solve_finds():
    capture, layers, scene = SHIFTED
    problem = Problem(capture, scene, 0.005, Weights())
    start, solved = problem.canvas.crop(problem.known.layers)[:, 0], taken_out().layers
    for i, most in ((0, 3.0), (1, 4.0)):
        assert psnr_db(start[i], layers[i], 16) > psnr_db(solved[i], layers[i], 16) - most


def test_tiles_agree_with_the_whole(monkeypatch):
    capture, layers, scene = seen_wide(200, focal_px=2 * WIDE, color=False)
    monkeypatch.setattr(polaropt.solving.solution, "tiles", lambda height, width: tiles(height, width, 160))
    result = separate(capture, scene)
    assert psnr_db(result.layers[0], layers[0], 8) > psnr_db(capture.stokes[0], layers[0], 8) + 10


@pytest.mark.parametrize("azimuth_deg", [10.0, 100.0, 200.0, 290.0])
@pytest.mark.parametrize("known", [False, True])
def test_polarization_tells_how_the_pane_stands(azimuth_deg, known):
    capture, _, _ = seen_wide(128, focal_px=150.0, azimuth_deg=azimuth_deg)
    fit = fit_perspective(stokes_images(capture, 0.005), 150.0 if known else None)
    assert abs(fit.incidence_deg - 55) < max(4 * fit.incidence_error_deg, 0.2)
    assert abs(turn_between(fit.azimuth_deg, azimuth_deg, 360.0)) < max(4 * fit.azimuth_error_deg, 0.2)
    assert abs(fit.focal_px - 150) <= 4 * fit.focal_error_px
    assert fit.incidence_error_deg < 1.5
    assert fit.misfit == pytest.approx(1, abs=0.1)


def test_blind_the_perspective_is_found_and_told():
    capture, layers, _ = seen_wide(128, focal_px=WIDE * 128 / 96)
    result = separate(capture, BLIND)
    assert result.scene.rung == "perspective"
    assert [tried.rung for tried in result.tried if tried.taken] == ["perspective"]
    assert psnr_db(result.layers[0], layers[0], 8) > psnr_db(capture.stokes[0], layers[0], 8) + 10
    assert result.diagnostics.warnings == ()


@pytest.mark.parametrize(("ghost_shift", "rung"), [(0.0, "pixelwise"), (6.0, "ghosts")])
def test_a_pane_far_away_stays_on_the_lower_rung(ghost_shift, rung):
    example = blend(60, 160, ghost_shift=ghost_shift)
    found = find_scene(example.capture, BLIND, 0.005)
    assert found.scene.rung == rung
    assert [tried.rung for tried in found.tried] == [rung]


def test_a_rung_can_be_asked_for():
    capture, _, scene = seen_wide(96, focal_px=112.0)
    plain = separate(capture, BLIND, model="pixelwise")
    assert plain.scene.rung == "pixelwise"
    assert SeparationWarning.MODEL_DOES_NOT_EXPLAIN in plain.diagnostics.warnings
    found = find_scene(capture, BLIND.replace(focal_px=112.0), 0.005)
    assert found.scene.focal_px == 112.0
    assert found.scene.incidence_deg == pytest.approx(55, abs=0.5)
    assert found.scene.azimuth_deg == pytest.approx(scene.azimuth_deg, abs=0.5)


@pytest.mark.parametrize(
    "told",
    [
        {"focal_px": 112.0, "azimuth_deg": 25.0},
        {"focal_px": 112.0, "incidence_deg": 55.0},
        {"focal_px": 112.0, "azimuth_deg": 25.0, "incidence_deg": 55.0},
        {"azimuth_deg": 25.0},
        {"incidence_deg": 55.0},
        {"azimuth_deg": 25.0, "incidence_deg": 55.0},
    ],
    ids=" ".join,
)
@pytest.mark.parametrize("model", ["perspective", "auto"])
def test_what_is_told_of_a_pane_before_a_lens_stays_and_the_rest_is_found(told, model):
    # A lens that was told beside incidence or azimuth was left out of account, and one asked for was not looked for.
    capture, _, scene = seen_wide(96, focal_px=112.0, azimuth_deg=25.0)
    found = find_scene(capture, BLIND.replace(**told), 0.005, model=model)
    assert {name: getattr(found.scene, name) for name in told} == told
    assert found.scene.incidence_deg == pytest.approx(55, abs=0.5)
    assert found.scene.azimuth_deg == pytest.approx(scene.azimuth_deg, abs=0.5)
    assert found.scene.focal_px == pytest.approx(112, rel=0.05)
    assert [tried.rung for tried in found.tried if tried.taken] == ["perspective"]
    assert all(getattr(found.errors, name) in (None, 0.0) for name in told)


def test_an_azimuth_told_from_the_other_side_is_turned_before_a_lens():
    # From far both are the same; before a lens the incidence came out at 86 degrees.
    capture, _, _ = seen_wide(96, focal_px=112.0, azimuth_deg=25.0)
    found = find_scene(capture, BLIND.replace(azimuth_deg=205.0), 0.005)
    assert found.scene.azimuth_deg == 25.0
    assert found.scene.incidence_deg == pytest.approx(55, abs=0.5)
    assert "leans to the other side" in found.tried[-1].reason


def test_light_that_is_polarized_itself_passes_for_no_lens_where_the_azimuth_is_told():
    example = blend(45, 160, azimuth_deg=25.0, transmission_polarization=(0.5, 60.0))
    assert not find_scene(example.capture, BLIND.replace(azimuth_deg=25.0), 0.005).scene.varies


@pytest.mark.parametrize("told", [{"azimuth_deg": 40.0}, {"incidence_deg": 30.0}], ids=" ".join)
def test_a_lens_does_not_excuse_what_is_told_wrongly_of_a_pane_seen_from_far(told):
    found = find_scene(blend(60, 96, azimuth_deg=25.0).capture, BLIND.replace(**told), 0.005)
    assert not found.scene.varies


@pytest.mark.parametrize(
    ("told", "model"),
    [
        ({"focal_px": 112.0}, "ghosts"),
        ({"focal_px": 112.0}, "pixelwise"),
        ({"azimuth_deg": 25.0}, "curved"),
        ({"azimuth_deg": 25.0, "focal_px": 112.0}, "polarized"),
    ],
)
def test_a_model_without_a_place_for_what_is_told_is_refused(told, model):
    capture, _, _ = seen_wide(32)
    with pytest.raises(InputError, match="leave"):
        find_scene(capture, BLIND.replace(**told), 0.005, model=model)


def test_a_wide_lens_that_was_asked_for_but_does_not_show_costs_nothing():
    example = blend(60, 112, ghost_shift=0.0)
    plain, asked = (separate(example.capture, BLIND, model=model) for model in ("pixelwise", "perspective"))
    assert asked.scene.rung == "perspective"
    quality = [psnr_db(result.layers[0], example.layers[0], 8) for result in (plain, asked)]
    assert quality[1] > quality[0] - 1


def test_the_lowest_rung_is_the_intensity_and_says_so():
    example = blend(60, 96, ghost_shift=0.0)
    result = separate(example.capture, model="none")
    assert result.scene.rung == "none"
    assert np.array_equal(result.layers[0], example.capture.stokes[0])
    assert not result.layers[1].any()
    assert [tried.rung for tried in result.tried] == ["none"]
    assert result.diagnostics.warnings == ()


def test_a_rung_that_does_not_exist_is_an_error():
    capture, _, _ = seen_wide(32)
    with pytest.raises(InputError, match="there are: auto, none, pixelwise, ghosts"):
        separate(capture, model="spherical")


@pytest.mark.parametrize("focal_px", [0.0, -1.0, math.nan, math.inf])
def test_a_focal_length_is_positive(focal_px):
    with pytest.raises(InputError, match="focal length"):
        SceneParameters(focal_px=focal_px)


def test_a_number_of_ghosts_that_was_given_is_kept_wherever_the_engine_is_moved():
    scene = SceneParameters(70.0, 20.0, 5.0, focal_px=200.0)
    found = VaryingPSE(scene, (0.0, 45.0, 90.0)).n_ghosts(120, 120)
    given = VaryingPSE(scene, (0.0, 45.0, 90.0), n_ghosts=found + 2)
    assert given.n_ghosts(120, 120) == found + 2
    assert given.moved(10, 20, 120, 120).n_ghosts(30, 30) == found + 2
    assert VaryingPSE(scene.replace(ghost_shift=0.0), (0.0, 45.0, 90.0)).n_ghosts(120, 120) == 1
