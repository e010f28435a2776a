"""How a pane stands before a pinhole camera, from the directions of polarization over the frame.

Unpolarized layers leave no light polarized at 45 degrees to the plane of incidence, in any pixel. Where the azimuth
turns over the frame, this alone tells the pane's normal, and the focal length as well.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from polaropt.pane_program import AZIMUTH, INCIDENCE, VIEW, PaneFit, fitted, with_errors
from polaropt.perspective import plane_normal, viewing_angles
from polaropt.plate_frame import StokesImages
from polaropt.polarized_blocks import PolarizedBlocks

Values = NDArray[np.float64]

_COARSE_BLOCKS = 12
_FOCAL_RATIOS = (0.6, 1.0, 2.0, 5.0)
_INCIDENCES_DEG = (10.0, 25.0, 40.0, 55.0, 68.0, 80.0)
_AZIMUTHS_DEG = tuple(range(0, 360, 15))
_N_STARTS = 4


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


def fit_perspective(stokes: StokesImages, focal_px: float | None = None) -> PerspectiveFit:
    """Fit normal and focal length: from a grid on large blocks, then on small ones.

    Parameters
    ----------
    stokes : StokesImages
    focal_px : float, optional
        Focal length, where it is known.
    """
    coarse, fine = PolarizedBlocks(stokes, _COARSE_BLOCKS), PolarizedBlocks(stokes)
    free = (INCIDENCE, AZIMUTH) if focal_px is not None else (INCIDENCE, AZIMUTH, VIEW)
    starts = _starts(coarse, focal_px)
    rough = [fitted(coarse, start, free) for start in starts]
    best = min(rough, key=lambda point: coarse.misfit(*named(point, coarse)))
    fit = with_errors(fine, fitted(fine, best, free), free)
    return _result(fine, fit)


def named(point: Values, blocks: PolarizedBlocks) -> tuple[float, float, float]:
    """Incidence and azimuth in degrees and focal length in pixels of a flat pane's point."""
    incidence_deg, azimuth_deg = np.degrees(point[[INCIDENCE, AZIMUTH]])
    return float(incidence_deg), float(azimuth_deg), blocks.half_px / float(point[VIEW])


def _result(blocks: PolarizedBlocks, fit: PaneFit) -> PerspectiveFit:
    incidence, azimuth, focal = named(fit.point, blocks)
    errors = np.sqrt(np.diag(fit.covariance))
    in_degrees = np.degrees(errors[[INCIDENCE, AZIMUTH]])
    focal_error = focal * float(errors[VIEW] / fit.point[VIEW])
    misfit = blocks.misfit(incidence, azimuth, focal)
    return PerspectiveFit(
        incidence, azimuth % 360, focal, float(in_degrees[0]), float(in_degrees[1]), focal_error, misfit, blocks.n
    )


def _starts(blocks: PolarizedBlocks, focal_px: float | None) -> list[Values]:
    """The best points of a grid, the valleys' floors among them."""
    ratios = _FOCAL_RATIOS if focal_px is None else (focal_px / (2 * blocks.half_px),)
    grid = [
        (math.radians(incidence), math.radians(azimuth), 0.5 / ratio, 0.0, 0.0, 0.0)
        for incidence in _INCIDENCES_DEG
        for azimuth in _AZIMUTHS_DEG
        for ratio in ratios
    ]
    points = np.array(grid)
    best = np.argsort(_misfits(blocks, points))[:_N_STARTS]
    return [points[i] for i in best]


def _misfits(blocks: PolarizedBlocks, points: Values) -> Values:
    """Sum of the squares across for flat panes (n, 6)."""
    incidence, azimuth, view = points[:, [INCIDENCE, AZIMUTH, VIEW]].T
    normal = np.array([plane_normal(*np.degrees(pair)) for pair in zip(incidence, azimuth, strict=True)]).T
    x, y = blocks.places
    _, cos, sin = viewing_angles(normal[..., None], view[:, None], x, y)
    s11, s12, s22 = blocks.moments
    return np.asarray((cos * cos) @ s22 - 2 * (cos * sin) @ s12 + (sin * sin) @ s11)
