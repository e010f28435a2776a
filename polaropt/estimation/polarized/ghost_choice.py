"""Ghosts before polarized light by a capture's tiles: whether there are any, where they lie, and whose light it is.

Tiles are asked (`StokesTiles`) at the panes in place that show what the capture shows, each with its ghosts anywhere
along its azimuth, at panes of any azimuth before two polarized layers, and at those that mean spectra find. The
likeliest pane is taken, with the least and most usual polarized light that explains the tiles as well: of one layer
rather than both, and of the mirrored one, as skies are, rather than a screen.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from polaropt.estimation.polarized.cross_relation import CrossRelation
from polaropt.estimation.polarized.light import (
    HIGHEST_DEG,
    INCIDENCE,
    LOWEST_DEG,
    OF_REFLECTION,
    OF_TRANSMISSION,
    SHIFT,
    Candidate,
    Place,
    Point,
    bounded,
    free_numbers,
    point_showing,
    shown_by,
    with_one_polarized,
)
from polaropt.estimation.polarized.likelihood import ghost_step
from polaropt.estimation.polarized.tiles import StokesTiles, TileFit
from polaropt.optics import GHOST_SHIFT_SEARCH_PX, SceneParameters, brewster_angle_deg

Values = NDArray[np.float64]

_LEAST_GAIN, _SURE = 50.0, 1.5
"""Log likelihood, and standard errors, that ghosts must gain. Of 60 random windows with ghosts before polarized light
(those to fit on, of 192 pixels) true ones gained 80 and 1.7 and more but in four, where none were found; where the
truth was in place the likeliest ones further apart than `_LIKE_BLUR_PX` gained 10 and 0.4 at most, of 70."""
_LIKE_BLUR_PX, _LEAST_GAIN_OF_CLOSE, _SURE_OF_CLOSE = 3.0, 2.0, 3.0
"""Closer ones mimic a blur: log likelihood that they must gain of each tile and colour, with one polarized layer alone,
and standard errors. Of the same windows true ones gained 2.6 and more, others 1.8 at most, with two layers 4.8."""
_SURE_OF_BOTH, _LEAST_DEG_OF_BOTH, _FARTHEST_PX = 3.0, 12.0, GHOST_SHIFT_SEARCH_PX + 2
"""Standard errors that ghosts before two polarized layers must gain, and incidence from which they are believed, as
ghosts in any direction explain a little of everything; and shift up to which a search that leaves its range is. Of 175
random windows in place (`studies.random_windows`, even seeds from 20000 to 23598, 192 and 256 px) one has more, of 152
with ghosts all but three of those that only these tell."""
_NONE_PX = 0.7
"""Ghosts that a fit brings closer are none. Set by hand."""
_TOLD_BETTER, _OF_BOTH, _NOT_HOPELESS = 15.0, 30.0, 150.0
"""Log likelihood of tiles by which a pane must be better than the one that coarse light takes, by how much more where
both layers' light is polarized, and by which others may be worse to be finished by coarse light. The first two by the
transmissions of 58 of these windows, 39.8 dB of what coarse light takes, 40.9 to 41.1 dB with 10 to 20; the last set by
hand."""
_AS_LIKELY, _AS_LIKELY_SKY = 50.0, 20.0
"""Log likelihood of tiles, coarse light and edges that polarized light in both layers must gain, and a screen over a
mirrored sky. By trial on the same windows."""
_SHIFTS: Values = np.concatenate([np.arange(-GHOST_SHIFT_SEARCH_PX, 0), np.arange(1, GHOST_SHIFT_SEARCH_PX + 1)])
"""Shifts that are looked at along the azimuth, in pixels: one apart, all that are searched."""
_PLACES_DEG = (35.0, 60.0)
"""Incidences at which ghosts are looked for in any direction: one at least is near enough. By trial."""
_HOPELESS_PAIR, _LIKELIEST, _MOST_PLACES = 300.0, 16, 4
"""Misfit by which two vectors may be worse at few places for all places to be looked at, the likeliest of these, and of
them, without neighbours, those that are looked at closely. Set by hand."""


def _half_plane(step: float) -> Values:
    """Places (n, 2) a step apart, in pixels to the right and up, of one side and not close to the middle."""
    side = np.arange(-GHOST_SHIFT_SEARCH_PX, GHOST_SHIFT_SEARCH_PX + step / 2, step)
    right, up = (part.ravel() for part in np.meshgrid(side, side))
    distance = np.hypot(right, up)
    inside = (distance > _LIKE_BLUR_PX - step / 2) & (distance <= GHOST_SHIFT_SEARCH_PX)
    inside &= (up > 0) | ((up == 0) & (right > 0))
    return np.stack([right[inside], up[inside]], axis=1)


_PLACES, _FEW_PLACES = _half_plane(1.5), _half_plane(8.0)
"""Of ghosts: all, and few. Set by hand."""
_MOST_PANES, _MOST_FITTED, _MOST_ALONG = 3, 2, 3
"""Panes in place that are looked at, and of these closely, and shifts of these that are fitted. Set by hand."""
_SAME_PX, _SAME_DEG = 1.6, np.array([4.0, 8.0])
"""Shifts (px), and incidences and azimuths, that differ by less are one. Set by hand."""
_LEAST_OFF_DEG = 4.0
"""How far from Brewster's angle its other side is looked at, at least. Set by hand."""
_LAST_TURNS, _FINE_STEPS = 12, (0.3, 0.1)
"""Turns in which the pane that is taken is moved to where all find it likeliest, at most, and steps of derivatives of
the last of them, in those that suit tiles. Set by hand."""
_WEIGHT_OF_COARSE, _WEIGHT_OF_RELATION = 0.1, 2.0
"""What a unit of log likelihood of coarse light, and of the cross relation, counts there, where one of tiles counts 1.
Of 45 random windows to fit on (screens, skies and both with ghosts from 2 px on, even seeds from 9300000 and 9320000,
192 and 256 px) T and R are 4.8 and 7.8 dB below the solve with the scene known without the relation, with steps that
suit tiles alone; 4.0 and 6.7 dB with a weight of 1, 3.9 and 6.3 with 2. Coarse light at 0.03, or at 0.3 where both
layers' light is polarized, gives less; the relation from the first step on 0.2 dB less on 34 windows."""


