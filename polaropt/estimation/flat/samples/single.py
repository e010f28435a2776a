"""The single pane that tiles of a raw mosaic find likeliest: in place, with ghosts, and of tinted glass.

Dark glass dims the images that cross it, and polarizes otherwise than clear glass at the same incidence. So a search
for ghosts of clear glass misses those of dark glass, and steep dark panes pass for clear ones across, with their layers
exchanged.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import product

import numpy as np

from polaropt.estimation.flat.windows.likelihood import Window
from polaropt.estimation.flat.windows.search import (
    TRIAL_ABSORPTION,
    TRIAL_INDICES,
    alike_incidences,
    likeliest_apart,
)
from polaropt.estimation.flat.windows.tiles import TileFit, TileLikelihood
from polaropt.optics import INCIDENCE_SEARCH_DEG, SceneParameters

USUAL_TILES_OF_MOSAIC = 121
"""Tiles of a mosaic of 384x384, of which was found what is needed of them: what layers are not as the likelihood takes
them to be makes all tiles of larger ones likelier."""
FARTHEST_PX = 20.0
"""Farthest ghosts that tiles are asked of, in pixels of the sensor: the mosaic's cells show those that lie farther off.
Set by hand."""
_SCAN_PX, _MOST_TILES = 1.0, 64
"""Spacing of the shifts that tiles are asked of, in pixels of the sensor, and how many tiles are at first. Set by
hand."""
REACH_PX = FARTHEST_PX + _SCAN_PX
"""How far ghosts may lie that tiles find: beside the farthest that they are asked of are likelier ones."""
_CANDIDATES = 2
"""Of the likeliest shifts that are looked at closely. Three that lie apart find more ghosts from the incidence of the
pane in place, and no more beside that of the cells, but some that are none (160 random mosaics of fit seeds)."""
_CANDIDATES_OF_TINT, _APART_PX = 3, 2.5
"""The same of tinted glass, and how far apart they are: pixels beside the likeliest of them are about as likely, and
lead to the same. Set by hand."""
_STEPS_DEG = (0.0, -8.0, 8.0)
"""Incidences at which tinted glass is looked for, beside that of the likeliest pane in place: tint moves it. Set by
hand."""
_STEEPEST_DEG, _LEAST_PX, _ABSORPTIONS = 84.5, 0.7, (0.08, 1.2)
"""Steepest incidence, closest ghosts, and absorptions between which a tinted pane is told: others imitate what is none.
Set by hand."""
_SURE_OF_OWN, _SIDE_OF_OWN = 2.5, 1.8
"""Standard errors by which tinted glass must be likelier than other panes, and than with its ghosts on the other
side."""
_SURE_ACROSS, _SIDE_ACROSS, _SURE_OF_GHOSTS = 1.0, 3.0, 4.0
"""The same of a pane across, and standard errors by which its ghosts must be likelier than none.

