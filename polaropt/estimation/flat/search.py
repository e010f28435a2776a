"""The search for incidence and ghost shift in the plate's frame, coarse to fine.

Edge overlap tells the incidence finely once the ghosts are accounted for; the spectral likelihood tells the ghost
shift once the incidence is about right, and the two together tell where to begin. So trial incidences, each with its
likeliest shift, are compared first, and from the best of them incidence and shift are improved in turns.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from statistics import NormalDist
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from polaropt.capture import PlateFrame
from polaropt.estimation.flat.errors import IncidenceLikelihood, ShiftErrors, incidence_error, shift_errors
from polaropt.estimation.flat.ghosts import CrossSpectra, ShiftLikelihood, cross_spectra
from polaropt.estimation.flat.layer_shifts import own_shifts
from polaropt.estimation.flat.overlap import BlockImages, EdgeOverlap, block_images
from polaropt.numerics import grid_minimum, jackknife_error, local_minima, local_minimum
from polaropt.optics import (
    FARTHEST_SHIFT_PX,
    INCIDENCE_SEARCH_DEG,
    SceneParameters,
    ghost_step,
    interface,
    largest_search_shift,
)

Curve = NDArray[np.float64]

INCIDENCE_GRID_DEG: Curve = np.arange(2.0, INCIDENCE_SEARCH_DEG[1] + 1, 2.0)
# All below by trial.
_TRIAL_DEG = (12.0, 25.0, 35.0, 42.0, 48.0, 54.0, 61.0, 68.0, 75.0, 81.0, 86.0)
"""Trial incidences: closer where panes are usually seen and ghosts change fast."""
_TRIAL_STEP_PX = 1.0
"""Spacing of their ghost shifts: those farther apart are others."""
_TRIAL_HALF_WIDTH_DEG, _TRIAL_STEP_DEG = 7.5, 2.5
_COARSE_HALF_WIDTH_DEG, _COARSE_STEP_DEG = 6.0, 2.0
_NEAR_HALF_WIDTH_DEG, _NEAR_STEP_DEG = 4.8, 1.2
"""Incidences around one: of a trial, on coarse blocks, and where shifts are compared."""
_MOST_BLOCKS, _MOST_TRIAL_BLOCKS, _TRIAL_SIZES = 160, 80, 3
"""Per side: a larger frame has enough blocks at a coarser scale, and trials do with fewer, and fewer scales."""
_N_TRIALS = 3
"""Likeliest trials whose overlap is looked at."""
_HALVINGS = 2
"""Times that trials are put halfway between the likeliest and those beside them, as a bright reflection makes minima
narrow. With none, panes at 82 to 86 degrees, and at 72 whose reflection is ten times as bright, were missed."""
_N_CANDIDATES, _CANDIDATE_STEP_PX = 6, 0.5
"""Likeliest shifts among which likelihood and overlap together choose, and the grid that they lie on."""
OVERLAP_WEIGHT = 0.2
"""Misfit per frequency that a unit of log overlap is worth."""
_TURNS, _RESTING_DEG = 4, 0.5
"""Turns of shift and incidence at most, and how little the incidence moves when both rest."""
_GRAZING_DEG, _GRAZING_PENALTY = 85.5, 0.03
"""Score per degree beyond: panes are hardly ever seen so, and one across, its layers exchanged, looks much alike."""
_OTHER_PX, _AGAINST, _MUCH_AGAINST = 0.75, 3.0, 10.0
"""Pixels from which on a shift that was given is another one than that found, standard errors of the log likelihood
that it loses, and how much of it, that speak against it."""
_FINE_BLOCK = 4
"""Side in pixels of the blocks whose edges tell whether the reflection is sharp."""
_CLOSELY = 16
"""Rounds in which spectra are fitted where misfits with and without ghosts are compared."""
_FINE_SHIFTS_PX: Curve = np.arange(-4.0, 4.5) / 8
_STEP_DEG, _ROUGHLY_DEG, _TOLERANCE_DEG = 2.0, 1.0, 0.2
_LEAST_GAIN, _SURE = 2e-5, 5.0
"""Misfit per frequency that a shift must gain over none, and how many times that to be sure of it. Errors mimic ghosts
more towards normal incidence, from `_MIMIC_DEG` on with a high power, and in noise."""
_MIMIC_DEG, _MIMIC_POWER, _IN_NOISE = 27.0, 8, 3
_FAR_DEG, _FAR_WEIGHT, _FAR_SLACK = 4.0, 0.5, 0.05
"""From where on an incidence is another one, what a unit of log overlap counts there beside the misfit, and the score
that it may lack on the grid to be looked at closely."""
_NO_ERROR, _LEAST_CHANCE = 1e-12, 1e-3
"""Least standard error of a score, and what is left of the chance of what is sure; chance from which on it counts."""
_BRIGHT_REFLECTANCE, _LEAST_SHARE = 0.6, 0.025
"""Reflectance of one face from which on the overlap counts fully where shifts are compared, and the least share of it.
"""


@dataclass(frozen=True)
class Thickness:
    """Thickness of the pane in pixels, and the formula of its ghost step."""

    pixels: float
    kind: Literal["paper", "plate"]

    def step(self, incidence_deg: float, refractive_index: float) -> float:
        """Ghost step at an incidence, in pixels; where all are out of sight it does not matter how far."""
        return min(ghost_step(incidence_deg, refractive_index, self.pixels, self.kind), FARTHEST_SHIFT_PX)


@dataclass(frozen=True)
class Trial:
    """An incidence and a ghost shift, and how well they explain the capture (less is better)."""

    incidence_deg: float
    ghost_shift: float
    score: float


@dataclass(frozen=True)
class _Judged:
    """A trial, the misfit of its spectra in detail, its score with the edges, and both without parts of the frame."""

    trial: Trial
    misfit: float
    score: float
    parts: tuple[Curve, Curve]

    def chance_beside(self, best: _Judged) -> float:
        """Chance that it is the true one and not the best, for what parts of the frame say of the two."""
        error = math.hypot(*(_error_between(a, b) for a, b in zip(self.parts, best.parts, strict=True)))
        return NormalDist().cdf((best.score - self.score) / max(error, _NO_ERROR))


def _error_between(one: Curve, other: Curve) -> float:
    """Jackknife error of a difference; of a small frame edges on other scales leave other parts out."""
    if one.size == other.size:
        return jackknife_error(one - other)
    return math.hypot(jackknife_error(one), jackknife_error(other))


@dataclass(frozen=True)
class Evidence:
    """What the search reads of a capture at one azimuth: mean spectra, and blocks coarse and fine."""

    spectra: CrossSpectra
    coarse: BlockImages
    fine: BlockImages

    def across(self) -> Evidence:
        """The same for a pane whose plane of incidence lies across."""
        return Evidence(self.spectra.across(), self.coarse.across(), self.fine.across())


def evidence(frame: PlateFrame) -> Evidence:
    """Gather what the search needs of a frame."""
    coarse = block_images(frame, _MOST_TRIAL_BLOCKS, _TRIAL_SIZES)
    return Evidence(cross_spectra(frame), coarse, block_images(frame, _MOST_BLOCKS))


class SceneSearch:
    """Search at one azimuth for those of incidence and ghost shift that the scene leaves open."""

    def __init__(self, seen: Evidence, scene: SceneParameters, thickness: Thickness | None) -> None:
        self._seen = seen
        self._scene = scene
        self._thickness = thickness
        self._open_shift = scene.ghost_shift is None and not scene.single_surface
        self._likelihood = ShiftLikelihood(seen.spectra, scene)
        self._in_place = EdgeOverlap(seen.coarse, scene, 0.0)
        self._overlaps_in_place: dict[float, float] = {}
        self._shift_curves: dict[Trial, tuple[Curve, Curve]] = {}

    def first(self) -> Trial:
        """The best of a few trial incidences, each with its likeliest ghost shift."""
        given = self._scene.incidence_deg
        trials = [self._likeliest(incidence) for incidence in (_TRIAL_DEG if given is None else (given,))]
        likely = sorted(trials, key=lambda trial: trial.score)[:_N_TRIALS]
        for _ in range(_HALVINGS):
            trials += [self._likeliest(incidence) for incidence in _between_likely(trials)]
            trials.sort(key=lambda trial: trial.incidence_deg)
        likely = list(dict.fromkeys([*likely, *(trials[i] for i in _likely(trials))]))
        return min((self._with_overlap(trial) for trial in likely), key=lambda trial: trial.score)

    def improved(self, trial: Trial) -> Trial:
        """Ghost shift and incidence in turns until both rest; its own shift where that scores better than another."""
        found = self._improved(trial)
        elsewhere = abs(found.ghost_shift - trial.ghost_shift) > _TRIAL_STEP_PX
        if found.score <= trial.score or not elsewhere or self._thickness is not None:
            return found
        kept = self._with_fine_shift(self._with_overlap_minimum(trial))
        kept = Trial(kept.incidence_deg, kept.ghost_shift, self._score(kept))
        return min(found, kept, key=lambda trial: trial.score)

    def _improved(self, trial: Trial) -> Trial:
        trial = self._with_overlap_minimum(trial)
        for _ in range(_TURNS if self._open_shift else 0):
            before = trial
            trial = self._with_overlap_minimum(self._best_shift(trial.incidence_deg))
            moved_deg = abs(trial.incidence_deg - before.incidence_deg)
            if trial.ghost_shift == before.ghost_shift and moved_deg < _RESTING_DEG:
                break
        if self._open_shift and self._thickness is None:
            trial = self._with_fine_shift(trial)
        else:
            trial = self._with_overlap_minimum(trial, _TOLERANCE_DEG)
        if self._thickness is not None:
            trial = self._with_tied_shift(trial)
        return Trial(trial.incidence_deg, trial.ghost_shift, self._score(trial))

    def best_of_far(self, trial: Trial) -> tuple[Trial, list[tuple[Trial, float]]]:
        """The trial, or the one far from it that spectra and edges together find likelier, if the spectra alone do.

        Towards the first trials' incidences, which know few spectra, a search may lead to the wrong one of two minima.

        Returns
        -------
        trial : Trial
        others : list of (Trial, float)
            The other minima, and the chance that the truth is there.
        """
        if self._scene.incidence_deg is not None or self._thickness is not None:
            return trial, []
        grid, here = INCIDENCE_GRID_DEG, self._judged(trial)
        misfit = IncidenceLikelihood(self._seen.spectra, self._scene, trial.ghost_shift).misfit(grid)
        score = misfit + _FAR_WEIGHT * np.log(self.curve(trial))
        away = np.abs(grid - trial.incidence_deg) > _FAR_DEG
        far = local_minima(score) & away & (score < score[~away].min() + _FAR_SLACK)
        found = [self.improved(Trial(float(angle), trial.ghost_shift, math.inf)) for angle in grid[far]]
        found = [other for other in found if abs(other.incidence_deg - trial.incidence_deg) > _FAR_DEG]
        panes = [here, *map(self._judged, found)]
        best = min((pane for pane in panes if pane.misfit <= here.misfit), key=lambda pane: pane.score)
        odds = {pane.trial: _odds(pane.chance_beside(best)) for pane in panes if pane is not best}
        chances = {trial: own / (1 + sum(odds.values())) for trial, own in odds.items()}
        return best.trial, [(trial, chance) for trial, chance in chances.items() if chance > _LEAST_CHANCE]

    def _judged(self, trial: Trial) -> _Judged:
        incidence, spectra = trial.incidence_deg, self._seen.spectra
        misfits = [
            IncidenceLikelihood(part, self._scene, trial.ghost_shift).at(incidence)
            for part in (spectra, *spectra.left_out)
        ]
        overlap = self._best_scales(trial, self._seen.fine)
        score = misfits[0] + _FAR_WEIGHT * math.log(overlap.joint(incidence))
        parts = np.array(misfits[1:]), _FAR_WEIGHT * np.log(overlap.left_out(incidence))
        return _Judged(trial, misfits[0], score, parts)

    def _score(self, trial: Trial) -> float:
        misfit = float(self._likelihood.misfit(trial.incidence_deg, [trial.ghost_shift])[0])
        overlap = EdgeOverlap(self._seen.coarse, self._scene, trial.ghost_shift)
        return misfit + OVERLAP_WEIGHT * self._log_overlap(overlap, trial.incidence_deg)

    def curve(self, trial: Trial) -> Curve:
        """Edge overlap over all trial incidences, at the trial's ghost shift."""
        overlap = self._best_scales(trial, self._seen.coarse)
        return np.array([overlap.joint(float(incidence)) for incidence in INCIDENCE_GRID_DEG])

    def shift_curve(self, trial: Trial) -> tuple[Curve, Curve]:
        """Ghost shifts and their misfit, at the trial's incidence."""
        if trial not in self._shift_curves:
            grid = self._shift_grid(trial.incidence_deg, _CANDIDATE_STEP_PX)
            self._shift_curves[trial] = grid, self._likelihood.misfit(trial.incidence_deg, grid)
        return self._shift_curves[trial]

    def speaks_against(self, told: Trial) -> bool:
        """Whether another ghost shift is likelier than one that was given, on either side, for all parts of the frame.

        Of 140 simulated captures (20 to 78 degrees, noise up to 1.5 %, up to 180 px) none speaks against the right one,
        and one in four against twice as much: larger and cleaner ones do, those of which nothing is told do not.
        """
        grid, misfit = self.shift_curve(told)
        best, shift = float(grid[np.argmin(misfit)]), told.ghost_shift
        spectra = self._seen.spectra
        if abs(abs(best) - abs(shift)) <= _OTHER_PX:
            return False
        given = [shift, -shift, best]
        parts = [ShiftLikelihood(part, self._scene).misfit(told.incidence_deg, given) for part in spectra.left_out]
        whole = self._likelihood.misfit(told.incidence_deg, given)
        side = int(np.argmin(whole[:2]))
        lost, of_parts = whole[side] - whole[2], np.array([part[side] - part[2] for part in parts])
        much = lost * float(spectra.multiplicity.sum()) > _MUCH_AGAINST
        return much and len(parts) > 1 and bool(lost > _AGAINST * jackknife_error(of_parts))

    def with_own_shifts(self, frame: PlateFrame, found: SceneParameters) -> SceneParameters:
        """A scene that was found, with a shift for each layer where both were open and that explains clearly more."""
        open_shifts = self._open_shift and self._thickness is None and self._scene.transmission_ghost_shift is None
        # They are found together with the incidence.
        if not open_shifts or self._scene.incidence_deg is not None or found.n_bounces == 0:
            return found
        return own_shifts(frame, self._likelihood, found, self._most_shift)

    def incidence_error(self, trial: Trial) -> float:
        """Standard error in degrees of the incidence of least edge overlap."""
        return incidence_error(lambda blocks: self._best_scales(trial, blocks), self._seen.fine, trial.incidence_deg)

    def shift_errors(self, found: SceneParameters) -> ShiftErrors:
        """Standard errors of the ghost shifts of both layers."""
        if not found.has_ghosts:
            return ShiftErrors()
        incidence, _, shift = found.values()
        likely = [] if self._thickness else self._likely_shifts(incidence, _CANDIDATE_STEP_PX, _N_CANDIDATES)
        rivals = [rival for rival in likely if abs(rival - shift) > 1]
        errors = shift_errors(self._seen.spectra, found, rivals)
        told = self._scene.transmission_ghost_shift is not None
        return replace(errors, transmission_ghost_shift=None) if told else errors

    def _likeliest(self, incidence_deg: float) -> Trial:
        grid = self._shift_grid(incidence_deg, _TRIAL_STEP_PX)
        misfit = self._likelihood.misfit(incidence_deg, grid, rounds=1)
        best = int(np.argmin(misfit))
        return Trial(incidence_deg, float(grid[best]), float(misfit[best]))

    def _with_overlap(self, trial: Trial) -> Trial:
        """The trial moved to the least edge overlap around it, which counts in its score."""
        incidences = np.array([trial.incidence_deg])
        if self._scene.incidence_deg is None:
            incidences = _around(trial.incidence_deg, _TRIAL_HALF_WIDTH_DEG, _TRIAL_STEP_DEG)
        overlap = EdgeOverlap(self._seen.coarse, self._scene, trial.ghost_shift)
        values = [overlap.joint(float(incidence)) for incidence in incidences]
        best = float(incidences[int(np.argmin(values))])
        return Trial(best, trial.ghost_shift, trial.score + OVERLAP_WEIGHT * self._log_overlap(overlap, best))

    def _log_overlap(self, overlap: EdgeOverlap, incidence_deg: float) -> float:
        """Log overlap with ghosts or, where that is less, without: doubled edges raise the one, ghosts the other."""
        values = [overlap.joint(incidence_deg)]
        if self._open_shift:
            near = INCIDENCE_GRID_DEG[np.abs(INCIDENCE_GRID_DEG - incidence_deg) <= 4]
            values += [self._overlap_in_place(float(x)) for x in near]
        grazing = _GRAZING_PENALTY / OVERLAP_WEIGHT * max(0.0, incidence_deg - _GRAZING_DEG)
        return math.log(min(values)) + grazing

    def _overlap_in_place(self, incidence_deg: float) -> float:
        if incidence_deg not in self._overlaps_in_place:
            self._overlaps_in_place[incidence_deg] = self._in_place.joint(incidence_deg)
        return self._overlaps_in_place[incidence_deg]

    def _with_overlap_minimum(self, trial: Trial, tolerance_deg: float = _ROUGHLY_DEG) -> Trial:
        """The trial moved to the least edge overlap around it: where that is on coarse blocks, then on fine ones."""
        if self._scene.incidence_deg is not None:
            return trial
        overlap = self._best_scales(trial, self._seen.coarse)
        near = _around(trial.incidence_deg, _COARSE_HALF_WIDTH_DEG, _COARSE_STEP_DEG)
        start = float(near[np.argmin([overlap.joint(float(x)) for x in near])])
        overlap = self._best_scales(trial, self._seen.fine)
        incidence = local_minimum(overlap.joint, start, INCIDENCE_SEARCH_DEG, _STEP_DEG, tolerance_deg)
        return Trial(incidence, trial.ghost_shift, trial.score)

    def _best_scales(self, trial: Trial, blocks: BlockImages) -> EdgeOverlap:
        return EdgeOverlap(blocks, self._scene, trial.ghost_shift).at_best_scales(trial.incidence_deg)

    def _best_shift(self, incidence_deg: float) -> Trial:
        """Among the likeliest shifts the best in likelihood and edge overlap together, the incidence free to give."""
        shifts = self._likely_shifts(incidence_deg, _CANDIDATE_STEP_PX, _N_CANDIDATES)
        near = self._near(incidence_deg)
        misfits = self._likelihood.misfit(near, shifts)
        weight = _overlap_weight(incidence_deg, self._scene.index)
        trials = []
        for shift, row in zip(shifts, misfits.T, strict=True):
            overlap = EdgeOverlap(self._seen.coarse, self._scene, shift)
            trials += [
                Trial(float(incidence), shift, misfit + weight * math.log(overlap.joint(float(incidence))))
                for incidence, misfit in zip(near, row, strict=True)
            ]
        return min(trials, key=lambda trial: trial.score)

    def _with_fine_shift(self, trial: Trial) -> Trial:
        """The trial's shift between the grid's points, none where it gains too little; then the incidence."""
        shifts = trial.ghost_shift + _FINE_SHIFTS_PX
        misfit = self._likelihood.misfit(trial.incidence_deg, shifts)
        shift = grid_minimum(shifts, misfit)
        near = self._near(trial.incidence_deg)
        without, with_ghosts = self._likelihood.misfit(near, [0.0, shift], rounds=_CLOSELY).min(axis=0)
        gain = (without - with_ghosts) / self._least_gain(trial.incidence_deg)
        # The further off, the more shifts there are to choose a chance likeness from.
        likelier = (without - with_ghosts) * float(self._seen.spectra.multiplicity.sum()) > math.log(max(1, abs(shift)))
        # Ghosts taken out that are elsewhere cost the incidence more than ghosts left in.
        safe = Trial(trial.incidence_deg, shift if gain > _SURE else 0.0, trial.score)
        incidence = self._with_overlap_minimum(safe, _TOLERANCE_DEG).incidence_deg
        return Trial(incidence, shift if gain > 1 and likelier else 0.0, trial.score)

    def _near(self, incidence_deg: float) -> Curve:
        """Incidences at which shifts are compared: what is gained by the one is lost by the other."""
        if self._scene.incidence_deg is not None:
            return np.array([incidence_deg])
        return _around(incidence_deg, _NEAR_HALF_WIDTH_DEG, _NEAR_STEP_DEG)

    def _least_gain(self, incidence_deg: float) -> float:
        """What a shift must gain over none: more towards normal incidence and in noise, where errors mimic ghosts."""
        least = _LEAST_GAIN * (1 + (_MIMIC_DEG / max(incidence_deg, INCIDENCE_SEARCH_DEG[0])) ** _MIMIC_POWER)
        return least if self._reflection_is_sharp(incidence_deg) else _IN_NOISE * least

    def _with_tied_shift(self, trial: Trial) -> Trial:
        """The trial with exactly the shift that the thickness gives at its incidence, in the same sense."""
        assert self._thickness is not None
        step = self._thickness.step(trial.incidence_deg, self._scene.index)
        return Trial(trial.incidence_deg, math.copysign(step, trial.ghost_shift), trial.score)

    def _reflection_is_sharp(self, incidence_deg: float) -> bool:
        """Whether the reflection's fine edges stand out of the noise."""
        scales = EdgeOverlap(self._seen.fine, self._scene, 0.0).at(incidence_deg)
        first = next((i for i, size in enumerate(self._seen.fine.sizes[: len(scales)]) if size >= _FINE_BLOCK), -1)
        return scales[first].reflection_seen

    def _likely_shifts(self, incidence_deg: float, spacing: float, most: int) -> list[float]:
        """Local minima of the misfit, least first."""
        grid = self._shift_grid(incidence_deg, spacing)
        if self._thickness is not None:
            return [float(shift) for shift in grid]
        misfit = self._likelihood.misfit(incidence_deg, grid)
        return [float(grid[i]) for i in _minima(misfit)[:most]]

    @property
    def _most_shift(self) -> float:
        return largest_search_shift(self._seen.fine.side)

    def _shift_grid(self, incidence_deg: float, spacing: float) -> Curve:
        if not self._open_shift:
            return np.array([0.0 if self._scene.ghost_shift is None else self._scene.ghost_shift])
        if self._thickness is not None:
            step = self._thickness.step(incidence_deg, self._scene.index)
            return np.array([step, -step])
        most = math.floor(self._most_shift / spacing)
        return np.arange(-most, most + 1.0) * spacing


