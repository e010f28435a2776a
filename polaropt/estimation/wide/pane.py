"""How a pane stands, from the light polarized across its plane of incidence: IPOPT with exact derivatives and bounds.

A pane is a point of six numbers: incidence and azimuth at the middle, half the longer side over the focal length, and
the three of its bend, angles in radians and lengths in units of half the longer side, so that all are of one order.
Programs are built once for a number of blocks; the blocks come in as parameters.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from importlib import import_module
from typing import Any

import numpy as np
from numpy.typing import NDArray

from polaropt.estimation.wide.blocks import PolarizedBlocks
from polaropt.optics import bent_normal, viewing_angles

Values = NDArray[np.float64]
Numbers = tuple[int, ...]

INCIDENCE, AZIMUTH, VIEW, BEND = 0, 1, 2, (3, 4, 5)
N_NUMBERS = 6
ALONG_INCIDENCE = np.eye(N_NUMBERS)[INCIDENCE]

# Half the longer side over the focal length of a usual lens, and its spread.
USUAL_VIEW, VIEW_SPREAD = 0.4, 0.25

# Focal length over the longer side: from a fisheye's middle to a telephoto lens that sees everything in parallel.
SHORTEST, LONGEST = 0.4, 30.0
FROM_AFAR = 0.0
_STEEPEST = np.radians(86.0)
_MOST_BENT = np.radians(40.0)
_LOW = np.array([np.radians(0.5), -2 * np.pi, 0.5 / LONGEST, *3 * [-_MOST_BENT]])
# A bent pane's view may come out a little beyond that of parallel rays, so that its errors are those of an open end.
_BEYOND = -0.3
_HIGH = np.array([_STEEPEST, 4 * np.pi, 0.5 / SHORTEST, *3 * [_MOST_BENT]])
_LEAST_CURVATURE = 1e-12
_OPTIONS = {"print_level": 0, "sb": "yes", "tol": 1e-7, "mu_init": 1e-3, "max_iter": 100}


@dataclass(frozen=True)
class Prior:
    """What is known beforehand of the six numbers: means (6,) and precision (6, 6); 0 where nothing is."""

    mean: Values
    precision: Values

    def told(self, direction: Values, value: float, error: float) -> Prior:
        """With a measurement of the numbers along a direction (6,), and its standard error."""
        information = direction / error**2
        precision = self.precision + np.outer(direction, information)
        mean = np.linalg.pinv(precision, hermitian=True) @ (self.precision @ self.mean + information * value)
        return Prior(mean, precision)

    def distance(self, point: Values) -> float:
        """Squared distance of a point in standard errors."""
        return float((point - self.mean) @ self.precision @ (point - self.mean))


NOTHING = Prior(np.zeros(N_NUMBERS), np.zeros((N_NUMBERS, N_NUMBERS)))


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


def fitted(blocks: PolarizedBlocks, start: Values, free: Numbers, prior: Prior = NOTHING) -> Values:
    """The minimum near a start.

    Parameters
    ----------
    blocks : PolarizedBlocks
    start : ndarray, shape (6,)
    free : tuple of int
        Which of the six numbers are fitted; the others stay.
    prior : Prior
    """
    program, chosen = _program(blocks.places.shape[1], free), list(free)
    low, high = _LOW.copy(), _HIGH
    if set(BEND) <= set(free):
        low[VIEW] = _BEYOND
    low, high = low[chosen], high[chosen]
    start_there = np.clip(start[chosen], low, high)
    found = program.solver(x0=start_there, p=_told(blocks, start, prior), lbx=low, ubx=high)
    point = start.copy()
    point[chosen] = np.asarray(found["x"]).ravel()
    return point


def with_errors(blocks: PolarizedBlocks, point: Values, free: Numbers, prior: Prior = NOTHING) -> PaneFit:
    """The minimum with the covariance of its errors.

    From curvature and scatter of the gradient between parts of the frame (a block jackknife's limit): so residuals that
    are larger than the noise, or alike in neighbouring blocks, widen it as much as they matter.
    """
    program, chosen = _program(blocks.places.shape[1], free), list(free)
    curvature, gradients = program.curvature(point[chosen], _told(blocks, point, prior))
    parts = blocks.grouped(np.asarray(gradients))
    scatter = parts.T @ parts * len(parts) / max(1, len(parts) - 1)
    told = _at_least_noise(np.asarray(curvature), scatter)
    known = prior.precision[np.ix_(chosen, chosen)]
    inverse = np.linalg.pinv(np.asarray(curvature) + known, hermitian=True)
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


def _told(blocks: PolarizedBlocks, point: Values, prior: Prior) -> Values:
    """The program's parameters: numbers that stay, the prior and the blocks."""
    told = [point, prior.mean, prior.precision, blocks.places, blocks.moments]
    return np.concatenate([part.ravel() for part in told])


@dataclass(frozen=True)
class _Program:
    """The minimizer, and curvature (free, free) and gradients (blocks, free) of the misfit's half sum of squares."""

    solver: Any
    curvature: Any


@lru_cache(maxsize=8)
def _program(n_blocks: int, free: Numbers) -> _Program:
    casadi = import_module("casadi")
    unknown = casadi.MX.sym("unknown", len(free))
    n, m = N_NUMBERS, N_NUMBERS**2
    told = casadi.MX.sym("told", 2 * n + m + 5 * n_blocks)
    fixed, mean, precision, rest = casadi.vertsplit(told, [0, n, 2 * n, 2 * n + m, told.numel()])
    point = [unknown[free.index(i)] if i in free else fixed[i] for i in range(N_NUMBERS)]
    halves = _half_squares(point, *casadi.vertsplit(rest, n_blocks))
    misfit = casadi.sum1(halves)
    away = casadi.vertcat(*point) - mean
    # Per block, so that tolerances mean the same for all numbers of them.
    objective = (misfit + casadi.bilin(casadi.reshape(precision, n, n), away, away) / 2) / n_blocks
    told_ipopt = {"print_time": False, "error_on_fail": False, "ipopt": _OPTIONS}
    solver = casadi.nlpsol("pane", "ipopt", {"x": unknown, "p": told, "f": objective}, told_ipopt)
    curvature, _ = casadi.hessian(misfit, unknown)
    return _Program(
        solver, casadi.Function("curvature", [unknown, told], [curvature, casadi.jacobian(halves, unknown)])
    )


def _half_squares(point: list[Any], x: Any, y: Any, s11: Any, s12: Any, s22: Any) -> Any:
    """Half the square of what each block's light has across the plane of incidence, symbolically."""
    casadi = import_module("casadi")
    incidence, azimuth, view, *bend = point
    across = casadi.sin(incidence)
    normal = across * casadi.cos(azimuth), across * casadi.sin(azimuth), casadi.cos(incidence)
    _, cos, sin = viewing_angles(bent_normal(normal, tuple(bend), view, x, y), view, x, y)
    return (cos * cos * s22 - 2 * cos * sin * s12 + sin * sin * s11) / 2
