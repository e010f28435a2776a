"""A bent pane: its normals, its engine and its fit."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from polaropt import SceneParameters, estimate, separate, simulate
from polaropt.capture.polarization import stokes_images
from polaropt.errors import InputError
from polaropt.estimation.ladder import find_scene
from polaropt.estimation.wide import fits
from polaropt.estimation.wide.blocks import PolarizedBlocks
from polaropt.estimation.wide.edges import VaryingOverlap, negative_light
from polaropt.estimation.wide.fits import fit_curved
from polaropt.numerics import turn_between
from polaropt.optics.engine import PSE, VaryingPSE
from polaropt.optics.geometry import Pane, pixel_grid, plane_normal, scene_angles, scene_pane
from polaropt.simulation.metrics import psnr_db
from polaropt.solving.problem import Problem
from studies.camera import take
from studies.photographs import pairs_of
from studies.random_windows.windows import window_of
from studies.scenes import SCENES
from tests.blends import blend
from tests.checks import assert_adjoint
from tests.solving.test_fused import WEIGHTS, assert_equal

ANGLES = (0, 45, 90, 135)
BLIND, IN_PLACE = SceneParameters(None, None, None), SceneParameters(None, None, 0.0)
BENT = SceneParameters(55.0, 200.0, 0.0, focal_px=40.0, bend_deg_per_px=(0.3, -0.1, 0.2))


def seen_bent(size: int, scene: SceneParameters):
    """Photographs of a bent pane, and the layers."""
    example = blend(55, size, ghost_shift=0.0)
    layers = np.moveaxis(example.layers, 1, -1)
    return simulate(layers[0], layers[1], scene, noise=0.005, bits=12, seed=1), example.layers


def test_a_flat_pane_is_not_bent():
    flat = BENT.replace(bend_deg_per_px=(0.0, 0.0, 0.0))
    assert (flat.rung, BENT.rung) == ("perspective", "curved")
    assert BENT.replace(focal_px=None).rung == "curved"
    layers = np.random.default_rng(0).random((2, 20, 31))
    nearly = VaryingPSE(flat.replace(focal_px=None, bend_deg_per_px=(1e-9, 0.0, 0.0)), ANGLES).forward(layers)
    np.testing.assert_allclose(nearly, PSE(flat.replace(focal_px=None), ANGLES).forward(layers), atol=1e-6)


def test_seen_frontally_from_far_the_incidence_is_the_tilt():
    x, y = pixel_grid(1, 41, (20.0, 0.0))
    cosine, cos, sin = scene_angles(SceneParameters(0.0, 0.0, 0.0, bend_deg_per_px=(0.5, 0.0, 0.0)), x, y)
    np.testing.assert_allclose(np.degrees(np.arccos(cosine)), np.degrees(np.arctan(np.radians(0.5) * np.abs(x))))
    np.testing.assert_allclose(cos[x != 0], 1, atol=1e-6)
    np.testing.assert_allclose(sin, 0, atol=1e-6)


@given(st.floats(5, 70), st.floats(0, 360), st.tuples(*3 * [st.floats(-0.2, 0.2)]), st.sampled_from([60.0, 200.0, 1e4]))
@settings(max_examples=50, deadline=None)
def test_its_normals_are_those_of_a_surface(incidence_deg, azimuth_deg, bend, focal_px):
    """The pane ``1 / Z`` given by finite differences of the points themselves."""
    scene = SceneParameters(incidence_deg, azimuth_deg, 0.0, focal_px=focal_px, bend_deg_per_px=bend)
    tilt, azimuth = math.radians(incidence_deg), math.radians(azimuth_deg)
    n_x, n_y, n_z = math.sin(tilt) * math.cos(azimuth), math.sin(tilt) * math.sin(azimuth), math.cos(tilt)
    b_xx, b_xy, b_yy = np.radians(bend)

    def point(x: float, y: float) -> np.ndarray:
        q = b_xx * x * x + 2 * b_xy * x * y + b_yy * y * y
        return np.array([x, y, focal_px]) / (focal_px * n_z + n_x * x + n_y * y + q / 2)

    x, y, step = 7.0, -4.0, 1e-3
    normal = np.cross(
        (point(x + step, y) - point(x - step, y)) / step, (point(x, y + step) - point(x, y - step)) / step
    )
    ray = np.array([x, y, focal_px]) / math.sqrt(x * x + y * y + focal_px**2)
    cosine, _, _ = scene_angles(scene, np.array([[x]]), np.array([[y]]))
    assert cosine[0, 0] == pytest.approx(abs(normal @ ray) / np.linalg.norm(normal), abs=1e-6)


@pytest.mark.parametrize("focal_px", [40.0, None])
@pytest.mark.parametrize("shape", [(17, 22), (2, 16, 15)])
def test_the_adjoint_is_the_transpose(shape, focal_px):
    pse = VaryingPSE(BENT.replace(focal_px=focal_px), ANGLES)
    assert_adjoint(pse.forward, pse.adjoint, (2, *shape))


@pytest.mark.parametrize("focal_px", [40.0, None])
def test_compiled_and_readable_objective_agree(focal_px):
    scene = BENT.replace(focal_px=focal_px)
    capture, _ = seen_bent(33, scene)
    assert_equal(Problem(capture, scene, 0.005, WEIGHTS))
    assert_equal(Problem(capture, scene, 0.005, WEIGHTS, center=(3.0, 50.0)))


def test_a_known_bent_pane_is_separated():
    scene = BENT.replace(focal_px=115.0, bend_deg_per_px=(0.15, 0.05, -0.1))
    capture, layers = seen_bent(96, scene)
    result = separate(capture, scene)
    assert psnr_db(result.layers[0], layers[0], 8) > psnr_db(capture.stokes[0], layers[0], 8) + 10
    assert result.diagnostics.warnings == ()


@pytest.mark.parametrize("bend", [(0.1, 0.2), (0.0, math.nan, 0.0), (math.inf, 0.0, 0.0)])
def test_a_bend_is_three_numbers(bend):
    with pytest.raises(InputError, match="three finite numbers"):
        SceneParameters(bend_deg_per_px=bend)


@pytest.mark.parametrize("incidence_deg", [62.0, 75.0])
def test_a_pane_that_would_leave_no_light_is_not_begun_from(incidence_deg):
    """The edges' nearest minimum lies where half of the frame would have less than no light."""
    scene = SceneParameters(incidence_deg, 200.0, 0.0, bend_deg_per_px=(0.10, 0.04, -0.06))
    stokes = stokes_images(seen_bent(96, scene)[0], 0.005)
    fit = fit_curved(stokes, SceneParameters(20.0, 20.0, 0.0))
    assert fit.incidence_deg == pytest.approx(incidence_deg, abs=max(2 * fit.incidence_error_deg, 1.0))
    found = scene.replace(
        incidence_deg=fit.incidence_deg, azimuth_deg=fit.azimuth_deg, bend_deg_per_px=fit.bend_deg_per_px
    )
    assert negative_light(PolarizedBlocks(stokes), found) < 0.01


