"""Windows whose plane of incidence lies one way: where they are searched, and how they are compared.

Patterns mimic faint images in mean spectra, but not in the layers: edges that a wrong window leaves doubled overlap.
Surest are the spectra of single tiles, where images do not lie close together.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import product
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from polaropt.capture import PlateFrame
from polaropt.estimation.flat.errors import widened_incidence, widened_shift
from polaropt.estimation.flat.ghost_overlap import LayerOverlap, SeenCoarsely, overlap_of, refined_incidence
from polaropt.estimation.flat.ghosts import CrossSpectra, ShiftLikelihood, cross_spectra
from polaropt.estimation.flat.overlap import MOST_NOISE, noise_of_mirrored
from polaropt.estimation.flat.windows.gaps import GapMap
from polaropt.estimation.flat.windows.likelihood import DETAIL, Window, WindowLikelihood
from polaropt.estimation.flat.windows.search import (
    MOST_STARTS,
    NAMES,
    NO_ERROR,
    ROUGH_SWEEPS,
    ROUNDS,
    LikelyWindow,
    WindowSearch,
    apart,
)
from polaropt.estimation.flat.windows.tiles import MOST_ABSORPTION, TileFit, TileLikelihood, tile_likelihood
from polaropt.numerics import jackknife_error, left_out, minimum_error, vertex
from polaropt.optics import INCIDENCE_SEARCH_DEG, SceneErrors, SceneParameters, largest_search_shift

Values = NDArray[np.float64]

# All below by trial.
CLOSE_PX, _BESIDE_DEG = 3.0, (-9.0, -6.0, -3.0, 0.0, 3.0)
"""Shifts up to which edges alone tell the incidence, and how far from the likelihood's they are looked at."""
_TURNED_DEG, HARDLY_PX = 3.0, 1.0
"""Angle between gap and azimuth from which on, and shift of a pane up to which, a window is one pane for all that its
images tell: as far as ghosts may lie beside the azimuth without a warning (`polaropt.estimation.angles`); by hand."""
_BESIDE_PX, _TURNED_INCIDENCES_DEG = np.arange(-2.0, 2.5, 0.5), np.arange(10.0, INCIDENCE_SEARCH_DEG[1], 3.0)
"""Shifts beside the gap, and incidences, at which that pane is looked at; by hand."""
_MOST_LIKELIEST, _MOST_CANDIDATES = 2, 4
"""How many windows of a scan are looked at closely: the likeliest, and those with the best scores, as patterns make
many a wrong window likelier than the true one."""
_TURNS_DEG = (-10.0, -5.0, 5.0, 10.0)
"""Turns from the azimuth at which the ghosts of a clear pane are looked for before it is taken for a tinted one; set by
hand."""
_INCIDENCE, _OF_SHIFT, _OF_TINT = NAMES[:1], ("pane_shift",), ("pane_shift", "absorption")
"""What edges tell, and what tiles tell of tinted glass beside it."""
_FIRST_ABSORPTION = 0.2
"""From which on tiles are asked for an absorption, at least. Set by hand."""
_OVERLAP_WEIGHT = 0.5
"""What a unit of log overlap is worth in log likelihood per frequency."""
_OF_MEAN_SPECTRA, _OF_EDGES = 0.5, 0.25
"""What a standard error of mean spectra, and of the edges' overlap, is worth beside one of tiles."""
_MOST_OF_TILES, _MOST_OF_SPECTRA, _MOST_OF_EDGES = (-9.0, 9.0), (-4.0, 8.0), (-4.0, 4.0)
"""Standard errors that count."""
NEEDED = 4.0
"""Standard errors, all together, by which several panes, tint or ghosts elsewhere must be likelier than what was found.
By trial on 124 random windows of one pane and 153 of several (`studies.random_windows`, training photographs, even
seeds from 9000 to 14120): one of the former is taken for several, and of the latter 92 are told so well that their
transmission is as bright as it is within 3 %."""
_BEYOND_TURNED = 2.5
"""Standard errors of tiles and mean spectra by which several panes must be likelier than a single one whose angles
start elsewhere: of 12 windows whose panes' own images lie within half a pixel (photographs that nothing was tuned on)
one has less, the others 2.6 to 10; of single panes whose angles start 8 or 45 degrees beside, none has more."""
SURER, SURE_OF_TILES = 1.5, 3.5
"""Standard errors by which tiles must be likelier under one window than under another to be believed against mean
spectra and edges: between windows of several panes; and between single ones, or one and several."""
_PROMISING = 0.5
"""Standard errors by which the tiles' luminance must be likelier under tinted glass than under clear for all to be
asked."""
_LEAST_ABSORPTION, _LEAST_GHOST_PX = 0.15, 1.25
"""Absorption that may be told at all: interpolation dims ghosts as less tint does; and the shift of a ghost that tells
it: close ones look like a blurred scene."""
_UNUSUAL, _RESOLVED_PX = 0.025, 0.5
"""What panes that are far from parallel must gain beside, and the shift of a pane from which on its sense is told."""
_THIN_PX = 0.25
"""Shift below which a pane beside a gap is thinner than any glass. Set by hand."""
_NEAR_DEG, _FARTHEST = 0.7, 2.0
"""Incidences beside a window's at which its overlap is looked at, and steps up to which a parabola is followed."""
_TURNS = 3
"""In which incidence and shifts are refined."""
_SEVERAL_WIDER = 2.0
"""What the standard errors of several panes' shifts are multiplied by: as they were, 70 % of 43 true ones lay within
two of them (`studies.random_windows`, fit, even seeds from 31000)."""
_TINT_WIDER, _LEAST_TINT_ERROR = 3.0, 0.05
"""What the standard error of an absorption by tiles is multiplied by, and the least that is believed: of the tinted
panes that are told 9 of 10 lie within two of them."""
_ERROR_STEP_PX = 0.25
"""Beside a shift: where the likelihood is looked at for its standard error."""