class Evidence(Protocol):
    """What coarse light and edges say of points."""

    def evidence(self, point: Point) -> float:
        """Minus the log likelihood at a point."""

    def finished(self, candidate: Candidate) -> Any:
        """With the candidate where they are likeliest."""

    def near(self, point: Point) -> Callable[[Point], float]:
        """Minus the log likelihood of points near one."""


def ghosts_told(
    tiles: StokesTiles,
    asked: SceneParameters,
    in_place: Sequence[Candidate],
    found: Sequence[Candidate],
    vectors: Sequence[Values] = (),
) -> list[TileFit]:
    """Panes with ghosts that tiles surely tell, the likeliest first; none where they tell of no ghosts.

    Parameters
    ----------
    tiles : StokesTiles
    asked : SceneParameters
        Fields that are None are to be found.
    in_place : sequence of Candidate
        Panes without ghosts that show what the capture shows, the likeliest first.
    found : sequence of Candidate
        Panes with ghosts that may be the best.
    vectors : sequence of ndarray, shape (2, 3)
        Likely pairs of Stokes vectors that the layers show in place.
    """
    panes = _distinct(in_place)[:_MOST_PANES]
    likely = sorted((tiles.fitted(pane) for pane in panes), key=_misfit)[:_MOST_FITTED]
    plain = min((_nearest(tiles, fit.candidate, asked) for fit in likely), key=_misfit)
    glance = tiles.luminance()
    starts = (*found, *_likely_shifts(glance, panes), *_likely_places(glance, vectors, asked))
    fits = [_nearest(tiles, start, asked) for start in starts]
    fits = [fit for fit in fits if _told(fit, plain)]
    if fits:
        fits += [_nearest(tiles, start, asked) for start in _alike(fits, asked)]
    far = [fit for fit in fits if abs(fit.candidate.point[SHIFT]) > _NONE_PX]
    return sorted(far, key=_misfit)