@pytest.mark.parametrize("focal_px", [150.0, None])
def test_polarization_and_edges_tell_how_the_pane_is_bent(focal_px):
    """From far a pane and its like, bent and leaning the other way, look the same: azimuth modulo 180."""
    bend = (0.10, 0.04, -0.06)
    capture, _ = seen_bent(128, SceneParameters(50.0, 200.0, 0.0, focal_px=focal_px, bend_deg_per_px=bend))
    fit = fit_curved(stokes_images(capture, 0.005), SceneParameters(45.0, 20.0, 0.0), focal_px)
    assert abs(fit.incidence_deg - 50) < max(3 * fit.incidence_error_deg, 0.5)
    assert fit.incidence_error_deg < 1.5
    turned = turn_between(fit.azimuth_deg, 200)
    assert abs(turned) < max(4 * fit.azimuth_error_deg, 0.1)
    leaning = 1 if abs(turn_between(fit.azimuth_deg, 200, 360.0)) < 90 else -1
    assert leaning == 1 or focal_px is None
    away = np.abs(leaning * np.array(fit.bend_deg_per_px) - bend)
    assert (away < np.maximum(4 * np.array(fit.bend_error_deg_per_px), 0.005)).all()
    assert fit.focal_px == focal_px
    assert fit.misfit == pytest.approx(1, abs=0.1)
    assert fit.edges_agree


def test_edges_speak_against_a_bend_that_explains_the_polarized_light_of_a_flat_pane():
    example = blend(20, 96, ghost_shift=0.0, transmission_polarization=(0.1, 60.0))
    plain = example.scene.replace(transmission_polarization=(0.0, 0.0))
    assert not fit_curved(stokes_images(example.capture, 0.005), plain).edges_agree


def test_where_no_bend_explains_much_the_edges_are_not_looked_at():
    example = blend(50, 96, ghost_shift=0.0, transmission_polarization=(0.6, 20.0))
    fit = fit_curved(stokes_images(example.capture, 0.005), example.scene, enough=0.9)
    assert fit.incidence_error_deg == math.inf


def test_blind_the_bent_pane_is_found_and_told():
    scene = SceneParameters(55.0, 200.0, 0.0, focal_px=150.0, bend_deg_per_px=(0.12, 0.05, -0.07))
    capture, layers = seen_bent(128, scene)
    blind, known = separate(capture, IN_PLACE), separate(capture, scene)
    assert blind.scene.rung == "curved"
    assert [tried.rung for tried in blind.tried] == ["pixelwise", "perspective", "curved"]
    assert psnr_db(blind.layers[0], layers[0], 8) > psnr_db(known.layers[0], layers[0], 8) - 2
    assert blind.diagnostics.warnings == ()


def test_a_flat_pane_before_a_lens_is_not_taken_for_bent():
    scene = SceneParameters(55.0, 200.0, 0.0, focal_px=150.0)
    capture, _ = seen_bent(128, scene)
    found = find_scene(capture, IN_PLACE, 0.005)
    assert found.scene.rung == "perspective"
    assert [tried.rung for tried in found.tried] == ["pixelwise", "perspective"]


