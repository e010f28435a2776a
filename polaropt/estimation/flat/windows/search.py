"""The search for the likeliest window at one azimuth, given a capture's mean spectra.

The shifts at which a single pane is likely are those between the brightest images, a pane's and that from pane to
pane. With each of them as the pane's, a map of gaps of all lengths and directions leads near the window, and steps
along all its numbers to it.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray

from polaropt.estimation.flat.windows.gaps import GapMap
from polaropt.estimation.flat.windows.likelihood import Window, WindowLikelihood
from polaropt.numerics import jackknife_error, local_minima, vertex
from polaropt.optics import GHOST_SHIFT_SEARCH_PX, INCIDENCE_SEARCH_DEG, in_place_reflectance, in_place_weights

Values = NDArray[np.float64]

# All below by trial.
STEP_PX, _PANE_PX = 1.0, 6.0
"""Spacing of scans, and the largest shift of a pane that is scanned."""
MOST_STARTS = 3
"""Shifts of a single pane that windows are begun from."""
ANOTHER_DEG = (5.0, 9.0)
"""How much less steep a window with a pane more stands that looks like one without."""
_EQUIVALENT_STEP_DEG = 1.0
_LEAST_EQUIVALENT, _EQUIVALENT_SPACING_DEG = 2, 7.0
_MOST_GAPS, _MOST_LIKELY = 12, 16
"""Likely gaps for each shift of a pane and each incidence, and likely windows of a scan."""
_SCAN_ROUNDS, ROUNDS = 4, 8
_FIRST_STEPS = (2.0, 0.5, 0.5, 0.5, 0.1)
"""Of incidence (degrees), the three shifts (pixels) and absorption."""
_CLOSER, ROUGH_SWEEPS, _SWEEPS = 0.5, 3, 4
"""What steps are multiplied by from sweep to sweep, and the number of sweeps."""
NAMES = ("incidence_deg", "pane_shift", "gap_along", "gap_across", "absorption")
NO_ERROR = 1e-9
"""For none at all, of a frame that is all alike."""
_WEAK_PRIOR = 0.002
"""Of a squared absorption, in log likelihood: dim ghosts hardly tell how dark the glass is. By trial."""
TRIAL_ABSORPTION = 0.4
"""Of tinted glass: two thirds of the light pass."""
TRIAL_INDICES = (1.35, 1.5, 1.65, 1.8, 1.95)
"""Indices at which tiles are glanced at. Set by hand."""
_SAME_DEG = 0.5
"""Incidences less apart are the same. Set by hand."""
_ALIKE_DEG = np.arange(*INCIDENCE_SEARCH_DEG, 0.5)
"""Incidences among which those are that make panes alike."""


@dataclass(frozen=True)
class LikelyWindow:
    """A window and its score: minus its log likelihood per frequency, and the log overlap of its layers' edges.

    `misfit` is the first alone; `parts` are the same two without parts of the frame.
    """

    window: Window
    score: float
    misfit: float
    parts: tuple[Values, ...] = ()

    @property
    def edges(self) -> float:
        """What the overlap of the layers' edges adds to the score."""
        return self.score - self.misfit

    def clearly_better(self, other: LikelyWindow, least: float, sure: float) -> bool:
        """Whether it scores better than another in all of the frame: by so much, and so many standard errors of it."""
        error = math.hypot(*(jackknife_error(a - b) for a, b in zip(self.parts, other.parts, strict=True)))
        return bool(other.score - self.score > max(least, sure * error))

    def clearly_likelier(self, other: LikelyWindow, sure: float) -> bool:
        """Whether the spectra alone, without the edges, are clearly likelier than under another."""
        return bool(other.misfit - self.misfit > sure * jackknife_error(other.parts[0] - self.parts[0]))

    def surer_than(self, other: LikelyWindow) -> tuple[float, float]:
        """Standard errors by which the spectra are likelier than under another, and by which edges overlap less."""
        gains = other.misfit - self.misfit, other.edges - self.edges
        errors = [jackknife_error(b - a) for a, b in zip(self.parts, other.parts, strict=True)]
        spectra, edges = (float(gain / max(error, NO_ERROR)) for gain, error in zip(gains, errors, strict=True))
        return spectra, edges