def likely_starts(found: Sequence[Candidate], fits: Sequence[TileFit]) -> list[Candidate]:
    """Those panes of mean spectra whose ghosts lie where tiles tell them; where none do, the likeliest of tiles.

    Parameters
    ----------
    found : sequence of Candidate
        With ghosts.
    fits : sequence of TileFit
        Those that tiles tell, the likeliest first.
    """
    best = [fit for fit in fits if fits[0].gain_over(fit) < _NOT_HOPELESS]
    shifts = [abs(float(fit.candidate.point[SHIFT])) for fit in best]
    near = [pane for pane in found if any(abs(abs(float(pane.point[SHIFT])) - shift) < _SAME_PX for shift in shifts)]
    return near or [fit.candidate for fit in best[:_MOST_ALONG]]


def settled(
    tiles: StokesTiles, asked: SceneParameters, fits: Sequence[TileFit], taken: Candidate, coarse: Evidence
) -> Candidate:
    """The pane taken, unless tiles tell better: then that of both, coarse light with edges, and tiles.

    Parameters
    ----------
    tiles : StokesTiles
    asked : SceneParameters
    fits : sequence of TileFit
        Those that tiles tell, the likeliest first.
    taken : Candidate
        What coarse light and edges say.
    coarse : Evidence
        Of coarse light and edges.
    """
    own = _nearest(tiles, taken, asked)
    if _single(taken):
        # With both layers polarized tiles explain too much: coarse light and edges tell whether they are.
        fits = [fit for fit in fits if _single(fit.candidate)]
    least = min(_cost(fit) for fit in (*fits, own))
    if _cost(own) - least < _TOLD_BETTER:
        return taken
    starts = {_light(fit.candidate): fit.candidate for fit in reversed(fits) if _cost(fit) - least < _NOT_HOPELESS}
    finished = [coarse.finished(start).candidate for start in starts.values()]
    pairs = [(fit.candidate, fit) for fit in fits] + [(pane, _nearest(tiles, pane, asked)) for pane in finished]
    panes = [pane for pane, fit in pairs if _cost(fit) - least < _TOLD_BETTER]
    scores = {id(pane): tiles.fitted(pane).misfit + coarse.evidence(pane.point) for pane in panes}
    return _most_usual(panes, lambda pane: scores[id(pane)])


def likeliest_near(
    tiles: StokesTiles, asked: SceneParameters, taken: Candidate, coarse: Evidence, relation: CrossRelation
) -> Candidate:
    """The pane near the one taken that tiles, coarse light with edges, and the cross relation find likeliest together.

    Coarse light tells the kind of pane, but is often sure of one beside the true one, and counts less there. What the
    cross relation says lies in valleys that are narrow and bent: the way to them is told without it, and along them go
    ever finer steps.
    """
    free = free_numbers(taken, asked)

    def cost(fit: TileFit) -> float:
        point = fit.candidate.point
        return fit.misfit + _WEIGHT_OF_COARSE * coarse.evidence(point) + _WEIGHT_OF_RELATION * relation.misfit(point)

    def nearest(fit: TileFit, finely: float, of_relation: float) -> TileFit:
        def beside(point: Point) -> Callable[[Point], float]:
            near = coarse.near(point)
            return lambda other: _WEIGHT_OF_COARSE * near(other) + of_relation * relation.misfit(other)

        return tiles.nearest(fit.candidate, free, _LAST_TURNS, beside=beside, finely=finely)

    best = nearest(tiles.fitted(taken), 1.0, 0.0)
    for finely in _FINE_STEPS:
        # The powers of tiles follow a step behind, so that a step may lead astray.
        best = min(best, nearest(best, finely, _WEIGHT_OF_RELATION), key=cost)
    return best.candidate


def _light(candidate: Candidate) -> tuple[bool, bool]:
    return candidate.transmission, candidate.reflection


def _nearest(tiles: StokesTiles, candidate: Candidate, asked: SceneParameters) -> TileFit:
    return tiles.nearest(candidate, free_numbers(candidate, asked))


