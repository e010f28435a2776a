"""How a flat or bent pane stands before a lens, from directions of polarization and the edges of the layers.

Unpolarized layers leave no light polarized at 45 degrees to the plane of incidence, in any pixel. Where the azimuth
turns over the frame, this alone tells the pane's normal, and the focal length as well. The edges of the layers tell the
incidence once more: together they are surer, and where they contradict each other the pane is not flat.

The directions tell how the pane's normal turns across the line of sight, but hardly its incidence, nor how that changes
along the azimuth: from far, a steeper and more bent pane turns the directions alike. What they leave open comes from
the edges of the layers, which fall together least at the true pane. An unknown focal length begins with what lenses
usually have.

Metal and sky are polarized, and outshine what the pane does. So a block's polarized light may be unexplained by a share
of itself beside the noise, and blocks that are left far off lose their weight, down to the half that agrees best.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from polaropt.capture import StokesImages
from polaropt.estimation.wide.blocks import COARSE_BLOCKS, PolarizedBlocks
from polaropt.estimation.wide.edges import (
    MIDDLE_BLOCKS,
    MOST_NEGATIVE,
    Candidate,
    PaneEdges,
    VaryingOverlap,
    candidate_near,
    named,
    negative_light,
    pane_at,
)
from polaropt.estimation.wide.pane import (
    ALONG_INCIDENCE,
    AZIMUTH,
    BEND,
    FROM_AFAR,
    INCIDENCE,
    N_NUMBERS,
    NO_PRIOR,
    USUAL_VIEW,
    VIEW,
    VIEW_SPREAD,
    PaneFit,
    Prior,
    fitted,
)
from polaropt.optics import (
    FLAT,
    FOCAL_RANGE_PX,
    Pane,
    SceneParameters,
    incidence_trace,
    plane_normal,
    twice_the_azimuth,
)

Values = NDArray[np.float64]

# Where the search begins: focal lengths over the longer side, incidences and azimuths, of which so many of the best
# points are followed. All set by hand.
_FOCAL_RATIOS = (0.6, 1.0, 2.0, 5.0)
_INCIDENCES_DEG = (10.0, 25.0, 40.0, 55.0, 68.0, 80.0)
_AZIMUTHS_DEG = tuple(range(0, 360, 15))
_N_STARTS = 4
# Ways that a pane may lean that is known from far: the azimuth is one of two across, and of either sense.
_TURNS_DEG = (0.0, 90.0, 180.0, 270.0)
# Spread of the incidence (rad) around that of the plain pane. Set by hand.
_INCIDENCE_SPREAD = math.radians(12)
# Error of the incidence (rad) above which nothing is asked: directions that tell nothing leave no pane to look at. Set
# by hand.
_WORST_INCIDENCE = math.radians(10)
# Standard errors, and at least an angle (rad), by which the edges' incidence differs where the pane is not flat. Set by
# hand.
_AWAY, _LEAST_AWAY = 4.0, math.radians(3)
# Natural logarithm of edge overlap by which a flat pane before a lens, or a bent one, may exceed the plain pane.
# Measured: true ones leave less than that or 0.03 more, mistaken ones 0.2 to 0.8 more.
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
    by_directions = candidate_near(blocks, NO_PRIOR, _free(focal_px), flat_pane(stokes, focal_px))
    errors = np.sqrt(np.diag(by_directions.fit.covariance))
    if not overlap.usable or errors[INCIDENCE] > _WORST_INCIDENCE:
        return fit_result(blocks, by_directions.fit, True)
    completed, agree = with_edges(by_directions, overlap, PolarizedBlocks(stokes, MIDDLE_BLOCKS), plain)
    return fit_result(blocks, completed.fit, agree)


def fit_told_perspective(
    stokes: StokesImages, incidence_deg: float | None, azimuth_deg: float | None, focal_px: float | None
) -> PerspectiveFit:
    """Fit what is left of normal and focal length where incidence or azimuth are told; edges have nothing to add.

    Parameters
    ----------
    stokes : StokesImages
    incidence_deg, azimuth_deg, focal_px : float or None
        None: to be fitted.
    """
    told = {INCIDENCE: incidence_deg, AZIMUTH: azimuth_deg}
    known = {number: math.radians(value) for number, value in told.items() if value is not None}
    free = tuple(number for number in _free(focal_px) if number not in known)
    coarse, blocks = PolarizedBlocks(stokes, COARSE_BLOCKS), PolarizedBlocks(stokes)
    starts = _starts_before_lens(coarse, focal_px, known)
    if not free:
        return fit_result(blocks, PaneFit(starts[0], np.zeros((N_NUMBERS, N_NUMBERS))), True)
    rough = [fitted(coarse, start, free) for start in starts]
    begin = min(rough, key=lambda point: coarse.misfit(*named(point, coarse)))
    return fit_result(blocks, candidate_near(blocks, NO_PRIOR, free, begin).fit, True)


def with_edges(
    pane: Candidate, overlap: VaryingOverlap, blocks: PolarizedBlocks, plain: SceneParameters
) -> tuple[Candidate, bool]:
    """The pane with the incidence that the edges tell, if it is about its own, and whether they agree that it is flat.

    How a bent pane turns the azimuth can look like a flat one before a lens at a wrong incidence: none near it leaves
    less overlap, but far off the plain pane does.
    """
    edges = PaneEdges(overlap, blocks)
    incidence, error = edges.minimum_along(pane, ALONG_INCIDENCE)
    if not _incidences_agree(pane.fit, incidence, error):
        return pane, False
    completed = pane.with_measurement(ALONG_INCIDENCE, incidence, error)
    return completed, edges.log_overlap(completed) - _of_plain(overlap, plain) <= _MORE_OVERLAP


def _of_plain(overlap: VaryingOverlap, plain: SceneParameters) -> float:
    """Log overlap of the layers' edges before the plain pane."""
    incidence_deg, azimuth_deg, _ = plain.values()
    return float(overlap.log(Pane(plane_normal(incidence_deg, azimuth_deg), FLAT, 0.0)).mean())


