"""Minima of functions of one variable, and of a few in a box."""

from __future__ import annotations

import math

import numpy as np
import pytest

from polaropt.numerics.minima import Box, grid_minimum, local_minima, local_minimum, vertex


def test_the_vertex_of_a_parabola():
    assert vertex(1.44, 0.04, 0.64) == pytest.approx(0.2)
    assert vertex(0.0, 1.0, 0.0) == 0
    assert vertex(math.inf, 1.0, 2.0) == 0
    assert vertex(9.0, 4.0, 1.0) == 1
    assert vertex(9.0, 4.0, 1.0, farthest=1.5) == 1.5


@pytest.mark.parametrize("start", [40.0, 47.0, 52.0])
def test_a_minimum_is_found_in_few_evaluations(start):
    seen = []

    def value(x):
        seen.append(x)
        return math.log1p((x - 45.3) ** 2)

    assert local_minimum(value, start, (0.5, 88.0), 2.0, 0.2) == pytest.approx(45.3, abs=0.05)
    assert len(seen) == len(set(seen)) <= 17


def test_bounds_are_kept():
    seen = []

    def value(x):
        seen.append(x)
        return -x

    assert 86 < local_minimum(value, 87.0, (0.5, 88.0), 2.0, 0.2) <= 88
    assert max(seen) <= 88


def test_the_minimum_of_values_on_a_grid_lies_between_its_points():
    points = np.arange(-3.0, 4.0) / 2
    assert grid_minimum(points, (points - 0.3) ** 2) == pytest.approx(0.3)
    # Values that merely fall tell no minimum: the last point that has two neighbours.
    assert grid_minimum(points, points) == points[1]


def test_local_minima_lie_inside():
    values = np.array([[0.0, 2, 1, 1, 3, 0], [3, 1, 2, 2, 2, 5]])
    expected = [[False, False, False, True, False, False], [False, True, False, False, True, False]]
    np.testing.assert_array_equal(local_minima(values), expected)


@pytest.mark.parametrize("width", [0.0, 1e-3, 0.1, 1.9, 2.0, 50.0])
def test_a_box_may_be_narrower_than_its_steps(width: float) -> None:
    """nlopt refuses a first step of more than half of the room that there is."""
    least = np.array([0.25, 0.75]) * width
    box = Box(np.full(2, 0.9 * width), np.ones(2), np.zeros(2), np.full(2, width))
    found = box.minimum(lambda x: float(np.sum((x - least) ** 2)), 200, 1e-6)
    np.testing.assert_allclose(found, least, atol=1e-3 * max(width, 1e-9))
