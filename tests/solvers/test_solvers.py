"""Every registered solver on the same problems."""

from __future__ import annotations

import itertools
import math
import time
from typing import Any

import numpy as np
import pytest

from polaropt import StoppingRule, separate
from solvers.base import SolverResult, Status, ValueAndGrad, Vector
from solvers.registry import get_solver, solver_names
from tests.blends import blend
from tests.checks import assert_gradient

SOLVERS = solver_names()
TO_THE_END = StoppingRule(max_evaluations=3000, relative_change=1e-9)


def quadratic(x: Vector) -> tuple[float, Vector]:
    away = x.astype(np.float64) - np.linspace(-1, 2, x.size)
    return 1 + 0.5 * float(away @ away), away.astype(np.float32)


def ill_conditioned(x: Vector) -> tuple[float, Vector]:
    away = np.logspace(0, 2, x.size) * (x.astype(np.float64) - 1)
    return 1 + 0.5 * float(away @ away), (np.logspace(0, 2, x.size) * away).astype(np.float32)


def rosenbrock(x: Vector) -> tuple[float, Vector]:
    a, b = x[:-1].astype(np.float64), x[1:].astype(np.float64)
    bend, slope = b - a * a, 1 - a
    gradient = np.zeros(x.size)
    gradient[:-1] = -400 * a * bend - 2 * slope
    gradient[1:] += 200 * bend
    return 1 + float(100 * bend @ bend + slope @ slope), gradient.astype(np.float32)


PROBLEMS = {
    "quadratic": (quadratic, np.full(200, 5.0), 1e-6),
    "ill-conditioned": (ill_conditioned, np.zeros(40), 1e-5),
    "rosenbrock": (rosenbrock, np.tile([-1.2, 1.0], 4), 1e-5),
    "long rosenbrock": (rosenbrock, np.zeros(100), 1e-5),
}
every_problem = pytest.mark.parametrize("problem", PROBLEMS)
every_solver = pytest.mark.parametrize("name", SOLVERS)


def solve(name: str, problem: str, stopping: StoppingRule = TO_THE_END) -> SolverResult:
    objective, start, _ = PROBLEMS[problem]
    return get_solver(name).minimize(objective, start.astype(np.float32), stopping)


def assert_sound(result: SolverResult, objective: ValueAndGrad, start: Any) -> None:
    """What holds for every result, however it ended."""
    assert result.x.dtype == np.float32
    assert result.x.shape == np.shape(start)
    numbers = [point.n_evaluations for point in result.trace]
    assert numbers == sorted(set(numbers))
    assert all(a.seconds <= b.seconds for a, b in itertools.pairwise(result.trace))
    assert len(numbers) <= result.n_evaluations
    assert result.value == min((point.value for point in result.trace), default=math.inf)
    assert result.n_iterations <= result.n_evaluations
    if result.trace:
        assert result.trace[-1].seconds <= result.seconds
        assert all(0 <= a.cpu_seconds <= b.cpu_seconds for a, b in itertools.pairwise(result.trace))
        assert objective(result.x)[0] == pytest.approx(result.value, rel=1e-12)


@pytest.mark.parametrize("problem", PROBLEMS)
def test_the_problems_have_right_gradients(problem: str) -> None:
    objective, start, _ = PROBLEMS[problem]
    assert_gradient(objective, start + 0.1, tolerance=1e-4)


@every_solver
@every_problem
def test_the_minimum_is_reached(name: str, problem: str) -> None:
    objective, start, tolerance = PROBLEMS[problem]
    result = solve(name, problem)
    assert_sound(result, objective, start)
    assert result.value == pytest.approx(1, abs=tolerance)
    assert result.status.success


@pytest.fixture(scope="module")
def separated() -> dict[str, float]:
    """The objective that each solver reaches on a small capture, all with the same rule."""
    example = blend(60, 64, color=False, ghost_shift=1.5)
    rule = StoppingRule(max_evaluations=200, relative_change=1e-5)
    results = {name: separate(example.capture, example.scene, solver=name, stopping=rule) for name in SOLVERS}
    return {name: result.solver.value for name, result in results.items()}


@every_solver
def test_a_separation_ends_at_the_same_value_with_every_solver(name: str, separated: dict[str, float]) -> None:
    assert separated[name] <= 1.001 * min(separated.values())


@every_solver
@pytest.mark.parametrize("problem", ["ill-conditioned", "rosenbrock"])
@pytest.mark.parametrize("scale", [1e-6, 1e6])
def test_the_unit_of_the_objective_does_not_matter(name: str, problem: str, scale: float) -> None:
    objective, start, tolerance = PROBLEMS[problem]

    def scaled(x: Vector) -> tuple[float, Vector]:
        value, gradient = objective(x)
        return scale * value, np.float32(scale) * gradient

    result = get_solver(name).minimize(scaled, start.astype(np.float32), TO_THE_END)
    assert result.value / scale == pytest.approx(1, abs=tolerance)


