"""Blind scene estimation: from a capture to incidence, azimuth and ghost shift.

The azimuth is the axis of the polarized light, and of the two such axes the one that leaves the likelier, less alike
layers. Given the azimuth, incidence (edge independence) and ghost shift (spectral likelihood) are found in turns until
both rest.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Literal

import numpy as np

from polaropt.capture import Capture, PlateFrame, StokesImages, noise_level, plate_frame, stokes_images
from polaropt.errors import InputError
from polaropt.estimation.flat.azimuth import AxisCandidate, AxisChoice, choose_axis, principal_axis
from polaropt.estimation.flat.errors import ShiftErrors, widened_incidence
from polaropt.estimation.flat.ghost_overlap import STRONG_GHOSTS_DEG, refined_incidence
from polaropt.estimation.flat.ghosts import LEAST_SHIFT_PX
from polaropt.estimation.flat.samples.single import FARTHEST_PX, REACH_PX, likeliest_panes
from polaropt.estimation.flat.samples.tiles import SampledTileLikelihood, SampledTiles
from polaropt.estimation.flat.search import INCIDENCE_GRID_DEG, Curve, Evidence, SceneSearch, Thickness, Trial, evidence
from polaropt.estimation.flat.windows.likelihood import Window
from polaropt.estimation.flat.windows.tiles import TileFit, tile_likelihood
from polaropt.optics import FARTHEST_SHIFT_PX, INCIDENCE_LIMITS_DEG, Rival, SceneErrors, SceneParameters

_POLARIZED_SNR = 10.0
"""Standard errors of what noise alone would leave that polarized light must have to be believed. Set by hand."""
LEAST_NOISE = 1e-4
"""Standard deviation of a photograph's noise (white = 1) below which the model itself is not exact. Set by hand."""
LEAST_INDEX = 1.0001
"""Below it a pane mirrors less than 3e-9 of the light at normal incidence, which no photograph shows. Set by hand."""
_SURE_OF_GHOSTS = 2.5
"""Standard errors by which tiles of a mosaic must find ghosts likelier than none for their side to speak for an axis:
of 183 random mosaics (see `_OF_SIDE` of the axis) 169 are told rightly so, 168 where the side of any speaks."""
_CLOSE = 0.06
"""Axes whose scores differ by less are compared again after the search. By trial."""
_GRAZING_DEG = 80.0
"""Incidence beyond which a pane that a mosaic's cells like best is compared again whatever its score: detail that
aliases in cells without noise passes for one (`_OF_CELLS_SCORE` of the axis counts no score beyond five noise levels).
Set by hand; of 117 mosaics of an engine of its own 5 such panes were right and stay, one at 51 degrees of another set
was taken for one at 84, its layers exchanged, in silence."""
_LEAST_OVERLAP = 1e-9
_DIFFERENCE = np.array([1.0, -1.0])
"""Of what is seen along and across the plane of incidence."""
_LIGHT_BLOCK = 2
"""Side in pixels of the blocks whose mean light is compared with the noise. Set by hand."""


