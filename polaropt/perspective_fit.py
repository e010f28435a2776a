"""How a pane stands before a pinhole camera, from the directions of polarization over the frame.

Unpolarized layers leave no light polarized at 45 degrees to the plane of incidence, in any pixel. Where the azimuth
turns over the frame, this alone tells the pane's normal, and the focal length as well. The edges of the layers tell the
incidence once more: together they are surer, and where they contradict each other the pane is not flat.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from polaropt.pane_edges import MIDDLE_BLOCKS, Candidate, PaneEdges, candidate_near, named
from polaropt.pane_program import ALONG_INCIDENCE, AZIMUTH, INCIDENCE, NOTHING, VIEW, PaneFit, fitted
from polaropt.perspective import FLAT, Pane, plane_normal, viewing_angles
from polaropt.plate_frame import StokesImages
from polaropt.polarized_blocks import PolarizedBlocks
from polaropt.scene import SceneParameters
from polaropt.varying_overlap import VaryingOverlap

Values = NDArray[np.float64]

_COARSE_BLOCKS = 12
_FOCAL_RATIOS = (0.6, 1.0, 2.0, 5.0)
_INCIDENCES_DEG = (10.0, 25.0, 40.0, 55.0, 68.0, 80.0)
_AZIMUTHS_DEG = tuple(range(0, 360, 15))
_N_STARTS = 4
# Error of the incidence above which nothing is asked: directions that tell nothing leave no pane to look at.
_WORST_ASKED = math.radians(10)
# Standard errors, and at least an angle, by which the edges' incidence differs where the pane is not flat.
_AWAY, _LEAST_AWAY = 4.0, math.radians(3)
# Logarithm of edge overlap by which a flat pane before a lens may exceed the plain pane: true ones leave less than that
# or 0.02 more, mistaken ones 0.2 to 0.8 more.
_MORE_OVERLAP = 0.1


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
    edges_agree : bool
        Whether the edges of the layers tell about the same incidence and overlap no more than before the plain pane, as
        they do where the pane is flat.
    """

    incidence_deg: float
    azimuth_deg: float
    focal_px: float
    incidence_error_deg: float
    azimuth_error_deg: float
    focal_error_px: float
    misfit: float
    n: int
    edges_agree: bool


def fit_perspective(
    stokes: StokesImages,
    focal_px: float | None = None,
    plain: SceneParameters = SceneParameters(),  # noqa: B008 (frozen)
) -> PerspectiveFit:
    """Fit normal and focal length: from a grid on large blocks, then on small ones, then with the layers' edges.

    Parameters
    ----------
    stokes : StokesImages
    focal_px : float, optional
        Focal length, where it is known.
    plain : SceneParameters
        Index and surfaces of the pane; the geometry is that of the pane seen from far that explains the capture best.
    """
    blocks, overlap = PolarizedBlocks(stokes), VaryingOverlap(stokes, plain)
    by_directions = candidate_near(blocks, NOTHING, _free(focal_px), flat_pane(stokes, focal_px))
    errors = np.sqrt(np.diag(by_directions.fit.covariance))
    if not overlap.usable or errors[INCIDENCE] > _WORST_ASKED:
        return fit_result(blocks, by_directions.fit, True)
    told, agree = asked_of_edges(by_directions, overlap, PolarizedBlocks(stokes, MIDDLE_BLOCKS), plain)
    return fit_result(blocks, told.fit, agree)


def asked_of_edges(
    pane: Candidate, overlap: VaryingOverlap, blocks: PolarizedBlocks, plain: SceneParameters
) -> tuple[Candidate, bool]:
    """The pane with the incidence that the edges tell, if it is about its own, and whether they agree that it is flat.

    How a bent pane turns the azimuth can look like a flat one before a lens at a wrong incidence: none near it leaves
    less overlap, but far off the plain pane does.
    """
    edges = PaneEdges(overlap, blocks)
    incidence, error = edges.told(pane, ALONG_INCIDENCE)
    if not _incidences_agree(pane.fit, incidence, error):
        return pane, False
    told = pane.told(ALONG_INCIDENCE, incidence, error)
    incidence_deg, azimuth_deg, _ = plain.values()
    of_plain = float(overlap.log(Pane(plane_normal(incidence_deg, azimuth_deg), FLAT, 0.0)).mean())
    return told, edges.log_overlap(told) - of_plain <= _MORE_OVERLAP


def _incidences_agree(by_directions: PaneFit, incidence: float, error: float) -> bool:
    """Whether the incidence of the edges, with its error, is the one that the directions tell; radians."""
    away = abs(incidence - by_directions.point[INCIDENCE])
    told = math.sqrt(by_directions.covariance[INCIDENCE, INCIDENCE])
    return bool(away <= max(_AWAY * math.hypot(error, told), _LEAST_AWAY))


def flat_pane(stokes: StokesImages, focal_px: float | None) -> Values:
    """The point of the flat pane that the directions of polarization on large blocks tell."""
    coarse = PolarizedBlocks(stokes, _COARSE_BLOCKS)
    rough = [fitted(coarse, start, _free(focal_px)) for start in _starts(coarse, focal_px)]
    return min(rough, key=lambda point: coarse.misfit(*named(point, coarse)))


def _free(focal_px: float | None) -> tuple[int, ...]:
    return (INCIDENCE, AZIMUTH) if focal_px is not None else (INCIDENCE, AZIMUTH, VIEW)


def fit_result(blocks: PolarizedBlocks, fit: PaneFit, edges_agree: bool) -> PerspectiveFit:
    """What a fit says of a flat pane."""
    incidence, azimuth, focal, _ = named(fit.point, blocks)
    errors = np.sqrt(np.diag(fit.covariance))
    incidence_error, azimuth_error = (float(np.degrees(errors[i])) for i in (INCIDENCE, AZIMUTH))
    focal_error = focal * float(errors[VIEW] / fit.point[VIEW])
    misfit = blocks.misfit(incidence, azimuth, focal)
    return PerspectiveFit(
        incidence, azimuth % 360, focal, incidence_error, azimuth_error, focal_error, misfit, blocks.n, edges_agree
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
