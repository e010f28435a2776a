"""How a pane stands, from the light polarized across its plane of incidence: bounded least squares.

A pane is a point of six numbers: incidence and azimuth at the middle, half the longer side over the focal length, and
the three of its bend, angles in radians and lengths in units of half the longer side, so that all are of one order.

A block's polarized light has a main axis; what of it lies across another one goes with the sine of the angle between
the two (in Stokes' plane), plus what no axis explains. Only the sine is fitted: the rest is the same for all panes.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from polaropt.estimation.wide.blocks import PolarizedBlocks
from polaropt.optics import FLAT, INCIDENCE_SEARCH_DEG, bent_normal, incidence_trace, twice_the_azimuth

Values = NDArray[np.float64]
Numbers = tuple[int, ...]

# Places of a point's numbers.
INCIDENCE, AZIMUTH, VIEW, BEND = 0, 1, 2, (3, 4, 5)
N_NUMBERS = 6
ALONG_INCIDENCE = np.eye(N_NUMBERS)[INCIDENCE]

# Half the longer side over the focal length of a usual lens, and its spread: 45 mm before a full frame, 28 to 120. Set
# by hand.
USUAL_VIEW, VIEW_SPREAD = 0.4, 0.25

# Focal length over the longer side: from a fisheye's middle to a telephoto lens that sees everything in parallel. Set
# by hand.
SHORTEST, LONGEST = 0.4, 30.0
# Half the longer side over an infinite focal length.
FROM_AFAR = 0.0
# Incidences at the middle (rad) between which a pane before a lens, or bent, is searched. The upper bound, 86 degrees,
# is lower than that of a pane seen from far: an end of the frame sees the pane at a greater incidence yet. Set by hand.
FRONTAL, STEEPEST = math.radians(INCIDENCE_SEARCH_DEG[0]), math.radians(86.0)
# Most that a pane's normal turns over half the longer side (rad). Set by hand.
_MOST_BENT = math.radians(40.0)
# Bounds of a point; the azimuth's (rad) leave it free to turn.
_LOW = np.array([FRONTAL, -2 * np.pi, 0.5 / LONGEST, *3 * [-_MOST_BENT]])
# A bent pane's view may come out a little beyond that of parallel rays, so that its errors are those of an open end.
# Half the longer side over the focal length, set by hand.
_BEYOND = -0.3
_HIGH = np.array([STEEPEST, 4 * np.pi, 0.5 / SHORTEST, *3 * [_MOST_BENT]])
# Least curvature in any direction, as a share of the largest: rounding errors. Set by hand.
_LEAST_CURVATURE = 1e-12
# Of cost and numbers, relative: panes are the same to four digits. Only those that fit nowhere need more evaluations.
# By trial.
_TOLERANCE, _MOST_EVALUATIONS = 1e-12, 50
# A step so small that its square vanishes beside 1: imaginary, it gives derivatives without a difference.
_IMAGINARY_STEP = 1e-30
# Of second derivatives by differences, in radians and the like: errors of its square beside 1.
_REAL_STEP = 1e-6


@dataclass(frozen=True)
class Prior:
    """What is known beforehand of the six numbers: means (6,) and precision (6, 6); 0 where nothing is."""

    mean: Values
    precision: Values

    def with_measurement(self, direction: Values, value: float, error: float) -> Prior:
        """With a measurement of the numbers along a direction (6,), and its standard error."""
        information = direction / error**2
        precision = self.precision + np.outer(direction, information)
        mean = np.linalg.pinv(precision, hermitian=True) @ (self.precision @ self.mean + information * value)
        return Prior(mean, precision)

    def distance(self, point: Values) -> float:
        """Squared distance of a point in standard errors."""
        return float((point - self.mean) @ self.precision @ (point - self.mean))


NO_PRIOR = Prior(np.zeros(N_NUMBERS), np.zeros((N_NUMBERS, N_NUMBERS)))


@dataclass(frozen=True)
class PaneFit:
    """Six numbers that leave least polarized light across.

    Attributes
    ----------
    point : ndarray, shape (6,)
    covariance : ndarray, shape (6, 6)
        Of their errors; 0 for those that were not fitted.
    """

    point: Values
    covariance: Values


def fitted(blocks: PolarizedBlocks, start: Values, free: Numbers, prior: Prior = NO_PRIOR) -> Values:
    """The minimum near a start.

    Parameters
    ----------
    blocks : PolarizedBlocks
    start : ndarray, shape (6,)
    free : tuple of int
        Which of the six numbers are fitted; the others stay.
    prior : Prior
    """
    from scipy.optimize import least_squares

    chosen, axes, root = list(free), _main_axes(blocks), _root(prior.precision)
    low, high = _LOW.copy(), _HIGH
    if set(BEND) <= set(free):
        low[VIEW] = _BEYOND
    low, high = low[chosen], high[chosen]

    def at(numbers: Values) -> Values:
        point = start.copy()
        point[chosen] = numbers
        return point

    def residuals(numbers: Values) -> Values:
        point = at(numbers)
        return np.concatenate([_across(point, blocks.places, axes), root @ (point - prior.mean)])

    def slopes(numbers: Values) -> Values:
        return np.concatenate([_slopes(at(numbers), free, blocks.places, axes), root[:, chosen]])

    found = least_squares(
        residuals,
        np.clip(start[chosen], low, high),
        slopes,
        (low, high),
        ftol=_TOLERANCE,
        xtol=_TOLERANCE,
        gtol=_TOLERANCE,
        max_nfev=_MOST_EVALUATIONS,
    )
    return at(found.x)


def with_errors(blocks: PolarizedBlocks, point: Values, free: Numbers, prior: Prior = NO_PRIOR) -> PaneFit:
    """The minimum with the covariance of its errors.

    From curvature and scatter of the gradient between parts of the frame (a block jackknife's limit): so residuals that
    are larger than the noise, or alike in neighbouring blocks, widen it as much as they matter.
    """
    chosen, axes = list(free), _main_axes(blocks)
    curvature = _curvature(point, free, blocks.places, axes)
    parts = blocks.grouped(_gradients(point, free, blocks.places, axes))
    scatter = parts.T @ parts * len(parts) / max(1, len(parts) - 1)
    told = _at_least_noise(curvature, scatter)
    known = prior.precision[np.ix_(chosen, chosen)]
    inverse = np.linalg.pinv(curvature + known, hermitian=True)
    covariance = np.zeros((N_NUMBERS, N_NUMBERS))
    covariance[np.ix_(chosen, chosen)] = inverse @ (told + known) @ inverse
    return PaneFit(point, covariance)


def _at_least_noise(curvature: Values, scatter: Values) -> Values:
    """The gradient's scatter, in no direction below the curvature, which is what the noise alone makes it.

    A few bright parts may hold most of what is told, and then scatter too little by chance.
    """
    sizes, directions = np.linalg.eigh(curvature)
    root = directions * np.sqrt(np.maximum(sizes, _LEAST_CURVATURE * sizes.max()))
    inverse = np.linalg.pinv(root)
    ratios, axes = np.linalg.eigh(inverse @ scatter @ inverse.T)
    whitened: Values = root @ (axes * np.maximum(ratios, 1)) @ axes.T @ root.T
    return whitened


def _root(precision: Values) -> Values:
    """A matrix whose square, transposed times itself, is a precision."""
    sizes, axes = np.linalg.eigh(precision)
    return np.asarray(np.sqrt(np.maximum(sizes, 0))[:, None] * axes.T)


def _main_axes(blocks: PolarizedBlocks) -> Values:
    """Main axis of each block's (s1, s2), (2, m), as long as the root of the most that a pane may leave across."""
    s11, s12, s22 = blocks.moments
    length, angle = np.sqrt(np.hypot(s11 - s22, 2 * s12)), np.arctan2(2 * s12, s11 - s22) / 2
    return np.stack([length * np.cos(angle), length * np.sin(angle)])


def _across(point: Any, places: Values, axes: Values) -> Any:
    """What a pane leaves of each block's main axis across the plane of incidence, (m,)."""
    cos, sin = _turn(point, places)
    return cos * axes[1] - sin * axes[0]


def _turn(point: Any, places: Values) -> tuple[Any, Any]:
    """Cosine and sine of twice the azimuth in each block; of complex numbers, too."""
    return twice_the_azimuth(*_trace(normal_at(point), tuple(point[3:]), point[VIEW], places))


def _trace(normal: Any, bend: Any, view: Any, places: Values) -> tuple[Any, Any]:
    """Trace of the plane of incidence in each block; several where normal and bend are columns."""
    return incidence_trace(bent_normal(normal, bend, view, *places), view, *places)


def normal_at(point: Any) -> tuple[Any, Any, Any]:
    """Normal at the middle; of many points at once where their numbers come first."""
    incidence, azimuth = point[:2]
    across = np.sin(incidence)
    return across * np.cos(azimuth), across * np.sin(azimuth), np.cos(incidence)


def _slopes(point: Values, free: Numbers, places: Values, axes: Values) -> Values:
    """Derivatives (m, free) of what lies across.

    The trace of the plane of incidence is linear in the normal, and that in the bend: how the trace moves is the trace
    of how the normal moves. The view alone acts otherwise.
    """
    view = point[VIEW]
    incidence, azimuth = point[[INCIDENCE, AZIMUTH]]
    tilted = np.cos(incidence) * np.cos(azimuth), np.cos(incidence) * np.sin(azimuth), -np.sin(incidence)
    turned = -np.sin(incidence) * np.sin(azimuth), np.sin(incidence) * np.cos(azimuth), 0.0
    moves = {INCIDENCE: (*tilted, *FLAT), AZIMUTH: (*turned, *FLAT)}
    moves |= {number: tuple(part) for number, part in zip(BEND, np.eye(N_NUMBERS)[3:], strict=True)}
    w_x, w_y = _trace(normal_at(point), tuple(point[3:]), view, places)
    cos, sin = twice_the_azimuth(w_x, w_y)
    # What lies across changes with twice the azimuth.
    rate = -2 * (sin * axes[1] + cos * axes[0]) / (w_x * w_x + w_y * w_y + 1e-12)
    slopes = np.empty((places.shape[1], len(free)))
    straight = [column for column, number in enumerate(free) if number != VIEW]
    if straight:
        moved = np.array([moves[free[column]] for column in straight]).T[..., None]
        t_x, t_y = _trace(moved[:3], moved[3:], view, places)
        slopes[:, straight] = (rate * (w_x * t_y - w_y * t_x)).T
    if VIEW in free:
        seen = [*point[:VIEW], view + 1j * _IMAGINARY_STEP, *point[3:]]
        slopes[:, free.index(VIEW)] = _across(seen, places, axes).imag / _IMAGINARY_STEP
    return slopes


def _gradients(point: Values, free: Numbers, places: Values, axes: Values) -> Values:
    """Gradient (m, free) of half the square of what each block has across."""
    return np.asarray(_across(point, places, axes)[:, None] * _slopes(point, free, places, axes))


def _curvature(point: Values, free: Numbers, places: Values, axes: Values) -> Values:
    """Second derivatives (free, free) of half the sum of squares across."""
    moves = _REAL_STEP * np.eye(N_NUMBERS)[list(free)]
    after, before = (
        np.array([_gradients(point + sign * move, free, places, axes).sum(axis=0) for move in moves])
        for sign in (1, -1)
    )
    curvature = (after - before) / (2 * _REAL_STEP)
    return np.asarray(curvature + curvature.T) / 2
