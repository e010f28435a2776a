"""Our L-BFGS: restarts, determinism, memory."""

from __future__ import annotations

import itertools
import math
import tracemalloc

import numpy as np
import pytest

from polaropt import StoppingRule
from solvers.base import Status
from solvers.lbfgs import HISTORY, LBFGS
from tests.solvers.test_solvers import TO_THE_END, assert_sound, quadratic, rosenbrock

START = np.zeros(100, np.float32)


def failing(objective, when, bad=math.nan):
    """`objective` with a value that is not finite at the evaluations `when`; also the points it was asked for."""
    points = []

    def fails(x):
        points.append(x.copy())
        value, gradient = objective(x)
        return (bad if len(points) in when else value), gradient

    return fails, points


@pytest.mark.parametrize("when", [{2}, {9}, {2, 3}, {5, 20, 40}])
@pytest.mark.parametrize("bad", [math.nan, math.inf])
def test_it_restarts_where_a_value_is_not_finite_and_reaches_the_minimum(when, bad):
    fails, _ = failing(rosenbrock, when, bad)
    result = LBFGS().minimize(fails, START, TO_THE_END)
    assert_sound(result, rosenbrock, START)
    assert result.status.success
    assert result.value == pytest.approx(1, abs=1e-5)
    assert result.restarts == len(when)
    assert len(result.trace) == result.n_evaluations - len(when)


def test_a_restart_begins_at_the_best_point_with_a_tenth_of_the_step():
    fails, points = failing(rosenbrock, {10})
    LBFGS().minimize(fails, START, StoppingRule(11, 0.0))
    best = min(points[:9], key=lambda x: rosenbrock(x)[0])
    failed, next_one = points[9] - best, points[10] - best
    assert np.linalg.norm(next_one) == pytest.approx(0.1 * np.linalg.norm(failed), rel=1e-3)
    slope = rosenbrock(best)[1]
    assert next_one @ slope == pytest.approx(-np.linalg.norm(next_one) * np.linalg.norm(slope), rel=1e-3)


def test_in_whitened_coordinates_the_first_step_leads_to_the_minimum():
    def whitened(x):
        away = (x - np.arange(100) / 100).astype(np.float32)
        return 1 + 0.5 * float(away @ away), away

    result = LBFGS().minimize(whitened, START, StoppingRule())
    assert result.trace[1].value == pytest.approx(1, abs=1e-9)


def test_it_stops_after_as_many_slow_iterations_as_the_rule_says():
    ends = [LBFGS().minimize(rosenbrock, START, StoppingRule(1000, 0.2, slow_iterations=n)) for n in (1, 2, 3)]
    assert len({result.n_iterations for result in ends}) == 3
    for n, result in enumerate(ends, start=1):
        values = [point.value for point in result.trace][-n - 1 :]
        assert result.status is Status.CONVERGED
        assert all(before - after <= 0.2 * after for before, after in itertools.pairwise(values))


def test_a_wall_that_is_not_finite_is_kept_away_from():
    # Like a logarithm: no value beyond 0.9, the minimum of the rest short of it.
    def walled(x):
        with np.errstate(all="ignore"):
            room = 0.9 - x.astype(np.float64)
            return float((-np.log(room) - 3 * x).sum()), (1 / room - 3).astype(np.float32)

    result = LBFGS().minimize(walled, np.full(50, -1, np.float32), TO_THE_END)
    assert result.status.success
    np.testing.assert_allclose(result.x, 0.9 - 1 / 3, atol=1e-3)


def test_after_three_restarts_it_gives_up_with_the_best_point():
    fails, _ = failing(rosenbrock, range(12, 1000))
    result = LBFGS().minimize(fails, START, TO_THE_END)
    assert (result.status, result.restarts, result.n_evaluations) == (Status.NOT_FINITE, 3, 15)
    assert "3 times" in result.sentence
    assert_sound(result, rosenbrock, START)