class WindowSearch:
    """Search for the likeliest window at one azimuth.

    Parameters
    ----------
    likelihood : WindowLikelihood
    gaps : GapMap
    most_shift : float
        Largest shift to look at, in pixels.
    refractive_index : float
    told : dict of str to float
        Numbers of a window that are not to be found.
    """

    def __init__(
        self,
        likelihood: WindowLikelihood,
        gaps: GapMap,
        most_shift: float,
        refractive_index: float,
        told: dict[str, Any],
    ) -> None:
        self._likelihood, self._gaps, self._index, self.told = likelihood, gaps, refractive_index, told
        n = math.floor(most_shift / STEP_PX)
        self._grid = STEP_PX * np.arange(-n, n + 1.0)

    def single(self, incidences_deg: Sequence[float], absorption: float = 0.0) -> list[LikelyWindow]:
        """Likely single panes: at the likeliest of some incidences each local minimum over shifts, likeliest first."""
        windows = [
            Window(incidence, shift, absorption=absorption)
            for incidence, shift in product(incidences_deg, self._grid.tolist())
        ]
        misfits = self._likelihood.misfit(windows, _SCAN_ROUNDS).reshape(len(incidences_deg), -1)
        best = int(np.argmin(misfits.min(axis=1)))
        misfit, trials = misfits[best], windows[best * self._grid.size :]
        # Where a pane shows next to nothing, no shift is likelier than those beside it.
        minima = np.flatnonzero(local_minima(misfit))
        minima = minima if minima.size else np.array([np.argmin(misfit)])
        return [
            LikelyWindow(trials[int(i)], float(misfit[i]), float(misfit[i])) for i in minima[np.argsort(misfit[minima])]
        ]

    def tinted(self, incidences_deg: Sequence[float]) -> list[LikelyWindow]:
        """Likely tinted panes, begun from the likeliest of some incidences."""
        starts = self.single(incidences_deg, TRIAL_ABSORPTION)[:MOST_STARTS]
        found = [self.refined(start.window, ROUGH_SWEEPS) for start in starts]
        # At the end of what is searched there is no minimum.
        return [near for near in found if abs(near.window.pane_shift) <= self._grid[-1] - STEP_PX]

    def panes(self, incidences_deg: Sequence[float]) -> list[LikelyWindow]:
        """Likely single clear panes, begun from some incidences."""
        return [self.refined(start.window, ROUGH_SWEEPS) for start in self.single(incidences_deg)[:MOST_STARTS]]

    def with_another(self, window: Window) -> list[LikelyWindow]:
        """Likely windows of a pane more than one that was found, whose panes stand alike."""
        angles = [window.incidence_deg - step for step in ANOTHER_DEG]
        starts = [replace(window, incidence_deg=angle, n_panes=window.n_panes + 1) for angle in angles if angle > 0]
        return [self.refined(start, ROUGH_SWEEPS) for start in starts]

    def starts(self, n_panes: int, singles: Sequence[Window]) -> list[LikelyWindow]:
        """Likely windows of so many panes whose shifts have something in common with those of single ones."""
        near = equivalent_incidences(singles[0].incidence_deg, n_panes, self._index)
        shifts = [single.pane_shift for single in singles]
        trials: dict[Window, None] = {}
        if "gap_along" not in self.told:
            panes = [self.told["pane_shift"]] if "pane_shift" in self.told else list(dict.fromkeys((0.0, *shifts)))
            for angle, pane in product(near, panes):
                window = replace(Window(angle, pane, n_panes=n_panes), **self.told)
                for along, across in self._gaps.likely(window, _MOST_GAPS):
                    trials[replace(window, gap_along=along, gap_across=across)] = None
        # The likeliest shift of a single pane may be that from one pane to the next.
        thin = self._grid[np.abs(self._grid) <= _PANE_PX].tolist()
        for angle, one, pane in product(near, shifts, thin):
            trials[replace(Window(angle, pane, one - pane, n_panes=n_panes), **self.told)] = None
        return self._likely(list(trials), _MOST_LIKELY)

    def _likely(self, windows: list[Window], most: int) -> list[LikelyWindow]:
        """The likeliest windows, those beside likelier ones left out."""
        misfit = self._likelihood.misfit(windows, _SCAN_ROUNDS)
        kept = likeliest_apart(windows, misfit, most, apart)
        return [LikelyWindow(windows[i], float(misfit[i]), float(misfit[i])) for i in kept]

    def refined(self, start: Window, sweeps: int = _SWEEPS, kept: Collection[str] = ()) -> LikelyWindow:
        """The likeliest window near a start, along each of its numbers in turns but those that are told, or kept."""
        names = (*(NAMES[:4] if start.n_panes > 1 else NAMES[:2]), *(NAMES[4:] if start.absorption else ()))
        free = [name for name in names if name not in self.told and name not in kept]
        steps = dict(zip(NAMES, _FIRST_STEPS, strict=True))
        best = LikelyWindow(replace(start, **self.told), math.inf, math.inf)
        for _ in range(sweeps):
            for name in free:
                here = getattr(best.window, name)
                best = self._along(best.window, name, steps[name])
                # Far steps say that the minimum is not near yet.
                near = abs(getattr(best.window, name) - here) < steps[name]
                steps[name] *= _CLOSER if near else 1.0
        return best

    def _along(self, window: Window, name: str, step: float) -> LikelyWindow:
        """The likeliest of a few windows along one number, between them by a parabola."""
        here = getattr(window, name)
        # A start may lie beyond what is searched: a pane's shift and a gap's add up to one that is not.
        values = [v for v in (here + step * np.arange(-2, 3.0)).tolist() if _allowed(name, v)] or [here]
        near = [replace(window, **{name: value}) for value in values]
        misfit = self._likelihood.misfit(near, ROUNDS)
        misfit += _WEAK_PRIOR * np.square([trial.absorption for trial in near])
        i = int(np.argmin(misfit))
        at = values[i]
        if 0 < i < len(values) - 1:
            at += step * vertex(*(float(m) for m in misfit[i - 1 : i + 2]))
        return LikelyWindow(replace(window, **{name: at}), float(misfit[i]), float(misfit[i]))