def _incidences_agree(by_directions: PaneFit, incidence: float, error: float) -> bool:
    """Whether the incidence of the edges, with its error, is the one that the directions tell; radians."""
    away = abs(incidence - by_directions.point[INCIDENCE])
    own = math.sqrt(by_directions.covariance[INCIDENCE, INCIDENCE])
    return bool(away <= max(_AWAY * math.hypot(error, own), _LEAST_AWAY))


def flat_pane(stokes: StokesImages, focal_px: float | None) -> Values:
    """The point of the flat pane that the directions of polarization on large blocks tell."""
    coarse = PolarizedBlocks(stokes, COARSE_BLOCKS)
    rough = [fitted(coarse, start, _free(focal_px)) for start in _starts_before_lens(coarse, focal_px)]
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


def _starts_before_lens(
    blocks: PolarizedBlocks, focal_px: float | None, known: Mapping[int, float] = MappingProxyType({})
) -> list[Values]:
    """The best points of a grid, the valleys' floors among them; numbers that are known are as they are."""
    ratios = _FOCAL_RATIOS if focal_px is None else (focal_px / (2 * blocks.half_px),)
    grid = [
        (math.radians(incidence), math.radians(azimuth), 0.5 / ratio, 0.0, 0.0, 0.0)
        for incidence in _INCIDENCES_DEG
        for azimuth in _AZIMUTHS_DEG
        for ratio in ratios
    ]
    points = np.array(grid)
    for number, value in known.items():
        points[:, number] = value
    points = np.unique(points, axis=0) if known else points
    best = np.argsort(_misfits(blocks, points))[:_N_STARTS]
    return [points[i] for i in best]


