"""The search for a pane before polarized light: what the layers show in place, then ghosts, then all together."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

from polaropt.bounded_search import Box
from polaropt.fresnel import brewster_angle_deg
from polaropt.jackknife import jackknife_error, left_out
from polaropt.polarized_errors import polarized_errors
from polaropt.polarized_light import (
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
    point_showing,
    shown_by,
)
from polaropt.polarized_likelihood import PolarizedLikelihood
from polaropt.polarized_mixing import Mixture
from polaropt.scene import SceneParameters
from polaropt.scene_errors import SceneErrors

Values = NDArray[np.float64]

_MOST_SHIFT, _LEAST_SHIFT, _N_SHIFTS = 24.0, 2.0, 3
_SHIFTS = np.arange(-_MOST_SHIFT, _MOST_SHIFT + 1)
_TURNS_DEG = (-9.0, -4.5, 4.5, 9.0)
_LEAST_GHOST_GAIN, _BLUR_PX = 0.01, 4.0
"""Score that ghosts must gain, more for those so close that they mimic a blur."""
_TWINS_DEG, _LEAST_OFF_DEG = 14.0, 4.0
_HOPELESS, _HOPELESS_START = 0.03, 0.01
"""Score by which a candidate in place may be worse than the best one for its ghosts to be looked at, and with them."""
_STEPS = np.array([2.0, 1.0, 0.5, 0.02, 0.02, 0.03, 0.03])
_LOW = np.array([LOWEST_DEG, -720, -40, *4 * [-0.995]])
_HIGH = np.array([HIGHEST_DEG, 720, 40, *4 * [0.995]])
_ROUGH = 40
"""Evaluations."""
_FINE_STEPS = np.array([1.0, 0.4, 0.1, 0.004, 0.004, 0.008, 0.008])
_NEWTON_STEPS, _REST = 3, 2e-5
_SURE = 2.0
"""Standard errors by which ghosts on one side must explain more than on the other."""
_OF_WINDOWS = 5.0
"""Weight of the windows' likelihood per gradient against doubt."""


@dataclass(frozen=True)
class Found:
    """A candidate and its score: less is better."""

    candidate: Candidate
    score: float


