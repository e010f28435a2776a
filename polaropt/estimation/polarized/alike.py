"""Panes before polarized light that no photograph tells apart: their images in place show the same.

In place a capture tells four numbers, the Stokes vector that each layer shows. With one polarized layer a handful of
panes shows them, with two a whole family; and either layer may be the one behind the glass. How likely each of them is
follows from Bayes' rule: by what is likely of panes, of light and of brightness before anything is seen, and by how
many panes and lights show nearly the same (where a small change of the pane changes much of what is shown, few do).

What is likely beforehand is set by hand: any incidence and azimuth, either layer polarized or both, any degree and
angle of polarization, and layers of the same brightness give or take a factor e.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from polaropt.estimation.polarized.light import (
    HIGHEST_DEG,
    HIGHEST_DEGREE,
    LOWEST_DEG,
    Candidate,
    in_place,
    pane_light,
    scene_at,
)
from polaropt.estimation.polarized.likelihood import PolarizedLikelihood
from polaropt.estimation.polarized.mixing import Mixture
from polaropt.optics import Rival, SceneParameters, brewster_angle_deg

Values = NDArray[np.float64]

_INCIDENCES_DEG, _AZIMUTHS_DEG = np.arange(LOWEST_DEG + 1, HIGHEST_DEG, 0.5), np.arange(0.0, 180.0, 4.0)
"""Panes that are looked at with polarized light in both layers; with one they lie between these. Set by hand."""
_LEAST_DEGREE = 0.03
"""Polarized less, light is hardly likelier to be polarized exactly so. Set by hand."""
_FLATTEST = 0.002
"""Change of what unpolarized light shows, per degree of incidence, below which it is told no better. Set by hand."""
_NEAR = 0.01
"""Share of the transmission by which panes differ that give the same layers: 1 % costs some 3 dB of 43. Set by hand."""
_QUANTILES = (0.3, 0.5, 0.7)
"""Of the panes of one kind, those whose neighbours are counted. Set by hand."""
_LEAST_CHANCE = 1e-3
"""Chance below which a pane is left out. Set by hand."""
_TRANSMISSION, _REFLECTION = 0, 1
_SIGNS = (1.0, -1.0)
"""Of the turned entry of each layer's light: the mirror turns it."""


@dataclass(frozen=True)
class Alike:
    """The pane to take, and those that may be the true one instead.

    Attributes
    ----------
    candidate : Candidate
        In place.
    chance : float
        That its transmission, or nearly the same, is the true one.
    rivals : tuple of Rival
    """

    candidate: Candidate
    chance: float
    rivals: tuple[Rival, ...]


@dataclass(frozen=True)
class _Panes:
    """Panes of one kind: points (n, 7), how likely each is, brightness of the transmission, and what kind it is."""

    points: Values
    weights: Values
    transmission: Values
    exchanged: bool
    polarized: tuple[bool, bool]


def panes_alike(mixture: Mixture, likelihood: PolarizedLikelihood, asked: SceneParameters) -> Alike | None:
    """Panes that show in place what a capture shows.

    Parameters
    ----------
    mixture : Mixture
    likelihood : PolarizedLikelihood
        Of the same capture.
    asked : SceneParameters
        Its incidence and azimuth are open.

    Returns
    -------
    Alike or None
        The pane taken is the one with most others near it: whose transmission is most likely right. None where no pane
        shows what is seen.
    """
    pairs, chances = mixture.spread()
    gains = np.array([in_place(pane_light(float(x), asked)) for x in _INCIDENCES_DEG])
    kinds = list(_kinds(pairs, chances, likelihood, gains, asked))
    total = sum(float(panes.weights.sum()) for panes in kinds)
    possible = [panes for panes in kinds if panes.weights.sum() > _LEAST_CHANCE * total]
    found: tuple[float, _Panes, int] | None = None
    # Where one polarized layer may do, two are not taken: they would have any incidence.
    for panes in [panes for panes in possible if not all(panes.polarized)] or possible:
        for quantile in _QUANTILES:
            place = _weighted_place(panes, quantile)
            chance = _chance_near(kinds, panes, float(panes.transmission[place])) / total
            if found is None or chance > found[0]:
                found = chance, panes, place
    if found is None:
        return None
    chance, panes, place = found
    rivals = _rivals(kinds, panes, float(panes.transmission[place]), total, asked)
    return Alike(Candidate(panes.points[place], *panes.polarized), chance, rivals)


