"""Windows of several panes, or of tinted glass: which of those that the search finds explains the capture.

Patterns mimic faint images in mean spectra, but not in the layers: edges that a wrong window leaves doubled overlap.
Surest are the spectra of single tiles, where images do not lie close together.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray

from polaropt.capture import PlateFrame, StokesImages, plate_frame
from polaropt.estimation.flat.errors import widened_incidence, widened_shift
from polaropt.estimation.flat.estimate import SceneEstimate
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
    equivalent_incidences,
)
from polaropt.estimation.flat.windows.tiles import MOST_ABSORPTION, TileFit, TileLikelihood
from polaropt.numerics import jackknife_error, left_out, minimum_error, vertex
from polaropt.optics import (
    INCIDENCE_SEARCH_DEG,
    SceneErrors,
    SceneParameters,
    largest_search_shift,
)

Values = NDArray[np.float64]

# All below by trial.
_TRIAL_DEG = (40.0, 52.0, 62.0, 72.0, 80.0)
"""Incidences of single panes that windows are likened to where the axis is in doubt."""
_CLOSE_PX, _BESIDE_DEG = 3.0, (-9.0, -6.0, -3.0, 0.0, 3.0)
"""Shifts up to which edges alone tell the incidence, and how far from the likelihood's they are looked at."""
_TURNED_DEG, HARDLY_PX = 12.0, 1.0
"""Angle between gap and azimuth from which on, and shift of a pane up to which, a window is one pane for all that its
images tell: as far as ghosts may lie beside the azimuth without a warning (`polaropt.estimation.angles`); by hand."""
_BESIDE_PX, _TURNED_INCIDENCES_DEG = np.arange(-2.0, 2.5, 0.5), np.arange(10.0, INCIDENCE_SEARCH_DEG[1], 3.0)
"""Shifts beside the gap, and incidences, at which that pane is looked at; by hand."""
_MOST_LIKELIEST, _MOST_CANDIDATES = 2, 4
"""How many windows of a scan are looked at closely: the likeliest, and those with the best scores, as patterns make
many a wrong window likelier than the true one; and how many tinted ones across."""
_INCIDENCE, _OF_TINT = NAMES[:1], ("pane_shift", "absorption")
"""What edges tell, and what tiles tell of tinted glass beside it."""
_FIRST_ABSORPTION = 0.2
"""From which on tiles are asked for an absorption, at least. Set by hand."""
_OVERLAP_WEIGHT = 0.5
"""What a unit of log overlap is worth in log likelihood per frequency."""
_LEAST_GAIN = 0.003
"""Score that a single pane of another kind must gain."""
_SURE = 2.0
"""The same in standard errors of what is gained."""
_OF_MEAN_SPECTRA, _OF_EDGES = 0.5, 0.25
"""What a standard error of mean spectra, and of the edges' overlap, is worth beside one of tiles."""
_MOST_OF_TILES, _MOST_OF_SPECTRA, _MOST_OF_EDGES = (-9.0, 9.0), (-4.0, 8.0), (-4.0, 4.0)
"""Standard errors that count."""
_NEEDED, _NEEDED_IN_DOUBT = 4.0, 7.0
"""Standard errors, all together, by which several panes must be likelier than one; the second where the noise leaves no
edges of what they mirror to be seen, or where they lie across the pane that was found. By trial on 124 random windows
of one pane and 153 of several (`studies.random_windows`, training photographs, even seeds from 9000 to 14120): one of
the former is taken for several, and of the latter 92 are told so well that their transmission is as bright as it is
within 3 %. Of 110 others of one pane at 10 to 33 degrees (even seeds from 17400) noise tells several by 6.5 at most."""
_LEAST_DEG = 12.0
"""Incidence beyond which they are told in noise: nearer to the normal, where a warning says that hardly anything is,
chance windows of that many numbers suit noise best. Set by hand."""
_SURE_OF_CLOSE = 1.5
"""Those of mean spectra and edges added where all images lie close together, and the single pane's do, too. With pairs
of photographs that no figure is taken of and those inside scikit-image, two panes at 30 to 70 degrees and single ones
at 20 to 80 (shifts of 1 to 3 px, noise 0.3 to 2 %): all of 18 of two panes have 2.2 and more, of 18 single ones 17 have
0.3 at most."""
_BEYOND_TURNED = 2.0
"""Standard errors of tiles and mean spectra by which several panes must be likelier than a single one whose angles
start elsewhere: 3 of 42 such (photographs that no figure is taken of) look more like two panes than that."""
_SURER, _SURE_OF_TILES = 1.5, 3.5
"""Standard errors by which tiles must be likelier under one window than under another to be believed against mean
spectra and edges: between windows of several panes; and between single ones, or one and several."""
_PROMISING, _LEAST_OF_TILES = 0.5, 2.0
"""Standard errors by which the tiles' luminance must be likelier under tinted glass than under clear for all to be
asked, and by which tiles must be, as mean spectra take ghosts that interpolation dims for those of tint; all together
tint must be told as several panes must. Of some 400 random windows of clear glass (`studies.random_windows`,
training photographs, even seeds from 9000, 20000 and 22000) one is taken for tinted, of 150 of tinted glass about 45
are told."""
_NEEDED_ACROSS, _GAIN_ACROSS = 3.0, 0.01
"""Standard errors, all together, and score by which a tinted pane across must be likelier, edges and all. Of 130 random
windows of one clear pane beyond 53 degrees (`studies.random_windows`, training photographs, even seeds from 8000) none
gains more than 0.002 of the score; of 52 of tinted glass 7 lay across, with 3.5 standard errors and 0.012 at least. On
other seeds, of 90 of clear glass and 50 of tinted none is turned wrongly and 2 of 6 rightly."""
_LEAST_ABSORPTION, _LEAST_GHOST_PX = 0.15, 1.25
"""Absorption that may be told at all: interpolation dims ghosts as less tint does; and the shift of a ghost that tells
it: close ones look like a blurred scene."""
_UNUSUAL, _RESOLVED_PX = 0.025, 0.5
"""What panes that are far from parallel must gain beside, and the shift of a pane from which on its sense is told."""
_NEAR_DEG, _FARTHEST = 0.7, 2.0
"""Incidences beside a window's at which its overlap is looked at, and steps up to which a parabola is followed."""
MOST_FOUND = 3
"""Panes of a window that is found: two, and one more; what is told may have more."""
_DOUBTFUL_MARGIN, _DOUBTFUL_DEG, _NEARLY_AS_LIKELY = 0.2, 55.0, 0.03
"""Margin of the azimuth's axis up to which the one across is looked at, too, as the single pane that it is of may be
wrong, and incidence of that pane from which on it always is: several panes polarize as a steeper one does across. And
log likelihood that a scan there may lack of the single pane's to be worth a closer look."""
_FAR_LESS_LIKELY, _LEAST_SEEN = 0.4, 0.005
"""What a single pane across may lack of the log likelihood of the one found for windows across to be scanned, and what
a scan of two must gain where one without double images was found: on the random windows to fit on, those that are found
gain 0.018."""
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