@dataclass(frozen=True)
class SceneEstimate:
    """A complete scene and the evidence it rests on.

    Attributes
    ----------
    scene : SceneParameters
        Complete: what was given stays, the rest is estimated.
    polarization_snr : float
        Polarized light found, in standard errors of what noise alone would leave.
    errors : SceneErrors
        Standard errors of what was estimated.
    polarized : bool
        Whether there is polarization at all; without, incidence, azimuth and shift mean nothing.
    axis_margin : float
        How much better this azimuth explains the capture than the one across it (log likelihood per frequency and
        weighted edge overlap); infinite where the azimuth was given.
    axis_chance : float
        Chance that the pane lies across, 0 where that is settled; see `AxisChoice`.
    axis_gain_db : float
        What the transmission is expected to gain over the plain intensity for that chance; infinite where the axis is
        settled, below 0 the intensity is the better guess.
    incidence_margin : float
        Depth of the overlap's minimum below its typical value, 0..1.
    incidence_grid_deg, overlap : ndarray
        Edge overlap of the layers over trial incidences.
    shift_grid, shift_misfit : ndarray
        Minus log likelihood over trial ghost shifts, less its minimum.
    rivals : tuple of Rival
        Other scenes that explain the capture about as well; the errors do not reach them.
    shift_error_of_side : float or None
        Standard error of the ghost shift once it is known on which side the ghosts lie, in pixels.
    doubtful_shift : bool
        Whether the photographs speak against the ghost shift that was given.
    """

    scene: SceneParameters
    polarization_snr: float
    errors: SceneErrors
    polarized: bool
    axis_margin: float
    axis_chance: float
    axis_gain_db: float
    incidence_margin: float
    incidence_grid_deg: Curve
    overlap: Curve
    shift_grid: Curve
    shift_misfit: Curve
    rivals: tuple[Rival, ...] = ()
    shift_error_of_side: float | None = None
    doubtful_shift: bool = False

    def scaled(self, factor: float) -> SceneEstimate:
        """The same of photographs with so many times the pixels a side."""
        grid = factor * self.shift_grid
        rivals = tuple(rival.scaled(factor) for rival in self.rivals)
        scene, errors = self.scene.scaled(factor), self.errors.scaled(factor)
        of_side = None if self.shift_error_of_side is None else factor * self.shift_error_of_side
        return replace(self, scene=scene, errors=errors, shift_grid=grid, rivals=rivals, shift_error_of_side=of_side)

    @property
    def better_left(self) -> bool:
        """Whether the plain intensity is the better guess of the transmission, as the pane may lie across."""
        return self.axis_gain_db < 0


def estimate_scene(
    capture: Capture,
    scene: SceneParameters = SceneParameters(None, None, None),  # noqa: B008 (frozen)
    *,
    noise: float | None = None,
    thickness_px: float | None = None,
    thickness_kind: Literal["paper", "plate"] = "paper",
    mosaic: SampledTiles | None = None,
) -> SceneEstimate:
    """Estimate what a scene leaves open.

    Parameters
    ----------
    capture : Capture
    scene : SceneParameters
        Fields that are None are estimated, all others stay as they are. The index is a number (see `with_index`).
    noise : float, optional
        Standard deviation of the noise of one photograph. Default: measured.
    thickness_px : float, optional
        Thickness of the pane in pixels; ties the ghost shift to the incidence (its sense stays open).
    thickness_kind : {"paper", "plate"}
        Formula of the ghost step, see `ghost_step`.
    mosaic : SampledTiles, optional
        Tiles of the mosaic whose cells the capture is: they have a say in which of two azimuths it is.

    Returns
    -------
    SceneEstimate

    Raises
    ------
    InputError
        A pane that mirrors nothing, as its index is that of air, or a thickness outside its range.
    """
    if scene.index < LEAST_INDEX:
        raise InputError(f"a pane of index {scene.index:g} mirrors nothing; give {LEAST_INDEX:g} or more")
    if thickness_px is not None and not 0 <= thickness_px <= FARTHEST_SHIFT_PX:
        raise InputError(f"the thickness is {thickness_px} px; it must lie between 0 and {FARTHEST_SHIFT_PX:g}")
    scene = scene.plainest
    noise = max(LEAST_NOISE, noise_level(capture) if noise is None else noise)
    stokes = stokes_images(capture, noise)
    axis = principal_axis(stokes)
    frame = plate_frame(stokes, axis.azimuth_deg if scene.azimuth_deg is None else scene.azimuth_deg)
    thickness = None if thickness_px is None else Thickness(thickness_px, thickness_kind)
    taken = _choose_axis(frame, scene, thickness, noise, mosaic)
    frame, search, trial = taken.frame, taken.search, taken.trial
    # Of a mosaic's cells the low pass shapes the spectra.
    told = axis.snr > _POLARIZED_SNR and not stokes.aliased
    trial, far = search.best_of_far(trial) if told else (trial, [])
    found = _completed(scene, frame.azimuth_deg, trial)
    errors, of_shifts = SceneErrors(), ShiftErrors()
    if axis.snr > _POLARIZED_SNR:
        own = search.with_own_shifts(frame, found)
        # How far apart a mosaic's double images lie is for its tiles to tell, as far as these reach.
        found = own if mosaic is None or abs(own.values()[2]) * mosaic.period > REACH_PX else found
        found, error = _refined(frame, scene, found, thickness)
        of_shifts = search.shift_errors(found) if scene.ghost_shift is None else of_shifts
        errors = _errors(search, (scene, trial), (error, axis.error_deg), of_shifts)
        if thickness is not None:
            errors = _tied(errors, found, thickness)
    overlap = search.curve(trial)
    shift_grid, shift_misfit = search.shift_curve(trial)
    return SceneEstimate(
        scene=found,
        polarization_snr=axis.snr,
        errors=errors,
        polarized=axis.snr > _POLARIZED_SNR,
        axis_margin=taken.margin,
        axis_chance=taken.choice.chance,
        axis_gain_db=taken.choice.gain_db,
        incidence_margin=float(1 - overlap.min() / max(float(np.median(overlap)), _LEAST_OVERLAP)),
        incidence_grid_deg=INCIDENCE_GRID_DEG,
        overlap=overlap,
        shift_grid=shift_grid,
        shift_misfit=shift_misfit - shift_misfit.min(),
        rivals=tuple(Rival(_completed(scene, frame.azimuth_deg, other), chance) for other, chance in far),
        shift_error_of_side=of_shifts.of_side,
    )