def is_close(window: Window) -> bool:
    """Whether images lie so close together that the likelihood hardly tells the incidence."""
    return max(abs(window.pane_shift), abs(window.gap_along), abs(window.gap_across)) <= CLOSE_PX


def tells_of_tint(window: Window) -> bool:
    """Whether a tinted pane's ghost lies far enough off, and is dim enough, to tell of tint at all.

    At the end of what is searched it is none that dims it.
    """
    told = _LEAST_ABSORPTION <= window.absorption < MOST_ABSORPTION - _LEAST_TINT_ERROR
    return told and abs(window.pane_shift) >= _LEAST_GHOST_PX


def looks_turned(window: Window) -> bool:
    """Whether it has the images of one pane and angles that start elsewhere, which is more usual, and warned of."""
    direction_deg = math.degrees(math.atan2(abs(window.gap_across), abs(window.gap_along)))
    apart_px = math.hypot(window.gap_along, window.gap_across)
    return direction_deg > _TURNED_DEG and abs(window.pane_shift) < HARDLY_PX and apart_px > CLOSE_PX


def looks_single(window: Window) -> bool:
    """Whether it has the images of one pane: two without thickness, one behind the other along the azimuth."""
    aligned = max(abs(window.pane_shift), abs(window.gap_across)) < _THIN_PX
    return window.n_panes == 2 and aligned and abs(window.gap_along) >= _RESOLVED_PX


class Evidence(NamedTuple):
    """Standard errors by which a window is likelier than another: by tiles, by mean spectra, and by edges."""

    tiles: float
    spectra: float
    edges: float = 0.0

    @property
    def together(self) -> float:
        """All of them, in standard errors of tiles."""
        limits, weights = (_MOST_OF_TILES, _MOST_OF_SPECTRA, _MOST_OF_EDGES), (1.0, _OF_MEAN_SPECTRA, _OF_EDGES)
        return sum(
            weight * min(max(error, least), most)
            for error, weight, (least, most) in zip(self, weights, limits, strict=True)
        )


@dataclass(frozen=True)
class Scan:
    """Likely windows of so many panes, to be looked at closely, and what they gain over single panes."""

    n_panes: int
    starts: list[LikelyWindow]
    gain: float

    @property
    def misfit(self) -> float:
        """That of the likeliest."""
        return min(start.misfit for start in self.starts)


