"""separate: what its users rely on."""

from __future__ import annotations

import numpy as np
import pytest

from polaropt import SceneParameters, SeparationWarning, StoppingRule, Weights, separate, simulate
from polaropt.capture.capture import Capture
from polaropt.numerics import turn_between
from polaropt.simulation.metrics import psnr_db
from polaropt.solving.starts import start_names
from solvers.base import Status
from tests.blends import blend

QUICK = StoppingRule(max_evaluations=12)


@pytest.fixture(scope="module")
def sixty():
    example = blend(60, 96)
    return example, separate(example.capture, example.scene)


def test_both_layers_come_out_far_better_than_the_intensity(sixty):
    example, result = sixty
    doing_nothing = psnr_db(example.capture.stokes[0], example.layers[0], 8)
    assert psnr_db(result.layers[0], example.layers[0], 8) > doing_nothing + 10
    assert psnr_db(result.layers[1], example.layers[1], 8) > 24


def test_images_are_as_image_libraries_have_them(sixty):
    _, result = sixty
    assert result.transmission.shape == result.reflection.shape == (96, 96, 3)
    assert result.transmission.dtype == result.layers.dtype == np.float32
    np.testing.assert_array_equal(np.moveaxis(result.transmission, -1, 0), result.layers[0])


def test_components_add_up_to_the_photographs(sixty):
    example, result = sixty
    assert result.components.shape == (2, 4, 3, 96, 96)
    residual = result.components.sum(axis=0) - example.capture.intensities
    assert residual.std() == pytest.approx(0.005, rel=0.3)


def test_the_solver_lowers_the_objective_and_tells_how(sixty):
    _, result = sixty
    solver = result.solver
    assert solver.status in (Status.CONVERGED, Status.EVALUATION_LIMIT)
    assert solver.value == min(point.value for point in solver.trace) < solver.trace[0].value
    assert solver.n_evaluations == len(solver.trace)
    total = sum(term.weight * term.value for term in result.terms.values())
    assert total == pytest.approx(solver.value, rel=1e-4)


def test_a_good_capture_earns_no_warning(sixty):
    _, result = sixty
    assert result.diagnostics.warnings == ()


def test_near_normal_incidence_is_said_not_to_tell_the_reflection():
    example = blend(10, 96, ghost_shift=0.3)
    result = separate(example.capture, example.scene, stopping=QUICK)
    assert SeparationWarning.REFLECTION_NOT_IDENTIFIABLE in result.diagnostics.warnings
    doing_nothing = psnr_db(example.capture.stokes[0], example.layers[0], 8)
    assert psnr_db(result.layers[0], example.layers[0], 8) > doing_nothing


def test_blind_finds_the_scene_and_the_layers():
    example = blend(65, 128)
    result = separate(example.capture)
    assert result.scene.incidence_deg == pytest.approx(65, abs=3)
    turn = turn_between(result.scene.azimuth_deg, 25)
    assert abs(turn) < 2
    doing_nothing = psnr_db(example.capture.stokes[0], example.layers[0], 8)
    assert psnr_db(result.layers[0], example.layers[0], 8) > doing_nothing + 8


def test_fields_that_are_given_stay(sixty):
    example, _ = sixty
    scene = SceneParameters(None, 25.0, 5.3, refractive_index=1.52)
    found = separate(example.capture, scene, stopping=StoppingRule(max_evaluations=1)).scene
    assert (found.azimuth_deg, found.ghost_shift, found.refractive_index) == (25.0, 5.3, 1.52)
    assert found.incidence_deg is not None


def test_unpolarized_light_is_returned_as_transmission_with_a_warning():
    image = blend(60, 64).layers[0]
    random = np.random.default_rng(0)
    capture = Capture.of_planes(np.stack([image / 2] * 4) + 0.005 * random.standard_normal((4, *image.shape)))
    result = separate(capture)
    assert SeparationWarning.NO_POLARIZATION in result.diagnostics.warnings
    np.testing.assert_allclose(result.layers[0], capture.stokes[0])
    assert (result.reflection == 0).all()
    assert all(np.isfinite(result.scene.values()))
    assert result.solver.status is Status.NOT_RUN
    assert result.scene.rung == "none"
    assert [tried.rung for tried in result.tried] == ["none"]


@pytest.mark.parametrize("color", [False, True])
@pytest.mark.parametrize("angles", [(0, 60, 120), (0, 45, 90, 135), (5, 40, 77, 110, 150)])
def test_any_angles_and_grey_images(color, angles):
    example = blend(65, 64, color=color, angles_deg=angles)
    result = separate(example.capture, example.scene, stopping=QUICK)
    assert result.layers.shape == example.layers.shape
    assert psnr_db(result.layers[0], example.layers[0], 8) > 28