@every_solver
@every_problem
@pytest.mark.parametrize("limit", [1, 2, 3, 10])
def test_evaluations_are_limited_exactly(name: str, problem: str, limit: int) -> None:
    objective, start, _ = PROBLEMS[problem]
    calls = 0

    def counted(x: Vector) -> tuple[float, Vector]:
        nonlocal calls
        calls += 1
        return objective(x)

    result = get_solver(name).minimize(counted, start.astype(np.float32), StoppingRule(limit, 0.0))
    assert_sound(result, objective, start)
    assert calls == result.n_evaluations <= limit
    assert result.status is Status.EVALUATION_LIMIT or result.status.success
    assert result.value <= objective(start.astype(np.float32))[0]


@every_solver
def test_time_is_limited(name: str) -> None:
    def slow(x: Vector) -> tuple[float, Vector]:
        time.sleep(0.005)
        return rosenbrock(x)

    start = np.tile([-1.2, 1.0], 20).astype(np.float32)
    result = get_solver(name).minimize(slow, start, StoppingRule(10_000, 0.0, seconds=0.05))
    assert result.status is Status.TIME_LIMIT
    assert result.n_evaluations < 20
    assert_sound(result, rosenbrock, start)


@every_solver
def test_the_first_evaluation_is_made_however_short_the_time(name: str) -> None:
    result = solve(name, "quadratic", StoppingRule(seconds=1e-9))
    assert result.n_evaluations == 1
    assert math.isfinite(result.value)


@every_solver
@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
@pytest.mark.parametrize("where", ["value", "gradient"])
def test_a_value_that_is_not_finite_ends_with_the_best_point(name: str, bad: float, where: str) -> None:
    calls = 0

    def breaks(x: Vector) -> tuple[float, Vector]:
        nonlocal calls
        calls += 1
        value, gradient = rosenbrock(x)
        if calls < 8:
            return value, gradient
        return (bad, gradient) if where == "value" else (value, np.full_like(gradient, bad))

    start = np.tile([-1.2, 1.0], 4).astype(np.float32)
    result = get_solver(name).minimize(breaks, start, TO_THE_END)
    assert result.status is Status.NOT_FINITE
    assert not result.status.success
    # Only our own tries again.
    assert (result.n_evaluations, len(result.trace)) == (8 + result.restarts, 7)
    assert result.restarts == (3 if name == "lbfgs" else 0)
    assert_sound(result, rosenbrock, start)


@every_solver
def test_a_first_value_that_is_not_finite_gives_the_start_back(name: str) -> None:
    start = np.arange(5.0, dtype=np.float32)
    result = get_solver(name).minimize(lambda x: (math.nan, x), start, TO_THE_END)
    assert (result.status, result.n_evaluations, result.trace) == (Status.NOT_FINITE, 1, [])
    assert result.value == math.inf
    np.testing.assert_array_equal(result.x, start)
    assert not np.shares_memory(result.x, start)


@every_solver
def test_a_loose_tolerance_stops_earlier_but_not_at_once(name: str) -> None:
    loose, tight = (solve(name, "rosenbrock", StoppingRule(3000, change)) for change in (1e-2, 1e-10))
    assert loose.status is Status.CONVERGED
    assert 2 <= loose.n_iterations < tight.n_iterations
    # Even a tolerance that every iteration fails needs two of them.
    assert solve(name, "rosenbrock", StoppingRule(3000, 1e9)).n_iterations == 2


@every_solver
def test_one_slow_iteration_is_not_the_end(name: str) -> None:
    # A long first slope that hardly falls, before the valley.
    def slope_then_valley(x: Vector) -> tuple[float, Vector]:
        value, gradient = quadratic(x)
        return 1e6 + value, gradient

    result = get_solver(name).minimize(slope_then_valley, np.full(200, 5, np.float32), StoppingRule(100, 1e-4))
    assert result.value < 1e6 + 2


@every_solver
def test_a_small_gradient_stops(name: str) -> None:
    result = solve(name, "quadratic", StoppingRule(100, 0.0, gradient_norm=1e-3))
    assert result.status is Status.SMALL_GRADIENT
    assert np.abs(quadratic(result.x)[1]).max() <= 1e-3


@every_solver
def test_a_start_at_the_minimum_is_one_evaluation(name: str) -> None:
    result = get_solver(name).minimize(lambda x: (0.0, 0 * x), np.ones(3, np.float32), StoppingRule())
    assert (result.status, result.n_evaluations, result.value) == (Status.SMALL_GRADIENT, 1, 0)


@every_solver
@pytest.mark.parametrize("dtype", [np.int64, np.float32, np.float64])
def test_any_start_gives_float32(name: str, dtype: Any) -> None:
    start = np.full(7, 3, dtype)
    kept = start.copy()
    result = get_solver(name).minimize(quadratic, start, TO_THE_END)
    assert_sound(result, quadratic, start)
    np.testing.assert_array_equal(start, kept)


@every_solver
def test_an_interrupt_passes_through(name: str) -> None:
    def interrupted(x: Vector) -> tuple[float, Vector]:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        get_solver(name).minimize(interrupted, np.ones(3, np.float32), StoppingRule())
