"""Which of two panes, their planes of incidence across each other, was photographed: the odds, and what is at stake.

Unpolarized layers tell the azimuth modulo 90 degrees only. A pane across has the layers exchanged, and often seems to
explain noisy photographs about as well; taken for the right one it is worse than no separation at all.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from polaropt.edge_overlap import EdgeOverlap
from polaropt.ghost_shift import ShiftLikelihood
from polaropt.jackknife import Values, jackknife_error
from polaropt.plate import in_place_correction
from polaropt.scene import SceneParameters
from polaropt.scene_search import Evidence, Trial

# Log odds per nat of the spectra's log likelihood, at the shift found and at the likeliest shift, and per standard
# error by which edges overlap less: logistic regression on the 241 of 504 scenes of photographs that no figure is taken
# of where two panes come close; of these they tell 235 right.
_AS_FOUND, _AT_BEST, _PER_ERROR = 2.0, 1.0, 0.25
_LEAST_DEG, _MOST_DEG = 0.5, 89.5
HIGH_STAKE, NOTABLE_STAKE = 0.5, 0.25
"""Stakes from which on the intensity is the safer guess, and from which on a gain of less than 6 dB is expected."""


@dataclass(frozen=True)
class Pane:
    """One of the two.

    Attributes
    ----------
    seen : Evidence
        What the search reads of the capture along this pane.
    trial : Trial
        The best one.
    least_misfit : float
        Of the spectra at its incidence, over all shifts.
    """

    seen: Evidence
    trial: Trial
    least_misfit: float


@dataclass(frozen=True)
class AxisChoice:
    """Which of two panes to take.

    Attributes
    ----------
    best : int
        0 or 1: the one whose transmission is expected to have the lesser error.
    stake : float
        That error, mean square, over that of the plain intensity, for the chance that the other pane is the right one.
    """

    best: int
    stake: float


def choose_axis(panes: tuple[Pane, Pane], scene: SceneParameters) -> AxisChoice:
    """Weigh the chance of each pane with what the transmission loses where it is taken and the other one is right.

    Both take a multiple of the polarized light off the intensity, c_0 and c_1 in opposite directions (all bounces in
    place). If pane 1 is right the plain intensity is c_1 off, and the transmission of pane 0 is c_0 + c_1 off.

    Parameters
    ----------
    panes : (Pane, Pane)
        The best trial at an azimuth and at the one across.
    scene : SceneParameters
        Index and surfaces of the pane.
    """
    odds = log_odds(panes, scene)
    chance = 1 / (1 + math.exp(-min(max(odds, -700.0), 700.0)))
    first, second = (in_place_correction(*_pane(_incidence(pane), scene)) for pane in panes)
    stakes = ((1 - chance) * (1 + first / second) ** 2, chance * (1 + second / first) ** 2)
    best = 0 if stakes[0] <= stakes[1] else 1
    return AxisChoice(best, stakes[best])


def log_odds(panes: tuple[Pane, Pane], scene: SceneParameters) -> float:
    """Natural logarithm of how much likelier the first pane is.

    From the likelihood of the spectra, from how far edges overlap less in units of its jackknife error, and from how
    often panes are seen at such an incidence: those of random directions show a projected area that goes with the sine
    of twice the incidence.
    """
    of_spectra = [_misfit_of_spectra(pane, scene) for pane in panes]
    overlaps = [_log_overlap_without_parts(pane, scene) for pane in panes]
    less = overlaps[1] - overlaps[0]
    area = [math.sin(2 * math.radians(_incidence(pane))) for pane in panes]
    of_edges = float(less.mean()) / max(jackknife_error(less), 1e-9)
    return of_spectra[1] - of_spectra[0] + _PER_ERROR * of_edges + math.log(area[0] / area[1])


def _incidence(pane: Pane) -> float:
    return min(max(pane.trial.incidence_deg, _LEAST_DEG), _MOST_DEG)


def _pane(incidence_deg: float, scene: SceneParameters) -> tuple[float, float, bool]:
    return incidence_deg, scene.refractive_index, scene.single_surface


def _misfit_of_spectra(pane: Pane, scene: SceneParameters) -> float:
    """Minus weighted log likelihood: a shift that the search missed counts for its pane, too."""
    spectra, trial = pane.seen.spectra, pane.trial
    found = float(ShiftLikelihood(spectra, scene).misfit(trial.incidence_deg, [trial.ghost_shift])[0])
    return float(spectra.multiplicity.sum()) * (_AS_FOUND * found + _AT_BEST * pane.least_misfit)


def _log_overlap_without_parts(pane: Pane, scene: SceneParameters) -> Values:
    """Logarithm of the edge overlap without each part of the frame, with ghosts or in place, where it is less."""
    shifts = dict.fromkeys((pane.trial.ghost_shift, 0.0))
    overlaps = [EdgeOverlap(pane.seen.coarse, scene, shift).left_out(pane.trial.incidence_deg) for shift in shifts]
    return np.asarray(np.log(min(overlaps, key=np.mean)))