def _misfits(blocks: PolarizedBlocks, points: Values) -> Values:
    """Sum of the squares across for flat panes (n, 6)."""
    incidence, azimuth, view = points[:, [INCIDENCE, AZIMUTH, VIEW]].T
    normal = np.array([plane_normal(*np.degrees(pair)) for pair in zip(incidence, azimuth, strict=True)]).T
    x, y = blocks.places
    cos, sin = twice_the_azimuth(*incidence_trace(normal[..., None], view[:, None], x, y))
    s11, s12, s22 = blocks.moments
    return np.asarray((cos * cos) @ s22 - 2 * (cos * sin) @ s12 + (sin * sin) @ s11)


# Standard errors by which a lens must be told from one that sees all from far: 99.7 % of a normal distribution.
_SHOWS = 3.0
# Factors on the errors of a point's numbers. Those of azimuth, view and bend from six numbers at once are a little
# small: of 56 scenes' bends 90 % lie within two.
_BENT_WIDER = np.array([1.0, 1.35, 1.1, 1.2, 1.2, 1.2])
# Spread of each part of the bend: how far the normal turns over half the longer side (rad). Set by hand.
_BEND_SPREAD = math.radians(15)
# Difference of chi squared up to which the directions leave both planes of incidence open. By trial.
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
    edges_agree : bool
        Whether the edges of the layers overlap about as little as before the plain pane, or less, as they do where the
        pane is bent so.
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
    edges_agree: bool


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
    prior, free = _bent_prior(blocks, plain, focal_px)
    coarse = PolarizedBlocks(stokes, COARSE_BLOCKS)
    rough = _rough(coarse, _starts_of_bend(stokes, plain, blocks.half_px, prior.mean[VIEW]), free, prior)
    left, plain_left = coarse.misfit(*named(rough[0], coarse)), coarse.least_constant_misfit()
    if plain_left - left < enough * (plain_left - 1) or not overlap.usable:
        seen = _from_afar(rough[0]) if _has_no_focal_length(rough[0], blocks) else rough[0]
        return _result(blocks, PaneFit(seen, np.full((N_NUMBERS, N_NUMBERS), math.inf)), edges_agree=True)
    found = _likeliest(blocks, rough, free, prior, plain)
    edges = PaneEdges(overlap, PolarizedBlocks(stokes, MIDDLE_BLOCKS))
    if len(found) > 1:
        found = sorted((edges.with_worst_direction(candidate) for candidate in found), key=edges.log_overlap)
    best = edges.completed(found[0])
    if focal_px is None and not _lens_shows(best.fit):
        remote = candidate_near(blocks, best.prior, _OTHERS, _from_afar(best.fit.point))
        losses = [_chi_squared(blocks, one.fit.point, best.prior) for one in (remote, best)]
        as_likely = losses[0] - losses[1] <= _AS_LIKELY * max(1.0, losses[1] / blocks.n)
        if as_likely or _has_no_focal_length(best.fit.point, blocks):
            best = edges.completed(replace(remote, directions=best.directions))
    agree = edges.log_overlap(best) - _of_plain(overlap, plain) <= _MORE_OVERLAP
    return _result(blocks, best.fit, edges_agree=agree)


_OTHERS = (INCIDENCE, AZIMUTH, *BEND)
_ALL = (INCIDENCE, AZIMUTH, VIEW, *BEND)


