"""Standard errors of a scene's numbers, by leaving parts of the frame out.

A jackknife over parts tells how far natural layers' accidental likeness moves the incidence, and their patterns the
ghost shift; both are far larger than what the noise does.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from polaropt.estimation.flat.ghosts import CrossSpectra, ShiftLikelihood
from polaropt.estimation.flat.overlap import BlockImages, EdgeOverlap
from polaropt.numerics import jackknife_error, local_minimum, minimum_error
from polaropt.optics import INCIDENCE_LIMITS_DEG, INCIDENCE_SEARCH_DEG, SceneParameters, in_place_weights

Values = NDArray[np.float64]

# Between the three points of a parabola around the estimate. By trial.
_STEP_DEG, _STEP_PX = 1.5, 0.25
# Below this incidence polarization is so faint that noise moves the least overlap.
_NOISY_DEG = 25.0
# What moves in proportion to the noise's standard deviation moves by so much less when its variance doubles.
_EXTRAPOLATED = 1 / (math.sqrt(2) - 1)
_OF_CELLS = 0.5
"""Share of what noise then moves that is believed of a mosaic's cells: what aliases in them counts as noise, which is
told twice, see `registered_noise`."""
_TOLERANCE_DEG = 0.2
# Measured on 120 scenes of photographs that no figure is taken of: without these, 85 and 76 % of the true values lie
# within two errors. Ghosts are told by spectra, whose model is nearly a tenth of a pixel off.
_WIDER, _LEAST_DEG = 1.3, 0.15
_SHIFT_WIDER, _LEAST_PX = 1.15, 0.08
# Radii and directions into which layers' spectra are split, and rounds in which they are fitted, where they tell the
# incidence: with fewer it is up to five degrees off towards normal incidence, where ghosts lie in place. By trial.
INCIDENCE_DETAIL, INCIDENCE_ROUNDS = (5, 4), 8
# First step of that search, and how far from the incidence of the edges it goes. By trial, and set by hand.
_COARSE_DEG, _FARTHEST_DEG = 2.0, 12.0
# Standard error in degrees that a jackknife of it does not see: spectra are not quite of the shape that they are taken
# to have. With what the ladder adds to that of the edges 95 % of 137 random windows to fit on lie within two errors of
# both together (`studies.random_windows`, even seeds to 798), with 0.3 and edges as they are 90 %.
_SHAPES_DEG = 0.4
# Standard error in degrees below which no incidence is believed to be known. Set by hand.
_SUREST_DEG = 0.05
# Standard error in degrees of an incidence that is unknown. Set by hand.
_UNKNOWN_DEG = 90.0
# Standard errors by which one shift must explain the spectra better than another to be told from it.
_SURE = 2.0


def incidence_error(
    overlap_of: Callable[[BlockImages], EdgeOverlap], blocks: BlockImages, incidence_deg: float
) -> float:
    """Standard error in degrees of the incidence at which an overlap is least.

    Parameters
    ----------
    overlap_of : callable
        From block images to their overlap.
    blocks : BlockImages
        Of the capture.
    incidence_deg : float
        Where their overlap is least.
    """
    step = min(_STEP_DEG, (INCIDENCE_LIMITS_DEG[1] - incidence_deg) / 2, incidence_deg / 2)
    overlaps = overlap_of(blocks).left_out
    error = minimum_error([overlaps(incidence_deg + shift) for shift in (-step, 0.0, step)], step)
    if incidence_deg >= _NOISY_DEG:
        return widened_incidence(error)
    of_noise = _noise_bias(overlap_of, blocks, incidence_deg) * (_OF_CELLS if blocks.aliased else 1.0)
    return math.hypot(widened_incidence(error), of_noise)


def _noise_bias(overlap_of: Callable[[BlockImages], EdgeOverlap], blocks: BlockImages, incidence_deg: float) -> float:
    """How far the noise has moved the incidence of least overlap, by how far as much noise again moves it.

    See Cook and Stefanski, Simulation-extrapolation estimation in parametric measurement error models (1994).
    """
    minima = [
        local_minimum(overlap_of(noisier).joint, incidence_deg, INCIDENCE_SEARCH_DEG, _STEP_DEG, _TOLERANCE_DEG)
        for noisier in blocks.noisier()
    ]
    return _EXTRAPOLATED * math.sqrt(np.mean(np.square(np.array(minima) - incidence_deg)))


def widened_incidence(error_deg: float) -> float:
    """A jackknife's error in degrees with what it misses: parts are few and alike, and searches stop a little short."""
    return math.hypot(_WIDER * error_deg, _LEAST_DEG)