def _allowed(name: str, value: float) -> bool:
    if name == "incidence_deg":
        return INCIDENCE_SEARCH_DEG[0] <= value <= INCIDENCE_SEARCH_DEG[1]
    return value >= 0 if name == "absorption" else abs(value) <= GHOST_SHIFT_SEARCH_PX


def likeliest_apart(
    windows: Sequence[Window], misfits: Sequence[float] | Values, most: int, are_apart: Callable[[Window, Window], bool]
) -> list[int]:
    """Which of some windows are the likeliest, so many at most, those beside likelier ones left out."""
    kept: list[int] = []
    for i in np.argsort(misfits).tolist():
        if all(are_apart(windows[i], windows[other]) for other in kept):
            kept.append(i)
        if len(kept) == most:
            break
    return kept


def apart(one: Window, other: Window) -> bool:
    """Whether two windows are more than neighbours of a scan."""
    shifts = ("pane_shift", "gap_along", "gap_across")
    far = max(abs(getattr(one, name) - getattr(other, name)) for name in shifts)
    return bool(far > 2 * STEP_PX)


def equivalent_incidences(incidence_deg: float, n_panes: int, refractive_index: float) -> list[float]:
    """Incidences between those at which so many panes in place polarize, and mirror, as one does at another."""
    angles = np.arange(INCIDENCE_SEARCH_DEG[0], incidence_deg + _EQUIVALENT_STEP_DEG, _EQUIVALENT_STEP_DEG)
    table = np.array([_reflected(float(angle), n_panes, refractive_index) for angle in angles])
    alike = np.abs(table - _reflected(incidence_deg, 1, refractive_index)).argmin(axis=0)
    lowest, highest = sorted(angles[alike].tolist())
    n = max(_LEAST_EQUIVALENT, math.ceil((highest - lowest) / _EQUIVALENT_SPACING_DEG) + 1)
    return [float(angle) for angle in np.linspace(lowest, highest, n)]


def equivalent_single(incidence_deg: float, n_panes: int, refractive_index: float) -> float:
    """Incidence at which one pane in place polarizes as so many do at another, before it mirrors all light alike."""
    last = max(incidence_deg, INCIDENCE_SEARCH_DEG[1])
    angles = np.arange(incidence_deg, last + _EQUIVALENT_STEP_DEG, _EQUIVALENT_STEP_DEG)
    asked, _ = _reflected(incidence_deg, n_panes, refractive_index)
    single = np.array([_reflected(float(angle), 1, refractive_index)[0] for angle in angles])
    rising = single[: int(np.argmax(single)) + 1]
    return float(angles[int(np.argmin(np.abs(rising - asked)))])


def alike_incidences(incidence_deg: float, index: float, more: float) -> list[float]:
    """Incidences at which a pane of another index keeps the transmission, and the reflection, as free of the other.

    What is mirrored along and across the plane of incidence tells the first by its ratio, on the same side of
    Brewster's angle, the second by the ratio of what is not mirrored; a single one where both are close.
    """
    par, perp = in_place_reflectance(incidence_deg, index, False)
    _, (pars, perps, _) = in_place_weights(np.cos(np.radians(_ALIKE_DEG)), index + more, False)
    steep = incidence_deg > math.degrees(math.atan(index))
    same_side = (math.degrees(math.atan(index + more)) < _ALIKE_DEG) == steep
    of_transmission = np.where(same_side, np.abs(np.log(perps * par / (pars * perp))), np.inf)
    of_reflection = np.abs(np.log((1 - perps) * (1 - par) / ((1 - pars) * (1 - perp))))
    first, second = (float(_ALIKE_DEG[np.argmin(apart)]) for apart in (of_transmission, of_reflection))
    return [second] if abs(first - second) < _SAME_DEG else [second, first]


@lru_cache(maxsize=4096)
def _reflected(incidence_deg: float, n_panes: int, refractive_index: float) -> tuple[float, float]:
    """How much more panes in place mirror across the plane of incidence than along, and how much across."""
    par, perp = in_place_reflectance(incidence_deg, refractive_index, False, n_panes)
    return perp - par, perp
