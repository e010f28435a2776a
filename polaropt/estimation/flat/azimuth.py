"""Azimuth of the pane: the main axis of polarization, and which of two panes across each other has it.

Unpolarized layers tell the azimuth modulo 90 degrees only. A pane across has the layers exchanged, and often seems to
explain noisy photographs about as well; taken for the right one it is worse than no separation at all.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from polaropt.capture import StokesImages, noise_of_neighbours
from polaropt.estimation.flat.ghosts import CrossSpectra, ShiftLikelihood
from polaropt.estimation.flat.search import Evidence, Trial
from polaropt.estimation.flat.windows.tiles import TileFit
from polaropt.numerics import jackknife_error
from polaropt.optics import INCIDENCE_LIMITS_DEG, SceneParameters, in_place_correction, in_place_reflectance

Images = NDArray[np.float32]
Matrix = NDArray[np.float64]

# All by trial.
_MOST_SIDE = 320
"""Blocks per side that polarized light is averaged over at most: it shows at low frequencies."""
_RINGS = 256
"""Rings of equal frequency, from none to the diagonal's."""
_LOW = 0.1
"""Squared frequency (rad per block) below which the signal's level is first read."""
_ROUNDS = 6
"""In which the signal's level is fitted."""
_LEAST = 1e-14
"""Power that is divided by where there is none."""
_BLOCK_OF_CELLS, _LEAST_BLOCKS_OF_CELLS = 12, 8
"""Side in pixels of the blocks of a mosaic's cells, and how many there are a side at least. Of 200 mosaics of panes at
10 to 40 degrees (`studies.random_windows`, photographs that no figure is taken of, even seeds from 9940000, mono and
color) the azimuth is off by 0.17 and 0.22 degrees so, the median; where all frequencies and their noise alone counted,
and tiles of the samples beside them, it was by 0.32 and 0.53, and one in ten by more than 5 and 18."""
_ALIASES_WIDER = 1.2
"""What a mosaic's error by its neighbours' covariance is multiplied by: of these and 100 steeper panes 68 % are within
1.25 and 1.0 errors without it, mono and color, and 91 % within two."""


@dataclass(frozen=True)
class PrincipalAxis:
    """The dominant axis of the polarized light.

    Attributes
    ----------
    azimuth_deg : float
        Azimuth modulo 90, in [0, 90): the axis is that of the plane of incidence or the one across it.
    error_deg : float
        Standard error of the azimuth that the noise leads to (22.5 where there is nothing but noise).
    snr : float
        Polarized energy found, in standard errors of what noise alone would leave.
    """

    azimuth_deg: float
    error_deg: float
    snr: float


