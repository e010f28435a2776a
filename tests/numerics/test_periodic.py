"""Angles that come round."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from polaropt.numerics import turn_between

ANGLES = st.floats(-1e4, 1e4)


@given(ANGLES, ANGLES, st.sampled_from([180.0, 360.0]))
def test_a_turn_leads_from_one_angle_to_the_other_the_shortest_way(first: float, second: float, period: float) -> None:
    turn = turn_between(first, second, period)
    assert -period / 2 <= turn <= period / 2
    assert math.remainder(second + turn - first, period) == pytest.approx(0, abs=1e-8)


@given(ANGLES, st.integers(-5, 5))
def test_axes_half_a_turn_apart_are_one(angle: float, turns: int) -> None:
    assert turn_between(angle + 180 * turns, angle) == pytest.approx(0, abs=1e-8)
