"""Pane, ghosts and the polarization of both layers' light, found blind.

The directions of the two Stokes vectors (`polarized_mixing`) leave a handful of panes that show them in place
(`polarized_light`); of these, each with its likeliest ghosts, the one is taken that explains the capture best, with
the least polarized light that does (`polarized_likelihood`).
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from polaropt.bounded_search import Box
from polaropt.fresnel import brewster_angle_deg
from polaropt.plate_frame import StokesImages
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
    candidates,
    point_showing,
    scene_at,
    shown_by,
)
from polaropt.polarized_likelihood import PolarizedLikelihood
from polaropt.polarized_mixing import Mixture
from polaropt.scene import SceneParameters

Values = NDArray[np.float64]

_MOST_SHIFT, _LEAST_SHIFT, _N_SHIFTS = 24.0, 2.0, 3
_TURNS_DEG = (0.0, -9.0, -4.5, 4.5, 9.0)
_LEAST_GHOST_GAIN, _BLUR_PX = 0.01, 4.0
"""Score that ghosts must gain, more for those so close that they mimic a blur."""
_LEAST_GAIN = 0.0008
"""Score that polarized light in the second layer must gain."""
_TWINS_DEG = 8.0
_CLOSE = 0.02
"""Candidates whose rough scores differ by less are compared closely."""
_STEPS = np.array([2.0, 1.0, 0.5, 0.02, 0.02, 0.03, 0.03])
_LOW = np.array([LOWEST_DEG, -720, -40, *4 * [-0.995]])
_HIGH = np.array([HIGHEST_DEG, 720, 40, *4 * [0.995]])
_ROUGH, _FINE = 50, 50
"""Evaluations."""
_OF_WINDOWS = 5.0
"""Weight of the windows' likelihood per gradient against doubt."""


@dataclass(frozen=True)
class PolarizedFit:
    """A pane before polarized light.

    Attributes
    ----------
    scene : SceneParameters
        Complete.
    misfit : float
        Mean square of coarse light that no two layers make behind this pane, in units of the noise: 1 where the model
        holds.
    n : int
        How many numbers it is the mean of.
    gain : float
        How much more likely the polarized light makes the capture, per frequency and colour, doubt deducted: the plain
        pane's score less this one's.
    """

    scene: SceneParameters
    misfit: float
    n: int
    gain: float


@dataclass(frozen=True)
class _Found:
    """A candidate and its score: less is better."""

    candidate: Candidate
    score: float


def fit_polarized(stokes: StokesImages, asked: SceneParameters, plain: SceneParameters) -> PolarizedFit | None:
    """Fit a pane whose layers' light may arrive polarized, a constant degree and angle each.

    Parameters
    ----------
    stokes : StokesImages
    asked : SceneParameters
        Fields that are None are estimated; index and surfaces are used. Polarization of the layers' light is estimated.
    plain : SceneParameters
        The pane that explains the capture best with unpolarized layers, to be compared with.

    Returns
    -------
    PolarizedFit or None
        None where no pane shows what the capture shows.
    """
    likelihood = PolarizedLikelihood(stokes, asked)
    mixture = Mixture(stokes)
    search = _Search(likelihood, mixture, asked)
    rough = search.rough(candidates(mixture.vectors(), asked))
    if not rough:
        return None
    limit = min(found.score for found in rough) + _CLOSE
    fine = [search.finely(found.candidate) for found in rough if found.score <= limit]
    best = min(fine, key=lambda found: found.score)
    misfit, n = likelihood.leftover(best.candidate.point)
    return PolarizedFit(scene_at(best.candidate.point, asked), misfit, n, search.unpolarized(plain) - best.score)