def with_shift_checked(estimate: SceneEstimate, stokes: StokesImages, asked: SceneParameters) -> SceneEstimate:
    """The same, with whether the spectra speak against a ghost shift that was given, on either side.

    Parameters
    ----------
    estimate : SceneEstimate
        Of photographs; a mosaic's cells show no double images as they are.
    stokes : StokesImages
    asked : SceneParameters
        Of a single pane with one ghost shift for both layers; what else there is has other spectra.
    """
    told = asked.ghost_shift
    if told is None or asked.transmission_ghost_shift is not None or asked.stacked or asked.single_surface:
        return estimate
    incidence, azimuth, _ = estimate.scene.values()
    search = SceneSearch(evidence(plate_frame(stokes, azimuth)), estimate.scene.replace(ghost_shift=None), None)
    return replace(estimate, doubtful_shift=search.speaks_against(Trial(incidence, told, 0.0)))


def shift_by_spectra(stokes: StokesImages, scene: SceneParameters) -> float:
    """The ghost shift of a scene, on the side on which the spectra of photographs have it.

    Parameters
    ----------
    stokes : StokesImages
    scene : SceneParameters
        Complete, of a single pane.
    """
    incidence, azimuth, shift = scene.values()
    search = SceneSearch(evidence(plate_frame(stokes, azimuth)), scene.replace(ghost_shift=None), None)
    here, across = np.interp([shift, -shift], *search.shift_curve(Trial(incidence, shift, 0.0)))
    return shift if here <= across else -shift


@dataclass(frozen=True)
class _Taken:
    """The frame at the azimuth taken, its search and best trial; margin as in `SceneEstimate`."""

    frame: PlateFrame
    search: SceneSearch
    trial: Trial
    margin: float
    choice: AxisChoice