def weighted_incidence(first: tuple[float, float], second: tuple[float, float]) -> tuple[float, float]:
    """Mean of two incidences in degrees as of `weighted_mean`, neither of which is believed to be exact."""
    return weighted_mean(first, second, _SUREST_DEG)


def weighted_mean(first: tuple[float, float], second: tuple[float, float], surest: float) -> tuple[float, float]:
    """Mean of two values, weighted by their standard errors, and its own, wider where they contradict.

    Parameters
    ----------
    first, second : (float, float)
        A value and its standard error, independent of each other.
    surest : float
        Standard error below which none is believed.

    Notes
    -----
    Errors that two values contradict are too small, both by the ratio of Birge (The calculation of errors by the method
    of least squares, 1932).
    """
    values, errors = zip(first, second, strict=True)
    information = [1 / max(error, surest) ** 2 for error in errors]
    mean = sum(value * weight for value, weight in zip(values, information, strict=True)) / sum(information)
    contradiction = abs(values[0] - values[1]) / math.hypot(*errors)
    return mean, max(1.0, contradiction) / math.sqrt(sum(information))


class IncidenceLikelihood:
    """Likelihood of incidences given mean spectra, for one ghost shift in pixels, with spectra of much detail.

    Parameters
    ----------
    spectra : CrossSpectra
    scene : SceneParameters
        Index and surfaces of the pane.
    ghost_shift : float
    """

    def __init__(self, spectra: CrossSpectra, scene: SceneParameters, ghost_shift: float) -> None:
        self._likelihood = ShiftLikelihood(spectra, scene, INCIDENCE_DETAIL)
        self._shifts = [ghost_shift]

    def misfit(self, incidences_deg: Values) -> Values:
        """Minus log likelihood per frequency of some incidences, up to a constant."""
        return np.asarray(self._likelihood.misfit(incidences_deg, self._shifts, INCIDENCE_ROUNDS)[:, 0])

    def at(self, incidence_deg: float) -> float:
        """The same of one."""
        return float(self.misfit(np.array([incidence_deg]))[0])


def spectral_incidence(spectra: CrossSpectra, scene: SceneParameters) -> tuple[float, float] | None:
    """The incidence near that of a complete scene at which the spectra are likeliest, and its standard error.

    How bright ghosts are tells it, and what both polarizations have in common; edges that both layers share do not
    mislead it, as they do their overlap. None where no incidence near is likelier than those beside it.
    """
    start, _, shift = scene.values()
    low, high = INCIDENCE_SEARCH_DEG
    bounds = (max(low, start - _FARTHEST_DEG), min(high, start + _FARTHEST_DEG))
    likelihood = IncidenceLikelihood(spectra, scene, shift)
    best = local_minimum(likelihood.at, start, bounds, _COARSE_DEG, _TOLERANCE_DEG)
    step = min(_COARSE_DEG, best / 2, (INCIDENCE_LIMITS_DEG[1] - best) / 2)
    around = best + step * np.arange(-1.0, 2.0)
    rest = [IncidenceLikelihood(part, scene, shift).misfit(around) for part in spectra.left_out]
    if not rest:
        return None
    before, here, after = np.array(rest).T
    if here.mean() >= min(before.mean(), after.mean()):
        return None
    return best, math.hypot(widened_incidence(minimum_error([before, here, after], step)), _SHAPES_DEG)


def polarized_share(stokes: NDArray[np.floating[Any]]) -> float:
    """Share of the light that is polarized, root mean squares of Stokes components (3, ...); 0 without any light."""
    light, *polarized = np.square(stokes, dtype=np.float64).mean(axis=tuple(range(1, stokes.ndim)))
    return math.sqrt(float(sum(polarized) / light)) if light > 0 else 0.0