def _distinct(panes: Sequence[Candidate]) -> list[Candidate]:
    """Panes in place without those that are like an earlier one."""
    kept: list[Candidate] = []
    for pane in panes:
        if not any(_alike_in_place(pane, other) for other in kept):
            kept.append(pane)
    return kept


def _alike_in_place(one: Candidate, other: Candidate) -> bool:
    off = one.point[:SHIFT] - other.point[:SHIFT]
    off[1] = (off[1] + 90) % 180 - 90
    return one.transmission == other.transmission and bool(np.all(np.abs(off) < _SAME_DEG))


def _likely_shifts(tiles: StokesTiles, panes: Sequence[Candidate]) -> list[Candidate]:
    """The panes with ghosts where their tiles are likeliest, along the azimuth."""
    return _first([valley for pane in panes for valley in _valleys(tiles, pane)], _MOST_ALONG)


def _likely_places(tiles: StokesTiles, vectors: Sequence[Values], asked: SceneParameters) -> list[Candidate]:
    """Panes before two polarized layers where their tiles are likeliest, with ghosts in any direction.

    A pane of any incidence and azimuth shows any two vectors, with the light that it takes.
    """
    if asked.azimuth_deg is not None:
        return []
    angles = _PLACES_DEG if asked.incidence_deg is None else (asked.incidence_deg,)
    pairs = [(angle, shown) for angle in angles for pair in vectors for shown in (pair, pair[::-1])]
    glances = [tiles.of_points(_points(*pair, asked, _FEW_PLACES)).min() for pair in pairs]
    found: list[tuple[float, Candidate]] = []
    for pair, glance in zip(pairs, glances, strict=True):
        if glance < min(glances) + _HOPELESS_PAIR:
            points = _points(*pair, asked, _PLACES)
            misfits = tiles.of_points(points)
            order = np.argsort(misfits)[:_LIKELIEST]
            found += [(float(misfits[i]), Candidate(points[i], True, True)) for i in order]
    kept: list[Candidate] = []
    for _, candidate in sorted(found, key=lambda place: place[0]):
        if len(kept) < _MOST_PLACES and not any(_same_place(candidate, other) for other in kept):
            kept.append(candidate)
    fits = [tiles.nearest(_likelier_side(tiles, start), free_numbers(start, asked)) for start in kept]
    return [fit.candidate for fit in sorted(fits, key=_misfit)[:_MOST_FITTED]]


def _points(incidence_deg: float, shown: Values, asked: SceneParameters, places: Values) -> Values:
    """Points (n, 7) of an incidence that show two vectors in place, with ghosts so far to the right and up, (n, 2)."""
    azimuths = np.degrees(np.arctan2(places[:, 1], places[:, 0])).tolist()
    where = (Place(incidence_deg, *numbers) for numbers in zip(azimuths, np.hypot(*places.T).tolist(), strict=True))
    return np.array([bounded(point_showing(place, shown, asked)) for place in where])


def _same_place(one: Candidate, other: Candidate) -> bool:
    """Whether two panes of one incidence have their ghosts close by."""
    first, second = (np.array(ghost_step(pane.point, float(pane.point[SHIFT]))) for pane in (one, other))
    near = min(math.hypot(*(first - second)), math.hypot(*(first + second))) < 2 * _SAME_PX
    return near and one.point[INCIDENCE] == other.point[INCIDENCE]


def _likelier_side(tiles: StokesTiles, pane: Candidate) -> Candidate:
    """A pane with its ghosts there or on the other side."""
    other = pane.point.copy()
    other[SHIFT] *= -1
    return min(pane, replace(pane, point=other), key=lambda one: tiles.fitted(one).misfit)


def _valleys(tiles: StokesTiles, pane: Candidate) -> Iterator[tuple[float, Candidate]]:
    """Least misfits of a pane whose ghosts lie anywhere along its azimuth."""
    misfits = tiles.of_shifts(pane.point, _SHIFTS)
    beside = np.concatenate([[math.inf], misfits, [math.inf]])
    for i in np.flatnonzero((misfits <= beside[:-2]) & (misfits <= beside[2:])):
        moved = pane.point.copy()
        moved[SHIFT] = _SHIFTS[i]
        yield float(misfits[i]), replace(pane, point=moved)