def _bent_prior(
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


def _before_lens(point: Values) -> Values:
    """The same for a view beyond that of parallel rays: a pane that leans, and is bent, the other way before a lens."""
    if point[VIEW] >= FROM_AFAR:
        return point
    turned = -point
    turned[INCIDENCE], turned[AZIMUTH] = point[INCIDENCE], point[AZIMUTH] + math.pi
    return turned


def _likeliest(
    blocks: PolarizedBlocks, rough: list[Values], free: tuple[int, ...], prior: Prior, plain: SceneParameters
) -> list[Candidate]:
    """The likeliest pane by directions, and one whose plane of incidence lies across if it is about as likely.

    Where layers would have less than no light, one about as likely that leaves them more takes its place.
    """
    points = [_before_lens(point) for point in rough]
    across = [i for i, point in enumerate(points) if math.cos(2 * (point[AZIMUTH] - points[0][AZIMUTH])) < 0]
    negative = [negative_light(blocks, plain, pane_at(point, blocks)) for point in points]
    lit = [i for i, share in enumerate(negative) if share <= MOST_NEGATIVE]
    chosen = sorted({0, *across[:1], *lit[:1], int(np.argmin(negative))})
    found = [candidate_near(blocks, prior, free, points[i]) for i in chosen]
    values = [_chi_squared(blocks, candidate.fit.point, prior) for candidate in found]
    enough = min(values) + _AS_LIKELY * max(1.0, min(values) / blocks.n)
    likely = [candidate for candidate, value in zip(found, values, strict=True) if value <= enough]
    return [candidate for candidate in likely if _lit(blocks, candidate.fit.point, plain)] or likely


def _lit(blocks: PolarizedBlocks, point: Values, plain: SceneParameters) -> bool:
    """Whether the layers have light all over the frame before the pane at a point."""
    return negative_light(blocks, plain, pane_at(point, blocks)) <= MOST_NEGATIVE


def _starts_of_bend(stokes: StokesImages, plain: SceneParameters, half_px: float, view: float) -> list[Values]:
    """The best flat pane before the lens, and the plain one leaning any way, before a lens and from far.

    Bent enough, all may fit. From far a pane looks like one that leans the other way.
    """
    incidence, azimuth, _ = plain.values()
    plains = [(math.radians(incidence), math.radians((azimuth + turn) % 360)) for turn in _TURNS_DEG]
    starts = [np.array([*angles, view, 0.0, 0.0, 0.0]) for angles in plains]
    return [flat_pane(stokes, half_px / view), *starts, *(_from_afar(start) for start in starts[:2])]


def _lens_shows(fit: PaneFit) -> bool:
    """Whether the focal length is known to be shorter than one that sees all from far."""
    return bool(fit.point[VIEW] - FROM_AFAR > _SHOWS * math.sqrt(fit.covariance[VIEW, VIEW]))


def _has_no_focal_length(point: Values, blocks: PolarizedBlocks) -> bool:
    """Whether a view is that of parallel rays, beyond it, or as near as no number tells, however likely it is."""
    return bool(point[VIEW] <= max(FROM_AFAR, blocks.half_px / FOCAL_RANGE_PX[1]))


def _from_afar(point: Values) -> Values:
    """The same for a lens that sees all from far."""
    point = point.copy()
    point[VIEW] = FROM_AFAR
    return point


def _result(blocks: PolarizedBlocks, fit: PaneFit, *, edges_agree: bool) -> CurvedFit:
    incidence, azimuth, focal, bend = named(fit.point, blocks)
    errors = _BENT_WIDER * np.sqrt(np.diag(fit.covariance))
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
        edges_agree,
    )


# Share of its polarized light that a block may have across. Set by hand.
_SHARE = 0.1
# Fits, each with the weights of the one before. Set by hand.
_ROUNDS = 5
# A block counts a quarter where it is this many times as far off as the median, in squares. Set by hand.
_FAR = 2.0
# Factor on errors: weights that the blocks themselves choose make them look surer than they are. Set by hand.
_TOLERANT_WIDER = 2.0


@dataclass(frozen=True)
class TolerantFit:
    """A pane, and what it explains where blocks agree.

    Attributes
    ----------
    pane : PerspectiveFit
        Its misfit is that of the blocks as they are trusted.
    plain_misfit : float
        The same of the best pane that is seen from far.
    """

    pane: PerspectiveFit
    plain_misfit: float

    @property
    def explained(self) -> float:
        """Share of what the pane seen from far leaves that this one explains."""
        return (self.plain_misfit - self.pane.misfit) / max(self.plain_misfit - 1, 1e-9)


