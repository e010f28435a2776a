"""Ghosts before polarized light by a capture's tiles: whether there are any, where they lie, and whose light it is.

Tiles are asked (`StokesTiles`) at the panes in place that show what the capture shows, each with its ghosts anywhere,
and at those that mean spectra find. The likeliest pane is taken, with the least and most usual polarized light that
explains the tiles as well: of one layer rather than both, and of the mirrored one, as skies are, rather than a screen.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

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
)
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
_FAR_SHIFTS: Values = np.concatenate(
    [sign * np.arange(3.0, GHOST_SHIFT_SEARCH_PX + 1, 1.5)[::sign] for sign in (-1, 1)]
)
"""Those that are looked at turned. Set by hand."""
_TURNS_DEG = (-18.0, -12.0, -6.0, 6.0, 12.0, 18.0)
"""Directions of ghosts that are looked at, from the azimuth of one polarized layer: light polarized in both may have
turned it. Set by hand."""
_MOST_PANES, _MOST_FITTED, _MOST_ALONG, _MOST_TURNED = 3, 2, 3, 1
"""Panes in place that are looked at, and of these closely, and shifts of these that are fitted, along the azimuth and
turned. Set by hand."""
_SAME_PX, _SAME_DEG = 1.6, np.array([4.0, 8.0])
"""Shifts (px), and incidences and azimuths, that differ by less are one. Set by hand."""
_LEAST_OFF_DEG = 4.0
"""How far from Brewster's angle its other side is looked at, at least. Set by hand."""


_LAST_TURNS = 12
"""Turns in which tiles move the pane that is taken: along narrow valleys, in which four stand still. Set by hand."""


class Evidence(Protocol):
    """What coarse light and edges say of points."""

    def evidence(self, point: Point) -> float:
        """Minus the log likelihood at a point."""

    def finished(self, candidate: Candidate) -> Any:
        """With the candidate where they are likeliest."""


def ghosts_told(
    tiles: StokesTiles, asked: SceneParameters, in_place: Sequence[Candidate], found: Sequence[Candidate]
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
    """
    panes = _distinct(in_place)[:_MOST_PANES]
    likely = sorted((tiles.fitted(pane) for pane in panes), key=_misfit)[:_MOST_FITTED]
    plain = min((_nearest(tiles, fit.candidate, asked) for fit in likely), key=_misfit)
    fits = [_nearest(tiles, start, asked) for start in (*found, *_likely_shifts(tiles.luminance(), panes, asked))]
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


def moved_by_tiles(tiles: StokesTiles, asked: SceneParameters, taken: Candidate) -> Candidate:
    """The pane near the one taken that tiles find likeliest, where the light of one layer is polarized.

    Coarse light tells the kind of pane, and is often sure of one beside the true one: of 81 random windows to fit on
    with such ghosts (192 px) 33 come within 3 dB of the scene known where coarse light puts them, 40 where tiles do.
    With both layers polarized tiles explain too much to tell better.
    """
    if not _single(taken):
        return taken
    return tiles.nearest(taken, free_numbers(taken, asked), _LAST_TURNS).candidate


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


def _likely_shifts(tiles: StokesTiles, panes: Sequence[Candidate], asked: SceneParameters) -> list[Candidate]:
    """The panes with ghosts where their tiles are likeliest, along the azimuth and turned."""
    along = [valley for pane in panes for valley in _valleys(tiles, pane.point, pane, _SHIFTS)]
    turned: list[tuple[float, Candidate]] = []
    if asked.azimuth_deg is None:
        for pane in panes[:_MOST_FITTED]:
            incidence, azimuth, _ = (float(x) for x in pane.point[:3])
            shown, both = shown_by(pane.point, asked), replace(pane, transmission=True, reflection=True)
            for turn in _TURNS_DEG:
                point = bounded(point_showing(Place(incidence, azimuth + turn, 0.0), shown, asked))
                turned += _valleys(tiles, point, both, _FAR_SHIFTS)
    return [*_first(along, _MOST_ALONG), *_first(turned, _MOST_TURNED)]


def _valleys(tiles: StokesTiles, point: Values, light: Candidate, shifts: Values) -> Iterator[tuple[float, Candidate]]:
    """Least misfits of a point whose ghosts lie anywhere."""
    misfits = tiles.of_shifts(point, shifts)
    beside = np.concatenate([[math.inf], misfits, [math.inf]])
    for i in np.flatnonzero((misfits <= beside[:-2]) & (misfits <= beside[2:])):
        moved = point.copy()
        moved[SHIFT] = shifts[i]
        yield float(misfits[i]), replace(light, point=moved)


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
    gain, sure, shift = fit.gain_over(plain), fit.surer_than(plain), abs(float(fit.candidate.point[SHIFT]))
    if shift < _LIKE_BLUR_PX:
        enough = gain > _LEAST_GAIN_OF_CLOSE * len(fit.misfits) and sure > _SURE_OF_CLOSE
        return enough and _single(fit.candidate) and shift > _NONE_PX
    return gain > _LEAST_GAIN and sure > _SURE


def _alike(fits: Sequence[TileFit], asked: SceneParameters) -> list[Candidate]:
    """Beside the best fit, and the best with one polarized layer: with both, and beyond Brewster's angle."""
    singles = [fit for fit in fits if _single(fit.candidate)]
    best = {id(fit): fit for part in (fits, singles) if part for fit in [min(part, key=_misfit)]}
    starts = []
    for fit in best.values():
        candidate = fit.candidate
        if _single(candidate):
            starts.append(replace(candidate, transmission=True, reflection=True))
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