def _close(window: Window) -> bool:
    """Whether images lie so close together that the likelihood hardly tells the incidence."""
    return max(abs(window.pane_shift), abs(window.gap_along), abs(window.gap_across)) <= _CLOSE_PX


def _tells_of_tint(window: Window) -> bool:
    """Whether a tinted pane's ghost lies far enough off, and is dim enough, to tell of tint at all.

    At the end of what is searched it is none that dims it.
    """
    told = _LEAST_ABSORPTION <= window.absorption < MOST_ABSORPTION - _LEAST_TINT_ERROR
    return told and abs(window.pane_shift) >= _LEAST_GHOST_PX


def _looks_turned(window: Window) -> bool:
    """Whether it has the images of one pane and angles that start elsewhere, which is more usual, and warned of."""
    direction_deg = math.degrees(math.atan2(abs(window.gap_across), abs(window.gap_along)))
    apart_px = math.hypot(window.gap_along, window.gap_across)
    return direction_deg > _TURNED_DEG and abs(window.pane_shift) < HARDLY_PX and apart_px > _CLOSE_PX


@dataclass(frozen=True)
class _Scan:
    """Likely windows of so many panes, to be looked at closely, and what they gain over single panes."""

    n_panes: int
    starts: list[LikelyWindow]
    gain: float

    @property
    def misfit(self) -> float:
        """That of the likeliest."""
        return min(start.misfit for start in self.starts)