Of 360 random mosaics of a single pane (`studies.random_windows --sensor mono`, even seeds from 9700000, 9710000,
9720000, 9750000 and 9760000, 130 of tinted glass) clear glass across is likelier than clear glass in 65: of these five
are told so, and of the others none is told across."""
SURER_THAN_OTHERS = 1.0
"""Standard errors by which tinted glass must be likelier than clear glass of another index, and than two clear panes.
Of 10 mosaics that would be told without (fit seeds 9730000, 9750000, 9770000, 9780000 and 9990000 on) seven are of
tinted glass, and surer than others by 1.4 and more; one is clear in strong noise, of one the index was told wrongly,
and one has two panes, and these are by 0.7 at most."""


def free_of_single(*, incidence_open: bool = True) -> tuple[str, ...]:
    """Names of the numbers of a single clear pane that are to be found."""
    return ("incidence_deg", "pane_shift") if incidence_open else ("pane_shift",)


def likeliest_panes(
    likelihood: TileLikelihood, scene: SceneParameters, incidence_deg: float, *, ghosts: bool = True
) -> tuple[TileFit, TileFit]:
    """The likeliest pane whose images are in place, and the likeliest of all.

    Parameters
    ----------
    likelihood : TileLikelihood
        Of a mosaic.
    scene : SceneParameters
        An incidence that is not None is kept.
    incidence_deg : float
        Where about it is.
    ghosts : bool
        Whether images may lie apart.
    """
    index, free = scene.index, ("incidence_deg",) if scene.incidence_deg is None else ()
    absorption = scene.absorption or 0.0
    place = likelihood.nearest(Window(incidence_deg, 0.0, absorption=absorption), index, free)
    if not ghosts:
        return place, place
    windows, misfits = _ghosts(likelihood, index, (place.window.incidence_deg, incidence_deg), absorption)
    starts = [windows[i] for i in np.argsort(misfits, kind="stable")[:_CANDIDATES]]
    fits = [likelihood.nearest(start, index, (*free, "pane_shift")) for start in starts]
    return place, min((place, *fits), key=_misfit)


def likeliest_tinted(likelihood: TileLikelihood, place: TileFit, *, incidence_open: bool = True) -> TileFit | None:
    """The likeliest pane of tinted glass whose images lie apart; None where it imitates something else.

    Parameters
    ----------
    likelihood : TileLikelihood
        Of a mosaic.
    place : TileFit
        The likeliest clear pane whose images are in place.
    incidence_open : bool
        Whether the incidence is to be found; else it is that of `place`.
    """
    about, index = place.window.incidence_deg, place.refractive_index
    low, high = INCIDENCE_SEARCH_DEG
    angles = [min(max(about + step, low), high) for step in (_STEPS_DEG if incidence_open else (0.0,))]
    windows, misfits = _ghosts(likelihood, index, angles, TRIAL_ABSORPTION)
    starts = [windows[i] for i in likeliest_apart(windows, misfits, _CANDIDATES_OF_TINT, _are_apart)]
    free = (*free_of_single(incidence_open=incidence_open), "absorption")
    found = min((likelihood.nearest(start, index, free) for start in starts), key=_misfit)
    window, (least, most) = found.window, _ABSORPTIONS
    apart = _LEAST_PX < abs(window.pane_shift) <= FARTHEST_PX
    return found if apart and least < window.absorption < most and window.incidence_deg < _STEEPEST_DEG else None


def tells_tint(
    likelihood: TileLikelihood, found: TileFit, others: Sequence[TileFit], *, across: bool, incidence_open: bool = True
) -> bool:
    """Whether tiles surely tell a pane of tinted glass.

    Parameters
    ----------
    likelihood : TileLikelihood
        Of its axis.
    found : TileFit
        See `likeliest_tinted`.
    others : sequence of TileFit
        The likeliest clear panes, and the tinted one of the axis across.
    across : bool
        Whether it lies across the pane that the mosaic's cells tell.
    incidence_open : bool
        As of `likeliest_tinted`.
    """
    least, of_side = (_SURE_ACROSS, _SIDE_ACROSS) if across else (_SURE_OF_OWN, _SIDE_OF_OWN)
    free = ("incidence_deg", "absorption") if incidence_open else ("absorption",)
    window, index = found.window, found.refractive_index
    opposite, place = (
        likelihood.nearest(replace(window, pane_shift=shift), index, free) for shift in (-window.pane_shift, 0.0)
    )

    def sure(other: TileFit) -> float:
        return found.believed_over(other, USUAL_TILES_OF_MOSAIC)

    of_ghosts = _SURE_OF_GHOSTS if across else _SURE_OF_OWN
    return min(map(sure, others)) > least and sure(opposite) > of_side and sure(place) > of_ghosts


def likeliest_of_other_index(
    likelihood: TileLikelihood, window: Window, refractive_index: float, *, incidence_open: bool = True
) -> TileFit:
    """The likeliest clear pane of another index than was told, that looks like a window and has its ghosts near by.

    Parameters
    ----------
    likelihood : TileLikelihood
    window : Window
        Of the index that was told.
    refractive_index : float
        That index.
    incidence_open : bool
        As of `likeliest_tinted`.
    """
    angle, free = window.incidence_deg, free_of_single(incidence_open=incidence_open)
    clear = replace(window, absorption=0.0)
    fits = (
        likelihood.nearest(replace(clear, incidence_deg=alike), index, free)
        for index in TRIAL_INDICES
        for alike in (
            alike_incidences(angle, refractive_index, index - refractive_index) if incidence_open else [angle]
        )
    )
    return min(fits, key=_misfit)


def _ghosts(
    likelihood: TileLikelihood, refractive_index: float, incidences_deg: Sequence[float], absorption: float
) -> tuple[list[Window], list[float]]:
    """Windows whose ghosts lie anywhere along the azimuth, and minus the log likelihood of some tiles under each."""
    side = np.arange(_SCAN_PX, FARTHEST_PX, _SCAN_PX)
    windows = [
        Window(incidence, shift, absorption=absorption)
        for shift, incidence in product((*side.tolist(), *(-side).tolist()), dict.fromkeys(incidences_deg))
    ]
    glance = likelihood.some(_MOST_TILES)
    return windows, [glance.fitted(window, refractive_index).misfit for window in windows]


def _are_apart(one: Window, other: Window) -> bool:
    """Whether ghosts of two windows are no neighbours of a scan."""
    return abs(one.pane_shift - other.pane_shift) > _APART_PX


def _misfit(fit: TileFit) -> float:
    return fit.misfit