def fit_tolerant(
    stokes: StokesImages, plain: SceneParameters, focal_px: float | None = None, enough: float = 0.0
) -> TolerantFit:
    """Fit normal and focal length to the blocks that agree, then ask the layers' edges.

    Parameters
    ----------
    stokes : StokesImages
    plain : SceneParameters
        The flat pane seen from far that explains the capture best: where to begin, and index and surfaces.
    focal_px : float, optional
        Focal length, where it is known; else it begins with what lenses usually have.
    enough : float
        Share explained below which the edges are not looked at.
    """
    blocks = PolarizedBlocks(stokes)
    blocks = blocks.trusted(1 / (1 + _SHARE**2 * blocks.brightness))
    search = _tolerant_prior(blocks, plain, focal_px)
    ways = [_agreed(blocks, _leaning(search.start, turn), search) for turn in _TURNS_DEG]
    best = ways[_most_agreed([_squares(blocks, way.fit.point) for way in ways])]
    plain_misfit = best.blocks.least_constant_misfit()
    found = TolerantFit(fit_result(best.blocks, best.fit, True), plain_misfit)
    overlap = VaryingOverlap(stokes, plain)
    if found.explained < enough or not overlap.usable:
        return found
    completed, agree = with_edges(best, overlap, best.blocks, plain)
    widened = replace(completed.fit, covariance=_TOLERANT_WIDER**2 * completed.fit.covariance)
    return TolerantFit(fit_result(best.blocks, widened, agree), plain_misfit)


@dataclass(frozen=True)
class _Search:
    """Where to begin, what is known beforehand and which numbers are to be found."""

    start: Values
    prior: Prior
    free: tuple[int, ...]


def _tolerant_prior(blocks: PolarizedBlocks, plain: SceneParameters, focal_px: float | None) -> _Search:
    incidence, azimuth, _ = plain.values()
    view = USUAL_VIEW if focal_px is None else blocks.half_px / focal_px
    point, spread = np.zeros(N_NUMBERS), np.full(N_NUMBERS, math.inf)
    point[[INCIDENCE, AZIMUTH, VIEW]] = math.radians(incidence), math.radians(azimuth % 360), view
    spread[[INCIDENCE, VIEW]] = _INCIDENCE_SPREAD, VIEW_SPREAD
    free = (INCIDENCE, AZIMUTH, VIEW) if focal_px is None else (INCIDENCE, AZIMUTH)
    return _Search(point, Prior(point * (spread < math.inf), np.diag(1 / spread**2)), free)


def _leaning(point: Values, turn_deg: float) -> Values:
    """The pane leaning another way."""
    turned = point.copy()
    turned[AZIMUTH] = (point[AZIMUTH] + math.radians(turn_deg)) % (2 * math.pi)
    return turned


def _agreed(blocks: PolarizedBlocks, point: Values, search: _Search) -> Candidate:
    """The pane near a point that most blocks agree on, and their weights."""
    trusted = blocks
    for _ in range(_ROUNDS):
        point = fitted(trusted, point, search.free, search.prior)
        trusted = _weighted(blocks, point)
    return candidate_near(trusted, search.prior, search.free, point)


def _weighted(blocks: PolarizedBlocks, point: Values) -> PolarizedBlocks:
    """Blocks with the less weight the farther off they are left."""
    squares = _squares(blocks, point)
    return blocks.trusted(1 / (1 + squares / (_FAR * max(1.0, float(np.median(squares))))) ** 2)


def _most_agreed(squares: list[Values]) -> int:
    """Index of the least sum over blocks, each counted up to a limit that is the same for all."""
    limit = _FAR * max(1.0, min(float(np.median(part)) for part in squares))
    return int(np.argmin([np.sum(part / (1 + part / limit)) for part in squares]))


def _squares(blocks: PolarizedBlocks, point: Values) -> Values:
    incidence_deg, azimuth_deg, focal, _ = named(point, blocks)
    return blocks.squares(incidence_deg, azimuth_deg, focal)