class _Axis:
    """The search at one azimuth, and how windows are compared there."""

    def __init__(self, frame: PlateFrame, asked: SceneParameters, spectra: CrossSpectra | None = None) -> None:
        self.frame, self._asked = frame, asked
        self._spectra = spectra = cross_spectra(frame) if spectra is None else spectra
        self.parts = [WindowLikelihood(part, asked.index) for part in spectra.left_out()]
        self.likelihood = WindowLikelihood(spectra, asked.index)
        most = largest_search_shift(min(frame.images.shape[-2:]))
        gaps = GapMap(spectra, asked.index, most)
        self.search = WindowSearch(self.likelihood, gaps, most, asked.index, _numbers_told(asked, frame.azimuth_deg))
        self._tile_fits: dict[Window, TileFit] = {}

    def across(self) -> _Axis:
        """The same for panes that lie across."""
        return _Axis(self.frame.across(), self._asked, self._spectra.across())

    def scene(self, window: Window) -> SceneParameters:
        """The scene that a window is."""
        # To the same side as the azimuth, as a pane's shift is told; it may be negative.
        sense = math.copysign(1.0, window.gap_along)
        gap = sense * math.hypot(window.gap_along, window.gap_across)
        turned = math.degrees(math.atan2(sense * window.gap_across, abs(window.gap_along)))
        along = window.n_panes == 1 or self._asked.gap_shift is not None
        direction = self._asked.gap_azimuth_deg if along else (self.frame.azimuth_deg - turned) % 360
        return self._asked.replace(
            incidence_deg=window.incidence_deg,
            azimuth_deg=self.frame.azimuth_deg,
            ghost_shift=window.pane_shift,
            n_panes=window.n_panes,
            gap_shift=self._asked.gap_shift if along and window.n_panes > 1 else gap,
            gap_azimuth_deg=direction,
            absorption=window.absorption,
        )

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

    def scan(self, n_panes: int, singles: Sequence[LikelyWindow], *found: Window) -> _Scan:
        """Windows of so many panes that are likely, begun from likely single panes, and those found."""
        starts = self.search.starts(n_panes, [*(single.window for single in singles[:MOST_STARTS]), *found])
        return _Scan(n_panes, starts, singles[0].misfit - starts[0].misfit)

    def candidates(self, scan: _Scan) -> list[LikelyWindow]:
        """Likely windows near those of a scan."""
        near = [self.search.refined(start.window, 1) for start in scan.starts]
        near.sort(key=lambda found: found.misfit)
        best = sorted(near, key=lambda found: found.misfit + self._edges(found.window))
        kept = dict.fromkeys(found.window for found in (*near[:_MOST_LIKELIEST], *best[:_MOST_CANDIDATES]))
        found = [self.search.refined(window, ROUGH_SWEEPS) for window in kept]
        return [*found, *(self._by_edges(one.window) for one in found[:1] if _close(one.window))]

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
        told = not _close(likeliest) and self.surer(likeliest, best.window) > _SURER
        return self.judged(likeliest) if told else best

    def likeliest(self, windows: Sequence[Window]) -> Window:
        """The window that the luminance of tiles, which takes a third of the time, is likeliest under as it is."""
        return min(windows, key=lambda window: self._glance.fitted(window, self._asked.index).misfit)

    def glimpses(self, candidates: Sequence[LikelyWindow], single: Window) -> bool:
        """Whether tiles are surely likelier under one of many windows than under a single pane."""
        apart = [found.window for found in candidates if not _close(found.window)]
        return bool(apart) and self.surer(self.likeliest(apart), single) > _SURER

    @cached_property
    def _glance(self) -> TileLikelihood:
        return self.tiles.luminance()

    @cached_property
    def tiles(self) -> TileLikelihood:
        """How likely the frame's tiles are under windows."""
        return TileLikelihood(self.frame)

    def surer(self, window: Window, other: Window) -> float:
        """Standard errors by which tiles are likelier under one window than under another, each at its incidence."""
        return self.tiles_under(window).surer_than(self.tiles_under(other))

    def tiles_under(self, window: Window) -> TileFit:
        """How likely the tiles are under a window, at the incidence near its own that suits them best."""
        if window not in self._tile_fits:
            self._tile_fits[window] = self.nearest_by_tiles(window, ())
        return self._tile_fits[window]

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
        told = [fit for fit in glances if _tells_of_tint(fit.window)]
        if not told:
            return None
        best = min(told, key=lambda fit: fit.misfit)
        if best.surer_than(self._glance.fitted(clear, self._asked.index)) < _PROMISING:
            return None
        found = self.nearest_by_tiles(best.window, _OF_TINT)
        return found if _tells_of_tint(found.window) else None

    def likelier_than_turned(self, found: LikelyWindow) -> bool:
        """Whether a window is clearly likelier than a single pane whose ghosts lie along its gap."""
        window = found.window
        single, direction = self.scene(Window(window.incidence_deg, 0.0)).plainest, self.scene(window).gap_azimuth_deg
        apart = math.hypot(window.gap_along, window.gap_across) + _BESIDE_PX
        shifts = np.concatenate([apart, -apart])

        def misfit(spectra: CrossSpectra, incidences_deg: Values, shifts: Values) -> Values:
            turned = spectra if direction is None else spectra.with_ghosts_along(direction)
            return np.asarray(ShiftLikelihood(turned, single, DETAIL).misfit(incidences_deg, shifts, ROUNDS))

        misfits = misfit(self._spectra, _TURNED_INCIDENCES_DEG, shifts)
        i, k = np.unravel_index(np.argmin(misfits), misfits.shape)
        rest = [misfit(part, _TURNED_INCIDENCES_DEG[[i]], shifts[[k]]).item() for part in self._spectra.left_out()]
        error = jackknife_error(np.array(rest) - found.parts[0])
        tiles = TileLikelihood(self.frame, ghosts_deg=direction)
        turned = tiles.nearest(Window(float(_TURNED_INCIDENCES_DEG[i]), float(shifts[k])), single.index)
        spectra = float(misfits[i, k] - found.misfit) / max(error, NO_ERROR)
        return _together((self.tiles_under(window).surer_than(turned), spectra)) > _BEYOND_TURNED

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
        others = [pane for pane in panes if apart(pane, plain.window) and not _close(pane)]
        if not others:
            return plain
        likeliest = self.judged(min(others, key=lambda window: self.tiles_under(window).misfit))
        return likeliest if _is_told(self, likeliest, plain) else plain

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


