"""The separation on a device gives what compiled passes give: closed form, windows, objective and solve."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from polaropt import InputError, SceneParameters, StoppingRule, Weights, separate, separate_many, separate_sequence
from polaropt.capture.noise import NoiseModel
from polaropt.simulation import simulated_mosaic
from polaropt.solving.problem import Problem
from polaropt.solving.starts import take_start
from polaropt.solving.tensors.batch import batch_of
from polaropt.solving.tensors.closed_form import closed_form
from polaropt.solving.tensors.objective import BatchMisfit
from polaropt.solving.tensors.solve import alike, batch_problem
from polaropt.solving.tensors.windows import expected_layers
from solvers.base import Status
from solvers.batch_lbfgs import minimize_all
from solvers.registry import get_solver
from tests.blends import blend
from tests.captured import color_mosaic, mono_mosaic

NOISE = 0.005
WEIGHTS = Weights(misfit=0.7, gradient_sparsity=1.3, natural_image=0.9, edge_independence=20.0, nonnegativity=0.5)


def problem_of(scene: SceneParameters | None = None, weights: Weights = WEIGHTS, **options) -> Problem:
    """Of a frame with an odd and an even side."""
    color = options.pop("color", True)
    example = blend(57, 80, color=color, ghost_shift=4.3)
    part = example.capture.part(slice(0, 77), slice(0, 80))
    return Problem(part, scene or example.scene, NOISE, weights, **options)


def numpy_of(tensor):
    return tensor[0].numpy()


@pytest.mark.parametrize("color", [True, False])
def test_the_closed_form_of_a_device_is_that_of_the_processor(color):
    problem = problem_of(color=color)
    batch = batch_of([problem.capture], [problem.pse], [NOISE], problem.canvas, "cpu")
    there, here = closed_form(batch, [problem.capture], [problem.pse], [NOISE]), problem.known
    np.testing.assert_allclose(numpy_of(there.told), here.told, rtol=1e-4)
    np.testing.assert_allclose(numpy_of(there.prior), here.prior, rtol=1e-3)
    np.testing.assert_allclose(numpy_of(batch.in_colors(there.layers)), here.layers, atol=1e-4)
    (form,) = there.each(batch.basis)
    np.testing.assert_allclose(form.variance, here.variance, rtol=1e-4)
    np.testing.assert_allclose(form.sampled.uncertainty(), here.sampled.uncertainty(), rtol=1e-3)


@pytest.mark.parametrize("incidence_deg", [57.0, 29.0])
def test_what_windows_expect_on_a_device_is_what_they_expect_on_the_processor(incidence_deg):
    """Whether they are shown what is fast alone, or all."""
    problem = problem_of(SceneParameters(incidence_deg, 33.0, 4.3))
    assert problem.slow_is_known == (incidence_deg > 30)
    batch = batch_of([problem.capture], [problem.pse], [NOISE], problem.canvas, "cpu")
    known = closed_form(batch, [problem.capture], [problem.pse], [NOISE])
    there = expected_layers(batch, known, BatchMisfit(batch).gradient, torch.ones(1, 1, 1), [problem.slow_is_known])
    frame = problem.canvas.crop
    np.testing.assert_allclose(frame(numpy_of(there.layers)), frame(problem.expected.layers), atol=5e-4)
    np.testing.assert_allclose(numpy_of(there.variance), problem.expected.variance, rtol=1e-3)


def test_a_device_shows_windows_no_more_of_dark_pixels_than_the_processor():
    problem = problem_of(growth=NoiseModel(0.002, 5e-4))
    share = problem.believed_share()
    assert share is not None
    assert share.min() < 0.9
    there = batch_problem([problem], "cpu", "closed-form")
    start = take_start(problem, "closed-form")
    here = problem.compiled(start).coordinates(start)
    np.testing.assert_allclose(numpy_of(there.start).ravel(), here.ravel(), atol=0.01 * np.abs(here).max())


@pytest.mark.parametrize("init", ["closed-form", "per-pixel"])
@pytest.mark.parametrize("robust", [False, True])
def test_the_objective_of_a_device_is_that_of_compiled_passes(init, robust):
    """Value and terms, and the gradient's slope along a random direction."""
    there = batch_problem([problem_of(robust=robust)], "cpu", init)
    problem = problem_of(robust=robust)
    start = take_start(problem, init)
    here = problem.compiled(start)
    value, _ = here.value_and_grad(here.coordinates(start))
    values, gradients = there.objective.value_and_grad(there.start)
    assert float(values[0]) == pytest.approx(value, rel=1e-5)
    terms = here.solution(here.coordinates(start))[1]
    for name, term in there.objective.terms(there.start)[0].items():
        assert term.value == pytest.approx(terms[name].value, rel=1e-4, abs=1e-2)
    way = torch.from_numpy(np.random.default_rng(0).standard_normal(gradients.shape).astype(np.float32))
    ahead, behind = (there.objective.value_and_grad(there.start + s * way)[0][0] for s in (0.02, -0.02))
    slope = float((gradients.double() * way).sum())
    assert float(ahead - behind) / 0.04 == pytest.approx(slope, abs=0.02 * float(gradients.norm() * way.norm()))


