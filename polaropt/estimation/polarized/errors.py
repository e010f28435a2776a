"""Standard errors of a pane and of both layers' polarized light, from the curvature of their likelihood."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from polaropt.estimation.polarized.light import (
    AZIMUTH,
    INCIDENCE,
    MOST_ANGLE_ERROR_DEG,
    MOST_DEGREE_ERROR,
    SHIFT,
    Point,
    degrees_mirrored,
)
from polaropt.numerics import turn_between
from polaropt.optics import GHOST_SHIFT_SEARCH_PX, SceneErrors, SceneParameters

Values = NDArray[np.float64]

# Factor on standard errors, and what is added to them in squares, with ghosts and in place: of incidence and azimuth
# (degrees), ghost shift (px), and of each layer's light degree and angle (degrees) of polarization.
_WIDER = 3.6
_LEAST = np.array([0.8, 0.5, 0.18, 0.01, 0.5, 0.1, 0.5])
_LEAST_IN_PLACE = np.array([5.0, 4.0, 0.0, 0.02, 2.0, 0.1, 20.0])
"""Measured on 48 scenes of photographs that no figure is taken of, screens and skies. In place several panes show the
same, and which of them is the true one is told by what is likely of screens and skies alone."""
# Least second derivative along one coordinate (of the log likelihood, per coordinate squared), and least one in any
# direction, as a share where each coordinate's is 1. Both set by hand.
_LEAST_CURVATURE, _FLATTEST = 1e-6, 3e-3
# Error of an incidence, which is at most 90 degrees, or an azimuth, an axis, that leaves it wholly open.
_MOST_ERROR_DEG = 90.0
# Step of derivatives, in standard errors of a coordinate alone. Set by hand.
_SLOPE_STEP = 1e-3
# Degree of polarization below which light is unpolarized, a rounding error. Set by hand.
_UNPOLARIZED = 1e-6


_OF_DEGREE = 0.02
"""Standard error of the degree of polarization that a mirrored scene of unpolarized light shows. Measured on 42 random
windows to fit on of a screen behind a pane with ghosts (`studies.random_windows`): it is off by 0.016, the median."""


def incidence_reach(incidence_deg: float, asked: SceneParameters) -> float:
    """How far an incidence, in degrees, may lie off as mirrored unpolarized light shows nearly the same degree there.

    At Brewster's angle it is fully polarized, and hardly less beside: curvature there says nothing of the error.
    """
    incidences, degrees = degrees_mirrored(asked)
    here = float(np.interp(incidence_deg, incidences, degrees))
    other = np.abs(degrees - here) > _OF_DEGREE
    below, above = other & (incidences < incidence_deg), other & (incidences > incidence_deg)
    first = incidences[below].max(initial=float(incidences[0]))
    last = incidences[above].min(initial=float(incidences[-1]))
    return float(min(incidence_deg - first, last - incidence_deg))


def polarized_errors(
    point_at: Callable[[Values], Point], x: Values, curvature: Values, free: NDArray[np.intp]
) -> SceneErrors:
    """Standard errors from the curvature of the likelihood, widened by what it does not know.

    Parameters
    ----------
    point_at : callable
        From coordinates (n,) to the point that they say.
    x : ndarray, shape (n,)
        Coordinates of the pane found.
    curvature : ndarray, shape (n, n)
        Second derivatives of minus the log likelihood there.
    free : ndarray of int
        Which of incidence, azimuth and ghost shift (0, 1, 2) were found.
    """
    scale = 1 / np.sqrt(np.maximum(np.diag(curvature), _LEAST_CURVATURE))
    size, axes = np.linalg.eigh(curvature * np.outer(scale, scale))
    covariance = (axes / np.maximum(size, _FLATTEST)) @ axes.T * np.outer(scale, scale)
    slopes = np.stack([_slope(point_at, x, i, _SLOPE_STEP * float(scale[i])) for i in range(x.size)], axis=1)
    spread = _WIDER * np.sqrt(np.maximum(np.diag(slopes @ covariance @ slopes.T), 0))
    point = point_at(x)
    errors = np.hypot(spread, _LEAST if point[SHIFT] else _LEAST_IN_PLACE)
    errors[:3] = np.minimum(errors[:3], [_MOST_ERROR_DEG, _MOST_ERROR_DEG, GHOST_SHIFT_SEARCH_PX])
    incidence, azimuth, shift = (float(errors[i]) if i in free else None for i in (INCIDENCE, AZIMUTH, SHIFT))
    return SceneErrors(
        incidence,
        azimuth,
        shift,
        transmission_polarization=_of_light(point[3:5], errors[3:5]),
        reflection_polarization=_of_light(point[5:7], errors[5:7]),
    )


def _of_light(numbers: Values, errors: Values) -> tuple[float, float] | None:
    """Errors of degree and angle; None for light that is not polarized."""
    if math.hypot(*numbers) < _UNPOLARIZED:
        return None
    return min(float(errors[0]), MOST_DEGREE_ERROR), min(float(errors[1]), MOST_ANGLE_ERROR_DEG)


def _slope(point_at: Callable[[Values], Point], x: Values, i: int, step: float) -> Values:
    """Derivatives of a scene's seven numbers."""
    move = np.zeros(x.size)
    move[i] = step
    after, before = _numbers(point_at(x + move)), _numbers(point_at(x - move))
    change = after - before
    # Angles of polarization come round after half a turn.
    change[[4, 6]] = turn_between(change[[4, 6]], 0.0)
    return change / (2 * step)


def _numbers(point: Point) -> Values:
    """Incidence, azimuth, shift, and degree and angle (in the camera's frame) of both layers' light."""
    numbers = point.copy()
    for first in (3, 5):
        along, turned = point[first : first + 2]
        numbers[first] = math.hypot(along, turned)
        numbers[first + 1] = point[AZIMUTH] + math.degrees(math.atan2(turned, along)) / 2
    return numbers