def _kinds(
    pairs: Values, chances: Values, likelihood: PolarizedLikelihood, gains: Values, asked: SceneParameters
) -> Iterator[_Panes]:
    """All panes, by which layer is polarized, which of the vectors is the transmission's, and side of Brewster's angle.

    Parameters
    ----------
    pairs : ndarray, shape (n, 2, 3)
        Stokes vectors that the layers show, and `chances` (n,) of each pair.
    likelihood : PolarizedLikelihood
    gains : ndarray, shape (incidence, layer, entry)
    asked : SceneParameters
    """
    seen = np.array([likelihood.shares(pair) for pair in pairs])
    likeliest = int(np.argmax(chances))
    brewster = brewster_angle_deg(asked.index)
    for exchanged in (False, True):
        order = slice(None, None, -1) if exchanged else slice(None)
        shown, mean = pairs[:, order, 1:], seen[:, order]
        for unpolarized, limits in (
            (_REFLECTION, (0.0, brewster)),
            (_REFLECTION, (brewster, 90.0)),
            (_TRANSMISSION, (0.0, 90.0)),
        ):
            inside = (limits[0] <= _INCIDENCES_DEG) & (limits[1] > _INCIDENCES_DEG)
            if np.count_nonzero(inside) > 1:
                yield _with_one_polarized(shown, mean, chances, unpolarized, _Side(gains, inside), exchanged)
        yield _with_both_polarized(shown[likeliest], mean[likeliest], gains, exchanged)


class _Side:
    """Incidences on one side of Brewster's angle: what unpolarized light shows there.

    Parameters
    ----------
    gains : ndarray, shape (incidence, layer, entry)
    inside : ndarray of bool, shape (incidence,)
    """

    def __init__(self, gains: Values, inside: NDArray[np.bool_]) -> None:
        self._incidence, self._gains = _INCIDENCES_DEG[inside], gains[inside]

    def showing(self, degree: Values, layer: int) -> tuple[Values, Values, Values]:
        """Incidence at which a layer shows a degree of polarization, the gains there, and how likely it is.

        Parameters
        ----------
        degree : ndarray, shape (n,)
        layer : int

        Returns
        -------
        incidence : ndarray, shape (n,)
        gains : ndarray, shape (n, layer, entry)
        density : ndarray, shape (n,)
            Panes per degree of polarization, 0 where none shows it.
        """
        par, perp = self._gains[:, layer, 0], self._gains[:, layer, 1]
        shown = np.abs(par - perp) / (par + perp)
        slope = np.abs(np.gradient(shown, self._incidence))
        rising = np.argsort(shown)
        incidence = np.interp(degree, shown[rising], self._incidence[rising])
        gains = [np.interp(incidence, self._incidence, part) for part in self._gains.reshape(len(shown), -1).T]
        slope = np.maximum(np.interp(incidence, self._incidence, slope), _FLATTEST)
        density = ((degree >= shown.min()) & (degree <= shown.max())) / (slope * _INCIDENCES_DEG.size / 2)
        return incidence, np.stack(gains, axis=-1).reshape(-1, *self._gains.shape[1:]), density


def _with_one_polarized(
    shown: Values, mean: Values, chances: Values, unpolarized: int, side: _Side, exchanged: bool
) -> _Panes:
    """Panes before one layer's unpolarized light, and what the other layer's light is then."""
    degree = np.hypot(*shown[:, unpolarized].T)
    # The pane passes light polarized in the plane of incidence, and mirrors light polarized across.
    azimuth = np.arctan2(shown[:, unpolarized, 1], shown[:, unpolarized, 0]) / 2 + unpolarized * math.pi / 2
    incidence, gains, density = side.showing(degree, unpolarized)
    # Vectors per area of what is shown: the direction of polarization turns twice as fast as the azimuth.
    density = density / (2 * math.pi * np.maximum(degree, _LEAST_DEGREE))
    light = [_entering(shown[:, layer], gains[:, layer], azimuth, layer) for layer in (0, 1)]
    of_light = light[1 - unpolarized].density
    brightness = np.stack([mean[:, layer] * light[layer].share for layer in (0, 1)])
    points = np.column_stack(
        [incidence, np.degrees(azimuth) % 180, np.zeros(len(incidence)), *(x.numbers for x in light)]
    )
    first = 3 + 2 * unpolarized
    points[:, first : first + 2] = 0
    weights = chances * density * of_light * _likely_beside(brightness)
    return _Panes(points, weights, brightness[0], exchanged, (unpolarized == 1, unpolarized == 0))