@pytest.mark.parametrize(
    ("pane", "options"),
    [
        ({}, {}),
        ({}, {"init": "cold"}),
        ({}, {"keep_start": 0.5}),
        ({}, {"solver": "torch"}),
        ({"transmission_polarization": (0.4, 20.0)}, {}),
        ({"ghost_shift": 25.0}, {}),
        ({"ghost_shift": 0.0, "focal_px": 150.0}, {}),
        ({"n_panes": 2, "gap_shift": 6.0}, {}),
    ],
)
def test_a_separation_on_a_device_ends_where_one_of_the_processor_does(pane, options):
    example = blend(57, 64, **pane)
    there = separate(example.capture, example.scene, device="cpu", **options)
    here = separate(
        example.capture, example.scene, **{name: value for name, value in options.items() if name != "solver"}
    )
    values = [sum(term.weight * term.value for term in result.terms.values()) for result in (there, here)]
    assert values[0] == pytest.approx(values[1], rel=1e-3)
    # Of a layer that is hardly told, an objective so near says less.
    np.testing.assert_allclose(there.layers, here.layers, atol=0.03)
    assert there.diagnostics.reflection_unknown == pytest.approx(here.diagnostics.reflection_unknown, abs=1e-3)
    np.testing.assert_allclose(there.uncertainty, here.uncertainty, rtol=0.05, atol=1e-3)


def test_values_that_cannot_be_trusted_count_as_little_on_a_device():
    example = blend(57, 80)
    valid = np.random.default_rng(0).random(example.capture.intensities.shape) > 0.0005
    few = example.capture.replace(valid=valid)
    many = example.capture.replace(valid=np.random.default_rng(1).random(valid.shape) > 0.05)
    for capture in (few, many):
        there, here = (separate(capture, example.scene, device=device) for device in ("cpu", None))
        np.testing.assert_allclose(there.layers, here.layers, atol=2e-3)


@pytest.mark.parametrize("color", [True, False])
def test_samples_of_a_mosaic_are_solved_on_a_device(color):
    example = blend(57, 96, color=color)
    images = example.capture.intensities
    raw = color_mosaic(images) if color else mono_mosaic(images)
    capture, scene = simulated_mosaic(raw.astype(np.float32), color), example.scene
    there, here = (separate(capture, scene, device=device) for device in ("cpu", None))
    np.testing.assert_allclose(there.layers, here.layers, atol=5e-3)


def test_captures_solved_together_end_where_each_ends_alone():
    """Two panes of one canvas, one of another, and one capture of another size: groups are told by what they need."""
    examples = [
        blend(57, 64, ghost_shift=4.3),
        blend(57, 64, ghost_shift=4.3, noise=0.01),
        blend(40, 64, azimuth_deg=100.0, ghost_shift=4.3),
        blend(57, 48, ghost_shift=4.3),
    ]
    stopping = StoppingRule(max_evaluations=12)
    captures = [example.capture for example in examples]
    # Found each for itself: how well is tested elsewhere.
    blind = {"scene": SceneParameters(None, None, 4.3), "model": "ghosts", "stopping": stopping}
    together = list(separate_many(captures, device="cpu", **blind))
    for capture, result in zip(captures, together, strict=True):
        alone = separate(capture, **blind)
        assert result.scene == alone.scene
        assert result.layers.shape == alone.layers.shape
        np.testing.assert_allclose(result.layers, alone.layers, atol=2e-3)
        assert result.seconds["Solving"] >= 0


