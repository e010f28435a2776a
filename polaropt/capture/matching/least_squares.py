"""Levenberg and Marquardt's way down a sum of squares of complex numbers, for the few unknowns of a matching."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.floating[Any]]
Curve = tuple[float, Floats, Floats]
"""What is minimized, half its gradient, and its Gauss-Newton matrix."""

_SLACK, _CHANGE = 1e-3, 8.0
"""Damping, as a share of the matrix's diagonal: where it starts, and how it changes; set by hand."""
_RIDGE = 1e-12
"""Added to the diagonal, for numbers that nothing depends on."""


def levenberg_marquardt(
    curve: Callable[[Floats], Curve],
    start: Floats,
    longest: Floats | float,
    *,
    most_steps: int,
    ends: float,
    most_slack: float,
    bounds: tuple[Floats | float, Floats | float] = (-np.inf, np.inf),
) -> tuple[Floats, float]:
    """Numbers (n,) that minimize a curve near those of the start, and what they leave.

    Parameters
    ----------
    curve : callable
    start : ndarray, shape (n,)
    longest : float or ndarray, shape (n,)
        Longest step of each number.
    most_steps : int
        Steps that are tried.
    ends : float
        Share of what is minimized that the last step gains.
    most_slack : float
        Damping at which the way ends.
    bounds : pair of float or ndarray, shape (n,)
        Least and greatest numbers.
    """
    numbers, here, slack = start, curve(start), _SLACK
    for _ in range(most_steps):
        misfit, gradient, matrix = here
        damped = matrix + np.diag(slack * np.diag(matrix) + _RIDGE)
        step = np.clip(np.linalg.solve(damped, -gradient), -longest, longest)
        further = np.clip(numbers + step, *bounds)
        there = curve(further)
        if there[0] < misfit:
            numbers, here = further, there
            slack /= _CHANGE
            if misfit - there[0] < ends * misfit:
                break
        else:
            slack *= _CHANGE
            if slack > most_slack:
                break
    return numbers, here[0]