def _with_both_polarized(shown: Values, mean: Values, gains: Values, exchanged: bool) -> _Panes:
    """All panes that show two Stokes vectors (s1, s2)."""
    incidence, azimuth = (x.ravel() for x in np.meshgrid(_INCIDENCES_DEG, _AZIMUTHS_DEG, indexing="ij"))
    gains = np.repeat(gains, _AZIMUTHS_DEG.size, axis=0)
    light = [_entering(shown[layer], gains[:, layer], np.radians(azimuth), layer) for layer in (0, 1)]
    brightness = np.stack([mean[layer] * light[layer].share for layer in (0, 1)])
    points = np.column_stack([incidence, azimuth, np.zeros(len(incidence)), *(x.numbers for x in light)])
    weights = light[0].density * light[1].density * _likely_beside(brightness) / len(incidence)
    return _Panes(points, weights, brightness[0], exchanged, (True, True))


@dataclass(frozen=True)
class _Entering:
    """Light of a layer before the pane: degree times cosine and sine of its angle (n, 2), how much there is of it for
    what is shown (n,), and how likely it is, per area of what is shown (n,)."""

    numbers: Values
    share: Values
    density: Values


def _entering(shown: Values, gains: Values, azimuth: Values, layer: int) -> _Entering:
    """The light that a layer must have to show (s1, s2), (..., 2), behind panes of some gains (n, entry).

    The inverse of a pane divides by its gains: areas grow by its determinant over the third power of the light.
    """
    cos, sin = np.cos(2 * azimuth), np.sin(2 * azimuth)
    along = cos * shown[..., 0] + sin * shown[..., 1]
    par, perp = (1 + along) / 2 / gains[:, 0], (1 - along) / 2 / gains[:, 1]
    turned = _SIGNS[layer] * (cos * shown[..., 1] - sin * shown[..., 0]) / gains[:, 2]
    share = par + perp
    numbers = np.stack([par - perp, turned], axis=-1) / share[:, None]
    degree = np.hypot(*numbers.T)
    # Any degree is as likely, and any angle.
    density = (degree <= HIGHEST_DEGREE) / (2 * math.pi * np.maximum(degree, _LEAST_DEGREE))
    return _Entering(numbers, share, density / np.abs(np.prod(gains, axis=1) * share**3))


def _likely_beside(brightness: Values) -> Values:
    """How likely layers of a brightness (2, n) are beside each other."""
    lit = (brightness > 0).all(axis=0)
    ratio = np.where(lit, brightness[1], 1.0) / np.where(lit, brightness[0], 1.0)
    return np.asarray(lit * np.exp(-0.5 * np.log(ratio) ** 2))


def _weighted_place(panes: _Panes, quantile: float) -> int:
    """Index of the pane at a quantile of the transmission's brightness."""
    order = np.argsort(panes.transmission)
    heaped = np.cumsum(panes.weights[order])
    return int(order[min(np.searchsorted(heaped, quantile * heaped[-1]), len(order) - 1)])


def _chance_near(kinds: list[_Panes], panes: _Panes, transmission: float) -> float:
    """Weight of all panes that give nearly the same transmission."""
    alike = [other for other in kinds if other.exchanged == panes.exchanged]
    return float(sum(other.weights[np.abs(other.transmission / transmission - 1) < _NEAR].sum() for other in alike))


def _rivals(
    kinds: list[_Panes], taken: _Panes, transmission: float, total: float, asked: SceneParameters
) -> tuple[Rival, ...]:
    """Those that are alike in what they make of the layers, taken together."""
    found = []
    for exchanged in (False, True):
        panes = [kind for kind in kinds if (kind.exchanged != taken.exchanged) == exchanged]
        points = np.concatenate([kind.points for kind in panes])
        weights = np.concatenate([kind.weights for kind in panes])
        off = transmission / np.concatenate([kind.transmission for kind in panes]) - 1
        for part in (off > 0, off <= 0):
            if (chance := float(weights[part].sum()) / total) > _LEAST_CHANCE:
                offs = np.ones(np.count_nonzero(part)) if exchanged else off[part]
                found.append(_of_group(points[part], weights[part], offs, chance, asked))
    return tuple(found)


def _of_group(points: Values, weights: Values, off: Values, chance: float, asked: SceneParameters) -> Rival:
    """The pane that stands for some: of those whose error is near theirs the likeliest."""
    error = math.sqrt(float(weights @ np.square(off)) / float(weights.sum()))
    near = np.abs(np.abs(off) - error)
    place = int(np.argmax(np.where(near <= max(_NEAR, float(near[weights > 0].min())), weights, -1.0)))
    return Rival(scene_at(points[place], asked), chance)
