"""Pane, ghosts and the polarization of both layers' light, found blind: the search, the choice, the errors.

References
----------
Q. H. Vuong, Likelihood ratio tests for model selection and non-nested hypotheses, Econometrica, 1989.

The directions of the two Stokes vectors (`Mixture`) leave a handful of panes that show them in place (`candidates`).
Single tiles tell whether there are ghosts, and where (`ghosts_told`). Of panes that have them there the one is taken
that explains the capture best, with the least polarized light that does: by coarse light (`closely`), unless tiles
refuse it (`settled`), where these and what no two layers make (`CrossRelation`) find it likeliest (`likeliest_near`).
Without ghosts what is likely of panes and light beforehand decides between those that show the same (`panes_alike`).
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

from polaropt.capture import StokesImages
from polaropt.estimation.flat.ghosts import LIKE_BLUR_PX
from polaropt.estimation.polarized.alike import panes_alike
from polaropt.estimation.polarized.cross_relation import CrossRelation
from polaropt.estimation.polarized.errors import incidence_reach, polarized_errors
from polaropt.estimation.polarized.ghost_choice import ghosts_told, likeliest_near, likely_starts, settled
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
    candidates,
    coordinates_of,
    free_numbers,
    point_of,
    point_showing,
    scene_at,
    shown_by,
    with_one_polarized,
)
from polaropt.estimation.polarized.likelihood import Levels, PolarizedLikelihood
from polaropt.estimation.polarized.mixing import Mixture
from polaropt.estimation.polarized.tiles import StokesTiles, TileFit
from polaropt.numerics import Box, jackknife_error, left_out
from polaropt.optics import GHOST_SHIFT_SEARCH_PX, Rival, SceneErrors, SceneParameters, brewster_angle_deg

Values = NDArray[np.float64]

# A score, and what it must gain, is minus log likelihood per frequency and colour, as of `PolarizedLikelihood`.
_N_SHIFTS = 3
"""How many shifts are compared closely. Set by hand."""
_SHIFTS = np.arange(-GHOST_SHIFT_SEARCH_PX, GHOST_SHIFT_SEARCH_PX + 1)
"""Ghost shifts that are looked at, in pixels: one pixel apart, all that are searched."""
_TURNS_DEG = (-18.0, -13.5, -9.0, -4.5, 4.5, 9.0, 13.5, 18.0)
"""Directions of ghosts that are looked at, from the azimuth of one polarized layer. Set by hand."""
_LEAST_GHOST_GAIN, _LEAST_GAIN_OF_BOTH, _BLUR_PX = 0.01, 0.02, 4.0
"""Score that ghosts must gain, with a single polarized layer and with two, and pixels at which it is double: closer
ones mimic a blur. By trial."""
_TWINS_DEG, _LEAST_OFF_DEG = 14.0, 4.0
"""Distance from Brewster's angle up to which its other side is looked at, too, and how far from it at least. By
trial."""
_HOPELESS, _HOPELESS_START = 0.03, 0.2
"""Score by which a candidate in place may be worse than the best one for its ghosts to be looked at, and with them:
where true ghosts bend what is seen in place they begin by 0.02 to 0.18 worse, and end better. By trial, on the random
windows to fit on."""
_STILL_MOVING, _MOST_ROUNDS = 0.004, 4
"""Score that a rough search must have gained to go on, and how often it begins at most. Set by hand."""
# Coordinates of the search: incidence and azimuth (degrees), ghost shift (px), and (s1, s2) that each layer shows.
# First steps, and bounds: degrees of polarization short of 1, the rest wide enough for no minimum to meet. By hand.
_STEPS = np.array([2.0, 1.0, 0.5, 0.02, 0.02, 0.03, 0.03])
_LOW = np.array([LOWEST_DEG, -720, -40, *4 * [-0.995]])
_HIGH = np.array([HIGHEST_DEG, 720, 40, *4 * [0.995]])
_ROUGH = 40
"""Evaluations of a rough search. Set by hand."""
_FINE_STEPS = np.array([1.0, 0.4, 0.1, 0.004, 0.004, 0.008, 0.008])
"""Steps of second derivatives, in the units of the coordinates. Set by hand."""
_NEWTON_STEPS, _REST = 3, 2e-5
"""Newton steps at most, and the score below whose gain they end. Set by hand."""
_SURE_OF_LIGHT = 2.0
"""Standard errors by which ghosts on one side must explain more than on the other: 95 % of a normal distribution."""
_OF_WINDOWS = 5.0
"""Weight of the windows' likelihood per gradient against doubt. By trial."""