class Search:
    """The search for those numbers of a pane that were not given.

    Parameters
    ----------
    likelihood : PolarizedLikelihood
    mixture : Mixture
    asked : SceneParameters
        Fields that are None are to be found.
    """

    def __init__(self, likelihood: PolarizedLikelihood, mixture: Mixture, asked: SceneParameters) -> None:
        self._likelihood, self._mixture, self._asked = likelihood, mixture, asked
        self._ghosts = asked.ghost_shift is None and not asked.single_surface and asked.n_bounces != 0

    def unpolarized(self, scene: SceneParameters) -> float:
        """Score of the pane near a given one with unpolarized layers."""
        point = np.array([*scene.values(), 0, 0, 0, 0])
        return self._refined(Candidate(point, False, False), edges=True).score

    def errors(self, candidate: Candidate) -> SceneErrors:
        """Standard errors of a candidate's numbers."""
        told = _free(candidate, self._asked)
        if candidate.point[SHIFT]:
            # Only what is told by ghosts holds whichever layer is polarized.
            candidate = dataclasses.replace(candidate, transmission=True, reflection=True)
        score = self._score(candidate.point, True)
        coordinates, free = self._coordinates(candidate), _free(candidate, self._asked)
        box = Box(coordinates[free], _FINE_STEPS[free], _LOW[free], _HIGH[free])

        def point_at(x: Values) -> Point:
            return self._point(candidate, coordinates, free, x)

        curvature = self._likelihood.n * box.curvature(lambda x: score(point_at(x)))
        errors = polarized_errors(point_at, coordinates[free], curvature, told)
        return errors if errors.ghost_shift is None else self._with_sense(candidate, errors, errors.ghost_shift)

    def _with_sense(self, candidate: Candidate, errors: SceneErrors, shift_error: float) -> SceneErrors:
        """The errors where the ghosts may lie on the other side: two of the shift's then reach there."""
        likelihood, shift = self._likelihood, float(candidate.point[SHIFT])
        other = self.finely(dataclasses.replace(candidate, point=_moved(candidate.point, -shift)))
        gap = other.score - self._fitted(candidate.point, edges=True)
        gaps = likelihood.sectors(other.candidate.point) - likelihood.sectors(candidate.point)
        told = gap > _SURE * jackknife_error(left_out(gaps))
        return errors if told else dataclasses.replace(errors, ghost_shift=max(shift_error, abs(shift)))

    def rough(self, panes: Sequence[Candidate]) -> list[Found]:
        """The candidates in place, and those with ghosts that explain more than any of them; by spectra alone."""
        in_place = [self._in_place(candidate) for candidate in panes]
        if not self._ghosts or not in_place:
            return in_place
        limit = min(found.score for found in in_place)
        likely = [found.candidate for found in in_place if found.score < limit + _HOPELESS]
        starts = [start for candidate in likely for start in self._with_ghosts(candidate)]
        ghosts = [self._improved(start) for start in starts if self._fitted(start.point) < limit + _HOPELESS_START]
        return in_place + [found for found in ghosts if limit - found.score > _least_gain(found.candidate.point)]

    def finely(self, candidate: Candidate) -> Found:
        """The candidate where spectra are likeliest; spectra and edges make its score."""
        if candidate.point[SHIFT]:
            candidate = self._refined(candidate).candidate
        # In place the windows' likelihood has told all that edges tell, and no more than four numbers are told.
        return Found(candidate, self._fitted(candidate.point, edges=True))

    def beyond_brewster(self, found: Found) -> Found:
        """The better of what was found and its like on the other side of Brewster's angle.

        In place the reflection shows the same there: only ghosts tell the two apart.
        """
        candidate, asked = found.candidate, self._asked
        off = float(candidate.point[INCIDENCE]) - brewster_angle_deg(asked.refractive_index)
        if (
            asked.incidence_deg is not None
            or candidate.reflection
            or not candidate.point[SHIFT]
            or abs(off) > _TWINS_DEG
        ):
            return found
        across = brewster_angle_deg(asked.refractive_index) - math.copysign(max(abs(off), _LEAST_OFF_DEG), off)
        point = point_showing(Place(across, *candidate.point[1:3]), shown_by(candidate.point, asked), asked)
        point[OF_REFLECTION] = 0
        twin = self.finely(self._improved(dataclasses.replace(candidate, point=bounded(point))).candidate)
        return min(found, twin, key=lambda one: one.score)

    def with_both_polarized(self, found: Found) -> Found:
        """The same with polarized light in both layers, which ghosts tell; what was found where there are none."""
        if not found.candidate.point[SHIFT]:
            return found
        return self.finely(dataclasses.replace(found.candidate, transmission=True, reflection=True))

    def finished(self, found: Found) -> Found:
        """The same where spectra and edges are likeliest."""
        return self._refined(found.candidate, edges=True) if found.candidate.point[SHIFT] else found

    def _fitted(self, point: Point, edges: bool = False) -> float:
        """Score of a point, its spectra fitted."""
        likelihood = self._likelihood
        pane = likelihood.pane(point)
        likelihood.prepare(pane)
        return (likelihood.evidence if edges else likelihood.spectral)(pane) + likelihood.doubt(point)

    def _with_ghosts(self, candidate: Candidate) -> list[Candidate]:
        """The candidate with its likeliest shifts of ghosts that stand out, along its azimuth and along others.

        Ghosts lie along the azimuth, which polarized light in both layers may have turned.
        """
        likelihood, asked = self._likelihood, self._asked
        incidence, azimuth, _ = candidate.point[:3]
        shown = shown_by(candidate.point, asked)
        # Spectra fitted with ghosts far away suit all of them alike.
        likelihood.prepare(likelihood.pane(_moved(candidate.point, _MOST_SHIFT)))

        def likeliest(turns: Sequence[float]) -> Point | None:
            rows = [
                [point_showing(Place(incidence, azimuth + turn, shift), shown, asked) for shift in _SHIFTS]
                for turn in turns
            ]
            likely = self._valleys(rows)
            return min(likely, key=self._fitted) if likely else None

        along = likeliest((0.0,))
        turned = likeliest(_TURNS_DEG) if asked.azimuth_deg is None else None
        # A glance often mistakes the side on which the ghosts lie.
        shifts = [] if along is None else [along[SHIFT], -along[SHIFT]]
        found = [dataclasses.replace(candidate, point=_moved(candidate.point, shift)) for shift in shifts]
        return found if turned is None else [*found, Candidate(turned, True, True)]

    def _valleys(self, rows: Sequence[Sequence[Point]]) -> list[Point]:
        """Where a glance at points, a row along the shifts each, sees the lowest valleys."""
        likelihood = self._likelihood
        scores = np.array([[likelihood.glance(likelihood.pane(point)) for point in row] for row in rows])
        scores[:, np.abs(_SHIFTS) < _LEAST_SHIFT] = np.inf
        inside = scores[:, 1:-1]
        valleys = np.argwhere((inside <= scores[:, :-2]) & (inside < scores[:, 2:])) + np.array([0, 1])
        valleys = valleys[np.argsort(scores[tuple(valleys.T)])][:_N_SHIFTS]
        return [bounded(rows[i][j]) for i, j in valleys]

    def _in_place(self, candidate: Candidate) -> Found:
        """The candidate where what it shows in place is likeliest."""

        def score(point: Point) -> float:
            cost = self._mixture.cost(shown_by(point, self._asked))
            return _OF_WINDOWS * cost + self._likelihood.doubt(point)

        found = self._best(candidate, score, _ROUGH)
        return Found(found, self._fitted(found.point))

    def _improved(self, candidate: Candidate) -> Found:
        """The candidate moved to where its spectra are likeliest, roughly."""
        found = self._best(candidate, self._score(candidate.point, False), _ROUGH)
        return Found(found, self._fitted(found.point))

    def _refined(self, candidate: Candidate, edges: bool = False) -> Found:
        """The candidate moved to where its spectra, or spectra and edges, are likeliest, by Newton steps."""
        before, curvature = math.inf, None
        free = _free(candidate, self._asked)
        for _ in range(_NEWTON_STEPS):
            score, coordinates = self._score(candidate.point, edges), self._coordinates(candidate)
            box = Box(coordinates[free], _FINE_STEPS[free], _LOW[free], _HIGH[free])
            step = box.newton(partial(self._score_at, score, candidate, coordinates), curvature)
            candidate = dataclasses.replace(candidate, point=self._point(candidate, coordinates, free, step.point))
            if before - step.value < _REST:
                break
            before, curvature = step.value, step.curvature
        return Found(candidate, self._fitted(candidate.point, edges))

    def _score_at(self, score: Callable[[Point], float], candidate: Candidate, coordinates: Values, x: Values) -> float:
        """A score where the coordinates that are to be found are x."""
        return score(self._point(candidate, coordinates, _free(candidate, self._asked), x))

    def _score(self, point: Point, edges: bool) -> Callable[[Point], float]:
        """Score of points near one, whose spectra it rests on."""
        likelihood = self._likelihood
        likelihood.prepare(likelihood.pane(point))
        evidence = likelihood.evidence if edges else likelihood.spectral
        return lambda point: evidence(likelihood.pane(point)) + likelihood.doubt(point)

    def _best(self, candidate: Candidate, score: Callable[[Point], float], most: int) -> Candidate:
        """The candidate at the point of least score near it."""
        coordinates, free = self._coordinates(candidate), _free(candidate, self._asked)
        box = Box(coordinates[free], _STEPS[free], _LOW[free], _HIGH[free])
        moved = box.minimum(lambda x: score(self._point(candidate, coordinates, free, x)), most)
        return dataclasses.replace(candidate, point=self._point(candidate, coordinates, free, moved))

    def _coordinates(self, candidate: Candidate) -> Values:
        """Pane and what the layers show in place, which is told best: coordinates of the search."""
        return np.concatenate([candidate.point[:3], shown_by(candidate.point, self._asked)[:, 1:].ravel()])

    def _point(self, candidate: Candidate, coordinates: Values, free: NDArray[np.intp], x: Values) -> Point:
        full = coordinates.copy()
        full[free] = x
        point = point_showing(Place(*full[:3]), _vectors(full[3:]), self._asked)
        for part, polarized in ((OF_TRANSMISSION, candidate.transmission), (OF_REFLECTION, candidate.reflection)):
            if not polarized:
                point[part] = candidate.point[part]
        return bounded(point)


def _least_gain(point: Point) -> float:
    """What the ghosts of a point must gain."""
    shift = abs(float(point[SHIFT]))
    return _LEAST_GHOST_GAIN * (1 + (_BLUR_PX / shift) ** 4) if shift >= _LEAST_SHIFT else math.inf


def _free(candidate: Candidate, asked: SceneParameters) -> NDArray[np.intp]:
    """Which coordinates are for us to find; a shift only where there is one."""
    ghosts = asked.ghost_shift is None and candidate.point[SHIFT] != 0
    flags = [asked.incidence_deg is None, asked.azimuth_deg is None, ghosts]
    return np.flatnonzero(flags + 2 * [candidate.transmission] + 2 * [candidate.reflection])


def _vectors(polarized: Values) -> Values:
    """Stokes vectors (2, 3) with s0 = 1 from their other components (4,)."""
    vectors = np.ones((2, 3))
    vectors[:, 1:] = polarized.reshape(2, 2)
    return vectors


def _moved(point: Point, shift: float) -> Point:
    point = point.copy()
    point[SHIFT] = shift
    return point