def _shows_across(single: LikelyWindow, plain: LikelyWindow) -> bool:
    """Whether a single pane that lies across explains the capture clearly better.

    Edges in noise may seem to say so where the spectra clearly say otherwise.
    """
    return single.clearly_better(plain, _LEAST_GAIN, _SURE) and not plain.clearly_likelier(single, _SURE)


def _several(axis: _Axis, scans: tuple[_Scan, _Scan]) -> list[LikelyWindow]:
    """The best windows of two panes, and of three, that may be the true one: the likelier of them first."""
    two, three = scans
    fewer = axis.surest(axis.candidates(two))
    more = axis.surest(axis.search.with_another(fewer.window) + axis.candidates(three))
    sure = 0.0 if _close(more.window) else axis.surer(more.window, fewer.window)
    third = sure > _SURER or (sure > -_SURER and more.score < fewer.score - _LEAST_GAIN)
    ordered = (more, fewer) if third else (fewer, more)
    return [window for window in ordered if axis.shows(window.window) or _is_told_in_noise(window.window)]


def _is_told_in_noise(window: Window) -> bool:
    """Whether several panes may be told where the noise leaves no edges of what they mirror to be seen."""
    return not _close(window) and window.incidence_deg > _LEAST_DEG


def _together(errors: tuple[float, ...]) -> float:
    """Standard errors of tiles, mean spectra and edges together."""
    limits, weights = (_MOST_OF_TILES, _MOST_OF_SPECTRA, _MOST_OF_EDGES), (1.0, _OF_MEAN_SPECTRA, _OF_EDGES)
    return sum(
        weight * min(max(error, least), most)
        for error, weight, (least, most) in zip(errors, weights, limits, strict=False)
    )


