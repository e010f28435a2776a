"""Numbers that come round, as angles do."""

from __future__ import annotations

from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

Number = TypeVar("Number", float, NDArray[np.float64])

HALF_TURN_DEG = 180.0
"""After which an axis is the same again."""


def turn_between(first_deg: Number, second_deg: Number | float, period_deg: float = HALF_TURN_DEG) -> Number:
    """By how much the first of two angles is turned against the second, the shortest way.

    Parameters
    ----------
    first_deg, second_deg : float or ndarray
        In degrees.
    period_deg : float
        After which they are the same again: 180 degrees for axes, 360 for directions.

    Returns
    -------
    float or ndarray
        From minus half a period, including it, to half a period.
    """
    return (first_deg - second_deg + period_deg / 2) % period_deg - period_deg / 2
