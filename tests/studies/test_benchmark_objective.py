"""The benchmark's differentiable objective is polaropt's."""

from __future__ import annotations

from copy import copy

import numpy as np
import pytest

pytest.importorskip("torch")

from polaropt.capture.capture import Capture
from polaropt.solving.objective import Misfit, Weights, build_objective, term_names
from polaropt.solving.problem import Problem
from polaropt.solving.starts import take_start
from studies.benchmark.autograd import AutogradObjective
from tests.blends import blend

WEIGHTS = Weights(misfit=0.7, gradient_sparsity=1.3, natural_image=0.9, edge_independence=20.0, nonnegativity=0.5)


def problem_of(size: int, color: bool, share: float = 0.0) -> Problem:
    example = blend(60, size, color=color)
    valid = np.random.default_rng(1).random(example.capture.intensities.shape) >= share
    capture = Capture.of_planes(example.capture.intensities, example.capture.angles_deg, valid)
    return Problem(capture, example.scene, 0.005, WEIGHTS)


@pytest.mark.parametrize("color", [False, True])
@pytest.mark.parametrize("share", [0.0, 0.1])
@pytest.mark.parametrize("init", ["cold", "closed-form"])
def test_value_and_gradient_are_those_of_the_readable_objective(color, share, init):
    problem = problem_of(33, color, share)
    start = take_start(copy(problem), init)
    layers = start + 0.02 * np.random.default_rng(0).standard_normal(start.shape).astype(np.float32)
    readable = problem.readable(start)
    expected, _ = readable.value_and_grad(readable.coordinates(layers))
    misfit = Misfit(problem.capture, problem.pse, problem.canvas, problem.noise)
    analytic = build_objective(misfit, problem.penalties, problem.canvas, WEIGHTS).value_and_grad(layers)
    value, gradient = AutogradObjective(problem, WEIGHTS).value_and_grad(layers)
    assert value == pytest.approx(expected, rel=1e-5)
    assert value == pytest.approx(analytic[0], rel=1e-5)
    assert np.linalg.norm(gradient - analytic[1]) <= 1e-5 * np.linalg.norm(analytic[1])


@pytest.mark.parametrize("left", ["misfit", "gradient_sparsity", "natural_image", "edge_independence", "nonnegativity"])
def test_every_term_can_be_left_out(left):
    weights = Weights(**{name: float(name == left) for name in term_names()})
    problem = problem_of(24, True)
    layers = take_start(copy(problem), "closed-form") - np.float32(0.1)
    misfit = Misfit(problem.capture, problem.pse, problem.canvas, problem.noise)
    expected = build_objective(misfit, problem.penalties, problem.canvas, weights).value_and_grad(layers)[0]
    assert expected > 0
    assert AutogradObjective(problem, weights).value_and_grad(layers)[0] == pytest.approx(expected, rel=1e-5)