class WindowAxis:
    """The search at one azimuth, and how windows are compared there."""

    def __init__(self, frame: PlateFrame, asked: SceneParameters, spectra: CrossSpectra | None = None) -> None:
        self.frame, self._asked = frame, asked
        self._spectra = spectra = cross_spectra(frame) if spectra is None else spectra
        self.parts = [WindowLikelihood(part, asked.index) for part in spectra.left_out]
        self.likelihood = WindowLikelihood(spectra, asked.index)
        most = largest_search_shift(min(frame.images.shape[-2:]))
        gaps = GapMap(spectra, asked.index, most)
        self.search = WindowSearch(self.likelihood, gaps, most, asked.index, _numbers_told(asked, frame.azimuth_deg))
        self._tile_fits: dict[Window, TileFit] = {}

    def across(self) -> WindowAxis:
        """The same for panes that lie across."""
        return WindowAxis(self.frame.across(), self._asked, self._spectra.across())

    def scene(self, window: Window) -> SceneParameters:
        """The scene that a window is."""
        return scene_of(window, self.frame.azimuth_deg, self._asked)

    def shows(self, window: Window) -> bool:
        """Whether the noise leaves the edges of what a window mirrors to be seen."""
        return noise_of_mirrored(self.frame, self.scene(window)) < MOST_NOISE

    def judged(self, window: Window) -> LikelyWindow:
        """A window with its score, at the incidence near it at which the layers' edges overlap least."""
        overlap = self._overlap(window)
        if "incidence_deg" not in self.search.told:
            near = window.incidence_deg + _NEAR_DEG * np.arange(-1, 2.0)
            values = [math.log(overlap.at(float(angle))) for angle in np.clip(near, *INCIDENCE_SEARCH_DEG)]
            moved = window.incidence_deg + _NEAR_DEG * vertex(values[0], values[1], values[2], _FARTHEST)
            window = replace(window, incidence_deg=float(np.clip(moved, *INCIDENCE_SEARCH_DEG)))
        sums = overlap.parts(window.incidence_deg)
        misfit = float(self.likelihood.misfit([window], ROUNDS)[0])
        score = misfit + _OVERLAP_WEIGHT * math.log(overlap_of(sums.sum(axis=-1)))
        # Near a mirror the likelihood may overflow.
        score, misfit = (value if math.isfinite(value) else math.inf for value in (score, misfit))
        likelihoods = np.array([part.misfit([window])[0] for part in self.parts])
        return LikelyWindow(
            window,
            score + (_UNUSUAL if self._unusual(window) else 0.0),
            misfit,
            (likelihoods, _OVERLAP_WEIGHT * np.log(overlap_of(left_out(sums)))),
        )

    def _unusual(self, window: Window) -> bool:
        """Whether gaps are narrower than panes, or shift to the other side: as of panes that are far from parallel."""
        if window.n_panes == 1 or {"pane_shift", "gap_along"} <= set(self.search.told):
            return False
        along = math.copysign(window.gap_along, window.gap_along * window.pane_shift)
        pane = abs(window.pane_shift)
        return pane > _RESOLVED_PX and (along < 0 or math.hypot(along, window.gap_across) < pane - _RESOLVED_PX)

    def scan(self, n_panes: int, singles: Sequence[LikelyWindow], *found: Window) -> Scan:
        """Windows of so many panes that are likely, begun from likely single panes, and those found."""
        starts = self.search.starts(n_panes, [*(single.window for single in singles[:MOST_STARTS]), *found])
        return Scan(n_panes, starts, singles[0].misfit - starts[0].misfit)

    def candidates(self, scan: Scan) -> list[LikelyWindow]:
        """Likely windows near those of a scan."""
        near = [self.search.refined(start.window, 1) for start in scan.starts]
        near.sort(key=lambda found: found.misfit)
        best = sorted(near, key=lambda found: found.misfit + self._edges(found.window))
        kept = dict.fromkeys(found.window for found in (*near[:_MOST_LIKELIEST], *best[:_MOST_CANDIDATES]))
        found = [self.search.refined(window, ROUGH_SWEEPS) for window in kept]
        return [*found, *(self._by_edges(one.window) for one in found[:1] if is_close(one.window))]

    def _by_edges(self, window: Window) -> LikelyWindow:
        """A window of close panes at the incidence at which the layers' edges overlap least."""
        if "incidence_deg" in self.search.told:
            return self.search.refined(window, 1)
        overlap = self._overlap(window)
        near = np.clip(window.incidence_deg + np.array(_BESIDE_DEG), *INCIDENCE_SEARCH_DEG).tolist()
        likeliest = replace(window, incidence_deg=min(near, key=overlap.at))
        return self.search.refined(likeliest, ROUGH_SWEEPS, kept=_INCIDENCE)

    def _overlap(self, window: Window) -> LayerOverlap:
        """That of a window's layers, over trial incidences."""
        return LayerOverlap(self.frame, self.scene(window), window.incidence_deg, self._coarse)

    @cached_property
    def _coarse(self) -> SeenCoarsely:
        return SeenCoarsely(self.frame)

    def _edges(self, window: Window) -> float:
        """What the overlap of the layers' edges adds to a window's score."""
        return _OVERLAP_WEIGHT * math.log(self._overlap(window).at(window.incidence_deg))

    def best(self, candidates: Sequence[LikelyWindow]) -> LikelyWindow:
        """The best of some windows."""
        return min((self.judged(found.window) for found in candidates), key=lambda found: found.score)

    def surest(self, candidates: Sequence[LikelyWindow]) -> LikelyWindow:
        """The best of some windows, or the one that tiles are surely likelier under."""
        best, likeliest = self.best(candidates), self.likeliest([found.window for found in candidates])
        told = not is_close(likeliest) and self.surer(likeliest, best.window) > SURER
        return self.judged(likeliest) if told else best

    def likeliest(self, windows: Sequence[Window]) -> Window:
        """The window that the luminance of tiles, which takes a third of the time, is likeliest under as it is."""
        return min(windows, key=lambda window: self._glance.fitted(window, self._asked.index).misfit)

    def glimpses(self, candidates: Sequence[LikelyWindow], single: Window) -> bool:
        """Whether tiles are surely likelier under one of many windows than under a single pane."""
        apart = [found.window for found in candidates if not is_close(found.window)]
        return bool(apart) and self.surer(self.likeliest(apart), single) > SURER

    @cached_property
    def _glance(self) -> TileLikelihood:
        return self.tiles.luminance()

    @cached_property
    def tiles(self) -> TileLikelihood:
        """How likely the frame's tiles are under windows."""
        return tile_likelihood(self.frame)

    def surer(self, window: Window, other: Window) -> float:
        """Standard errors by which tiles are likelier under one window than under another, each at its incidence."""
        return self.tiles_under(window).believed_over(self.tiles_under(other))

    def tiles_under(self, window: Window) -> TileFit:
        """How likely the tiles are under a window, at the incidence near its own that suits them best."""
        if window not in self._tile_fits:
            self._tile_fits[window] = self.nearest_by_tiles(window, ())
        return self._tile_fits[window]

    def evidence(self, window: LikelyWindow, other: LikelyWindow, beside: WindowAxis | None = None) -> Evidence:
        """What speaks for a window rather than for another, of this axis or of the one across."""
        tiles = self.tiles_under(window.window).believed_over((beside or self).tiles_under(other.window))
        return Evidence(tiles, *window.surer_than(other))

    def tells(self, window: LikelyWindow, other: LikelyWindow) -> bool:
        """Whether all together tell a window beside another, or tiles alone."""
        evidence = self.evidence(window, other)
        return evidence.tiles > SURE_OF_TILES or evidence.together > NEEDED

    def nearest_by_tiles(self, window: Window, names: tuple[str, ...], tiles: TileLikelihood | None = None) -> TileFit:
        """The likeliest window near one given tiles, as far as its incidence and some other numbers are open."""
        free = tuple(name for name in (*_INCIDENCE, *names) if name not in self.search.told)
        return (tiles or self.tiles).nearest(window, self._asked.index, free)

    def tinted_near(self, starts: Sequence[Window], clear: Window) -> TileFit | None:
        """The tinted pane near some that tiles find likeliest; None where they hardly tell of tint, or noise drowns it.

        A glance at the tiles' luminance leaves most panes out.
        """
        if not self.shows(clear):
            return None
        places = [*starts, *([clear] if clear.pane_shift else [])]
        dark = [replace(place, absorption=max(place.absorption, _FIRST_ABSORPTION)) for place in places]
        glances = [self.nearest_by_tiles(place, _OF_TINT, self._glance) for place in dark]
        told = [fit for fit in glances if tells_of_tint(fit.window)]
        if not told:
            return None
        best = min(told, key=lambda fit: fit.misfit)
        if best.surer_than(self._glance.fitted(clear, self._asked.index)) < _PROMISING:
            return None
        found = self.nearest_by_tiles(best.window, _OF_TINT)
        return found if tells_of_tint(found.window) else None

    def likelier_than_turned(self, found: LikelyWindow) -> bool:
        """Whether a window is clearly likelier than a single pane whose ghosts lie along its gap."""
        window = found.window
        single, direction = self.scene(Window(window.incidence_deg, 0.0)).plainest, self.scene(window).gap_azimuth_deg
        apart = math.hypot(window.gap_along, window.gap_across) + _BESIDE_PX
        shifts = np.concatenate([apart, -apart])

        def misfit(spectra: CrossSpectra, incidences_deg: Values, shifts: Values) -> Values:
            turned = spectra if direction is None else spectra.with_ghosts_along(direction)
            return np.asarray(ShiftLikelihood(turned, single, DETAIL).misfit(incidences_deg, shifts, ROUNDS))

        told = self._asked.incidence_deg
        incidences = _TURNED_INCIDENCES_DEG if told is None else np.array([told])
        misfits = misfit(self._spectra, incidences, shifts)
        i, k = np.unravel_index(np.argmin(misfits), misfits.shape)
        rest = [misfit(part, incidences[[i]], shifts[[k]]).item() for part in self._spectra.left_out]
        error = jackknife_error(np.array(rest) - found.parts[0])
        tiles = self.tiles if direction is None else self.tiles.with_ghosts_along(direction)
        turned = self.nearest_by_tiles(Window(float(incidences[i]), float(shifts[k])), _OF_SHIFT, tiles)
        spectra = float(misfits[i, k] - found.misfit) / max(error, NO_ERROR)
        return Evidence(self.tiles_under(window).believed_over(turned), spectra).together > _BEYOND_TURNED

    def is_clear_and_turned(self, tinted: TileFit) -> bool:
        """Whether a clear pane is likelier than a tinted one if its ghosts lie a little beside the azimuth.

        Where the angles start elsewhere ghosts are dimmer along the azimuth, as those of tinted glass are.
        """
        pane, azimuth = replace(tinted.window, absorption=0.0), self.frame.azimuth_deg
        if not pane.pane_shift:
            return False
        turned = (self.tiles.with_ghosts_along(azimuth + turn) for turn in _TURNS_DEG)
        return any(self.nearest_by_tiles(pane, _OF_SHIFT, tiles).misfit < tinted.misfit for tiles in turned)

    def with_ghost_of(self, window: Window, single: Window) -> LikelyWindow:
        """The single pane that tiles find likeliest with a ghost where a window's first one lies, or its next pane's.

        Begun where the window stands, too: a ghost that was missed may have misled the single pane's incidence.
        """
        shifts = window.pane_shift, window.pane_shift + window.gap_along
        angles = single.incidence_deg, window.incidence_deg
        starts = (replace(single, incidence_deg=angle, pane_shift=shift) for angle, shift in product(angles, shifts))
        near = [self.search.refined(start, ROUGH_SWEEPS).window for start in starts]
        return self.judged(min(near, key=lambda pane: self.tiles_under(pane).misfit))

    def with_surer_ghosts(self, panes: Sequence[Window], plain: LikelyWindow) -> LikelyWindow:
        """A single pane, or that of some whose ghosts lie elsewhere that is so much likelier as several panes must be.

        Of 131 random windows in place (`studies.random_windows`, training photographs, even seeds from 20000) ghosts
        are told by 2 standard errors at most.
        """
        others = [pane for pane in panes if apart(pane, plain.window) and not is_close(pane)]
        if not others:
            return plain
        likeliest = self.judged(min(others, key=lambda window: self.tiles_under(window).misfit))
        return likeliest if self.tells(likeliest, plain) else plain

    def refined(self, window: Window) -> tuple[SceneParameters, SceneErrors]:
        """The scene near a window, its incidence where the layers' edges overlap least, and standard errors."""
        error = None
        if "incidence_deg" in self.search.told:
            window = self.search.refined(window).window
        else:
            # The likelihood's own incidence is off where images hardly lie apart; the edges' goes with the shifts.
            for _ in range(_TURNS):
                incidence, error = refined_incidence(self.frame, self.scene(window))
                moved = replace(window, incidence_deg=incidence)
                window = self.search.refined(moved, ROUGH_SWEEPS, kept=_INCIDENCE).window

        def shift_error(name: str) -> float | None:
            error = self._shift_error(window, name)
            return None if error is None else widened_shift(error) * (_SEVERAL_WIDER if window.n_panes > 1 else 1.0)

        of_tint = None
        if window.absorption and "absorption" not in self.search.told:
            window, of_tint = self._with_tint(window)
        errors = SceneErrors(
            incidence_deg=None if error is None else widened_incidence(error),
            ghost_shift=shift_error("pane_shift"),
            gap_shift=shift_error("gap_along") if window.n_panes > 1 else None,
            absorption=of_tint,
        )
        return self.scene(window), errors

    def _with_tint(self, window: Window) -> tuple[Window, float]:
        """A tinted pane with the ghost and the absorption that tiles tell at its incidence, and the standard error."""
        free = tuple(name for name in _OF_TINT if name not in self.search.told)
        fit = self.tiles.nearest(window, self._asked.index, free)
        error = float(self.tiles.errors(fit, free)[free.index("absorption")])
        return fit.window, min(math.hypot(_TINT_WIDER * error, _LEAST_TINT_ERROR), MOST_ABSORPTION)

    def _shift_error(self, window: Window, name: str) -> float | None:
        """Standard error of one shift of a window, by leaving parts of the frame out; None where it is told."""
        if name in self.search.told:
            return None
        moves = (-_ERROR_STEP_PX, 0.0, _ERROR_STEP_PX)
        near = [replace(window, **{name: getattr(window, name) + move}) for move in moves]
        values = np.array([part.misfit(near) for part in self.parts])
        return minimum_error(list(values.T), _ERROR_STEP_PX) if self.parts else math.inf