def test_a_bent_pane_cannot_be_given_by_half():
    with pytest.raises(InputError, match="given whole"):
        separate(blend(50, 32).capture, SceneParameters(None, None, 0.0, bend_deg_per_px=(0.1, 0.0, 0.0)))


def test_the_edges_overlap_least_at_the_true_incidence():
    scene = SceneParameters(55.0, 200.0, 0.0, focal_px=115.0, bend_deg_per_px=(0.10, 0.04, -0.06))
    overlap = VaryingOverlap(stokes_images(seen_bent(128, scene)[0], 0.005), scene)
    bend = tuple(math.radians(part) for part in scene.bend_deg_per_px)
    trials = np.arange(45.0, 66.0, 2.0)
    values = [overlap.log(Pane(plane_normal(float(trial), 200.0), bend, 1 / 115)).mean() for trial in trials]
    assert abs(trials[int(np.argmin(values))] - 55) <= 2


@pytest.mark.parametrize("azimuth_deg", [100.0, 229.0])
def test_a_pane_seen_from_far_has_no_focal_length(azimuth_deg):
    # Polarized light makes its view come out a little beyond that of parallel rays.
    example = blend(55, 64, azimuth_deg=azimuth_deg, ghost_shift=0.0, transmission_polarization=(0.3, 20.0))
    fit = fit_curved(stokes_images(example.capture, 0.005), example.scene, enough=math.inf)
    assert fit.focal_px is None


def test_a_view_as_narrow_as_no_lens_has_no_focal_length(monkeypatch):
    # A search came upon a focal length of 2e10 px, which no scene may have.
    def rough(*_):
        return [np.array([0.9, 1.0, 1e-9, 0.0, 0.0, 0.0])]

    monkeypatch.setattr(fits, "_rough", rough)
    example = blend(55, 64, ghost_shift=0.0)
    fit = fit_curved(stokes_images(example.capture, 0.005), example.scene, enough=math.inf)
    assert fit.focal_px is None


def test_a_bent_pane_is_not_taken_for_a_flat_one_whose_layers_share_their_edges():
    # From how the azimuth turns it looks like a flat pane before a lens, at another incidence.
    sample = take(SCENES["bend of the pane (deg): 10"], pairs_of(None, 128, 64)[0])
    found = find_scene(sample.capture, sample.hint, 0.005)
    assert found.scene.rung == "curved"
    assert abs(found.scene.incidence_deg - 55) < 2


@pytest.mark.parametrize("focal_px", [190.0, None])
def test_before_the_true_pane_layers_have_light_before_one_across_they_have_not(focal_px):
    scene = SceneParameters(55.0, 200.0, 0.0, focal_px=focal_px, bend_deg_per_px=(0.10, 0.04, -0.06))
    blocks = PolarizedBlocks(stokes_images(seen_bent(128, scene)[0], 0.005))
    across = scene.replace(azimuth_deg=290.0)
    assert negative_light(blocks, scene) < 0.01
    assert negative_light(blocks, across) > 0.1
    assert negative_light(blocks, scene, scene_pane(across)) == negative_light(blocks, across)


def test_a_slightly_bent_pane_from_far_is_not_taken_for_one_across():
    # Before a lens, and bent otherwise, a pane across turns the azimuth alike: layers would have less than no light.
    found = found_of_window(174)
    assert found.scene.rung == "curved"
    assert found.scene.incidence_deg == pytest.approx(20.9, abs=1)
    assert turn_between(found.scene.azimuth_deg, 1.6) == pytest.approx(0, abs=1)


def test_edges_that_ghosts_double_do_not_make_a_flat_pane_bent():
    # Its double images lie 15 px apart, and the bent pane that edges tell leaves less than no light.
    found = found_of_window(108)
    assert found.scene.rung == "perspective"
    assert found.scene.incidence_deg == pytest.approx(69.5, abs=1)
    assert abs(found.scene.ghost_shift) == pytest.approx(15.4, abs=0.5)


def test_ghosts_of_a_bent_pane_are_found_where_its_edges_are_far_off():
    # Its double images lie 19.8 px apart: edges tell 72 degrees.
    found = found_of_window(718)
    assert found.scene.incidence_deg == pytest.approx(66.9, abs=1.5)
    assert abs(found.scene.ghost_shift) == pytest.approx(19.8, abs=0.5)


def found_of_window(number: int):
    window = window_of(number, 192)
    sample = window.sample(None, 192)
    return find_scene(sample.capture, sample.hint, window.taking.noise)


def test_a_bent_pane_asked_for_behind_polarized_light_has_no_focal_length_below_nothing():
    # Bends explain the polarized light a little better with a view beyond that of parallel rays.
    light = (0.42605462591119964, 123.59049986993817)
    pane = {"azimuth_deg": 103.0013091849751, "ghost_shift": 0.0}
    example = blend(29.614569822486082, 96, **pane, transmission_polarization=light)
    found = estimate(example.capture, BLIND, model="curved")
    assert found.scene.bent
    assert found.scene.focal_px is None