def _odds(chance: float) -> float:
    return chance / max(1 - chance, _NO_ERROR)


def _likely(trials: list[Trial]) -> list[int]:
    """Which of the trials, sorted by incidence, are likelier than both beside them: the likeliest of these."""
    scores = np.pad([trial.score for trial in trials], 1, constant_values=math.inf)
    minima = np.flatnonzero(local_minima(scores)[1:-1])
    return [int(i) for i in minima[np.argsort(scores[1:-1][minima])][:_N_TRIALS]]


def _between_likely(trials: list[Trial]) -> list[float]:
    """Incidences halfway between likely trials and those beside them."""
    angles = [trial.incidence_deg for trial in trials]
    beside = {(low, low + 1) for i in _likely(trials) for low in (i - 1, i) if 0 <= low < len(angles) - 1}
    return [(angles[low] + angles[high]) / 2 for low, high in sorted(beside)]


def _minima(values: Curve) -> list[int]:
    """Indices of local minima, least first: not at the ends, where values merely fall, unless there is nothing else."""
    minima = np.flatnonzero(local_minima(values))
    return [int(i) for i in minima[np.argsort(values[minima])]] or [int(np.argmin(values))]


def _around(incidence_deg: float, half_width: float, spacing: float) -> Curve:
    near = incidence_deg + np.arange(-half_width, half_width + spacing / 2, spacing)
    lowest, highest = INCIDENCE_SEARCH_DEG
    return near[(near > lowest) & (near < highest)]


def _overlap_weight(incidence_deg: float, refractive_index: float) -> float:
    """Only where ghosts of the transmission are bright does the overlap tell shifts apart, too."""
    reflectance = interface(incidence_deg, refractive_index).reflection[1]
    return OVERLAP_WEIGHT * min(1.0, max(_LEAST_SHARE, (reflectance / _BRIGHT_REFLECTANCE) ** 4))