def _choose_axis(
    frame: PlateFrame, scene: SceneParameters, thickness: Thickness | None, noise: float, mosaic: SampledTiles | None
) -> _Taken:
    """At the given azimuth, or at that one of two which explains the capture better, or is safer where both do."""
    seen = evidence(frame)
    frames, seens = [frame, frame.across()], [seen, seen.across()]
    if scene.azimuth_deg is not None:
        frames, seens = frames[:1], seens[:1]
    searches = [SceneSearch(part, scene, thickness) for part in seens]
    trials = [search.first() for search in searches]
    margin = _margin(trials)
    best = 0 if margin >= 0 else 1
    if _is_settled(margin, trials[best], of_mosaic=mosaic is not None):
        trial = searches[best].improved(trials[best])
        return _Taken(frames[best], searches[best], trial, abs(margin), AxisChoice(best))
    trials = [search.improved(trial) for search, trial in zip(searches, trials, strict=True)]
    panes = [_candidate(*parts, scene, mosaic) for parts in zip(frames, seens, searches, trials, strict=True)]
    choice = choose_axis((panes[0], panes[1]), scene, noise, _polarized_db(frame), aliased=mosaic is not None)
    best = choice.best
    return _Taken(frames[best], searches[best], trials[best], _margin(trials) * (1 - 2 * best), choice)


def _candidate(
    frame: PlateFrame,
    seen: Evidence,
    search: SceneSearch,
    trial: Trial,
    scene: SceneParameters,
    mosaic: SampledTiles | None,
) -> AxisCandidate:
    """The best pane of an azimuth, with what is asked where the search leaves the axis open."""
    least = float(search.shift_curve(trial)[1].min())
    if mosaic is not None:
        return AxisCandidate(seen, trial, least, *_asked_of_samples(mosaic, frame.azimuth_deg, trial, scene))
    return AxisCandidate(seen, trial, least, partial(_tile_fit, frame, _windows(search, trial, scene), scene))


def _is_settled(margin: float, best: Trial, *, of_mosaic: bool) -> bool:
    """Whether first trials tell the axis by their scores' margin; an axis that is given has an infinite one."""
    doubtful = of_mosaic and math.isfinite(margin) and best.incidence_deg > _GRAZING_DEG
    return abs(margin) >= _CLOSE and not doubtful


def _polarized_db(frame: PlateFrame) -> float:
    """Light polarized along the azimuth or across over its noise, in a pixel."""
    noise = float(_DIFFERENCE @ frame.covariance @ _DIFFERENCE)
    difference = np.einsum("i,ichw->chw", _DIFFERENCE, frame.means(_LIGHT_BLOCK))
    light = float(np.vdot(difference, difference)) / difference.size - noise / _LIGHT_BLOCK**2
    return 10 * math.log10(max(light / noise, 1.0))


def _windows(search: SceneSearch, trial: Trial, scene: SceneParameters) -> list[Window]:
    """A trial's pane with its double images, with those that the spectra like best, and in place."""
    shifts = [trial.ghost_shift]
    if scene.ghost_shift is None and not scene.single_surface:
        grid, misfit = search.shift_curve(trial)
        shifts += [float(grid[np.argmin(misfit)]), 0.0]
    return [Window(trial.incidence_deg, shift) for shift in dict.fromkeys(shifts)]


def _tile_fit(frame: PlateFrame, windows: Sequence[Window], scene: SceneParameters) -> TileFit:
    """How likely tiles are under the likeliest of some panes, at the best incidence near it where that is open."""
    free = ("incidence_deg",) if scene.incidence_deg is None else ()
    tiles = tile_likelihood(frame)
    glance = tiles.luminance()
    likeliest = min(windows, key=lambda window: glance.nearest(window, scene.index, free).misfit)
    return tiles.nearest(likeliest, scene.index, free)