def _is_told(axis: _Axis, window: LikelyWindow, other: LikelyWindow) -> bool:
    """Whether all together tell a window beside another of its axis, or tiles alone."""
    tiles = axis.surer(window.window, other.window)
    return tiles > _SURE_OF_TILES or _together((tiles, *window.surer_than(other))) > _NEEDED


def _likelier(axis: _Axis, window: LikelyWindow, beside: _Axis, single: LikelyWindow) -> bool:
    """Whether a window of several panes is so much likelier than a single pane, of the same axis or of the one across.

    Where more numbers are free, edges overlap less by chance; where layers have edges in common they may overlap more.
    Images a pixel or two apart hardly change the spectra, but leave edges doubled. They suit few windows: no chance
    likeness was chosen from many. What lies closer passes for a pane of another index, or a tinted one.
    """
    spectra, edges = window.surer_than(single)
    tiles = axis.tiles_under(window.window).surer_than(beside.tiles_under(single.window))
    close = _close(window.window) and HARDLY_PX <= abs(single.window.pane_shift) <= _CLOSE_PX
    if close and axis is beside and spectra + edges > _SURE_OF_CLOSE and window.score < single.score:
        return True
    told = _together((tiles, spectra, edges))
    if axis is not beside or not axis.shows(window.window):
        return told > _NEEDED_IN_DOUBT
    return told > _NEEDED or (tiles > _SURE_OF_TILES and not _close(window.window))


def _with_panes(
    axes: Sequence[tuple[_Axis, Sequence[float]]], plain: LikelyWindow, found: LikelyWindow
) -> tuple[_Axis, LikelyWindow]:
    """A pane that was found, or the window that is clearly likelier; with its axis.

    Parameters
    ----------
    axes : sequence of (axis, incidences)
        The one found and, where it is in doubt, the one across, and where single panes are looked for.
    plain : LikelyWindow
        The single clear pane.
    found : LikelyWindow
        It, or a tinted one.
    """
    first = taken = axes[0][0]
    likely, single_across = list[tuple[_Axis, list[LikelyWindow]]](), plain
    for axis, incidences in axes:
        told = () if axis is not first else (plain.window,)
        singles = axis.search.single(incidences)
        across = axis is not first
        if across and singles[0].misfit > plain.misfit + _FAR_LESS_LIKELY:
            continue
        two = axis.scan(2, singles, *told)
        if across and two.misfit > plain.misfit + _NEARLY_AS_LIKELY:
            continue
        three = axis.scan(MOST_FOUND, singles, *told)
        # A gap that the spectra show shows in a scan as well; where a pane's ghosts are seen, it may not.
        unseen = not (across or plain.window.pane_shift) and two.gain < _LEAST_SEEN
        if unseen and not axis.glimpses([*two.starts, *three.starts], plain.window):
            continue
        if across:
            # What looks like several panes there may be a single one.
            single_across = axis.best(axis.search.panes(incidences))
            if _shows_across(single_across, plain) and single_across.score < found.score:
                taken, found = axis, single_across
        if windows := _several(axis, (two, three)):
            likely.append((axis, windows))
    likely.sort(key=lambda one: one[1][0].score)
    for axis, window in ((axis, window) for axis, windows in likely for window in windows):
        if not _likelier(axis, window, first, plain) or (found.window.absorption and window.score > found.score):
            continue
        if _looks_turned(window.window) and not axis.likelier_than_turned(window):
            continue
        # Two thin panes look much like the faces of one, whose ghost may have been missed.
        single = axis.with_ghost_of(window.window, plain.window) if axis is first else single_across
        if _likelier(axis, window, axis, single):
            return axis, window
        better = single.score < found.score and single.clearly_better(plain, _LEAST_GAIN, _SURE)
        if axis is first and (better or _is_told(axis, single, plain)):
            return axis, single
    return taken, found


