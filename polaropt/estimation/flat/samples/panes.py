"""Several panes, as tiles of a raw mosaic tell them: how many, where their images lie, and the incidence.

To a mosaic's cells the low pass, and what aliases there, look like a second pane. Tiles of its samples tell windows of
several panes from single ones as those of photographs do: all gaps near the azimuth are looked at, at incidences at
which so many panes in place mirror as the single one does that was found.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cache, partial
from itertools import product

import numpy as np

from polaropt.estimation.flat.windows.likelihood import Window
from polaropt.estimation.flat.windows.search import ANOTHER_DEG, NAMES, equivalent_incidences, likeliest_apart
from polaropt.estimation.flat.windows.tiles import TileFit, TileLikelihood
from polaropt.optics import INCIDENCE_SEARCH_DEG

_STEP_PX, _ALONG_PX, _ACROSS_PX = 2.0, 12.0, 4.0
"""Spacing of the gaps that are looked at, and how far they reach along the azimuth and to its sides, in pixels of the
sensor. Set by hand: those found are followed farther."""
_MOST_TILES = 25
"""Tiles that are looked at first. Set by hand."""
_CANDIDATES, _APART_PX, _APART_DEG = 3, 2.5, 4.0
"""Likely windows that are looked at closely, and how far apart they are. Set by hand."""
_FREE, _SHIFTS = NAMES[:4], NAMES[1:4]
_SURE, _FEWER = (3.5, 2.8), (0.012, 0.1)
"""Standard errors by which tiles must find several panes likelier than one, and share of edges by which the layers must
have fewer with all images on their side than on the other: one or the other pair. On mosaics of 256x256 of photographs
that no figure is taken of (30 to 72 degrees, noise 0.2 to 1 %, mono and color) 2 of 90 single panes pass, and half of
the windows of two or three."""
_USUAL_TILES, _CLEARLY_FEWER = 49, 0.06
"""Tiles of a mosaic of 256x256, and share of edges up to which no more are believed: what layers are not as the
likelihood takes them to be makes all tiles of larger ones likelier. Of 384x384 (`studies.random_windows --sensor mono`,
fit seeds from 200000) 7 of 74 single panes pass without this, with shares of 0.04 at most but for two across."""
_SURE_ACROSS, _FEWER_ACROSS, _LEAST_ACROSS_DEG = (3.7, 2.5), (0.0, 0.06), 55.0
"""Standard errors, as of so few tiles, and shares of edges, one or the other pair, that are needed where other axes are
asked, too, with which layers would be exchanged, and the least incidence: only steep panes look like another one across
with the layers exchanged. Of 37 random windows of single panes at 60 to 85 degrees (`studies.random_windows --sensor
mono`, even seeds from 180000 and 190000) none has 1.6 and 0.02; of 24 of several (from 170000) 8 lie across, 6 with 2.5
and 0.06 or more. Windows at 31 and 50 degrees passed for single panes at 84 (an engine of its own)."""
_SURE_OF_UNUSUAL, _RESOLVED_PX = 4.5, 2.0
"""The same where panes that shift images by so many pixels, and gaps, shift them to opposite sides, or gaps shift them
rather to the side than along the azimuth, farther than is looked, as of panes that are far from parallel: ghosts of
single panes that lie far off, and patterns, pass for such. Of the mosaics of 384x384 single ones have 4.4 at most (6 of
some 220), of 4 such windows 3 have 4.7 and more."""
_LEAST_DEG = 12.0
"""Incidence beyond which they are told, as those of photographs in noise are: nearer to the normal, where hardly any
light is polarized, chance windows suit detail best. Set by hand."""
_WORTH_ANOTHER, _SURE_OF_ANOTHER = 2.0, 2.0
"""Standard errors by which two must be likelier than one for a third to be looked for, and a third than two. On those
mosaics 14 of 26 windows of three panes have more, and of 54 of two 7, most of them at less than 40 degrees."""


def several_panes(
    likelihood: TileLikelihood,
    single: TileFit,
    fewer_edges: Callable[[Window], float],
    *,
    beside: Sequence[TileFit] = (),
    incidence_open: bool = True,
) -> TileFit | None:
    """The window of two or three panes that is surely likelier than a single one; None without.

    Parameters
    ----------
    likelihood : TileLikelihood
        Of a mosaic.
    single : TileFit
        The likeliest single pane.
    fewer_edges : callable
        Share of edges by which the layers have fewer behind a window than behind it with all images on the other side.
    beside : sequence of TileFit
        Single panes of other axes, than which it must be surely likelier, too.
    incidence_open : bool
        Whether the incidence is to be found; else it is that of the single pane.
    """

    # Each is two closed forms.
    fewer_edges = cache(fewer_edges)

    across, others = bool(beside), (single, *beside)
    found = two = likeliest_window(likelihood, single, 2, incidence_open=incidence_open)
    if min(map(two.surer_than, others)) > _WORTH_ANOTHER:
        three = likeliest_window(likelihood, single, 3, incidence_open=incidence_open)
        two, three = (
            min((own, *_begun_from(likelihood, other, own, incidence_open)), key=lambda fit: fit.misfit)
            for own, other in ((two, three), (three, two))
        )
        found = two
        if three.surer_than(two) > _SURE_OF_ANOTHER and _is_told(three, others, fewer_edges, across=across):
            found = three
    if not _is_told(found, others, fewer_edges, across=across):
        return None
    # Two thin panes look much like the faces of a single one, whose ghosts may have been missed.
    ghosts = _with_ghosts_of(likelihood, found.window, single, incidence_open)
    return found if _is_told(found, (ghosts,), fewer_edges, across=across) else None


def _with_ghosts_of(likelihood: TileLikelihood, window: Window, single: TileFit, incidence_open: bool) -> TileFit:
    """The likeliest single pane that has a ghost where one of the images of a window lies, or the one given."""
    shifts = (window.gap_along, window.pane_shift + window.gap_along, window.pane_shift)
    free = ("incidence_deg", "pane_shift") if incidence_open else ("pane_shift",)
    starts = [Window(single.window.incidence_deg, shift) for shift in shifts]
    others = [likelihood.nearest(start, single.refractive_index, free) for start in starts]
    return min((single, *others), key=lambda fit: fit.misfit)


def _is_told(
    found: TileFit, others: Sequence[TileFit], fewer_edges: Callable[[Window], float], *, across: bool
) -> bool:
    """Whether a window of several panes is believed beside single ones, if one of these lies across or if none does."""
    sure, believed = (
        min(how(other) for other in others)
        for how in (found.surer_than, partial(found.believed_over, usual=_USUAL_TILES))
    )
    window = found.window
    if window.incidence_deg <= _LEAST_DEG or sure <= min(_SURE):
        return False
    opposed = abs(window.pane_shift) > _RESOLVED_PX and window.pane_shift * window.gap_along < 0
    # Small gaps may have changed places with panes, whose ghosts lie along.
    aside = abs(window.gap_across) > max(abs(window.gap_along), _ACROSS_PX)
    unusual = opposed or aside
    if (across and window.incidence_deg < _LEAST_ACROSS_DEG) or (unusual and believed <= _SURE_OF_UNUSUAL):
        return False
    fewer = fewer_edges(window)
    if across and not _passes(believed, fewer, _SURE_ACROSS, _FEWER_ACROSS):
        return False
    sure = sure if fewer > _CLEARLY_FEWER else believed
    return _passes(sure, fewer, _SURE, _FEWER)


def _passes(sure: float, fewer: float, least: tuple[float, float], shares: tuple[float, float]) -> bool:
    """Whether standard errors and a share of fewer edges are more than one or the other pair."""
    return any(sure > first and fewer > second for first, second in zip(least, shares, strict=True))


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
    index, angle = single.refractive_index, single.window.incidence_deg
    angles = equivalent_incidences(angle, n_panes, index) if incidence_open else [angle]
    glance = likelihood.some(_MOST_TILES)
    powers = glance.powers(single)
    along, across = (np.arange(-reach, reach + _STEP_PX / 2, _STEP_PX).tolist() for reach in (_ALONG_PX, _ACROSS_PX))
    panes = dict.fromkeys((0.0, single.window.pane_shift))
    windows = [Window(at, pane, x, y, n_panes) for at, pane, x, y in product(angles, panes, along, across)]
    misfits = [glance.glanced(window, index, powers) for window in windows]
    free = free_numbers(incidence_open=incidence_open)
    kept = likeliest_apart(windows, misfits, _CANDIDATES, _are_apart)
    return min((likelihood.nearest(windows[i], index, free) for i in kept), key=lambda fit: fit.misfit)


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