def test_polarized_light_of_known_polarization():
    polarization = {"transmission_polarization": (0.6, 70.0), "reflection_polarization": (0.3, 10.0)}
    example = blend(50, 64, **polarization)
    knowing = separate(example.capture, example.scene, stopping=QUICK)
    plain = example.scene.replace(**dict.fromkeys(polarization, (0.0, 0.0)))
    ignoring = separate(example.capture, plain, stopping=QUICK)
    better, worse = (psnr_db(result.layers[0], example.layers[0], 8) for result in (knowing, ignoring))
    assert better > 40
    assert better > worse + 0.5


def test_water_has_one_surface():
    example = blend(55, 64, ghost_shift=0.0, single_surface=True, refractive_index=1.33)
    result = separate(example.capture, refractive_index=1.33, single_surface=True, stopping=QUICK)
    assert result.scene.single_surface
    assert result.scene.ghost_shift == 0
    doing_nothing = psnr_db(example.capture.stokes[0], example.layers[0], 8)
    assert psnr_db(result.layers[0], example.layers[0], 8) > doing_nothing + 3


def test_clipped_pixels_hurt_only_themselves():
    example = blend(60, 64)
    clipped = np.minimum(example.capture.intensities, np.quantile(example.capture.intensities, 0.95))
    capture = Capture.of_planes(clipped, example.capture.angles_deg, valid=clipped < clipped.max())
    untouched = capture.valid.all(axis=0)
    error = []
    for each in (example.capture, capture):
        layers = separate(each, example.scene, stopping=QUICK).layers
        error.append(np.sqrt(np.mean((layers[0] - example.layers[0])[untouched] ** 2)))
    assert error[1] < 1.2 * error[0]
    assert SeparationWarning.SATURATED in separate(capture, example.scene, stopping=QUICK).diagnostics.warnings


def test_same_input_same_result():
    example = blend(60, 48)
    first, second = (separate(example.capture, example.scene, stopping=QUICK) for _ in range(2))
    np.testing.assert_array_equal(first.layers, second.layers)


def test_every_start_leads_to_nearly_the_same_value():
    example = blend(65, 48)
    stopping = StoppingRule(max_evaluations=150, relative_change=1e-6)
    cold = separate(example.capture, example.scene, init="cold", stopping=StoppingRule(max_evaluations=1)).solver.value
    found = {
        init: separate(example.capture, example.scene, init=init, stopping=stopping).solver.value
        for init in start_names()
    }
    best = found["closed-form"]
    assert {init: value for init, value in found.items() if abs(value - best) >= 5e-3 * (cold - best)} == {}


def test_names_that_do_not_exist_are_listed():
    capture = blend(60, 32).capture
    with pytest.raises(ValueError, match=r"'magic'.*scipy"):
        separate(capture, solver="magic")
    with pytest.raises(ValueError, match=r"'magic'.*closed-form"):
        separate(capture, init="magic")


def test_progress_runs_forward():
    told = []
    example = blend(60, 32)
    separate(example.capture, progress=lambda stage, done: told.append((stage, done)), stopping=QUICK)
    fractions = [done for _, done in told]
    assert fractions == sorted(fractions)
    assert 0 <= fractions[0] <= fractions[-1] <= 1


@pytest.mark.parametrize("name", ["edge_independence", "gradient_sparsity", "nonnegativity", "natural_image"])
def test_terms_can_be_left_out(name):
    example = blend(60, 48)
    result = separate(example.capture, example.scene, weights=Weights(**{name: 0}), stopping=QUICK)
    assert result.terms[name].weight == 0
    assert psnr_db(result.layers[0], example.layers[0], 8) > 25


@pytest.mark.parametrize("size", [16, 31])
def test_small_images(size):
    random = np.random.default_rng(0)
    layers = random.uniform(0, 1, (2, size, size + 3))
    capture = simulate(layers[0], layers[1], SceneParameters(60, 30, 1.5))
    assert np.isfinite(separate(capture, stopping=QUICK).layers).all()


def test_residuals_that_count_linearly_do_no_harm_behind_a_wide_lens():
    example = blend(60, 96, ghost_shift=4.0, focal_px=150.0, noise=0.002, exposure=0.5)
    plain, robust = (separate(example.capture, example.scene, robust=robust) for robust in (False, True))
    assert robust.diagnostics.warnings == ()
    assert psnr_db(robust.layers[0], example.layers[0], 16) > psnr_db(plain.layers[0], example.layers[0], 16) - 0.5