def _tinted_or(axis: _Axis, starts: Sequence[Window], plain: LikelyWindow) -> LikelyWindow:
    """A clear pane, or a tinted one whose ghost lies so far off, and is so much dimmer, that it tells of tint."""
    tinted = axis.tinted_near(starts, plain.window)
    if tinted is None:
        return plain
    clear = axis.judged(axis.nearest_by_tiles(replace(tinted.window, absorption=0.0), ("pane_shift",)).window)
    panes = [clear, plain, *([axis.judged(replace(plain.window, pane_shift=0.0))] if plain.window.pane_shift else [])]
    likeliest = min(panes, key=lambda pane: axis.tiles_under(pane.window).misfit)
    judged = axis.judged(tinted.window)
    tiles = tinted.surer_than(axis.tiles_under(likeliest.window))
    told = tiles > _LEAST_OF_TILES and _together((tiles, *judged.surer_than(likeliest))) > _NEEDED
    return judged if told else plain


def _tinted_across(across: _Axis, first: _Axis, found: LikelyWindow) -> tuple[_Axis, LikelyWindow]:
    """A pane that was found, or a tinted one across that is likelier.

    Dark glass mirrors more beside what it lets through, and polarizes as clear glass does across.
    """
    near = [pane for angle in _TRIAL_DEG for pane in across.search.tinted(angle)]
    starts = [pane.window for pane in sorted(near, key=lambda pane: pane.misfit)[:_MOST_CANDIDATES]]
    tinted = across.tinted_near(starts, replace(starts[0], absorption=0.0)) if starts else None
    if tinted is None:
        return first, found
    judged, tiles = across.judged(tinted.window), tinted.surer_than(first.tiles_under(found.window))
    told = _together((tiles, *judged.surer_than(found))) > _NEEDED_ACROSS
    return (across, judged) if told and judged.score < found.score - _GAIN_ACROSS else (first, found)


def _numbers_told(asked: SceneParameters, azimuth_deg: float) -> dict[str, Any]:
    """Numbers of a window that are not to be found."""
    told = {"incidence_deg": asked.incidence_deg, "pane_shift": asked.ghost_shift, "absorption": asked.absorption}
    if asked.gap_shift is not None:
        turned = math.radians(azimuth_deg - (azimuth_deg if asked.gap_azimuth_deg is None else asked.gap_azimuth_deg))
        told |= {"gap_along": asked.gap_shift * math.cos(turned), "gap_across": asked.gap_shift * math.sin(turned)}
    return {name: value for name, value in told.items() if value is not None}