@dataclass(frozen=True)
class ScoredCandidate:
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
        self.seeks_ghosts = asked.ghost_shift is None and not asked.single_surface and asked.n_bounces != 0

    def unpolarized(self, scene: SceneParameters) -> float:
        """Score of the pane near a given one with unpolarized layers."""
        point = np.array([*scene.values(), 0, 0, 0, 0])
        return self._refined(Candidate(point, False, False), edges=True).score

    def errors(self, candidate: Candidate) -> SceneErrors:
        """Standard errors of a candidate's numbers."""
        told, screen = free_numbers(candidate, self._asked), not candidate.reflection
        if candidate.point[SHIFT]:
            # Only what is told by ghosts holds whichever layer is polarized.
            candidate = _with_both(candidate)
        score = self._score(candidate.point, True)
        coordinates, free = self._coordinates(candidate), free_numbers(candidate, self._asked)
        box = Box(coordinates[free], _FINE_STEPS[free], _LOW[free], _HIGH[free])

        def point_at(x: Values) -> Point:
            return self._point(candidate, coordinates, free, x)

        curvature = self._likelihood.n * box.curvature(lambda x: score(point_at(x)))
        errors = polarized_errors(point_at, coordinates[free], curvature, told)
        if screen and errors.incidence_deg is not None:
            reach = incidence_reach(float(candidate.point[INCIDENCE]), self._asked)
            errors = dataclasses.replace(errors, incidence_deg=max(errors.incidence_deg, reach))
        return errors if errors.ghost_shift is None else self._with_sense(candidate, errors, errors.ghost_shift)

    def _with_sense(self, candidate: Candidate, errors: SceneErrors, shift_error: float) -> SceneErrors:
        """The errors where the ghosts may lie on the other side: two of the shift's then reach there."""
        likelihood, shift = self._likelihood, float(candidate.point[SHIFT])
        other = self.finely(dataclasses.replace(candidate, point=_moved(candidate.point, -shift)))
        gap = other.score - self._fitted(candidate.point, edges=True)
        gaps = likelihood.sectors(other.candidate.point) - likelihood.sectors(candidate.point)
        told = gap > _SURE_OF_LIGHT * jackknife_error(left_out(gaps))
        return errors if told else dataclasses.replace(errors, ghost_shift=max(shift_error, abs(shift)))

    def rough(self, panes: Sequence[Candidate]) -> list[ScoredCandidate]:
        """The candidates in place, and those with ghosts that explain more than any of them; by spectra alone."""
        in_place = [self._in_place(candidate) for candidate in panes]
        if not self.seeks_ghosts or not in_place:
            return in_place
        limit = min(found.score for found in in_place)
        likely = [found.candidate for found in in_place if found.score < limit + _HOPELESS]
        starts = [start for candidate in likely for start in self._with_ghosts(candidate)]
        ghosts = [self._improved(start) for start in starts if self._fitted(start.point) < limit + _HOPELESS_START]
        return in_place + [found for found in ghosts if limit - found.score > _least_gain(found.candidate)]

    def finely(self, candidate: Candidate) -> ScoredCandidate:
        """The candidate where spectra are likeliest; spectra and edges make its score."""
        if candidate.point[SHIFT]:
            candidate = self._refined(candidate).candidate
        # In place the windows' likelihood has told all that edges tell, and no more than four numbers are told.
        return ScoredCandidate(candidate, self._fitted(candidate.point, edges=True))

    def beyond_brewster(self, found: ScoredCandidate) -> ScoredCandidate:
        """The better of what was found and its like on the other side of Brewster's angle.

        In place the reflection shows the same there: only ghosts tell the two apart.
        """
        candidate, asked = found.candidate, self._asked
        off = float(candidate.point[INCIDENCE]) - brewster_angle_deg(asked.index)
        if (
            asked.incidence_deg is not None
            or candidate.reflection
            or not candidate.point[SHIFT]
            or abs(off) > _TWINS_DEG
        ):
            return found
        across = brewster_angle_deg(asked.index) - math.copysign(max(abs(off), _LEAST_OFF_DEG), off)
        point = point_showing(Place(across, *candidate.point[1:3]), shown_by(candidate.point, asked), asked)
        point[OF_REFLECTION] = 0
        twin = self.finely(self._improved(dataclasses.replace(candidate, point=bounded(point))).candidate)
        return min(found, twin, key=lambda one: one.score)

    def with_both_polarized(self, found: ScoredCandidate) -> ScoredCandidate:
        """The same with polarized light in both layers, which ghosts tell; what was found where there are none."""
        if not found.candidate.point[SHIFT]:
            return found
        return self.finely(_with_both(found.candidate))

    def with_one_polarized(self, found: ScoredCandidate) -> ScoredCandidate:
        """The same with polarized light in one layer, whichever suits better."""
        point = found.candidate.point
        ones = [self.finely(with_one_polarized(point, part)) for part in (OF_REFLECTION, OF_TRANSMISSION)]
        return min(ones, key=lambda one: one.score)

    def finished(self, candidate: Candidate) -> ScoredCandidate:
        """The candidate where spectra and edges are likeliest."""
        return self._refined(candidate, edges=True)

    def evidence(self, point: Point) -> float:
        """Minus the log likelihood of spectra and edges at a point."""
        return self._likelihood.n * self._fitted(point, edges=True)

    def near(self, point: Point) -> Callable[[Point], float]:
        """The same of points near one, whose spectra it rests on."""
        score = self._score(point, True)
        return lambda near: self._likelihood.n * score(near)

    def _fitted(self, point: Point, edges: bool = False) -> float:
        """Score of a point, its spectra fitted."""
        likelihood = self._likelihood
        pane = likelihood.pane(point)
        evidence = likelihood.evidence if edges else likelihood.spectral
        return evidence(pane, likelihood.levels(pane)) + likelihood.doubt(point)

    def _with_ghosts(self, candidate: Candidate) -> list[Candidate]:
        """The candidate with its likeliest shifts of ghosts that stand out, along its azimuth and along others.

        Ghosts lie along the azimuth, which polarized light in both layers may have turned.
        """
        likelihood, asked = self._likelihood, self._asked
        incidence, azimuth, _ = candidate.point[:3]
        shown = shown_by(candidate.point, asked)
        # Spectra fitted with ghosts far away suit all of them alike.
        levels = likelihood.levels(likelihood.pane(_moved(candidate.point, GHOST_SHIFT_SEARCH_PX)))

        def likeliest(turns: Sequence[float]) -> list[Point]:
            rows = [point_showing(Place(incidence, azimuth + turn, 0.0), shown, asked) for turn in turns]
            return [min(likely, key=self._fitted) for likely in self._valleys(rows, levels) if likely]

        along = likeliest((0.0,))
        turned = likeliest(_TURNS_DEG) if asked.azimuth_deg is None else []
        # A glance often mistakes the side on which the ghosts lie.
        shifts = [sign * float(point[SHIFT]) for point in along for sign in (1, -1)]
        found = [dataclasses.replace(candidate, point=_moved(candidate.point, shift)) for shift in shifts]
        return [*found, *(Candidate(point, True, True) for point in turned)]

    def _valleys(self, rows: Sequence[Point], levels: Levels) -> list[list[Point]]:
        """Where a glance at points, each with all shifts, sees the lowest valleys, far ones and close ones.

        Close ones mimic a blur, which suits nearly any capture, and would crowd out all others.
        """
        scores = np.array([self._likelihood.glances(point, _SHIFTS, levels) for point in rows])
        inside = scores[:, 1:-1]
        valleys = np.argwhere((inside <= scores[:, :-2]) & (inside < scores[:, 2:])) + np.array([0, 1])
        # That the least of the shifts is likelier than farther ones tells of no ghosts, not of close ones.
        valleys = valleys[np.abs(_SHIFTS[valleys[:, 1]]) >= LIKE_BLUR_PX]
        valleys = valleys[np.argsort(scores[tuple(valleys.T)])]
        far = np.abs(_SHIFTS[valleys[:, 1]]) >= _BLUR_PX
        return [
            [bounded(_moved(rows[i], float(_SHIFTS[j]))) for i, j in part[:_N_SHIFTS]]
            for part in (valleys[far], valleys[~far])
        ]

    def _in_place(self, candidate: Candidate) -> ScoredCandidate:
        """The candidate where what it shows in place is likeliest."""

        def score(point: Point) -> float:
            cost = self._mixture.cost(shown_by(point, self._asked))
            return _OF_WINDOWS * cost + self._likelihood.doubt(point)

        found = self._best(candidate, score, _ROUGH)
        return ScoredCandidate(found, self._fitted(found.point))

    def _improved(self, candidate: Candidate) -> ScoredCandidate:
        """The candidate moved to where its spectra are likeliest, roughly."""
        before = ScoredCandidate(candidate, self._fitted(candidate.point))
        for _ in range(_MOST_ROUNDS):
            moved = self._best(before.candidate, self._score(before.candidate.point, False), _ROUGH)
            found = ScoredCandidate(moved, self._fitted(moved.point))
            if before.score - found.score < _STILL_MOVING:
                return min(before, found, key=lambda one: one.score)
            before = found
        return before

    def _refined(self, candidate: Candidate, edges: bool = False) -> ScoredCandidate:
        """The candidate moved to where its spectra, or spectra and edges, are likeliest, by Newton steps."""
        before, curvature = math.inf, None
        free = free_numbers(candidate, self._asked)
        for _ in range(_NEWTON_STEPS):
            score, coordinates = self._score(candidate.point, edges), self._coordinates(candidate)
            box = Box(coordinates[free], _FINE_STEPS[free], _LOW[free], _HIGH[free])
            step = box.newton(partial(self._score_at, score, candidate, coordinates), curvature)
            candidate = dataclasses.replace(candidate, point=self._point(candidate, coordinates, free, step.point))
            if before - step.value < _REST:
                break
            before, curvature = step.value, step.curvature
        return ScoredCandidate(candidate, self._fitted(candidate.point, edges))

    def _score_at(self, score: Callable[[Point], float], candidate: Candidate, coordinates: Values, x: Values) -> float:
        """A score where the coordinates that are to be found are x."""
        return score(self._point(candidate, coordinates, free_numbers(candidate, self._asked), x))

    def _score(self, point: Point, edges: bool) -> Callable[[Point], float]:
        """Score of points near one, whose spectra it rests on."""
        likelihood = self._likelihood
        levels = likelihood.levels(likelihood.pane(point))
        evidence = likelihood.evidence if edges else likelihood.spectral
        return lambda near: evidence(likelihood.pane(near), levels) + likelihood.doubt(near)

    def _best(self, candidate: Candidate, score: Callable[[Point], float], most: int) -> Candidate:
        """The candidate at the point of least score near it."""
        coordinates, free = self._coordinates(candidate), free_numbers(candidate, self._asked)
        box = Box(coordinates[free], _STEPS[free], _LOW[free], _HIGH[free])
        moved = box.minimum(lambda x: score(self._point(candidate, coordinates, free, x)), most)
        return dataclasses.replace(candidate, point=self._point(candidate, coordinates, free, moved))

    def _coordinates(self, candidate: Candidate) -> Values:
        """Coordinates of the search."""
        return coordinates_of(candidate.point, self._asked)

    def _point(self, candidate: Candidate, coordinates: Values, free: NDArray[np.intp], x: Values) -> Point:
        full = coordinates.copy()
        full[free] = x
        return point_of(full, candidate, self._asked)