def principal_axis(stokes: StokesImages) -> PrincipalAxis:
    """Dominant axis of Wiener-smoothed (s1, s2), by their uncentred second moment.

    Parameters
    ----------
    stokes : StokesImages

    Notes
    -----
    Each frequency counts as far as it stands out of the noise: s1' of natural layers has the power ``A / |omega|^2``.
    The cosine transform has no seam at the borders, and white noise stays white in it. So is what aliases in a mosaic's
    cells, far stronger than noise and mostly of one component, as edges lie; large blocks tell how much it is of each.
    """
    from scipy.fft import dctn

    size = _thinning(max(stokes.images.shape[-2:]))
    if stokes.aliased:
        size = max(size, min(_BLOCK_OF_CELLS, min(stokes.images.shape[-2:]) // _LEAST_BLOCKS_OF_CELLS))
    polarized, noise_covariance = stokes.means(size)[1:], stokes.covariance[1:, 1:] / size**2
    if stokes.aliased:
        noise_covariance = max(noise_of_neighbours(polarized), noise_covariance, key=np.trace)
    coefficients = dctn(polarized, axes=(-2, -1), norm="ortho", overwrite_x=size > 1)
    radius2 = _squared_frequency(*coefficients.shape[-2:])
    noise = float(np.trace(noise_covariance))
    gains = np.stack(
        [_wiener_gain(np.einsum("iyx,iyx->yx", c, c), radius2, noise) for c in coefficients.swapaxes(0, 1)]
    )
    s1, s2 = coefficients * gains
    moment = np.array([[np.vdot(a, b) for b in coefficients] for a in (s1, s2)], np.float64)
    moment = moment - noise_covariance * gains.sum()
    twice = math.atan2(2 * moment[0, 1], moment[0, 0] - moment[1, 1])
    signal = math.hypot(2 * moment[0, 1], moment[0, 0] - moment[1, 1])
    across = np.array([-math.sin(twice / 2), math.cos(twice / 2)])
    # Large blocks differ in what is polarized along, too.
    noise = 2 * float(across @ noise_covariance @ across)
    of_noise = 0.5 * noise * math.sqrt(float((gains**2).sum())) + _LEAST
    # What turns the moment: noise with noise, and noise across with signal along.
    seen = sum(float(np.vdot(c * gain, c * gain)) for c, gain in zip(coefficients.swapaxes(0, 1), gains, strict=True))
    along = max(seen - noise * float((gains**2).sum()), 0.0)
    turning = math.sqrt(4 * of_noise**2 + 2 * noise * along)
    error_deg = math.degrees(math.atan2(turning, max(signal, _LEAST))) / 4 * (_ALIASES_WIDER if stokes.aliased else 1.0)
    return PrincipalAxis(math.degrees(twice) / 4 % 90, error_deg, signal / of_noise)


def _thinning(side: int) -> int:
    """Side of the blocks that are averaged first: polarized light shows at low frequencies."""
    return int(2 ** max(0, math.ceil(math.log2(side / _MOST_SIDE))))


def _squared_frequency(height: int, width: int) -> Images:
    rows, columns = (np.pi * np.arange(n, dtype=np.float32) / n for n in (height, width))
    radius2 = np.asarray(rows[:, None] ** 2 + columns[None, :] ** 2, np.float32)
    radius2[0, 0] = (np.pi / max(height, width)) ** 2
    return radius2


def _wiener_gain(power: Images, radius2: Images, noise: float) -> Images:
    """Share of signal in the power at each frequency, the signal's level A estimated along the way."""
    # Only the distance from zero matters: rings of frequencies do.
    ring = np.sqrt(radius2 * np.float32((_RINGS / np.pi) ** 2 / 2)).astype(np.int32).ravel()
    count = np.maximum(np.bincount(ring), 1e-9)
    signal = np.bincount(ring, (power - np.float32(noise)).ravel() * radius2.ravel())
    mean_radius2 = np.bincount(ring, radius2.ravel()) / count
    low = mean_radius2 < _LOW
    level = max(float(signal[low].sum() / count[low].sum()), _LEAST)
    for _ in range(_ROUNDS):
        gain = level / (level + noise * mean_radius2)
        level = max(float(np.sum(signal * gain**2) / np.sum(count * gain**2)), _LEAST)
    # Towards white noise (no signal) every frequency should count alike, hence the gain and not the filter itself.
    return np.asarray(level / (level + noise * radius2), np.float32)


_AS_FOUND, _AT_BEST, _OF_SPECTRA, _MOST_OF_SPECTRA = 0.5, 1.5, 0.6, 1.5
"""How mean spectra's log likelihood counts at the shift found and at the likeliest shift, log odds per nat of their sum
where its jackknife error is below a nat, and how many nats count at most: patterns pass for ghosts, and are sure of it.
The last two, and the next, by logistic regression on 192 flat random windows of which the search left the axis open
(`studies.random_windows`, training photographs, even seeds to 5400; ten parts left out in turn: right in 168)."""
_OF_SCORE, _OF_TILES = 0.3, 0.4
"""Log odds per noise level of the search's own score, and per standard error by which single tiles are likelier."""
# Noise levels by which scores differ where the search is not mistaken: so it was in all of these scenes.
_SETTLED = 2.0
_BEYOND_DOUBT, _CONTRADICTED = 4.0, 2.0
"""Noise levels from which on nothing else is asked, and log odds for the other pane by which a score of fewer is
overruled. In strong noise a grazing pane with ghosts that are none may score 2 to 3 levels better (7 of 16 seeds of one
scene at 68 degrees and 1.5 %, log odds 2.4 to 2.7 for the right one, in silence); of flat random windows
(`studies.random_windows`, training photographs, even seeds from 700000) the odds contradict no score beyond 2."""
_OF_CELLS_SCORE, _MOST_OF_CELLS_SCORE, _OF_SAMPLED_TILES, _OF_AREA = 0.33, 5.0, 0.55, 1.84
"""The same of a mosaic: log odds per noise level of the score of its cells, which counts up to so many levels, per
standard error by which tiles of samples are likelier, and how many times the projected area counts. Cells alias, and
more is mistaken in them than by noise: scores of 5 to 70 levels exchanged the layers of 8 of 170 random mosaics, of
panes at 13 to 30 degrees that passed for grazing ones. By logistic regression on the 96 of these (training photographs,
numbers from 200) whose axis was open: 89 are told rightly, each left out in turn 88, where a score of 4 levels settled
it 82. Of 100 others (numbers from 600 and 1000) 92 are right instead of 87."""
_OF_SIDE = 0.3
"""The same of a mosaic per standard error by which tiles are likelier with a pane's ghosts, of which they are sure, on
their side than on the other: what passes for ghosts lies on neither. Of 183 random mosaics whose axis was open
(`studies.random_windows --sensor mono`, even seeds from 9600000 and 9610000) 169 are told rightly, without it 167, and
of those told wrongly five are not in doubt, without it seven; by 0.5 likelihood is greater, and two more are wrong."""
_OWN_OPPOSITE, _OF_CELLS_OPPOSITE, _TOLD_THERE = 0.05, 0.1, 0.5
"""How far from 1 what a pane mirrors along and across may add up to, of photographs and of a mosaic's cells, and what
log odds count there: at 78.9 degrees of window glass a pane across with its layers exchanged is the same pane, and
chance alone tells the two apart. Of 60 panes in place at 76.5 to 81.5 degrees (training photographs, noise 0.05 to
1.5 %, an engine of its own) 5 are found across, all at incidences of this range, at which 8 of 17 others are told
surely; of 14 random mosaics whose panes both are of the wider one (`studies.random_windows --sensor mono`, even seeds
from 100000 to 140700) 6 are, where the odds made expect 3."""
_HARDLY = 0.1
"""Chance of the other pane up to which the likelier one is taken, whatever noise covers in a pixel: coarse light shows
beneath it. Set by hand; of three mosaics at noises of 1.3 to 2.3 % the transmission gains 1 to 5 dB by it."""
NOTABLE_CHANCE = 0.2
"""Chance of the other pane from which on the axis is in doubt, set by hand: of those windows 28 of the 170 that are
right are in doubt, and 14 of the 22 that are not."""
NOTABLE_CHANCE_OF_MOSAIC = 0.1
"""The same before a polarization camera, whose cells are surer than they should be: of 260 random mosaics of a pane
beyond 40 degrees (`studies.random_windows --sensor mono`, even seeds from 310000 and 400000, photographs that nothing
was tuned on) the layers were exchanged in 8 of the 19 whose chance is 0.1 to 0.2, and in 1 in 100 below 0.05. Of 110
others whose axis was open (even seeds 9943000 to 9943710) 2 of the 83 below 0.1 are, 1 of 9 to 0.2, and 7 of 18 above,
where the odds made expect 1.3, 1.2 and 6.4."""


@dataclass(frozen=True)
class AxisCandidate:
    """One of two panes across each other.

    Attributes
    ----------
    evidence : Evidence
        What the search reads of the capture along this pane.
    trial : Trial
        The best one.
    least_misfit : float
        Of the spectra at its incidence, over all shifts.
    tile_fit : callable
        How likely single tiles are of it: asked for where the search leaves it open.
    sure_of_side : callable
        Standard errors by which tiles of a mosaic find it likelier than with its ghosts on the other side.
    """

    evidence: Evidence
    trial: Trial
    least_misfit: float
    tile_fit: Callable[[], TileFit]
    sure_of_side: Callable[[TileFit], float] = lambda _: 0.0


@dataclass(frozen=True)
class AxisChoice:
    """Which of two panes to take.

    Attributes
    ----------
    best : int
        0 or 1: the one that is expected to gain more over the plain intensity.
    chance : float
        That the other one is the right one; 0 where it is settled.
    gain_db : float
        What the transmission is expected to gain over the plain intensity; infinite where it is hardly in doubt.
    """

    best: int
    chance: float = 0.0
    gain_db: float = math.inf


def choose_axis(
    panes: tuple[AxisCandidate, AxisCandidate],
    scene: SceneParameters,
    noise: float,
    polarized_db: float,
    *,
    aliased: bool = False,
) -> AxisChoice:
    """Weigh what the transmission gains where a pane is right with what it loses where the other one is.

    Both take a multiple of the polarized light off the intensity, c_0 and c_1 in opposite directions (all bounces in
    place). If pane 1 is right the plain intensity is c_1 off, and the transmission of pane 0 is c_0 + c_1 off; if pane
    0 is right its transmission has but the noise of the polarized light. What counts is the mean of decibels.

    Parameters
    ----------
    panes : (AxisCandidate, AxisCandidate)
        The best trial at an azimuth and at the one across.
    scene : SceneParameters
        Index and surfaces of the pane.
    noise : float
        Standard deviation of the noise of one photograph.
    polarized_db : float
        Polarized light over its noise, in a pixel.
    aliased : bool
        Whether they are of a mosaic's cells, and single tiles of its samples.
    """
    score = (panes[1].trial.score - panes[0].trial.score) / noise
    settled = abs(score) > _SETTLED and not aliased
    by_score = 0 if score > 0 else 1
    if settled and abs(score) > _BEYOND_DOUBT:
        return AxisChoice(by_score)
    odds = log_odds(panes, scene, noise, aliased=aliased)
    within = _OF_CELLS_OPPOSITE if aliased else _OWN_OPPOSITE
    if all(_is_its_own_opposite(pane, scene, within) for pane in panes):
        odds *= _TOLD_THERE
    if settled and (odds if by_score else -odds) < _CONTRADICTED:
        return AxisChoice(by_score)
    chance = 1 / (1 + math.exp(odds))
    if min(chance, 1 - chance) < _HARDLY:
        return AxisChoice(int(chance > 0.5), min(chance, 1 - chance))
    first, second = (in_place_correction(_incidence(pane), scene.index, *scene.sheets) for pane in panes)
    choices = []
    for best, (wrong, ratio) in enumerate(((chance, first / second), (1 - chance, second / first))):
        gain_db = (1 - wrong) * polarized_db - wrong * 20 * math.log10(1 + ratio)
        choices.append(AxisChoice(best, wrong, gain_db))
    return max(choices, key=lambda choice: choice.gain_db)


def log_odds(
    panes: tuple[AxisCandidate, AxisCandidate], scene: SceneParameters, noise: float, *, aliased: bool = False
) -> float:
    """Natural logarithm of how much likelier the first pane is; parameters as for `choose_axis`.

    From the likelihood of the spectra, less trusted the more it differs between parts of the frame; from that of single
    tiles, in standard errors; from the search's score, which noise biases; and from how often panes are seen at such an
    incidence: those of random directions show a projected area that goes with the sine of twice the incidence. Of a
    mosaic from how surely its tiles tell the side of ghosts in place of the spectra.
    """
    score = (panes[1].trial.score - panes[0].trial.score) / noise
    fits = [pane.tile_fit() for pane in panes]
    sigmas = fits[0].surer_than(fits[1])
    area = [math.sin(2 * math.radians(_incidence(pane))) for pane in panes]
    of_area = math.log(area[0] / area[1])
    if aliased:
        score = max(-_MOST_OF_CELLS_SCORE, min(score, _MOST_OF_CELLS_SCORE))
        first, second = (max(pane.sure_of_side(fit), 0.0) for pane, fit in zip(panes, fits, strict=True))
        by_tiles = _OF_SAMPLED_TILES * sigmas + _OF_SIDE * (first - second)
        return float(_OF_CELLS_SCORE * score + by_tiles + _OF_AREA * of_area)
    return float(_of_spectra(panes, scene) + _OF_SCORE * score + _OF_TILES * sigmas + of_area)


def _of_spectra(panes: tuple[AxisCandidate, AxisCandidate], scene: SceneParameters) -> float:
    """Log odds by mean spectra, at the shifts found and at the likeliest."""
    n = float(panes[0].evidence.spectra.multiplicity.sum())
    gain, error = _likelier(panes, scene)
    likelier = _AS_FOUND * gain + _AT_BEST * (panes[1].least_misfit - panes[0].least_misfit)
    return float(_OF_SPECTRA * np.clip(n * likelier / math.hypot(1, n * error), -_MOST_OF_SPECTRA, _MOST_OF_SPECTRA))


def _is_its_own_opposite(pane: AxisCandidate, scene: SceneParameters, within: float) -> bool:
    """Whether a pane across with its layers exchanged is about the same pane."""
    mirrored = in_place_reflectance(_incidence(pane), scene.index, scene.single_surface)
    return abs(sum(mirrored) - 1) < within


def _incidence(pane: AxisCandidate) -> float:
    lowest, highest = INCIDENCE_LIMITS_DEG
    return min(max(pane.trial.incidence_deg, lowest), highest)


def _likelier(panes: tuple[AxisCandidate, AxisCandidate], scene: SceneParameters) -> tuple[float, float]:
    """Log likelihood per frequency by which the first pane is the likelier, at the shifts found, and its error."""

    def misfit(pane: AxisCandidate, spectra: CrossSpectra) -> float:
        trial = pane.trial
        return float(ShiftLikelihood(spectra, scene).misfit(trial.incidence_deg, [trial.ghost_shift])[0])

    first, second = panes
    gain = misfit(second, second.evidence.spectra) - misfit(first, first.evidence.spectra)
    parts = zip(first.evidence.spectra.left_out, second.evidence.spectra.left_out, strict=True)
    gains = np.array([misfit(second, b) - misfit(first, a) for a, b in parts])
    return gain, jackknife_error(gains) if gains.size else 0.0