def with_window(estimate: SceneEstimate, stokes: StokesImages, asked: SceneParameters) -> SceneEstimate:
    """An estimate of a single clear pane, or the window that explains the capture clearly better.

    Parameters
    ----------
    estimate : SceneEstimate
        Of a single flat pane.
    stokes : StokesImages
    asked : SceneParameters
        Fields that are None are to be found: tint of a single pane, and up to three clear ones. A number of panes and
        an absorption that are given are kept.
    """
    incidence, azimuth, shift = estimate.scene.values()
    open_panes = asked.n_panes is None
    doubtful = estimate.axis_margin < _DOUBTFUL_MARGIN or (open_panes and incidence > _DOUBTFUL_DEG)
    doubtful &= asked.azimuth_deg is None
    first = _Axis(plate_frame(stokes, azimuth), asked)
    across = first.across() if doubtful else None
    shown = first.shows(Window(incidence, shift))
    if open_panes and not shown and across is None:
        return estimate

    axes = [(first, (incidence,)), *((axis, _TRIAL_DEG) for axis in (across,) if axis is not None)]
    if open_panes or asked.n_panes == 1:
        plains = {Window(incidence, px, absorption=asked.absorption or 0.0) for px in (shift, 0.0)}
        before = plain = min((first.judged(window) for window in plains), key=lambda judged: judged.score)
        of_tint = asked.absorption is None and (shown or not open_panes)
        tinted = [near.window for near in first.search.tinted(incidence)] if of_tint else []
        if shown:
            # A dim ghost that is looked for may be one of clear glass.
            clear = [replace(window, absorption=0.0) for window in tinted]
            panes = [near.window for near in first.search.panes((incidence,))]
            plain = first.with_surer_ghosts([*panes, *clear], plain)
        found, taken = _tinted_or(first, tinted, plain) if of_tint else plain, first
        if of_tint and across is not None:
            taken, found = _tinted_across(across, first, found)
        if open_panes and taken is first:
            taken, found = _with_panes(axes, plain, found)
        if found is before:
            return estimate
    else:
        n_panes = asked.n_panes or 1
        scans = [(axis, axis.scan(n_panes, axis.search.single(near))) for axis, near in axes]
        pairs = [(axis, axis.best(axis.candidates(scan))) for axis, scan in scans]
        taken, found = min(pairs, key=lambda pair: pair[1].score)
    scene, errors = taken.refined(found.window)
    tint_found = bool(found.window.absorption) and asked.absorption is None
    if tint_found and not _tells_of_tint(window_of(scene, taken.frame.azimuth_deg)):
        # At the incidence that edges tell no ghost tells of tint.
        return estimate
    errors = replace(errors, azimuth_deg=estimate.errors.azimuth_deg)
    return replace(estimate, scene=scene, errors=errors, axis_chance=0.0, axis_gain_db=math.inf, rivals=())


def judged_pane(
    frame: PlateFrame, scene: SceneParameters, *, incidence_open: bool = True, spectra: CrossSpectra | None = None
) -> LikelyWindow:
    """How well a single pane that was found explains a capture, with its double images or in place.

    Parameters
    ----------
    frame : PlateFrame
        At the azimuth of the scene.
    scene : SceneParameters
        Complete.
    incidence_open : bool
        Whether the incidence may move to where the layers' edges overlap least.
    spectra : CrossSpectra, optional
        Of the frame, where they are at hand.
    """
    incidence, _, shift = scene.values()
    axis = _Axis(frame, scene.replace(incidence_deg=None) if incidence_open else scene, spectra)
    return axis.best([LikelyWindow(Window(incidence, px), math.inf, math.inf) for px in dict.fromkeys((shift, 0.0))])


def judged_window(frame: PlateFrame, scene: SceneParameters, spectra: CrossSpectra | None = None) -> LikelyWindow:
    """The same of a window that was found, of as many panes as it has, near its incidence."""
    return _Axis(frame, scene.replace(incidence_deg=None), spectra).judged(window_of(scene, frame.azimuth_deg))


def window_of(scene: SceneParameters, azimuth_deg: float) -> Window:
    """The window that a complete scene is, in the frame of an azimuth that is its own."""
    return Window(**_numbers_told(scene, azimuth_deg), n_panes=scene.n_panes or 1)


def window_remark(scene: SceneParameters) -> str:
    """What is to be said of a pane without double images: several would look like it."""
    incidence = equivalent_incidences(scene.values()[0], 2, scene.index)[-1]
    return f"Without double images two panes at {incidence:.0f} degrees would look much alike."