def _least_gain(candidate: Candidate) -> float:
    """What the ghosts of a candidate must gain; more numbers explain more by chance."""
    shift = abs(float(candidate.point[SHIFT]))
    least = _LEAST_GHOST_GAIN if _single(candidate) else _LEAST_GAIN_OF_BOTH
    return least * (1 + (_BLUR_PX / shift) ** 4) if shift >= LIKE_BLUR_PX else math.inf


def _moved(point: Point, shift: float) -> Point:
    point = point.copy()
    point[SHIFT] = shift
    return point


_CLOSE, _MOST = 0.02, 3
"""Candidates whose rough scores differ by less are compared closely, so many at most. Set by hand."""
_SAME_PLACE = np.array([3.0, 3.0, 0.5])
"""Differences of incidence and azimuth (degrees) and ghost shift (px) of candidates that are one. Set by hand."""
_SURELY_LIKELIER = 2.5
"""Standard errors by which the less usual polarized light must explain more: behind the pane, and in both layers. By
trial; the test is Vuong's."""
_LEAST_GAIN_OF_UNUSUAL, _SURE_OF_UNUSUAL = 48.0, 0.7
"""Log likelihood of coarse light, and standard errors, that polarized light in both layers must gain where ghosts are.
Of 40 random scenes, from the true pane, it gained 45 at most where one layer was polarized, and at least 51 and 0.8
standard errors where both were and the transmission was more than 2.2 % off without. The same of a screen in place of a
sky: of 14 skies it gained nothing, of a screen that is polarized by a tenth 84 and 2.5 standard errors."""
_SURE_OF_GHOSTS = 1.3
"""The same of ghosts, which tiles must tell, too. By trial: of 13 random windows true ones gain 2 to 10 standard errors
(one: 0.6), two that tiles are wrong about, as a photograph repeats itself six pixels off, 0.8 and 1.0."""


