"""How a pane stands before a pinhole camera, from the directions of polarization over the frame.

Unpolarized layers leave no light polarized at 45 degrees to the plane of incidence, in any pixel. Where the azimuth
turns over the frame, this alone tells the pane's normal, and the focal length as well.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from polaropt.perspective import pixel_grid, plane_normal, viewing_angles
from polaropt.plate_frame import StokesImages, block_mean

Values = NDArray[np.float64]

_BLOCKS, _COARSE_BLOCKS = 48, 12
_STEEPEST_DEG = 86.0
# Focal length over the longer side: from a fisheye's middle to a telephoto lens that sees everything in parallel.
_SHORTEST, _LONGEST = 0.4, 30.0
_FOCAL_RATIOS = (0.6, 1.0, 2.0, 5.0)
_INCIDENCES_DEG = (10.0, 25.0, 40.0, 55.0, 68.0, 80.0)
_AZIMUTH_STEP_DEG = 15
_N_STARTS = 8
_MOST_EVALUATIONS = 300
_STEP = 1e-4
_WHOLE = 0.999
# Share of the blocks below which those with clipped pixels must do, too.
_LEAST_SEEN = 0.05


@dataclass(frozen=True)
class PerspectiveFit:
    """Pane and camera that turn the azimuth as the polarized light tells.

    Attributes
    ----------
    incidence_deg, azimuth_deg, focal_px : float
    incidence_error_deg, azimuth_error_deg, focal_error_px : float
        Standard errors; of a focal length that was given, 0.
    misfit : float
        Mean square of the light that is polarized across, in units of its noise: 1 where the model holds.
    n : int
        Number of blocks times colours that it is the mean of.
    """

    incidence_deg: float
    azimuth_deg: float
    focal_px: float
    incidence_error_deg: float
    azimuth_error_deg: float
    focal_error_px: float
    misfit: float
    n: int


class PolarizedBlocks:
    """Polarized light of blocks of a frame, in units of its noise.

    Parameters
    ----------
    stokes : StokesImages
    most : int
        Blocks along the longer side, at most.
    """

    def __init__(self, stokes: StokesImages, most: int = _BLOCKS) -> None:
        height, width = stokes.images.shape[-2:]
        size = max(1, math.ceil(max(height, width) / most))
        means = block_mean(stokes.images[1:], size)
        self.noise = math.sqrt(float(np.trace(stokes.covariance[1:, 1:])) / 2) / size
        # A clipped pixel is no polarized light.
        whole = block_mean(stokes.valid.astype(np.float32), size).min(axis=0).ravel() > _WHOLE
        seen = whole if whole.mean() > _LEAST_SEEN else np.ones_like(whole)
        self._s1, self._s2 = (means.astype(np.float64) / self.noise).reshape(2, means.shape[1], -1)[..., seen]
        x, y = pixel_grid(height, width, ((width - 1) / 2, (height - 1) / 2))
        middle = np.arange(max(means.shape[-2:])) * size + (size - 1) / 2
        columns = np.interp(middle[: means.shape[-1]], np.arange(width), x[0])
        rows = np.interp(middle[: means.shape[-2]], np.arange(height), y[:, 0])
        self._x, self._y = (grid.ravel()[seen] for grid in np.broadcast_arrays(columns[None, :], rows[:, None]))
        self.n = self._s1.size

    def across(self, incidence_deg: float, azimuth_deg: float, focal_px: float) -> Values:
        """Light polarized at 45 degrees to the plane of incidence, flat, in units of its noise."""
        normal = plane_normal(incidence_deg, azimuth_deg)
        _, cos, sin = viewing_angles(normal, focal_px, self._x, self._y)
        return np.asarray(cos * self._s2 - sin * self._s1).ravel()

    def misfit(self, incidence_deg: float, azimuth_deg: float, focal_px: float) -> float:
        """Its mean square."""
        return float(np.mean(np.square(self.across(incidence_deg, azimuth_deg, focal_px))))

    def constant_misfit(self, azimuth_deg: float) -> float:
        """The same for one azimuth all over the frame."""
        double = 2 * math.radians(azimuth_deg)
        return float(np.mean(np.square(math.cos(double) * self._s2 - math.sin(double) * self._s1)))


def fit_perspective(stokes: StokesImages, focal_px: float | None = None) -> PerspectiveFit:
    """Fit normal and focal length: from a grid on large blocks, then on small ones.

    Parameters
    ----------
    stokes : StokesImages
    focal_px : float, optional
        Focal length, where it is known.
    """
    side = max(stokes.images.shape[-2:])
    coarse, fine = PolarizedBlocks(stokes, _COARSE_BLOCKS), PolarizedBlocks(stokes)

    def named(point: Values) -> tuple[float, float, float]:
        focal = focal_px if focal_px is not None else side * math.exp(point[2])
        return float(point[0]), float(point[1]), float(focal)

    starts = _starts(lambda p: coarse.misfit(*named(p)), focal_px is None)
    rough = [_minimized(lambda p: coarse.misfit(*named(p)), start) for start in starts]
    best = min(rough, key=lambda p: coarse.misfit(*named(p)))
    found = _minimized(lambda p: fine.misfit(*named(p)), best)
    errors = _standard_errors(lambda p: fine.across(*named(p)), found)
    incidence, azimuth, focal = named(found)
    focal_error = focal * float(errors[2]) if focal_px is None else 0.0
    misfit = fine.misfit(incidence, azimuth, focal)
    return PerspectiveFit(
        incidence, azimuth % 360, focal, float(errors[0]), float(errors[1]), focal_error, misfit, fine.n
    )


def _starts(misfit: Callable[[Values], float], focal_open: bool) -> list[Values]:
    """The best points of a grid, the valleys' floors among them."""
    focal = [[math.log(ratio)] for ratio in _FOCAL_RATIOS] if focal_open else [[]]
    grid = [
        np.array([incidence, azimuth, *rest])
        for incidence in _INCIDENCES_DEG
        for azimuth in range(0, 360, _AZIMUTH_STEP_DEG)
        for rest in focal
    ]
    grid.sort(key=misfit)
    return grid[:_N_STARTS]


def _minimized(misfit: Callable[[Values], float], start: Values) -> Values:
    import nlopt

    low, high = np.array([0.5, -360.0, math.log(_SHORTEST)]), np.array([_STEEPEST_DEG, 720.0, math.log(_LONGEST)])
    optimizer = nlopt.opt(nlopt.LN_BOBYQA, len(start))
    optimizer.set_lower_bounds(low[: len(start)])
    optimizer.set_upper_bounds(high[: len(start)])
    optimizer.set_initial_step(np.array([5.0, 5.0, 0.2])[: len(start)])
    optimizer.set_min_objective(lambda point, _: misfit(point))
    optimizer.set_maxeval(_MOST_EVALUATIONS)
    optimizer.set_xtol_abs(1e-4)
    return np.asarray(optimizer.optimize(start), dtype=np.float64)


def _standard_errors(residuals: Callable[[Values], Values], point: Values) -> Values:
    """From the curvature at the minimum, widened where the model leaves more than noise."""
    columns = []
    for i in range(len(point)):
        step = np.zeros(len(point))
        step[i] = _STEP * max(1.0, abs(point[i]))
        columns.append((residuals(point + step) - residuals(point - step)) / (2 * step[i]))
    jacobian = np.stack(columns, axis=1)
    left = residuals(point)
    excess = max(1.0, float(np.mean(np.square(left))))
    covariance = np.linalg.pinv(jacobian.T @ jacobian) * excess
    return np.sqrt(np.maximum(np.diag(covariance), 0))