def _first(valleys: list[tuple[float, Candidate]], most: int) -> list[Candidate]:
    """The deepest valleys that lie apart."""
    kept: list[Candidate] = []
    for _, candidate in sorted(valleys, key=lambda valley: valley[0]):
        near = (
            abs(candidate.point[SHIFT] - other.point[SHIFT]) < _SAME_PX and _alike_in_place(candidate, other)
            for other in kept
        )
        if len(kept) < most and not any(near):
            kept.append(candidate)
    return kept


def _told(fit: TileFit, plain: TileFit) -> bool:
    """Whether tiles surely tell of a fit's ghosts."""
    incidence, shift = float(fit.candidate.point[INCIDENCE]), abs(float(fit.candidate.point[SHIFT]))
    gain, sure, single = fit.gain_over(plain), fit.surer_than(plain), _single(fit.candidate)
    if shift < _LIKE_BLUR_PX:
        enough = gain > _LEAST_GAIN_OF_CLOSE * len(fit.misfits) and sure > _SURE_OF_CLOSE
        return enough and single and shift > _NONE_PX
    if shift > _FARTHEST_PX or not (single or incidence > _LEAST_DEG_OF_BOTH):
        return False
    return gain > _LEAST_GAIN and sure > (_SURE if single else _SURE_OF_BOTH)


def _alike(fits: Sequence[TileFit], asked: SceneParameters) -> list[Candidate]:
    """Beside the best fit, and the best with one polarized layer: other light, and beyond Brewster's angle."""
    singles = [fit for fit in fits if _single(fit.candidate)]
    best = {id(fit): fit for part in (fits, singles) if part for fit in [min(part, key=_misfit)]}
    starts = []
    for fit in best.values():
        candidate = fit.candidate
        if _single(candidate):
            starts.append(replace(candidate, transmission=True, reflection=True))
        else:
            starts += [with_one_polarized(candidate.point, part) for part in (OF_TRANSMISSION, OF_REFLECTION)]
        if asked.incidence_deg is None:
            starts.append(_beyond_brewster(candidate, asked))
    return starts


def _beyond_brewster(candidate: Candidate, asked: SceneParameters) -> Candidate:
    """A pane on the other side of Brewster's angle that shows nearly the same in place."""
    brewster = brewster_angle_deg(asked.index)
    off = float(candidate.point[INCIDENCE]) - brewster
    across = brewster - math.copysign(max(abs(off), _LEAST_OFF_DEG), off)
    across = min(max(across, LOWEST_DEG), HIGHEST_DEG)
    point = point_showing(Place(across, *map(float, candidate.point[1:3])), shown_by(candidate.point, asked), asked)
    for part, polarized in ((OF_TRANSMISSION, candidate.transmission), (OF_REFLECTION, candidate.reflection)):
        if not polarized:
            point[part] = candidate.point[part]
    return replace(candidate, point=bounded(point))


def _most_usual(panes: Sequence[Candidate], score: Callable[[Candidate], float]) -> Candidate:
    """The best pane, unless one with more usual polarized light is as likely."""
    best = min(panes, key=score)
    singles = [pane for pane in panes if _single(pane) and score(pane) - score(best) < _AS_LIKELY]
    if not singles:
        return best
    single = min(singles, key=score)
    skies = [pane for pane in singles if pane.reflection and score(pane) - score(single) < _AS_LIKELY_SKY]
    return min(skies or [single], key=score)


def _single(candidate: Candidate) -> bool:
    return not (candidate.transmission and candidate.reflection)


def _cost(fit: TileFit) -> float:
    """Misfit, and what polarized light in both layers must gain."""
    return fit.misfit + (0.0 if _single(fit.candidate) else _OF_BOTH)


def _misfit(fit: TileFit) -> float:
    return fit.misfit