def test_limits_hold_through_restarts():
    fails, points = failing(rosenbrock, {5, 7})
    result = LBFGS().minimize(fails, START, StoppingRule(7, 0.0))
    assert (result.status, len(points)) == (Status.EVALUATION_LIMIT, 7)


def wide(x):
    """Cheap, ill-conditioned and separable, for many unknowns."""
    stiffness = np.linspace(0.1, 5, x.size, dtype=np.float32)
    away = stiffness * (x - np.float32(0.3))
    return 1 + 0.5 * float(np.square(away).sum(dtype=np.float64)), stiffness * away


def test_the_result_is_the_same_to_the_bit_whatever_the_threads(monkeypatch):
    results = []
    # Several blocks of different lengths.
    for threads in ("1", "2", "2"):
        monkeypatch.setenv("OMP_NUM_THREADS", threads)
        results.append(LBFGS().minimize(wide, np.zeros(700_001, np.float32), StoppingRule(12, 0.0)))
    for other in results[1:]:
        np.testing.assert_array_equal(results[0].x, other.x)
        assert [point.value for point in results[0].trace] == [point.value for point in other.trace]


def test_memory_is_what_the_docstring_says():
    n = 1_000_000
    solver, start = LBFGS(), np.zeros(n, np.float32)
    objective = wide_into(np.empty(n, np.float32))
    # Compiled before the memory is watched.
    solver.minimize(objective, start, StoppingRule(3, 0.0))
    tracemalloc.start()
    solver.minimize(objective, start, StoppingRule(12, 0.0))
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak <= (2 * HISTORY + 3 + 0.1) * 4 * n


def wide_into(gradient):
    """`wide` without memory of its own but what it is made with."""
    stiffness = np.linspace(0.1, 5, gradient.size, dtype=np.float32)

    def objective(x):
        np.subtract(x, np.float32(0.3), out=gradient)
        np.multiply(gradient, stiffness, out=gradient)
        value = 1 + 0.5 * float(np.dot(gradient, gradient))
        np.multiply(gradient, stiffness, out=gradient)
        return value, gradient

    return objective


def test_an_objective_may_reuse_its_gradient():
    gradient = np.empty(100, np.float32)

    def reuses(x):
        value, gradient[:] = rosenbrock(x)
        return value, gradient

    ours, fresh = (LBFGS().minimize(each, START, TO_THE_END) for each in (reuses, rosenbrock))
    np.testing.assert_array_equal(ours.x, fresh.x)


@pytest.mark.parametrize("kind", ["float64", "strided"])
def test_gradients_of_other_kinds_are_understood(kind):
    def other(x):
        value, gradient = rosenbrock(x)
        return value, np.repeat(gradient, 2)[::2] if kind == "strided" else gradient.astype(np.float64)

    assert LBFGS().minimize(other, START, TO_THE_END).value == pytest.approx(1, abs=1e-5)


@pytest.mark.parametrize("scale", [1e-25, 1e-12, 1e12, 1e25])
def test_far_away_units_of_the_objective_do_not_matter(scale):
    def scaled(x):
        value, gradient = quadratic(x)
        return scale * value, np.float32(scale) * gradient

    result = LBFGS().minimize(scaled, np.full(200, 5, np.float32), TO_THE_END)
    assert result.value / scale == pytest.approx(1, abs=1e-6)


@pytest.mark.filterwarnings("error")
def test_a_slope_that_grows_beyond_the_unit_of_the_first_one_is_measured_anew():
    # Next to level at the start, and steep a step away: squares in the first slope's unit are beyond float32.
    def cliff(x):
        away = x.astype(np.float64) - 1
        level = x < 0.5
        value = np.where(level, 1 - 1e-25 * x, np.square(away))
        return float(value.sum()), np.where(level, -1e-25, 2 * away).astype(np.float32)

    result = LBFGS().minimize(cliff, np.zeros(4, np.float32), TO_THE_END)
    assert result.status.success
    np.testing.assert_allclose(result.x, 1, atol=1e-3)
