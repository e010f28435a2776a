"""Whether far and near scenes double differently: a ghost shift of its own for each layer, where the capture tells.

The spectral likelihood is scanned along one layer's shift and then the other's. It hardly tells their senses apart, and
patterns mimic faint ghosts; so the layers that follow are compared, too: edges doubled in one lie upon the other's.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from polaropt.capture import PlateFrame
from polaropt.estimation.flat.ghost_overlap import LayerOverlap
from polaropt.estimation.flat.ghosts import ShiftLikelihood
from polaropt.numerics import grid_minimum, local_minima, local_minimum
from polaropt.optics import INCIDENCE_SEARCH_DEG, SceneParameters, plate_at

Curve = NDArray[np.float64]

# Share of the light that the transmission's first ghost must have before its place can be told: from about 53 degrees.
_LEAST_LIGHT = 0.015
# All below by trial.
_LEAST_REFLECTION_SHIFT_PX = 3.0
"""Closer ghosts of the reflection, nearly as bright as itself, look like a blurred scene."""
_LEAST_DIFFERENCE_PX = 1.5
"""By which two shifts must differ to be told as two."""
_MOST_TURNS = 4
"""Scans along one layer's shift and then the other's."""
_FIRST_ROUNDS, _FINE_ROUNDS, _ROUNDS = 2, 4, 16
"""In which spectra are fitted: for scans, between the grid's points, and where misfits decide."""
_FINE_PX: Curve = np.arange(-6.0, 6.5) / 6
_WORTH_A_LOOK = 1.5e-3
"""Misfit per frequency that two shifts must gain over one before layers are compared."""
_LEAST_GAIN, _OVERLAP_WEIGHT = 5e-3, 0.1
"""The same to be taken, with what a unit of log overlap is worth: twice what chance gains one shift's panes."""
_HALF_WIDTH_DEG, _NEAR_DEG = 3.6, 1.2
"""Incidences around the estimate that a pair is compared at: how far, and how far apart."""
_ELSEWHERE_DEG = (0.0, -4.0, 4.0)
"""What one shift had to explain may have taken the incidence along by so much."""
_STEP_DEG, _TOLERANCE_DEG = 2.0, 0.3
# Incidences tried for two shifts that were found: from well below the first at which they can be.
_BOUNDS_DEG = (30.0, INCIDENCE_SEARCH_DEG[1])


class _Pair(NamedTuple):
    """Ghost shifts of both layers."""

    transmission: float
    reflection: float


@dataclass(frozen=True)
class _Scanner:
    """Scans of the likelihood along one layer's shift."""

    likelihood: ShiftLikelihood
    incidence_deg: float
    grid: Curve

    def best(self, pair: _Pair) -> tuple[_Pair, float]:
        """The likeliest pair that has one of the two shifts, the reflection's in either sense, and its misfit."""
        n = self.grid.size
        of_t = np.stack([self.grid, self.grid, np.full(n, pair.transmission)])
        of_r = np.stack([np.full(n, pair.reflection), np.full(n, -pair.reflection), self.grid])
        flat = self.likelihood.misfit(self.incidence_deg, of_r.ravel(), _FIRST_ROUNDS, of_t.ravel())
        misfit = flat.reshape(3, n)
        misfit = np.where(local_minima(misfit) & (np.abs(of_r) >= _LEAST_REFLECTION_SHIFT_PX), misfit, np.inf)
        best = np.unravel_index(int(np.argmin(misfit)), misfit.shape)
        return _Pair(float(of_t[best]), float(of_r[best])), float(misfit[best])

    def misfit(self, pair: _Pair) -> float:
        """Of one pair, the incidence free to give."""
        near = self.incidence_deg + np.arange(-_HALF_WIDTH_DEG, _HALF_WIDTH_DEG + _NEAR_DEG / 2, _NEAR_DEG)
        near = near[near < _BOUNDS_DEG[1]]
        return float(self.likelihood.misfit(near, [pair.reflection], _ROUNDS, [pair.transmission]).min())

    def refined(self, pair: _Pair) -> _Pair:
        """Both shifts between the grid's points."""
        for _ in range(2):
            of_t = pair.transmission + _FINE_PX
            misfit = self.likelihood.misfit(self.incidence_deg, np.full(of_t.size, pair.reflection), _FINE_ROUNDS, of_t)
            pair = _Pair(grid_minimum(of_t, misfit), pair.reflection)
            of_r = pair.reflection + _FINE_PX
            misfit = self.likelihood.misfit(
                self.incidence_deg, of_r, _FINE_ROUNDS, np.full(of_r.size, pair.transmission)
            )
            pair = _Pair(pair.transmission, grid_minimum(of_r, misfit))
        return pair