def _numbers_told(asked: SceneParameters, azimuth_deg: float) -> dict[str, Any]:
    """Numbers of a window that are not to be found."""
    told = {"incidence_deg": asked.incidence_deg, "pane_shift": asked.ghost_shift, "absorption": asked.absorption}
    if asked.gap_shift is not None:
        turned = math.radians(azimuth_deg - (azimuth_deg if asked.gap_azimuth_deg is None else asked.gap_azimuth_deg))
        told |= {"gap_along": asked.gap_shift * math.cos(turned), "gap_across": asked.gap_shift * math.sin(turned)}
    return {name: value for name, value in told.items() if value is not None}


def scene_of(window: Window, azimuth_deg: float, asked: SceneParameters) -> SceneParameters:
    """The scene that a window in the frame of an azimuth is, all else as it was asked for."""
    # To the same side as the azimuth, as a pane's shift is told; it may be negative.
    sense = math.copysign(1.0, window.gap_along)
    gap = sense * math.hypot(window.gap_along, window.gap_across)
    turned = math.degrees(math.atan2(sense * window.gap_across, abs(window.gap_along)))
    along = window.n_panes == 1 or asked.gap_shift is not None
    direction = asked.gap_azimuth_deg if along else (azimuth_deg - turned) % 360
    return asked.replace(
        incidence_deg=window.incidence_deg,
        azimuth_deg=azimuth_deg,
        ghost_shift=window.pane_shift,
        n_panes=window.n_panes,
        gap_shift=asked.gap_shift if along and window.n_panes > 1 else gap,
        gap_azimuth_deg=direction,
        absorption=window.absorption,
    )


def window_of(scene: SceneParameters, azimuth_deg: float) -> Window:
    """The window that a complete scene is, in the frame of an azimuth that is its own."""
    return Window(**_numbers_told(scene, azimuth_deg), n_panes=scene.n_panes or 1)