def _asked_of_samples(
    mosaic: SampledTiles, azimuth_deg: float, trial: Trial, scene: SceneParameters
) -> tuple[Callable[[], TileFit], Callable[[TileFit], float]]:
    """How likely tiles of a mosaic are under the likeliest pane near a trial's, and how sure of its ghosts' side.

    The trial is in pixels of the cells.
    """
    likelihood, told = SampledTileLikelihood(mosaic, azimuth_deg), scene.ghost_shift
    free = ("incidence_deg",) if scene.incidence_deg is None else ()

    def fitted() -> TileFit:
        if told:
            return likelihood.nearest(Window(trial.incidence_deg, mosaic.period * told), scene.index, free)
        ghosts = told is None and not scene.single_surface
        fits = [likeliest_panes(likelihood, scene, trial.incidence_deg, ghosts=ghosts)[1]]
        far = mosaic.period * trial.ghost_shift
        if ghosts and abs(far) > FARTHEST_PX:
            starts = (Window(trial.incidence_deg, shift) for shift in (far, -far))
            fits += [likelihood.nearest(start, scene.index, (*free, "pane_shift")) for start in starts]
        return min(fits, key=lambda fit: fit.misfit)

    def sure_of_side(fit: TileFit) -> float:
        if abs(fit.window.pane_shift) < LEAST_SHIFT_PX:
            return 0.0
        place = likelihood.nearest(replace(fit.window, pane_shift=0.0), scene.index, free)
        return likelihood.surer_of_side(fit, free) if fit.surer_than(place) > _SURE_OF_GHOSTS else 0.0

    return fitted, sure_of_side


def _margin(trials: list[Trial]) -> float:
    """How much better the first axis is than the second."""
    return math.inf if len(trials) == 1 else trials[1].score - trials[0].score


def _completed(scene: SceneParameters, azimuth_deg: float, trial: Trial) -> SceneParameters:
    """The scene with what it left open; a single surface has no ghosts."""
    shift = scene.ghost_shift
    if shift is None:
        shift = 0.0 if scene.single_surface else trial.ghost_shift
    incidence = trial.incidence_deg if scene.incidence_deg is None else scene.incidence_deg
    return scene.replace(incidence_deg=incidence, azimuth_deg=azimuth_deg, ghost_shift=shift)


def _refined(
    frame: PlateFrame, asked: SceneParameters, found: SceneParameters, thickness: Thickness | None
) -> tuple[SceneParameters, float | None]:
    """The scene with its incidence looked at again, where one was asked for and ghosts are strong, and its error."""
    incidence, _, shift = found.values()
    ghosts = shift != 0 and not found.single_surface and found.n_bounces != 0
    if asked.incidence_deg is not None or incidence < STRONG_GHOSTS_DEG or not ghosts:
        return found, None
    incidence, error = refined_incidence(frame, found)
    found = found.replace(incidence_deg=incidence)
    if thickness is None or asked.ghost_shift is not None:
        return found, error
    step = thickness.step(incidence, found.index)
    return found.replace(ghost_shift=math.copysign(step, shift)), error


def _errors(
    search: SceneSearch,
    scenes: tuple[SceneParameters, Trial],
    errors_deg: tuple[float | None, float],
    of_shifts: ShiftErrors,
) -> SceneErrors:
    """Of what was asked for, from the search's own sums; the incidence's where it was looked at again is known."""
    asked, trial = scenes
    refined_error_deg, azimuth_error_deg = errors_deg
    incidence = None
    if asked.incidence_deg is None:
        incidence = search.incidence_error(trial) if refined_error_deg is None else widened_incidence(refined_error_deg)
    return SceneErrors(
        incidence_deg=incidence,
        azimuth_deg=azimuth_error_deg if asked.azimuth_deg is None else None,
        ghost_shift=of_shifts.ghost_shift,
        transmission_ghost_shift=of_shifts.transmission_ghost_shift,
    )


def _tied(errors: SceneErrors, found: SceneParameters, thickness: Thickness) -> SceneErrors:
    """With the error of a ghost shift that follows from the incidence."""
    if errors.ghost_shift is None or errors.incidence_deg is None:
        return errors
    incidence = found.values()[0]
    near = (max(0.0, incidence - errors.incidence_deg), min(INCIDENCE_LIMITS_DEG[1], incidence + errors.incidence_deg))
    steps = [thickness.step(angle, found.index) for angle in near]
    return replace(errors, ghost_shift=abs(steps[1] - steps[0]) / 2)