def test_captures_solved_together_take_the_options_of_one():
    example = blend(57, 64, ghost_shift=4.3)
    told: list[str] = []
    options = {"refractive_index": 1.5, "single_surface": False, "progress": lambda stage, _: told.append(stage)}
    captures = [example.capture, blend(57, 64, ghost_shift=4.3, noise=0.01).capture]
    for result in separate_many(captures, example.scene, device="cpu", start=None, **options):
        assert result.scene == example.scene
    assert "Solving" in told
    start = example.layers.astype(np.float32)
    for result in separate_many(captures, example.scene, device="cpu", start=start, init="cold"):
        assert result.layers.shape == start.shape
    with pytest.raises(TypeError, match="nonsense"):
        list(separate_many(captures, example.scene, device="cpu", nonsense=1))


def test_frames_of_a_film_are_worked_out_on_a_device_as_each_alone():
    frames = [blend(57, 80, ghost_shift=4.3, noise=noise).capture for noise in (0.005, 0.006, 0.007)]
    pane = blend(57, 80, ghost_shift=4.3).scene
    film = separate_sequence(frames, pane, device="cpu")
    for frame, result in zip(frames, film, strict=True):
        np.testing.assert_allclose(result.layers, separate(frame, pane).layers, atol=2e-3)


def test_only_problems_of_one_canvas_are_alike():
    assert alike(problem_of()) == alike(problem_of())
    assert alike(problem_of()) != alike(problem_of(color=False))
    assert alike(problem_of()) != alike(problem_of(SceneParameters(57.0, 33.0, 14.0)))


def test_a_device_that_is_not_there_is_an_error_of_one_line():
    example = blend(57, 64)
    with pytest.raises(InputError, match=r"device 'nonsense' cannot be used"):
        separate(example.capture, example.scene, device="nonsense")
    with pytest.raises(InputError, match=r"device 'cpu' is for the solver lbfgs or torch, not scipy"):
        separate(example.capture, example.scene, "scipy", device="cpu")


def quadratics(n: int = 50):
    """Three convex functions with minima at 1, 2 and 3, of curvatures that spread over a factor of 3 to 100."""
    curvatures = torch.stack([torch.logspace(0, power, n) for power in (0.5, 1, 2)])
    minima = torch.tensor([[1.0], [2.0], [3.0]])

    def objective(points):
        apart = points - minima
        return 0.5 * (curvatures * apart.square()).double().sum(dim=1), curvatures * apart

    return objective, minima


def test_each_objective_of_a_batch_is_minimized_by_its_own_steps():
    objective, minima = quadratics()
    found = minimize_all(objective, torch.zeros(3, 50), StoppingRule(relative_change=1e-7))
    np.testing.assert_allclose(found.points, np.broadcast_to(minima, (3, 50)), atol=2e-2)
    assert [result.status.success for result in found.results] == [True] * 3
    # The easier one needs fewer evaluations, and makes no more.
    assert found.results[0].n_evaluations < found.results[2].n_evaluations


@pytest.mark.parametrize(
    ("stopping", "apart", "atol"),
    # By the minimum what processors round otherwise decides whether one more is looked at, so that it stops before.
    # After a hundred steps that has moved a few of them.
    [(StoppingRule(max_evaluations=30, gradient_norm=1e-3), 0, 1e-3), (StoppingRule(relative_change=1e-6), 6, 1e-2)],
)
def test_a_batch_takes_the_steps_that_one_alone_takes(stopping, apart, atol):
    objective, _ = quadratics()
    found = minimize_all(objective, torch.zeros(3, 50), stopping)
    for i, result in enumerate(found.results):

        def alone(x, i=i):
            values, gradients = objective(torch.from_numpy(x)[None].expand(3, -1))
            return float(values[i]), gradients[i].numpy()

        expected = get_solver("lbfgs").minimize(alone, np.zeros(50, np.float32), stopping)
        assert result.n_evaluations == pytest.approx(expected.n_evaluations, abs=apart)
        np.testing.assert_allclose(found.points[i], expected.x, atol=atol)


def test_a_batch_stops_where_the_rule_says_so_and_at_what_is_not_finite():
    objective, _ = quadratics()
    few = minimize_all(objective, torch.zeros(3, 50), StoppingRule(max_evaluations=3))
    assert {result.n_evaluations for result in few.results} == {3}

    def broken(points):
        values, gradients = objective(points)
        values[1] = torch.nan
        return values, gradients

    found = minimize_all(broken, torch.zeros(3, 50), StoppingRule(relative_change=1e-6))
    assert [result.status.success for result in found.results] == [True, False, True]
    assert found.results[1].status is Status.NOT_FINITE
    np.testing.assert_array_equal(found.points[1], np.zeros(50))
