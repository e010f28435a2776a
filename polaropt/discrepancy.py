"""The least change of a start that explains the photographs: Morozov's discrepancy principle along a line."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from polaropt.objective import Term

if TYPE_CHECKING:
    from polaropt.problem import Coordinates

Images = NDArray[np.float32]


def least_change(
    objective: Coordinates, start: Images, end: Images, enough: float
) -> tuple[Images, dict[str, Term], float]:
    """Canvas layers between two others, as near to the first as the misfit allows.

    In whitened coordinates the first steps of a solve go nearly all the way to the minimum. Where the start is better
    than that minimum all beyond the point at which the photographs are explained is lost; and where start and minimum
    err independently, that point is better than both.

    Parameters
    ----------
    objective : Coordinates
    start, end : ndarray, shape (2, channel, H, W)
    enough : float
        Raw misfit to reach.

    Returns
    -------
    layers : ndarray, shape (2, channel, H, W)
        The objective's own, which its next call overwrites.
    terms : dict of str to Term
    share : float
        Of the way from start to end, 0..1.

    References
    ----------
    V. A. Morozov, On the solution of functional equations by the method of regularization, Soviet Mathematics Doklady
    7, 1966.
    """
    ends = (start, end.copy())
    first, middle, last = (_at(objective, *ends, share)[1]["misfit"].value for share in (0.0, 0.5, 1.0))
    share = first_crossing(first, middle, last, enough)
    return (*_at(objective, *ends, share), share)


def _at(objective: Coordinates, start: Images, end: Images, share: float) -> tuple[Images, dict[str, Term]]:
    between = start + np.float32(share) * (end - start)
    return objective.solution(objective.coordinates(between))


def first_crossing(start: float, middle: float, end: float, level: float) -> float:
    """Where between 0 and 1 the parabola through values at 0, 1/2 and 1 first falls to a level; 1 where it does not."""
    if start <= level:
        return 0.0
    curvature = 2 * (start - 2 * middle + end)
    slope = end - start - curvature
    root = slope**2 - 4 * curvature * (start - level)
    if slope >= 0 or root < 0:
        return 1.0
    # The form of the smaller root that does not cancel.
    return min(1.0, 2 * (start - level) / (-slope + math.sqrt(root)))
