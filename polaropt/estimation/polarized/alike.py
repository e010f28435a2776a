"""Panes before polarized light that no photograph tells apart: their images in place show the same.

In place a capture tells four numbers, the Stokes vector that each layer shows. With one polarized layer a handful of
panes shows them, with two a whole family; and either layer may be the one behind the glass. What is likely of skies,
screens and brightness alone (`PolarizedLikelihood.doubt`) speaks for one of them.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from polaropt.estimation.polarized.light import (
    HIGHEST_DEG,
    HIGHEST_DEGREE,
    LOWEST_DEG,
    OF_REFLECTION,
    OF_TRANSMISSION,
    Candidate,
    Place,
    Point,
    bounded,
    candidates,
    point_showing,
    scene_at,
    shown_by,
)
from polaropt.estimation.polarized.likelihood import PolarizedLikelihood
from polaropt.optics import Rival, SceneParameters

Values = NDArray[np.float64]

_AS_LIKELY = 0.004
"""Doubt, as of `PolarizedLikelihood.doubt`, by which a pane is e times less likely. By trial, on the random windows to
fit on: the true pane is up to 0.005 more doubtful than the one taken."""
_STEPS_DEG = np.arange(-24.0, 25.0, 4.0)
"""From an incidence with one polarized layer to others that show nearly the same. Set by hand."""
_INCIDENCES_DEG, _AZIMUTHS_DEG = np.arange(LOWEST_DEG + 1, HIGHEST_DEG, 3.0), np.arange(0.0, 180.0, 6.0)
"""Panes of which those are looked at that show the same with polarized light in both layers. Set by hand."""
_LEAST_CHANCE = 1e-3
"""Chance below which a pane is left out. Set by hand."""

_MOST_BETTER = 100.0
"""Exponent of a pane's weight beside that found, at most: beyond, the other is certain. Set by hand."""


@dataclass(frozen=True)
class _Alike:
    """A pane, how likely it is beside others, and the transmission found as a share of what it says, minus 1."""

    point: Point
    weight: float
    off: float
    exchanged: bool


def panes_alike(
    likelihood: PolarizedLikelihood, cost: Callable[[Values], float], found: Point, asked: SceneParameters
) -> tuple[Rival, ...]:
    """Panes that show nearly the same in place as the one found, those like each other taken together.

    Parameters
    ----------
    likelihood : PolarizedLikelihood
    cost : callable
        What speaks against two Stokes vectors (2, 3), in units of the likelihood's scores.
    found : Point
        In place.
    asked : SceneParameters
        Its incidence and azimuth are open.
    """
    shown = shown_by(found, asked)
    least, of_found = likelihood.doubt(found) + cost(shown), likelihood.brightness(found)[0]

    def alike(point: Point) -> _Alike:
        of_point = shown_by(point, asked)
        exchanged = bool(np.linalg.norm(of_point[0] - shown[1]) < np.linalg.norm(of_point[0] - shown[0]))
        worse = (likelihood.doubt(point) + cost(of_point) - least) / _AS_LIKELY
        weight = math.exp(-max(worse, -_MOST_BETTER))
        off = of_found / max(float(likelihood.brightness(point)[0]), 1e-9) - 1
        return _Alike(point, weight, 1.0 if exchanged else off, exchanged)

    single = [
        _weighing_together([alike(point) for point in _with_one_polarized(candidate, asked)], max)
        for candidate in candidates(shown, asked)
    ]
    # All of them together are one more kind of pane.
    both = _weighing_together([alike(point) for point in _with_both_polarized(shown, asked)], np.mean)
    panes = [pane for kind in (*single, both) for pane in kind]
    total = sum(pane.weight for pane in panes)
    if not total:
        return ()
    groups = [
        [pane for pane in panes if pane.exchanged == exchanged and (pane.off > 0) == more]
        for exchanged in (False, True)
        for more in (False, True)
    ]
    rivals = [_of_group(group, total, asked) for group in groups if group]
    return tuple(rival for rival in rivals if rival.chance > _LEAST_CHANCE)


def _weighing_together(panes: list[_Alike], together: Callable[[list[float]], Any]) -> list[_Alike]:
    """The same panes, whose weights add up to what all of them weigh together."""
    weights = [pane.weight for pane in panes]
    share = float(together(weights)) / sum(weights) if sum(weights) else 0.0
    return [replace(pane, weight=share * pane.weight) for pane in panes]


def _with_one_polarized(candidate: Candidate, asked: SceneParameters) -> Iterator[Point]:
    """Panes at other incidences before the same unpolarized light, and what shows the same of the other layer.

    Near Brewster's angle the reflection hardly changes with the incidence.
    """
    layer = 0 if candidate.transmission else 1
    incidence, azimuth, shift = (float(number) for number in candidate.point[:3])
    other = (OF_REFLECTION, OF_TRANSMISSION)[layer]
    for step in _STEPS_DEG:
        if LOWEST_DEG <= incidence + step <= HIGHEST_DEG:
            point = point_showing(Place(incidence + step, azimuth, shift), shown_by(candidate.point, asked), asked)
            point[other] = 0
            yield bounded(point)


def _with_both_polarized(shown: Values, asked: SceneParameters) -> Iterator[Point]:
    for vectors in (shown, shown[::-1]):
        for incidence in _INCIDENCES_DEG:
            for azimuth in _AZIMUTHS_DEG:
                point = point_showing(Place(float(incidence), float(azimuth), 0.0), vectors, asked)
                if max(math.hypot(*point[3:5]), math.hypot(*point[5:7])) <= HIGHEST_DEGREE:
                    yield point


def _of_group(group: list[_Alike], total: float, asked: SceneParameters) -> Rival:
    """The pane that stands for some: the one whose error is nearest to theirs."""
    weights = np.array([pane.weight for pane in group])
    error = math.sqrt(float(weights @ np.square([pane.off for pane in group])) / max(float(weights.sum()), 1e-300))
    # Of those that are alike in this the likeliest.
    nearest = min(group, key=lambda pane: abs(abs(pane.off) - error) - _AS_LIKELY * math.log(max(pane.weight, 1e-300)))
    return Rival(scene_at(nearest.point, asked), float(weights.sum()) / total, min(error, 1.0))