def finalists(rough: Sequence[ScoredCandidate]) -> list[Candidate]:
    """Candidates that may be the best, without those that came to the same place as a better one of their kind.

    The best one in place is always among them, the best one with a single polarized layer, and the best one with each
    where both come close.
    """
    ranked = sorted(rough, key=lambda found: found.score)
    chosen: list[Candidate] = []
    for found in ranked:
        candidate = found.candidate
        alike = [other for other in chosen if _kind(other) == _kind(candidate)]
        new = all(np.any(np.abs(candidate.point - other.point)[:3] > _SAME_PLACE) for other in alike)
        close = found.score <= ranked[0].score + _CLOSE
        first = _single(candidate) and (not any(_single(other) for other in chosen) or (close and not alike))
        first = first or (not candidate.point[SHIFT] and all(other.point[SHIFT] for other in chosen))
        if first or (new and len(chosen) < _MOST and close):
            chosen.append(candidate)
    return chosen


@dataclass(frozen=True)
class Choice:
    """What spectra and edges say of some candidates.

    Attributes
    ----------
    best : ScoredCandidate
    single : ScoredCandidate
        The best one with a single polarized layer, which may be the same.
    screen : ScoredCandidate or None
        A screen that is likelier than the mirrored sky that was taken for `single`, but not surely.
    """

    best: ScoredCandidate
    single: ScoredCandidate
    screen: ScoredCandidate | None = None