def errors_of_gains(apart: float, polarized_share: float, scene: SceneParameters) -> tuple[float, float]:
    """Standard errors of incidence and azimuth, in degrees, that follow from photographs that do not add up.

    Gains that differ by sigma leave sigma / 2 of the light where four photographs do not add up, and sigma / sqrt(2) in
    either coordinate of what is polarized: across the plane of incidence it turns the azimuth, along it the pane seems
    to polarize so much more.

    Parameters
    ----------
    apart : float
        Share of the light by which the photographs do not add up.
    polarized_share : float
        Share of the light that is polarized.
    scene : SceneParameters
        Complete; its pane is taken as flat, with all bounces in place.
    """
    if not apart:
        return 0.0, 0.0
    polarized = math.sqrt(2) * apart
    azimuth = math.degrees(0.5 * math.atan2(polarized, polarized_share))
    incidence = scene.values()[0]
    near = np.clip(incidence + _STEP_DEG * np.array([-1.0, 1.0]), *INCIDENCE_LIMITS_DEG)
    (par, perp, _), _ = in_place_weights(np.cos(np.radians(near)), scene.index, *scene.sheets)
    below, above = (par - perp) / (par + perp)
    slope = abs(above - below) / (near[1] - near[0])
    return min(_UNKNOWN_DEG, float(polarized / max(slope, polarized / _UNKNOWN_DEG))), azimuth


def widened_shift(error_px: float) -> float:
    """The same of a ghost shift in pixels: ghosts are told by spectra, whose model is nearly a tenth of a pixel off."""
    return math.hypot(_SHIFT_WIDER * error_px, _LEAST_PX)


@dataclass(frozen=True)
class ShiftErrors:
    """Standard errors in pixels of the ghost shifts of a scene.

    Attributes
    ----------
    ghost_shift : float or None
        None where there are no ghosts to see.
    transmission_ghost_shift : float or None
        None where the transmission has none of its own.
    of_side : float or None
        That of `ghost_shift` once it is known on which side the ghosts lie.
    """

    ghost_shift: float | None = None
    transmission_ghost_shift: float | None = None
    of_side: float | None = None


def shift_errors(spectra: CrossSpectra, scene: SceneParameters, rivals: Sequence[float] = ()) -> ShiftErrors:
    """Standard errors of both ghost shifts of a complete scene.

    Parameters
    ----------
    spectra : CrossSpectra
    scene : SceneParameters
    rivals : sequence of float
        Other shifts that explain the spectra nearly as well: two standard errors reach to those that cannot be told
        from the one found.
    """
    incidence, _, shift = scene.values()
    own = scene.transmission_ghost_shift
    likelihoods = [ShiftLikelihood(part, scene) for part in spectra.left_out]
    around = _STEP_PX * np.arange(-1.0, 2.0)

    def misfits(shifts: Values, of_transmission: Values | None) -> Values:
        others = None if of_transmission is None else np.resize(of_transmission, shifts.size)
        return np.array([likelihood.misfit(incidence, shifts, 4, others) for likelihood in likelihoods])

    if own is not None:
        of_both = misfits(shift + around, np.full(3, own)), misfits(np.full(3, shift), own + around)
        return ShiftErrors(*(_error(part, np.zeros(0)) for part in of_both))
    rest = np.array(rivals, dtype=np.float64)
    here = rest * shift > 0
    rows = misfits(np.concatenate([shift + around, rest]), None)
    kept = np.concatenate([np.ones(around.size, dtype=bool), here])
    distances = np.abs(rest - shift)
    return ShiftErrors(_error(rows, distances), of_side=_error(rows[:, kept] if rows.size else rows, distances[here]))


def _error(misfits: Values, distances: Values) -> float:
    """From misfits (part, trial): three around the shift found, then those of its rivals, at a distance from it."""
    if not misfits.size:
        return math.inf
    near = minimum_error(list(misfits[:, :3].T), _STEP_PX)
    worse = misfits[:, 3:] - misfits[:, :3].min(axis=1, keepdims=True)
    open_rivals = [
        float(distance) / _SURE
        for distance, gap in zip(distances, worse.T, strict=True)
        if gap.mean() < _SURE * jackknife_error(gap)
    ]
    return max([widened_shift(near), *open_rivals])