class _Search:
    """The search for a pane: what the layers show in place, then ghosts, then all together."""

    def __init__(self, likelihood: PolarizedLikelihood, mixture: Mixture, asked: SceneParameters) -> None:
        self._likelihood, self._mixture, self._asked = likelihood, mixture, asked
        self._ghosts = asked.ghost_shift is None and not asked.single_surface and asked.n_bounces != 0

    def unpolarized(self, scene: SceneParameters) -> float:
        """Score of the pane near a given one with unpolarized layers."""
        point = np.array([*scene.values(), 0, 0, 0, 0])
        return self._improved(Candidate(point, False, False), edges=True).score

    def rough(self, panes: Sequence[Candidate]) -> list[_Found]:
        """The candidates in place, and those with ghosts that explain more than any of them; by spectra alone."""
        in_place = [self._in_place(candidate) for candidate in panes]
        if not self._ghosts or not in_place:
            return in_place
        limit = min(found.score for found in in_place)
        starts = [self._with_ghosts(found.candidate) for found in in_place]
        ghosts = [self._improved(start) for start in starts if start is not None]
        return in_place + [found for found in ghosts if limit - found.score > _least_gain(found.candidate.point)]

    def finely(self, candidate: Candidate) -> _Found:
        """The candidate with edges, and with polarized light in both layers where that gains enough."""
        if not candidate.point[SHIFT]:
            # In place the windows' likelihood has told all that edges tell, and no more than four numbers are told.
            return _Found(candidate, self._fitted(candidate.point, edges=True))
        one = min((self._improved(twin) for twin in _twins(candidate, self._asked)), key=lambda found: found.score)
        both = self._improved(dataclasses.replace(one.candidate, transmission=True, reflection=True))
        better = both if one.score - both.score > _LEAST_GAIN else one
        return self._improved(better.candidate, edges=True)

    def _fitted(self, point: Point, edges: bool = False) -> float:
        """Score of a point, its spectra fitted."""
        likelihood = self._likelihood
        pane = likelihood.pane(point)
        likelihood.prepare(pane)
        return (likelihood.evidence if edges else likelihood.spectral)(pane) + likelihood.doubt(point)

    def _with_ghosts(self, candidate: Candidate) -> Candidate | None:
        """The candidate with its likeliest shift of ghosts; None where no shift stands out.

        Ghosts lie along the azimuth, which another layer's polarized light may have turned.
        """
        likelihood, asked = self._likelihood, self._asked
        incidence, azimuth, _ = candidate.point[:3]
        shown = shown_by(candidate.point, asked)
        shifts = np.arange(-_MOST_SHIFT, _MOST_SHIFT + 1)
        # Spectra fitted with ghosts far away suit all of them alike.
        likelihood.prepare(likelihood.pane(_moved(candidate.point, _MOST_SHIFT)))
        turns = _TURNS_DEG if asked.azimuth_deg is None else (0.0,)
        points = [[point_showing(Place(incidence, azimuth + turn, s), shown, asked) for s in shifts] for turn in turns]
        scores = np.array([[likelihood.glance(likelihood.pane(point)) for point in row] for row in points])
        scores[:, np.abs(shifts) < _LEAST_SHIFT] = np.inf
        inside = scores[:, 1:-1]
        valleys = np.argwhere((inside <= scores[:, :-2]) & (inside < scores[:, 2:])) + np.array([0, 1])
        valleys = valleys[np.argsort(scores[tuple(valleys.T)])][:_N_SHIFTS]
        likely = [(turns[i], bounded(points[i][j])) for i, j in valleys]
        if not likely:
            return None
        turn, point = min(likely, key=lambda pair: self._fitted(pair[1]))
        if turn:
            return Candidate(point, True, True)
        return dataclasses.replace(candidate, point=_moved(candidate.point, point[SHIFT]))

    def _in_place(self, candidate: Candidate) -> _Found:
        """The candidate where what it shows in place is likeliest."""

        def score(point: Point) -> float:
            cost = self._mixture.cost(shown_by(point, self._asked))
            return _OF_WINDOWS * cost + self._likelihood.doubt(point)

        found = self._best(candidate, score, _ROUGH)
        return _Found(found, self._fitted(found.point))

    def _improved(self, candidate: Candidate, edges: bool = False) -> _Found:
        """The candidate moved to where its spectra, or spectra and edges, are likeliest."""
        likelihood = self._likelihood
        likelihood.prepare(likelihood.pane(candidate.point))
        evidence = likelihood.evidence if edges else likelihood.spectral

        def score(point: Point) -> float:
            return evidence(likelihood.pane(point)) + likelihood.doubt(point)

        found = self._best(candidate, score, _FINE if edges else _ROUGH)
        return _Found(found, self._fitted(found.point, edges))

    def _best(self, candidate: Candidate, score: Callable[[Point], float], most: int) -> Candidate:
        """The candidate at the point of least score near it.

        What the layers show in place is told best: the search moves that, and the pane behind it.
        """
        coordinates = np.concatenate([candidate.point[:3], shown_by(candidate.point, self._asked)[:, 1:].ravel()])
        free = _free(candidate, self._asked)
        box = Box(coordinates[free], _STEPS[free], _LOW[free], _HIGH[free])
        moved = box.minimum(lambda x: score(self._point(candidate, coordinates, free, x)), most)
        return dataclasses.replace(candidate, point=self._point(candidate, coordinates, free, moved))

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


def _twins(candidate: Candidate, asked: SceneParameters) -> list[Candidate]:
    """The candidate on both sides of Brewster's angle, where the reflection shows the same: ghosts tell them apart."""
    incidence = float(candidate.point[INCIDENCE])
    brewster = brewster_angle_deg(asked.refractive_index)
    if (
        asked.incidence_deg is not None
        or candidate.reflection
        or not candidate.point[SHIFT]
        or abs(incidence - brewster) > _TWINS_DEG
    ):
        return [candidate]
    shown = shown_by(candidate.point, asked)
    points = []
    for side in (-1, 1):
        away = max(abs(incidence - brewster), _TWINS_DEG / 2)
        point = point_showing(Place(brewster + side * away, *candidate.point[1:3]), shown, asked)
        point[OF_REFLECTION] = 0
        points.append(bounded(point))
    return [dataclasses.replace(candidate, point=point) for point in points]


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