def own_shifts(frame: PlateFrame, likelihood: ShiftLikelihood, scene: SceneParameters, most: float) -> SceneParameters:
    """A scene whose one shift was estimated, with a shift for each layer where that explains clearly more.

    Parameters
    ----------
    frame : PlateFrame
        The capture in the frame of the scene's azimuth.
    likelihood : ShiftLikelihood
        Of the same frame.
    scene : SceneParameters
        Complete.
    most : float
        Largest shift to look at, in pixels.

    Returns
    -------
    SceneParameters
        The same where one shift does, or where the transmission's ghosts are too faint to tell.
    """
    incidence, _, shift = scene.values()
    transmission, _ = plate_at(incidence, scene).series
    if transmission.ratio[1] < _LEAST_LIGHT:
        return scene
    scanner = _Scanner(likelihood, incidence, np.arange(-math.floor(most), math.floor(most) + 1.0))
    pair = _likeliest(scanner, shift)
    if pair is None:
        return scene
    return _compared(frame, scanner, scene, scanner.refined(pair))


def _likeliest(scanner: _Scanner, shift: float) -> _Pair | None:
    """The pair at which scans come to rest, or None where it is hardly likelier than one shift."""
    one = round(shift)
    pair = _Pair(one, one)
    alone = float(scanner.likelihood.misfit(scanner.incidence_deg, [one], _FIRST_ROUNDS)[0])
    least = alone
    for _ in range(_MOST_TURNS):
        found, misfit = scanner.best(pair)
        if misfit >= least or alone - misfit < _WORTH_A_LOOK:
            break
        pair, least = found, misfit
    if pair.transmission == pair.reflection:
        return None
    around = scanner.incidence_deg + np.array(_ELSEWHERE_DEG)
    elsewhere = [replace(scanner, incidence_deg=float(x)).best(pair) for x in around if x < _BOUNDS_DEG[1]]
    return min(elsewhere, key=lambda found: found[1])[0]


def _compared(frame: PlateFrame, scanner: _Scanner, scene: SceneParameters, pair: _Pair) -> SceneParameters:
    """The best of the pair's four senses, or the scene as it is."""
    incidence, _, shift = scene.values()
    one = _score(frame, scanner, scene, _Pair(shift, shift))
    t, r = pair
    scored = [(_score(frame, scanner, scene, _Pair(a, b)), a, b) for a in {t, -t} for b in {r, -r}]
    score, of_t, of_r = min(scored)
    if one - score < _LEAST_GAIN or abs(of_t - of_r) < _LEAST_DIFFERENCE_PX or abs(of_r) < _LEAST_REFLECTION_SHIFT_PX:
        return scene
    found = scene.replace(ghost_shift=of_r, transmission_ghost_shift=of_t)
    overlap = LayerOverlap(frame, found, incidence)
    return found.replace(incidence_deg=local_minimum(overlap.at, incidence, _BOUNDS_DEG, _STEP_DEG, _TOLERANCE_DEG))


def _score(frame: PlateFrame, scanner: _Scanner, scene: SceneParameters, pair: _Pair) -> float:
    misfit = scanner.misfit(pair)
    shifted = scene.replace(ghost_shift=pair.reflection, transmission_ghost_shift=pair.transmission)
    overlap = LayerOverlap(frame, shifted, scanner.incidence_deg)
    near = (scanner.incidence_deg + step for step in (-_NEAR_DEG, 0.0, _NEAR_DEG))
    return misfit + _OVERLAP_WEIGHT * math.log(min(overlap.at(x) for x in near if x < _BOUNDS_DEG[1]))
