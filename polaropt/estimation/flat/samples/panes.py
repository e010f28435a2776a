"""Several panes, as tiles of a raw mosaic tell them: how many, where their images lie, and the incidence.

To a mosaic's cells the low pass, and what aliases there, look like a second pane. Tiles of its samples tell windows of
several panes from single ones as those of photographs do: all gaps near the azimuth are looked at, at incidences at
which so many panes in place mirror as the single one does that was found.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from polaropt.estimation.flat.samples.edges import WindowEdges
from polaropt.estimation.flat.samples.single import USUAL_TILES_OF_MOSAIC, free_of_single, likeliest_of_other_index
from polaropt.estimation.flat.windows.likelihood import Window
from polaropt.estimation.flat.windows.search import (
    ANOTHER_DEG,
    NAMES,
    TRIAL_ABSORPTION,
    equivalent_incidences,
    likeliest_apart,
)
from polaropt.estimation.flat.windows.tiles import TileFit, TileLikelihood
from polaropt.optics import INCIDENCE_SEARCH_DEG

_ALONG_PX, _ACROSS_PX = 20.0, 8.0
_GAPS_ALONG_PX, _GAPS_ACROSS_PX = (
    np.arange(-reach, reach + step / 2, step).tolist() for reach, step in ((_ALONG_PX, 2.5), (_ACROSS_PX, 4.0))
)
"""Gaps that are looked at, along the azimuth and to its sides, in pixels of the sensor: those found are followed
farther."""
_WORTH_MORE, _NEAR_PX = 1.0, 1.5
"""Standard errors by which the best window must be likelier than a single pane for another scan, with panes where it
has images; and pixels within which panes were asked before. Set by hand."""
_STEEP_DEG, _STEEP_FROM_DEG = (76.0, 84.0), 50.0
"""Incidences of steep windows, and that of a single pane from which on these are looked at, too. With all of this the
true window, or one as likely, is found of 27 of 34 random windows of several panes beyond 22 degrees
(`studies.random_windows --sensor mono`, fit seeds from 9850000); with gaps up to 12 px, one scan and no steep ones it
was of half."""
_MOST_TILES = 16
"""Tiles that are looked at first. Set by hand: 25 find no more."""
_CANDIDATES, _APART_PX, _APART_DEG = 3, 2.5, 4.0
"""Likely windows that are looked at closely, and how far apart they are. Set by hand."""
_FREE, _SHIFTS = NAMES[:4], NAMES[1:4]
_DOUBT, _OF_SURE, _OF_FEWER, _FEW_EDGES, _OF_MORE, _MORE = 3.0, 0.53, 0.49, 0.005, 9.0, (-0.2, 0.4)
"""Log odds of several panes that tiles find: by the standard errors by which they are likelier than any single pane; by
the share of edges by which the layers have fewer with all images on their side than on the other, whose inverse
hyperbolic sine counts, in units of a few; and less by the share of edges by which the transmission has more than behind
the single pane, as far as it counts: what a wrong pane leaves of the reflection there is edges. Fitted to 154 random
windows (`studies.random_windows --sensor mono`, fit seeds from 9840000), of which 70 have several panes. Of 30 others
(from 9860000) 3 came within 3 dB of the scene known by tiles and edges on either side alone, and lost 8.5 dB on
average; by these odds it is 9 and 4.8 dB."""
_DOUBT_ACROSS, _LEAST_SURE = 1.5, 2.5
"""By how much log odds are less where single panes of other axes are asked, too, with which layers would be exchanged;
and the least standard errors. Of those windows 18 of 25 of several panes beyond 55 degrees have log odds above 1.5, and
one of 67 of one pane, whose noise is strong, across from it."""
_SURER_THAN_GLASS = 2.5
"""Least standard errors by which they must be likelier than a single pane of tinted glass, or of another index than
was told. Of 100 mosaics of single panes beyond 40 degrees and 30 of several (fit seeds 9941000, 9942000 and 9961000 on)
11 and 14 would be taken for several: 4 of the former, tinted or told a wrong index, are likelier by less, and none of
the latter by less than 3."""
_EVEN, NOTABLE_CHANCE = 0.5, 0.4
"""Chance from which on they are taken, and from which on what is not taken may be true all the same."""
_LEAST_ACROSS_DEG = 55.0
"""Least incidence of windows across: only steep panes look like another one across with the layers exchanged. Windows
at 31 and 50 degrees passed for single panes at 84 (an engine of its own)."""
_LEAST_DEG = 12.0
"""Incidence beyond which they are told, as those of photographs in noise are: nearer to the normal, where hardly any
light is polarized, chance windows suit detail best. Set by hand."""
_WORTH_ANOTHER, _SURE_OF_ANOTHER = 2.0, 1.0
"""Standard errors by which two must be likelier than one for a third to be looked for, and a third than two. Of 56 of
those windows 8 are taken for the other number, with 2.0 for the third it would be 12."""


@dataclass(frozen=True)
class LikelyPanes:
    """A window of several panes, and the chance that it, and no single one, is the true one.

    Attributes
    ----------
    fit : TileFit
    chance : float
    """

    fit: TileFit
    chance: float

    @property
    def is_told(self) -> bool:
        """Whether it is to be taken."""
        return self.chance > _EVEN


def several_panes(
    likelihood: TileLikelihood,
    single: TileFit,
    edges: WindowEdges,
    *,
    beside: Sequence[TileFit] = (),
    incidence_open: bool = True,
) -> LikelyPanes | None:
    """The window of two or three panes that may be likelier than a single one; None where none may be.

    Parameters
    ----------
    likelihood : TileLikelihood
        Of a mosaic.
    single : TileFit
        The likeliest single pane.
    edges : WindowEdges
    beside : sequence of TileFit
        Single panes of other axes, than which it must be surely likelier, too.
    incidence_open : bool
        Whether the incidence is to be found; else it is that of the single pane.
    """

    def judged(found: TileFit) -> LikelyPanes:
        # Two thin panes look much like the faces of a single one, whose ghosts may have been missed.
        ghosts = _with_ghosts_of(likelihood, found.window, single, incidence_open)
        panes = _judged(found, (*singles, ghosts), edges, across=bool(beside))
        if panes.chance <= NOTABLE_CHANCE:
            return panes
        # So does glass that lets through, or mirrors, unlike what was told.
        other = _of_other_glass(likelihood, ghosts, incidence_open)
        return (
            panes if found.believed_over(other, USUAL_TILES_OF_MOSAIC) > _SURER_THAN_GLASS else LikelyPanes(found, 0.0)
        )

    singles = (single, *beside)
    two = likeliest_window(likelihood, single, 2, incidence_open=incidence_open)
    # More panes that look alike are seen at less.
    if two.window.incidence_deg <= _least_deg(across=bool(beside)):
        return None
    likely: tuple[TileFit, ...] = (two,)
    if min(map(two.surer_than, singles)) > _WORTH_ANOTHER:
        three = likeliest_window(likelihood, single, 3, incidence_open=incidence_open)
        two, three = (
            min((own, *_begun_from(likelihood, other, own, incidence_open)), key=lambda fit: fit.misfit)
            for own, other in ((two, three), (three, two))
        )
        likely = (three, two) if three.surer_than(two) > _SURE_OF_ANOTHER else (two,)
    panes: list[LikelyPanes] = []
    for fit in likely:
        # Neither ghosts nor edges make it any surer.
        if _surer_than_all(fit, singles) <= _LEAST_SURE:
            continue
        panes.append(judged(fit))
        if panes[-1].is_told:
            return panes[-1]
    notable = (one for one in panes if one.chance > NOTABLE_CHANCE)
    return max(notable, key=lambda one: one.chance, default=None)


def _with_ghosts_of(likelihood: TileLikelihood, window: Window, single: TileFit, incidence_open: bool) -> TileFit:
    """The likeliest single pane that has a ghost where one of the images of a window lies, or the one given."""
    shifts = (window.gap_along, window.pane_shift + window.gap_along, window.pane_shift)
    free = free_of_single(incidence_open=incidence_open)
    starts = [Window(single.window.incidence_deg, shift) for shift in shifts]
    others = [likelihood.nearest(start, single.refractive_index, free) for start in starts]
    return min((single, *others), key=lambda fit: fit.misfit)


def _of_other_glass(likelihood: TileLikelihood, single: TileFit, incidence_open: bool) -> TileFit:
    """The likeliest single pane of tinted glass, or of another refractive index, near one."""
    window, told = single.window, single.refractive_index
    free = (*free_of_single(incidence_open=incidence_open), "absorption")
    dark = likelihood.nearest(replace(window, absorption=TRIAL_ABSORPTION), told, free)
    other = likeliest_of_other_index(likelihood, window, told, incidence_open=incidence_open)
    return min(dark, other, key=lambda fit: fit.misfit)


def _judged(found: TileFit, singles: Sequence[TileFit], edges: WindowEdges, *, across: bool) -> LikelyPanes:
    """How likely a window of several panes is beside single ones: its own, and others.

    These are of its axis, or lie across as well.
    """
    window = found.window
    sure = _surer_than_all(found, singles)
    if window.incidence_deg <= _least_deg(across=across) or sure <= _LEAST_SURE:
        return LikelyPanes(found, 0.0)
    odds = _log_odds(sure, edges.fewer(window), edges.more_behind(window, singles[0].window))
    return LikelyPanes(found, 1 / (1 + math.exp((_DOUBT_ACROSS if across else 0) - odds)))


def _surer_than_all(found: TileFit, singles: Sequence[TileFit]) -> float:
    """Standard errors by which a window is likelier than each of some single panes, as of usual mosaics."""
    return min(found.believed_over(other, USUAL_TILES_OF_MOSAIC) for other in singles)


def _least_deg(*, across: bool) -> float:
    return _LEAST_ACROSS_DEG if across else _LEAST_DEG


def _log_odds(sure: float, fewer_edges: float, more_behind: float) -> float:
    """Of several panes, by standard errors and shares of edges: fewer than on the other side, more than of a single."""
    low, high = _MORE
    by_edges = _OF_FEWER * math.asinh(fewer_edges / _FEW_EDGES) - _OF_MORE * min(max(more_behind, low), high)
    return _OF_SURE * sure + by_edges - _DOUBT


def likeliest_window(
    likelihood: TileLikelihood, single: TileFit, n_panes: int, *, incidence_open: bool = True
) -> TileFit:
    """The likeliest window of so many panes, begun from a single one.

    Parameters
    ----------
    likelihood, single, incidence_open
        As of `several_panes`.
    n_panes : int
    """
    scan = _Scan(likelihood, single, n_panes, incidence_open=incidence_open)
    asked = list(dict.fromkeys((0.0, single.window.pane_shift)))
    best = scan.likeliest(asked)
    if best.surer_than(single) < _WORTH_MORE:
        return best
    # What passes for the ghost of a gap may be that of a pane, for which other gaps are likely.
    window = best.window
    images = dict.fromkeys((window.gap_along, window.pane_shift + window.gap_along, window.pane_shift))
    others = [px for px in images if abs(px) <= _ALONG_PX and all(abs(px - one) > _NEAR_PX for one in asked)]
    return min(best, scan.likeliest(others), key=lambda fit: fit.misfit) if others else best


class _Scan:
    """Windows of so many panes with all gaps, for some shifts of the panes."""

    def __init__(self, likelihood: TileLikelihood, single: TileFit, n_panes: int, *, incidence_open: bool) -> None:
        self._likelihood, self._single, self._n_panes = likelihood, single, n_panes
        self._glance = likelihood.some(_MOST_TILES)
        self._powers = self._glance.powers(single)
        self._free = free_numbers(incidence_open=incidence_open)
        angle = single.window.incidence_deg
        self._angles = _incidences(angle, n_panes, single.refractive_index) if incidence_open else [angle]

    def likeliest(self, panes: Sequence[float]) -> TileFit:
        """The likeliest window near the best of those whose panes shift images so far."""
        index = self._single.refractive_index
        windows = [
            Window(angle, pane, along, across, self._n_panes)
            for pane, along, across, angle in product(panes, _GAPS_ALONG_PX, _GAPS_ACROSS_PX, self._angles)
        ]
        misfits = [self._glance.glanced(window, index, self._powers) for window in windows]
        kept = likeliest_apart(windows, misfits, _CANDIDATES, _are_apart)
        best = min((self._nearest(windows[i]) for i in kept), key=lambda fit: fit.misfit)
        return min(best, self._nearest(_exchanged(best.window)), key=lambda fit: fit.misfit)

    def _nearest(self, window: Window) -> TileFit:
        return self._likelihood.nearest(window, self._single.refractive_index, self._free)


def _incidences(single_deg: float, n_panes: int, refractive_index: float) -> list[float]:
    """Incidences at which so many panes may look like a single one.

    In place they look like a steeper one; steep ones whose images lie apart look like no single one.
    """
    alike = equivalent_incidences(single_deg, n_panes, refractive_index)
    steep = _STEEP_DEG if single_deg > _STEEP_FROM_DEG else ()
    return [*alike, *(angle for angle in steep if angle > max(alike) + _APART_DEG)]


def _exchanged(window: Window) -> Window:
    """The window whose gaps and panes change places: its images lie where those of the other do."""
    return replace(
        window,
        pane_shift=window.pane_shift + window.gap_along,
        gap_along=-window.gap_along,
        gap_across=-window.gap_across,
    )


def free_numbers(*, incidence_open: bool = True) -> tuple[str, ...]:
    """Names of the numbers of a window of several clear panes that are to be found."""
    return _FREE if incidence_open else _SHIFTS


def _begun_from(likelihood: TileLikelihood, other: TileFit, own: TileFit, incidence_open: bool) -> list[TileFit]:
    """Likely windows of as many panes as its own, whose panes stand as those of another number do."""
    if not incidence_open:
        return []
    fewer = other.window.n_panes - own.window.n_panes
    starts = [
        replace(other.window, incidence_deg=other.window.incidence_deg + fewer * step, n_panes=own.window.n_panes)
        for step in ANOTHER_DEG
    ]
    low, high = INCIDENCE_SEARCH_DEG
    return [
        likelihood.nearest(start, own.refractive_index, _FREE) for start in starts if low < start.incidence_deg < high
    ]


def _are_apart(one: Window, other: Window) -> bool:
    """Whether two windows are no neighbours of a scan."""
    gap = math.hypot(one.gap_along - other.gap_along, one.gap_across - other.gap_across)
    return gap > _APART_PX or abs(one.incidence_deg - other.incidence_deg) > _APART_DEG
