"""The compiled objective equals the readable one, term by term, and on tensors too."""

from __future__ import annotations

import os

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from polaropt.capture.capture import Capture
from polaropt.optics.scene import SceneParameters
from polaropt.solving.kernels.penalties import raise_to_power
from polaropt.solving.objective import Weights
from polaropt.solving.problem import Problem
from tests.blends import Blend, blend
from tests.forks import forks

WEIGHTS = Weights(misfit=0.7, gradient_sparsity=1.3, natural_image=0.9, edge_independence=20.0, nonnegativity=0.5)


def problem_of(example: Blend, scene: SceneParameters | None = None, weights: Weights = WEIGHTS, **kwargs) -> Problem:
    return Problem(example.capture, scene or example.scene, 0.005, weights, **kwargs)


def start_of(problem: Problem) -> np.ndarray:
    return problem.canvas.continued(problem.canvas.crop(problem.known.layers))


def assert_equal(problem: Problem, device: str | None = None) -> None:
    """Values, terms and gradients agree to 1e-5 at a point away from the start."""
    start = start_of(problem)
    fused, readable = problem.compiled(start), problem.readable(start, device)
    layers = start + 0.01 * np.random.default_rng(0).standard_normal(start.shape).astype(np.float32)
    z = fused.coordinates(layers)
    there = readable.coordinates(layers)
    np.testing.assert_allclose(np.asarray(there), z, atol=1e-5 * np.abs(z).max())
    value, gradient = fused.value_and_grad(z)
    expected, slope = readable.value_and_grad(there)
    assert value == pytest.approx(expected, rel=1e-5)
    assert np.linalg.norm(gradient - np.asarray(slope)) <= 1e-5 * np.linalg.norm(gradient)
    (images, terms), (expected_images, named) = fused.solution(z), readable.solution(there)
    assert terms.keys() == named.keys()
    for name, term in terms.items():
        assert term.value == pytest.approx(named[name].value, rel=1e-5, abs=1e-3)
        assert term.weight == named[name].weight
    np.testing.assert_allclose(images, expected_images, atol=1e-5)


@pytest.mark.parametrize("color", [False, True])
@pytest.mark.parametrize("ghost_shift", [0.0, 4.0, 5.3, -7.7, 60.0])
def test_compiled_and_readable_objective_agree(color, ghost_shift):
    assert_equal(problem_of(blend(60, 33, color=color, ghost_shift=ghost_shift)))


@pytest.mark.parametrize("incidence_deg", [89.0, 89.9999999])
def test_they_agree_where_most_ghosts_lie_beyond_the_frame(incidence_deg):
    example = blend(89, 16, ghost_shift=30.0)
    assert_equal(problem_of(example, example.scene.replace(incidence_deg=incidence_deg)))


@pytest.mark.parametrize("share", [0.02, 0.6])
def test_they_agree_where_pixels_are_masked(share):
    example = blend(60, 32)
    valid = np.random.default_rng(1).random(example.capture.intensities.shape) > share
    capture = Capture.of_planes(example.capture.intensities, example.capture.angles_deg, valid)
    assert_equal(Problem(capture, example.scene, 0.005, WEIGHTS))


def test_they_agree_for_light_that_is_polarized_already():
    example = blend(50, 32)
    scene = SceneParameters(50.0, 30.0, 3.3, transmission_polarization=(0.5, 20.0), reflection_polarization=(0.2, 80.0))
    assert_equal(problem_of(example, scene))


@pytest.mark.parametrize("polarized", [{}, {"transmission_polarization": (0.5, 20.0)}])
@pytest.mark.parametrize("own", [0.0, 2.6, -4.0])
def test_they_agree_where_each_layer_has_its_own_shift(own, polarized):
    example = blend(70, 33, ghost_shift=5.3, transmission_ghost_shift=own, **polarized)
    assert_equal(problem_of(example))


def test_they_agree_where_outliers_count_linearly():
    assert_equal(problem_of(blend(60, 32), robust=True))


@pytest.mark.parametrize("name", ["misfit", "gradient_sparsity", "natural_image", "edge_independence", "nonnegativity"])
def test_they_agree_with_a_term_switched_off(name):
    assert_equal(problem_of(blend(60, 24), weights=Weights(**{name: 0.0})))


@pytest.mark.parametrize("color", [False, True])
def test_tensors_and_arrays_agree(color):
    pytest.importorskip("torch", reason="torch is not installed")
    assert_equal(problem_of(blend(60, 33, color=color)), device="cpu")


@settings(max_examples=50, deadline=None)
@given(st.lists(st.floats(2.0**-66, 2.0**66, width=32), min_size=1, max_size=40), st.floats(2.0**-7, 1.0, width=32))
def test_the_compiled_power_is_a_power(base, exponent):
    base = np.array(base, dtype=np.float32)
    out = np.empty_like(base)
    raise_to_power(base, np.float32(exponent), out)
    np.testing.assert_allclose(out, base.astype(np.float64) ** np.float32(exponent), rtol=2e-5)


def test_the_threads_do_not_change_a_bit(monkeypatch):
    problem = problem_of(blend(60, 96))
    start = start_of(problem)
    results = []
    for threads in ("1", "2"):
        monkeypatch.setenv("OMP_NUM_THREADS", threads)
        fused = problem.compiled(start)
        results.append(fused.value_and_grad(fused.coordinates(start)))
    assert results[0][0] == results[1][0]
    np.testing.assert_array_equal(results[0][1], results[1][1])


def test_nan_is_not_hidden():
    problem = problem_of(blend(60, 32))
    start = start_of(problem)
    fused = problem.compiled(start)
    z = fused.coordinates(start)
    z[100] = np.nan
    value, gradient = fused.value_and_grad(z)
    assert np.isnan(value)
    assert np.isnan(gradient).any()


MISFIT = """
import numpy as np
from polaropt.inversion.canvas import canvas_for
from polaropt.optics.engine import engine_for
from polaropt.solving.compiled import FusedMisfit
from solvers.kernels import compilations_reported_to
from tests.blends import blend

example, compiled = blend(60.0, 64), []
pse = engine_for(example.scene, example.capture.angles_deg, 0.005, (64, 64))
canvas = canvas_for(pse, 64, 64)
layers = canvas.continued(example.layers.astype(np.float32))
with compilations_reported_to(compiled.append):
    value = FusedMisfit(example.capture, pse, canvas, 0.005).value_and_grad(layers, np.empty_like(layers))
print(len(compiled), value.hex())
"""


def test_a_process_that_compiles_sums_as_one_that_loads(tmp_path):
    with forks(os.environ) as process:
        runs = [process.run(MISFIT, {"NUMBA_CACHE_DIR": str(tmp_path)}) for _ in range(2)]
    assert [(run.code, run.err) for run in runs] == [(0, "")] * 2
    (compiled, first), (loaded, second) = (run.out.split() for run in runs)
    assert int(compiled) > 0 == int(loaded)
    assert first == second