def choose(search: Search, likelihood: PolarizedLikelihood, candidates: Sequence[Candidate]) -> Choice:
    """The likeliest candidate, where spectra and edges put it, with polarized light in both layers if that is sure.

    Two polarized layers before unknown ghosts explain nearly anything a little better. How much better may be an
    accident of the spectra of these layers: then all of it comes from few of their directions and bands. So it may
    where a screen is a little likelier than a mirrored sky. A sky is mirrored more often than a screen is so weakly
    polarized as to look like one, and where a sky is taken for a screen another incidence makes up for its light.
    """
    fine = [search.finely(candidate) for candidate in candidates]
    # Of two polarized layers alone the best one with a single is the same with one of them.
    singles = [found for found in fine if _single(found.candidate)] or [
        search.with_one_polarized(min(fine, key=_score))
    ]
    single, screen = _single_layer(search, likelihood, singles)
    rivals = [found for found in fine if not _single(found.candidate)]
    both = min((*rivals, search.with_both_polarized(single)), key=_score)
    return Choice(both if _surely_better(likelihood, both, single) else single, single, screen)


def closely(search: Search, likelihood: PolarizedLikelihood, choice: Choice) -> Candidate:
    """A pane with ghosts where coarse light and edges put it, with the less usual polarized light if that is told.

    Fine light may mistake polarized light in both layers for a wrong pane before one, and is hardly sure of a screen.

    Parameters
    ----------
    search : Search
        By the likelihood of coarse light.
    likelihood : PolarizedLikelihood
        The same, see `PolarizedLikelihood.coarse`.
    choice : Choice
        Its best candidate has ghosts.
    """
    found = choice.best.candidate
    taken = search.finished(choice.single.candidate)
    unusual = [] if choice.screen is None or not choice.screen.candidate.point[SHIFT] else [choice.screen.candidate]
    for candidate in (*unusual, *([] if _single(found) else [found]), _with_both(choice.single.candidate)):
        other = search.finished(candidate)
        enough = likelihood.n * (taken.score - other.score) > _LEAST_GAIN_OF_UNUSUAL
        if enough and _surely_better(likelihood, other, taken, _SURE_OF_UNUSUAL):
            taken = other
    return taken.candidate


