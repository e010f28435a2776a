"""Which of two panes, their planes of incidence across each other, was photographed: the odds, and what is at stake.

Unpolarized layers tell the azimuth modulo 90 degrees only. A pane across has the layers exchanged, and often seems to
explain noisy photographs about as well; taken for the right one it is worse than no separation at all.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from polaropt.cross_spectra import CrossSpectra
from polaropt.ghost_shift import ShiftLikelihood
from polaropt.jackknife import jackknife_error
from polaropt.plate import in_place_correction
from polaropt.scene import SceneParameters
from polaropt.scene_search import Evidence, Trial

# Log odds per nat of the spectra's log likelihood, at the shift found and at the likeliest shift, where its jackknife
# error is below a nat, and per noise level of the search's own score: fitted by logistic regression, then kept on the
# safe side, on 311 scenes of photographs that no figure is taken of where two panes come close.
_AS_FOUND, _AT_BEST, _OF_SCORE = 0.5, 1.5, 2.0
# Noise levels by which scores differ where the search is not mistaken: so it was in all of these scenes.
_SETTLED = 2.0
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


def choose_axis(panes: tuple[Pane, Pane], scene: SceneParameters, noise: float) -> AxisChoice:
    """Weigh the chance of each pane with what the transmission loses where it is taken and the other one is right.

    Both take a multiple of the polarized light off the intensity, c_0 and c_1 in opposite directions (all bounces in
    place). If pane 1 is right the plain intensity is c_1 off, and the transmission of pane 0 is c_0 + c_1 off.

    Parameters
    ----------
    panes : (Pane, Pane)
        The best trial at an azimuth and at the one across.
    scene : SceneParameters
        Index and surfaces of the pane.
    noise : float
        Standard deviation of the noise of one photograph.
    """
    score = (panes[1].trial.score - panes[0].trial.score) / noise
    if abs(score) > _SETTLED:
        return AxisChoice(0 if score > 0 else 1, 0.0)
    odds = log_odds(panes, scene, noise)
    chance = 1 / (1 + math.exp(-min(max(odds, -700.0), 700.0)))
    first, second = (
        in_place_correction(_incidence(pane), scene.refractive_index, scene.single_surface) for pane in panes
    )
    stakes = ((1 - chance) * (1 + first / second) ** 2, chance * (1 + second / first) ** 2)
    best = 0 if stakes[0] <= stakes[1] else 1
    return AxisChoice(best, stakes[best])


def log_odds(panes: tuple[Pane, Pane], scene: SceneParameters, noise: float) -> float:
    """Natural logarithm of how much likelier the first pane is; parameters as for `choose_axis`.

    From the likelihood of the spectra, less trusted the more it differs between parts of the frame; from the search's
    score, which noise biases; and from how often panes are seen at such an incidence: those of random directions show
    a projected area that goes with the sine of twice the incidence.
    """
    n = float(panes[0].seen.spectra.multiplicity.sum())
    found, error = _likelier(panes, scene)
    told = _AS_FOUND * found + _AT_BEST * (panes[1].least_misfit - panes[0].least_misfit)
    of_score = _OF_SCORE * (panes[1].trial.score - panes[0].trial.score) / noise
    area = [math.sin(2 * math.radians(_incidence(pane))) for pane in panes]
    return n * told / math.hypot(1, n * error) + of_score + math.log(area[0] / area[1])


def _incidence(pane: Pane) -> float:
    return min(max(pane.trial.incidence_deg, _LEAST_DEG), _MOST_DEG)


def _likelier(panes: tuple[Pane, Pane], scene: SceneParameters) -> tuple[float, float]:
    """Log likelihood per frequency by which the first pane is the likelier, at the shifts found, and its error."""

    def misfit(pane: Pane, spectra: CrossSpectra) -> float:
        trial = pane.trial
        return float(ShiftLikelihood(spectra, scene).misfit(trial.incidence_deg, [trial.ghost_shift])[0])

    first, second = panes
    gain = misfit(second, second.seen.spectra) - misfit(first, first.seen.spectra)
    parts = zip(first.seen.spectra.left_out(), second.seen.spectra.left_out(), strict=True)
    gains = np.array([misfit(second, b) - misfit(first, a) for a, b in parts])
    return gain, jackknife_error(gains) if gains.size else 0.0
