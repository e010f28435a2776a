"""How a bent pane stands, from the directions of polarization and the edges of the layers.

The directions tell how the pane's normal turns across the line of sight, but hardly its incidence, nor how that changes
along the azimuth: from far, a steeper and more bent pane turns the directions alike. What they leave open comes from
the edges of the layers, which fall together least at the true pane. An unknown focal length begins with what lenses
usually have.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from polaropt.pane_edges import MIDDLE_BLOCKS, Candidate, PaneEdges, candidate_near, named
from polaropt.pane_program import (
    AZIMUTH,
    BEND,
    FROM_AFAR,
    INCIDENCE,
    N_NUMBERS,
    USUAL_VIEW,
    VIEW,
    VIEW_SPREAD,
    PaneFit,
    Prior,
    fitted,
)
from polaropt.perspective_fit import flat_pane
from polaropt.plate_frame import StokesImages
from polaropt.polarized_blocks import PolarizedBlocks
from polaropt.scene import SceneParameters
from polaropt.varying_overlap import VaryingOverlap

Values = NDArray[np.float64]

_COARSE_BLOCKS = 12
# Standard errors by which a lens must be told from one that sees all from far.
_SHOWS = 3.0
# Errors of azimuth, view and bend from six numbers at once are a little small: of 56 scenes' bends 90 % lie within two.
_WIDER = np.array([1.0, 1.35, 1.1, 1.2, 1.2, 1.2])
_BEND_SPREAD, _INCIDENCE_SPREAD = math.radians(15), math.radians(12)
# Difference of chi squared up to which the directions leave both planes of incidence open.
_AS_LIKELY = 20.0


@dataclass(frozen=True)
class CurvedFit:
    """A bent pane that turns the azimuth as the polarized light tells.

    Attributes
    ----------
    incidence_deg, azimuth_deg : float
        At the middle of the frame.
    focal_px : float or None
        None where it was not given and the pane may as well be seen from far.
    bend_deg_per_px : (float, float, float)
        As in `SceneParameters`.
    incidence_error_deg, azimuth_error_deg, focal_error_px : float
        Standard errors; of a focal length that was given or is None, 0.
    bend_error_deg_per_px : (float, float, float)
    misfit : float
        Mean square of the light that is polarized across, in units of its noise: 1 where the model holds.
    n : int
        Number of blocks times colours that it is the mean of.
    """

    incidence_deg: float
    azimuth_deg: float
    focal_px: float | None
    bend_deg_per_px: tuple[float, float, float]
    incidence_error_deg: float
    azimuth_error_deg: float
    focal_error_px: float
    bend_error_deg_per_px: tuple[float, float, float]
    misfit: float
    n: int


def fit_curved(
    stokes: StokesImages, plain: SceneParameters, focal_px: float | None = None, enough: float = 0.0
) -> CurvedFit:
    """Fit normal, bend and, unless it is given, focal length.

    Parameters
    ----------
    stokes : StokesImages
    plain : SceneParameters
        The flat pane seen from far that explains the capture best: where to begin, and index and surfaces.
    focal_px : float, optional
        Focal length, where it is known.
    enough : float
        Share of what the plain pane leaves on large blocks below which no more is looked at: the pane is not bent so,
        and its errors are infinite.
    """
    blocks, overlap = PolarizedBlocks(stokes), VaryingOverlap(stokes, plain)
    prior, free = _beforehand(blocks, plain, focal_px)
    coarse = PolarizedBlocks(stokes, _COARSE_BLOCKS)
    rough = _rough(coarse, _starts(stokes, plain, blocks.half_px, prior.mean[VIEW]), free, prior)
    left, plain_left = coarse.misfit(*named(rough[0], coarse)), coarse.least_constant_misfit()
    if plain_left - left < enough * (plain_left - 1) or not overlap.usable:
        # A view beyond that of parallel rays has no focal length.
        seen = rough[0] if rough[0][VIEW] > FROM_AFAR else _from_afar(rough[0])
        return _result(blocks, PaneFit(seen, np.full((N_NUMBERS, N_NUMBERS), math.inf)))
    found = _likeliest(blocks, rough, free, prior)
    edges = PaneEdges(overlap, PolarizedBlocks(stokes, MIDDLE_BLOCKS))
    if len(found) > 1:
        found = sorted((edges.asked(candidate) for candidate in found), key=edges.log_overlap)
    best = edges.completed(found[0])
    if focal_px is None and not _lens_shows(best.fit):
        remote = candidate_near(blocks, best.prior, _OTHERS, _from_afar(best.fit.point))
        best = edges.completed(replace(remote, asked=best.asked))
    return _result(blocks, best.fit)


_OTHERS = (INCIDENCE, AZIMUTH, *BEND)
_ALL = (INCIDENCE, AZIMUTH, VIEW, *BEND)


def _beforehand(
    blocks: PolarizedBlocks, plain: SceneParameters, focal_px: float | None
) -> tuple[Prior, tuple[int, ...]]:
    """What is known of a pane before it is looked at, and which numbers are to be found."""
    view = USUAL_VIEW if focal_px is None else blocks.half_px / focal_px
    spread = np.array([_INCIDENCE_SPREAD, math.inf, VIEW_SPREAD, *3 * [_BEND_SPREAD]])
    mean = np.array([math.radians(plain.values()[0]), 0.0, view, 0.0, 0.0, 0.0])
    return Prior(mean, np.diag(1 / spread**2)), _ALL if focal_px is None else _OTHERS


def _chi_squared(blocks: PolarizedBlocks, point: Values, prior: Prior) -> float:
    return float(blocks.n * blocks.misfit(*named(point, blocks)) + prior.distance(point))


def _rough(coarse: PolarizedBlocks, starts: list[Values], free: tuple[int, ...], prior: Prior) -> list[Values]:
    """Panes on large blocks, likeliest first."""
    points = [fitted(coarse, start, free, prior) for start in starts]
    return sorted(points, key=lambda point: _chi_squared(coarse, point, prior))


def _likeliest(blocks: PolarizedBlocks, rough: list[Values], free: tuple[int, ...], prior: Prior) -> list[Candidate]:
    """The likeliest pane by directions, and one whose plane of incidence lies across if it is about as likely."""
    across = [point for point in rough if math.cos(2 * (point[AZIMUTH] - rough[0][AZIMUTH])) < 0]
    found = [candidate_near(blocks, prior, free, point) for point in (rough[0], *across[:1])]
    values = [_chi_squared(blocks, candidate.fit.point, prior) for candidate in found]
    enough = min(values) + _AS_LIKELY * max(1.0, min(values) / blocks.n)
    return [candidate for candidate, value in zip(found, values, strict=True) if value <= enough]


def _starts(stokes: StokesImages, plain: SceneParameters, half_px: float, view: float) -> list[Values]:
    """The best flat pane before the lens, and the plain one leaning any way: bent enough, all may fit."""
    incidence, azimuth, _ = plain.values()
    plains = [(math.radians(incidence), math.radians((azimuth + turn) % 360)) for turn in (0, 90, 180, 270)]
    return [flat_pane(stokes, half_px / view), *(np.array([*angles, view, 0.0, 0.0, 0.0]) for angles in plains)]


def _lens_shows(fit: PaneFit) -> bool:
    """Whether the focal length is known to be shorter than one that sees all from far."""
    return bool(fit.point[VIEW] - FROM_AFAR > _SHOWS * math.sqrt(fit.covariance[VIEW, VIEW]))


def _from_afar(point: Values) -> Values:
    """The same for a lens that sees all from far."""
    point = point.copy()
    point[VIEW] = FROM_AFAR
    return point


def _result(blocks: PolarizedBlocks, fit: PaneFit) -> CurvedFit:
    incidence, azimuth, focal, bend = named(fit.point, blocks)
    errors = _WIDER * np.sqrt(np.diag(fit.covariance))
    in_degrees = np.degrees(errors)
    b_xx, b_xy, b_yy = np.degrees(bend)
    e_xx, e_xy, e_yy = in_degrees[list(BEND)] / blocks.half_px
    return CurvedFit(
        incidence,
        azimuth % 360,
        None if focal == math.inf else focal,
        (float(b_xx), float(b_xy), float(b_yy)),
        float(in_degrees[INCIDENCE]),
        float(in_degrees[AZIMUTH]),
        0.0 if focal == math.inf else focal * float(errors[VIEW] / fit.point[VIEW]),
        (float(e_xx), float(e_xy), float(e_yy)),
        blocks.misfit(incidence, azimuth, focal, bend),
        blocks.n,
    )