def _with_both(candidate: Candidate) -> Candidate:
    return dataclasses.replace(candidate, transmission=True, reflection=True)


def _single_layer(
    search: Search, likelihood: PolarizedLikelihood, fine: Sequence[ScoredCandidate]
) -> tuple[ScoredCandidate, ScoredCandidate | None]:
    """The best one with a single polarized layer: the mirrored one's unless the other's is surely better.

    The second is that other one, where it is better, but not surely.
    """
    best = search.beyond_brewster(min(fine, key=_score))
    skies = [found for found in fine if found.candidate.reflection]
    if best.candidate.reflection or not skies:
        return best, None
    sky = min(skies, key=_score)
    return (best, None) if _surely_better(likelihood, best, sky) else (sky, best)


def _surely_better(
    likelihood: PolarizedLikelihood, found: ScoredCandidate, simpler: ScoredCandidate, sure: float = _SURELY_LIKELIER
) -> bool:
    """Whether a gain in score exceeds what it scatters over parts of the spectra."""
    gains = likelihood.sectors(simpler.candidate.point) - likelihood.sectors(found.candidate.point)
    return simpler.score - found.score > sure * jackknife_error(left_out(gains))


def _single(candidate: Candidate) -> bool:
    return not (candidate.transmission and candidate.reflection)


def _kind(candidate: Candidate) -> tuple[bool, bool]:
    return candidate.transmission, candidate.reflection


def _score(found: ScoredCandidate) -> float:
    return found.score


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
    errors : SceneErrors
        They do not reach the rivals.
    gain : float
        How much more likely the polarized light makes the capture, per frequency and colour, doubt deducted: the plain
        pane's score less this one's.
    shown : ndarray, shape (2, 3)
        Stokes vectors that both layers show with all images in place, s0 = 1.
    rivals : tuple of Rival
        Panes that show the same.
    """

    scene: SceneParameters
    misfit: float
    n: int
    errors: SceneErrors
    gain: float
    shown: Values
    rivals: tuple[Rival, ...] = ()


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
    if not likelihood.lit:
        return None
    mixture = Mixture(stokes)
    search = Search(likelihood, mixture, asked)
    vectors = mixture.likely_vectors()
    rough = search.rough([pane for shown in vectors for pane in candidates(shown, asked)])
    if not rough:
        return None
    tiles = StokesTiles(stokes, asked)
    in_place = [found for found in sorted(rough, key=_score) if not found.candidate.point[SHIFT]]
    ghosts = [candidate for candidate in finalists(rough) if candidate.point[SHIFT]]
    places, fits = finalists(in_place), list[TileFit]()
    if search.seeks_ghosts:
        fits = ghosts_told(tiles, asked, [found.candidate for found in in_place], ghosts, vectors)
        ghosts = likely_starts(ghosts, fits)
    rivals: tuple[Rival, ...] = ()
    choice = choose(search, likelihood, ghosts or places)
    if fits and not _surely_better(
        likelihood, choice.best, min(map(search.finely, places), key=_score), _SURE_OF_GHOSTS
    ):
        choice = choose(search, likelihood, places)
    gain = search.unpolarized(plain) - choice.best.score
    candidate: Candidate = choice.best.candidate
    if candidate.point[SHIFT]:
        coarse = PolarizedLikelihood(stokes, asked, coarse=True)
        # A frame of few blocks has no coarse light.
        if coarse.n:
            search = Search(coarse, mixture, asked)
            candidate = closely(search, coarse, choice)
            if fits:
                candidate = settled(tiles, asked, fits, candidate, search)
            candidate = likeliest_near(tiles, asked, candidate, search, CrossRelation(stokes, asked))
    elif asked.incidence_deg is None and asked.azimuth_deg is None:
        alike = panes_alike(mixture, likelihood, asked)
        candidate, rivals = (candidate, ()) if alike is None else (alike.candidate, alike.rivals)
    scene, errors = scene_at(candidate.point, asked), search.errors(candidate)
    shown = shown_by(candidate.point, asked)
    return PolarizedFit(scene, *likelihood.leftover(candidate.point), errors, gain, shown, rivals)
