"""Which rung of the ladder a capture needs: the lowest one that leaves no polarized light unexplained.

Unpolarized layers behind a flat pane that is seen from far leave no light polarized at 45 degrees to its plane of
incidence. What there is of it beyond the noise says that a higher rung is needed, and whether one explains it.
"""

from __future__ import annotations

import dataclasses
import math
import time
from dataclasses import dataclass
from functools import partial, reduce
from typing import Literal

from polaropt.capture import Capture, StokesImages, plate_frame, registered_noise, stokes_images
from polaropt.errors import InputError
from polaropt.estimation.flat.errors import errors_of_gains, polarized_share, spectral_incidence, weighted_incidence
from polaropt.estimation.flat.estimate import (
    LEAST_INDEX,
    SceneEstimate,
    estimate_scene,
    shift_by_spectra,
    with_shift_checked,
)
from polaropt.estimation.flat.ghosts import cross_spectra, is_of_two_faces
from polaropt.estimation.flat.gradients import incidence_by_gradients
from polaropt.estimation.flat.lone_edges import with_mirrored_edges
from polaropt.estimation.flat.pane_by_tiles import with_ghosts_by_tiles, with_tiles
from polaropt.estimation.flat.samples.edges import LayerEdges, WindowEdges
from polaropt.estimation.flat.samples.ghosts import is_told_by_samples, pane_of_samples, sampled_shift
from polaropt.estimation.flat.samples.single import REACH_PX
from polaropt.estimation.flat.samples.tiles import PaneOfTiles, SampledTiles, tiles_of_mosaic
from polaropt.estimation.flat.samples.window import with_window_of_mosaic
from polaropt.estimation.flat.window import window_remark, with_window
from polaropt.estimation.polarized_things import PolarizedThings, polarized_things
from polaropt.estimation.refractive_index import IndexFit, with_index
from polaropt.estimation.rung import LEAST_EXPLAINED, Evidence, RungFit, noise_misfit
from polaropt.estimation.rungs import RUNGS, with_ghosts
from polaropt.estimation.wide.blocks import PolarizedBlocks
from polaropt.optics import INCIDENCE_SEARCH_DEG, Rival, SceneErrors, SceneParameters, widened

_LOWER = ("none", "pixelwise", "ghosts")
_WITH_IMAGES = ("auto", "ghosts")
"""Models under which double images, and those of several panes, are looked for."""
_OF_ALIASES_DEG = 0.6
"""Standard error of the incidence that edges of a mosaic's cells tell, beside what parts of the frame tell of it: what
aliases is alike in all parts. By trial on mosaics of photographs that no figure is taken of."""
_TOLD_BY_TILES_DEG = 40.0
"""Incidence from which on tiles of a mosaic's samples tell it beside its cells. Below, the detail beside the carriers
passes for light that the pane polarizes: of 118 panes at 10 to 40 degrees (`studies.random_windows --sensor mono`, even
seeds from 9940000 and 9950000) cells alone are off by 0.9 degrees, the median, both together by 1.1, and below 25
degrees by 2.9, too steep nine times in ten."""
_EDGES_WIDER = 1.2
"""What the edges' standard error of a flat pane's incidence is multiplied by: on 137 random windows to fit on
(`studies.random_windows`, even seeds to 798) it is off by 1.27 errors, root mean square, and a little the same way as
that of the spectra."""
_SURER_GRADIENTS_DEG = 40.0
"""Incidence from which on gradients in small windows tell it so much better than the edges' overlap that this is left
out: with spectra they are then off by 0.20 degrees, root mean square, with both by 0.22 and without gradients by 0.40
(49 random windows of single panes to fit on, `studies.random_windows`, even seeds to 632)."""


@dataclass(frozen=True)
class RungReport:
    """One rung that was looked at.

    Attributes
    ----------
    rung : str
    misfit : float or None
        Mean square of the light polarized at 45 degrees to the plane of incidence, in units of its noise; None where
        it was not measured.
    score : float or None
        Bayesian information criterion: n log misfit + parameters log n; the smaller the better.
    seconds : float
    taken : bool
    reason : str
        Why it was taken or left, a sentence.
    """

    rung: str
    misfit: float | None
    score: float | None
    seconds: float
    taken: bool
    reason: str


@dataclass(frozen=True)
class LadderResult:
    """A complete scene, how it was estimated (None where it was given) and the rungs that were looked at.

    Attributes
    ----------
    scene : SceneParameters
    estimate : SceneEstimate or None
    tried : tuple of RungReport
    index_error : float or None
        Standard error of the index where all else was given; otherwise it is one of the estimate's.
    of_gains : (float, float)
        Standard errors of incidence and azimuth, in degrees, by gains that photographs which do not add up tell of.
    things : PolarizedThings or None
        What was left out of the photographs, as it is polarized by itself.
    """

    scene: SceneParameters
    estimate: SceneEstimate | None
    tried: tuple[RungReport, ...]
    index_error: float | None = None
    of_gains: tuple[float, float] = (0.0, 0.0)
    things: PolarizedThings | None = dataclasses.field(default=None, compare=False)

    @property
    def errors(self) -> SceneErrors:
        """Standard errors of what was estimated; they reach its rivals, and as far as wrong gains may have led."""
        if self.estimate is None:
            return SceneErrors(refractive_index=self.index_error)
        errors = widened(self.estimate.errors, self.scene, self.estimate.rivals)
        incidence, azimuth = self.of_gains
        return dataclasses.replace(
            errors,
            incidence_deg=None if errors.incidence_deg is None else math.hypot(errors.incidence_deg, incidence),
            azimuth_deg=None if errors.azimuth_deg is None else math.hypot(errors.azimuth_deg, azimuth),
        )

    def scaled(self, factor: float) -> LadderResult:
        """The same of photographs with so many times the pixels a side."""
        estimate = None if self.estimate is None else self.estimate.scaled(factor)
        return dataclasses.replace(self, scene=self.scene.scaled(factor), estimate=estimate)

    def with_index(self, fit: IndexFit) -> LadderResult:
        """The same with the standard error of an index that was found before."""
        if fit.error is None:
            return self
        if self.estimate is None:
            return dataclasses.replace(self, index_error=fit.error)
        errors = dataclasses.replace(self.estimate.errors, refractive_index=fit.error)
        return dataclasses.replace(self, estimate=dataclasses.replace(self.estimate, errors=errors))

    def with_shift(self, ghost_shift: float | None, error: float | None) -> LadderResult:
        """The same with double images, and the standard error of their distance."""
        if not ghost_shift or self.estimate is None:
            return self
        errors = dataclasses.replace(self.estimate.errors, ghost_shift=error)
        return self.with_scene(self.scene.replace(ghost_shift=ghost_shift), self.estimate, errors)

    def with_scene(self, scene: SceneParameters, estimate: SceneEstimate, errors: SceneErrors) -> LadderResult:
        """The same with another scene of an estimate, and its errors."""
        tried = tuple(dataclasses.replace(one, rung=scene.rung) if one.taken else one for one in self.tried)
        estimate = dataclasses.replace(estimate, scene=scene, errors=errors)
        return dataclasses.replace(self, scene=scene, estimate=estimate, tried=tried)

    @property
    def unexplained(self) -> float:
        """Polarized light that the rung taken leaves, in units of its noise: 1 where it explains all."""
        left = [tried.misfit for tried in self.tried if tried.taken and tried.misfit is not None]
        return left[0] if left else 1.0


def model_names() -> tuple[str, ...]:
    """Names that `find_scene` knows."""
    return tuple(dict.fromkeys(("auto", *_LOWER, *(rung.name for rung in RUNGS))))


def check_model(asked: SceneParameters, model: str) -> None:
    """InputError where a model has no place for what is told of the pane, which would be left out of account."""
    told = asked.incidence_deg is not None or asked.azimuth_deg is not None
    if asked.complete or (not told and asked.focal_px is None):
        return
    if asked.focal_px is not None and model in ("pixelwise", "ghosts"):
        raise InputError(
            f"the focal length is that of a wide lens, which the model {model} has not; leave one of them out"
        )
    if told and (model == "curved" or (model == "polarized" and asked.focal_px is not None)):
        raise InputError(f"the model {model} finds incidence and azimuth itself; leave them out, or the model")


def find_scene(
    capture: Capture,
    asked: SceneParameters,
    noise: float,
    model: str = "auto",
    *,
    thickness_px: float | None = None,
    thickness_kind: Literal["paper", "plate"] = "paper",
    mosaic: SampledTiles | None = None,
    edges: LayerEdges | None = None,
) -> LadderResult:
    """Complete a scene on the lowest rung that explains the capture, or on the one asked for.

    Parameters
    ----------
    capture : Capture
        Of a mosaic the samples tell where ghosts lie, and the incidence beside its cells; all else is the cells'.
    asked : SceneParameters
        Fields that are None are estimated. A focal length asks for the perspective rung.
    noise : float
        Standard deviation of one photograph's noise; of a mosaic, of a sample's.
    model : str
        One of `model_names`.
    thickness_px, thickness_kind, mosaic
        As for `estimate_scene`; of a mosaic itself its tiles are asked here.
    edges : LayerEdges, optional
        Logarithms of the edges that both layers behind a complete scene have, in pixels of the capture. Default: of a
        mosaic's cells no several panes are looked for.
    """
    if asked.ghost_shift is not None and thickness_px is not None:
        raise InputError("the ghost shift and the thickness both say how far ghosts lie apart; give one of them")
    check_model(asked, model)
    fit = with_index(capture, asked, noise, thickness_px=thickness_px, thickness_kind=thickness_kind)
    found = _completed(
        capture,
        fit.scene,
        noise,
        model,
        thickness_px=thickness_px,
        thickness_kind=thickness_kind,
        mosaic=mosaic,
        edges=edges,
    )
    return found.with_index(fit)


def _completed(
    capture: Capture,
    asked: SceneParameters,
    noise: float,
    model: str,
    *,
    thickness_px: float | None,
    thickness_kind: Literal["paper", "plate"],
    mosaic: SampledTiles | None = None,
    edges: LayerEdges | None = None,
) -> LadderResult:
    """The same where the index is known."""
    if asked.index < LEAST_INDEX:
        # Any number of panes that mirror nothing is one.
        asked = asked.plainest
    if asked.complete and thickness_px is None:
        return LadderResult(asked, None, ())
    if asked.stacked and thickness_px is not None:
        raise InputError("a thickness is for a single pane; give the shifts of a window of several, or leave it out")
    if capture.cells is not None:
        small, of_cells, tiles = 1 / capture.scale, registered_noise(capture), tiles_of_mosaic(capture, noise)
        thickness = None if thickness_px is None else thickness_px * small
        found = _completed(
            capture.registered,
            asked.scaled(small),
            of_cells,
            model,
            thickness_px=thickness,
            thickness_kind=thickness_kind,
            mosaic=tiles,
        )
        return in_full(found, capture, asked, noise, model, mosaic=tiles, sense_only=thickness_px is not None)
    of_photographs = partial(
        _of_photographs,
        asked=asked,
        noise=noise,
        model=model,
        thickness_px=thickness_px,
        thickness_kind=thickness_kind,
    )
    found, evidence = of_photographs(capture, mosaic=mosaic, edges=edges)
    things = None if evidence is None else _things_beside(found, evidence)
    if evidence is None or things is None:
        return found
    # What is filled in, and the low pass of cells, pass for far double images.
    near = asked.replace(ghost_shift=0.0) if asked.ghost_shift is None and capture.low_passed else asked
    beside, _ = of_photographs(capture.left_out(things.where), asked=near, climbs=False)
    taken = _likelier_beside(found, beside, things)
    if taken is found or asked.ghost_shift is not None:
        return taken
    # Double images are everywhere, and show in detail, of which the whole frame has more.
    if beside.scene.has_ghosts:
        return taken.with_shift(shift_by_spectra(evidence.stokes, beside.scene), beside.errors.ghost_shift)
    told = asked.replace(**{name: getattr(beside.scene, name) for name in ("incidence_deg", "azimuth_deg")})
    everywhere, _ = of_photographs(capture, asked=told, climbs=False)
    return taken.with_shift(everywhere.scene.ghost_shift, everywhere.errors.ghost_shift)


def _of_photographs(
    capture: Capture,
    asked: SceneParameters,
    noise: float,
    model: str,
    *,
    thickness_px: float | None,
    thickness_kind: Literal["paper", "plate"],
    mosaic: SampledTiles | None = None,
    edges: LayerEdges | None = None,
    climbs: bool = True,
) -> tuple[LadderResult, Evidence | None]:
    """The scene of photographs, or of a mosaic's cells, and what it was found by; on the lowest rungs, or on all."""
    if asked.focal_px is not None and model == "auto":
        model = "perspective"
    with_images = model in _WITH_IMAGES
    if asked.stacked and not with_images:
        # Only where the pane is seen from far are the images of several panes looked for.
        asked = asked.replace(ghost_shift=asked.ghost_shift or 0.0, gap_shift=asked.gap_shift or 0.0)
    if asked.bent:
        raise InputError("a bent pane must be given whole: set incidence, azimuth and ghost shift, or no bend")
    began = time.perf_counter()
    flat = asked.replace(focal_px=None).plainest
    shifted = asked.stacked and with_images
    flat = flat.replace(n_panes=1, gap_shift=0.0) if shifted else flat
    if asked.ghost_shift is None and (not with_images or capture.start_unknown):
        flat = flat.replace(ghost_shift=0.0)
    stokes = stokes_images(capture, noise)
    estimate = estimate_scene(
        capture,
        flat,
        noise=noise,
        thickness_px=thickness_px,
        thickness_kind=thickness_kind,
        mosaic=mosaic,
    )
    blocks = PolarizedBlocks(stokes)
    misfit = blocks.constant_misfit(estimate.scene.values()[1])
    is_flat = misfit <= noise_misfit(blocks.n)
    if model == "auto" and asked.ghost_shift is None and thickness_px is None:
        estimate = with_ghosts_by_tiles(estimate, stokes, flat, is_flat=is_flat)
    if climbs and is_flat and estimate.polarized and not capture.low_passed:
        estimate = with_shift_checked(estimate, stokes, asked)
    lone = ""
    # Of a mosaic's cells the samples tell it; a thickness ties it to the ghosts.
    told_by_edges = asked.incidence_deg is None and thickness_px is None and not stokes.aliased
    may_be_one = not (asked.stacked or asked.absorption or capture.low_passed)
    if told_by_edges and may_be_one and is_flat and estimate.polarized:
        estimate, lone = with_mirrored_edges(estimate, plate_frame(stokes, estimate.scene.values()[1]))
    seconds = time.perf_counter() - began
    unpolarized = not estimate.polarized and asked.incidence_deg is None
    if unpolarized or model == "none":
        reason = "There is no polarization beyond the noise." if unpolarized else _ASKED
        return _unseparated(estimate, seconds, reason), None
    # Ghosts that mean spectra have at half their distance tell another index.
    open_ghosts = is_of_two_faces(asked) and flat.ghost_shift is None
    open_window = open_ghosts or None in (asked.n_panes, asked.absorption)
    # The low pass of a mosaic's cells, and what aliases there, passes for a second pane.
    open_window &= thickness_px is None and not stokes.aliased
    # What was filled in, too; and of one layer's edges alone nothing tells several panes.
    open_window &= climbs and not lone
    # Beyond the angles that are searched any number of panes is a mirror.
    open_window &= estimate.scene.values()[0] <= INCIDENCE_SEARCH_DEG[1]
    if shifted or (open_window and with_images and is_flat):
        estimate = with_window(estimate, stokes, asked)
        misfit = blocks.constant_misfit(estimate.scene.values()[1])
    if mosaic is not None and edges is not None and misfit <= _NEARLY_FLAT and open_ghosts and thickness_px is None:
        open_gap = not asked.gap_shift if asked.n_panes is None else asked.stacked and asked.gap_shift is None
        if open_gap and climbs and with_images:
            estimate = with_window_of_mosaic(estimate, mosaic, asked, edges)
    alike = asked.n_panes is None and not estimate.scene.has_ghosts
    remark = lone or (window_remark(estimate.scene) if alike else "")
    window = {name: getattr(estimate.scene, name) for name in ("n_panes", "gap_shift", "gap_azimuth_deg", "absorption")}
    of_window = asked.replace(**window)
    evidence = Evidence(capture, noise, stokes, blocks, of_window, estimate, misfit, model, mosaic)
    # One layer's edges tell nothing of polarized light either.
    found = _climbed(evidence, seconds, remark, climbs=climbs and not lone)
    if told_by_edges and not lone:
        found = _with_all_told(found, stokes, asked)
    return _with_errors_of_gains(found, evidence), evidence


def _things_beside(found: LadderResult, evidence: Evidence) -> PolarizedThings | None:
    """Things that may be polarized by themselves, where no rung explains the polarized light and none was asked for."""
    is_open = evidence.wanted == "auto" and evidence.light_is_open
    if not is_open or evidence.asked.stacked or not found.scene.signal:
        return None
    if found.scene.polarized and _is_told_by_cells(evidence):
        # What it leaves aliases.
        return None
    unexplained = [evidence.blocks] if found.unexplained > evidence.most_unexplained else []
    if evidence.stokes.aliased and not (found.scene.polarized or found.scene.varies):
        # What aliases is fine: in larger blocks it is less of what they show.
        large = PolarizedBlocks(evidence.stokes, _BLOCKS_OF_CELLS)
        unexplained += [large] if large.constant_misfit(found.scene.values()[1]) > evidence.most_unexplained else []
    if not unexplained or evidence.gains_explain:
        return None
    return next(filter(None, (polarized_things(blocks, evidence.apart) for blocks in unexplained)), None)


def _likelier_beside(found: LadderResult, beside: LadderResult, things: PolarizedThings) -> LadderResult:
    """What is found beside things that are polarized by themselves, if that explains the rest of the frame."""
    left = 1 + _LEFT_BESIDE * (found.unexplained - 1)
    if beside.estimate is None or not beside.scene.signal or beside.unexplained > max(left, _MOST_BESIDE):
        return found
    reason = (
        f"Things in {100 * things.share:.0f} % of the frame are polarized by themselves; the rest tells the pane, and "
        "it leaves no polarized light there."
    )
    tried = tuple(dataclasses.replace(one, taken=False, reason=_NOT_TAKEN) for one in found.tried if one.taken)
    others = tuple(one for one in found.tried if not one.taken)
    taken = tuple(dataclasses.replace(one, reason=reason) for one in beside.tried if one.taken)
    return dataclasses.replace(beside, tried=(*others, *tried, *taken), things=things)


def _with_errors_of_gains(found: LadderResult, evidence: Evidence) -> LadderResult:
    """The same with what photographs that do not add up tell of the errors of incidence and azimuth."""
    scene = found.scene
    # What polarized layers show depends on gains in other ways, and their errors are wide.
    if scene.polarized:
        return found
    share = polarized_share(evidence.blocks.stokes)
    return dataclasses.replace(found, of_gains=errors_of_gains(evidence.apart, share, scene))


def _with_all_told(found: LadderResult, stokes: StokesImages, asked: SceneParameters) -> LadderResult:
    """The same with the incidence that all tell together, where the pane is seen from far.

    Gradients in small windows and the edges' overlap go by the same edges, and gradients are the surer where the pane
    polarizes much. Spectra tell the incidence of a single clear pane, tiles that of any two faces.
    """
    scene, estimate = found.scene, found.estimate
    if estimate is None or estimate.errors.incidence_deg is None or scene.rung not in ("pixelwise", "ghosts"):
        return found
    incidence, azimuth, _ = scene.values()
    frame, single = plate_frame(stokes, azimuth), scene.single_and_clear
    by_edges = incidence, estimate.errors.incidence_deg * (_EDGES_WIDER if single else 1.0)
    spectra = spectral_incidence(cross_spectra(frame), scene) if single else None
    gradients = incidence_by_gradients(frame, scene)
    surer = single and gradients is not None and gradients[0] > _SURER_GRADIENTS_DEG
    told = [part for part in (None if surer else by_edges, gradients, spectra) if part is not None]
    mean, error = reduce(weighted_incidence, told)
    scene, errors = scene.replace(incidence_deg=mean), dataclasses.replace(estimate.errors, incidence_deg=error)
    scene, errors = with_tiles(frame, scene, errors, asked)
    estimate = dataclasses.replace(estimate, scene=scene, errors=errors)
    return dataclasses.replace(found, scene=scene, estimate=estimate)


def in_full(
    found: LadderResult,
    capture: Capture,
    asked: SceneParameters,
    noise: float,
    model: str = "auto",
    *,
    mosaic: SampledTiles | None = None,
    sense_only: bool = False,
    edges: LayerEdges | None = None,
) -> LadderResult:
    """What was found from a mosaic's cells, in pixels of the capture, with ghosts and incidence as its samples tell.

    Parameters
    ----------
    found : LadderResult
        In pixels of `Capture.registered`.
    capture, asked, noise, model
        As of `find_scene`.
    mosaic : SampledTiles, optional
        Tiles of the capture, where there are enough.
    sense_only : bool
        Whether the distance of the ghosts is given, and only their side is to be told.
    edges : LayerEdges, optional
        Of scenes in pixels of the capture: close ghosts must lie where the layers have fewer. Default: what tiles tell
        is believed.
    """
    whole = found.scaled(capture.scale)
    if found.things is not None or (asked.absorption is None and found.scene.absorption):
        # Samples of these things tell other panes; what is tinted was told by samples.
        return whole
    open_shift, open_incidence = asked.ghost_shift is None, asked.incidence_deg is None
    estimate = whole.estimate
    if estimate is None or model not in _WITH_IMAGES or not (open_shift or open_incidence):
        return whole
    # A thickness ties the ghosts' distance to the incidence of the cells.
    sense_only &= open_shift
    if mosaic is not None and not sense_only and _is_told_by_tiles(found.scene.scaled(mosaic.period), asked):
        by_tiles = _told_by_tiles(found.scaled(mosaic.period), capture, mosaic, asked, noise, edges)
        is_asked_for = model == "auto" or by_tiles.scene.has_ghosts
        return by_tiles.scaled(capture.scale / mosaic.period) if is_asked_for else whole
    sampled = pane_of_samples(
        capture,
        whole.scene,
        noise,
        incidence_error_deg=_error_of_cells(whole),
        open_shift=open_shift,
        open_incidence=open_incidence and not sense_only,
        sense_only=sense_only,
    )
    if sampled is None or (model == "ghosts" and not sampled.shift_px):
        return whole
    scene, errors = whole.scene, estimate.errors
    if open_shift:
        scene = scene.replace(ghost_shift=sampled.shift_px)
        error = errors.ghost_shift if sense_only else sampled.shift_error_px
        errors = dataclasses.replace(errors, ghost_shift=error if scene.has_ghosts else None)
    return _with_incidence(whole, estimate, scene, errors, sampled.incidence)


def _is_told_by_tiles(scene: SceneParameters, asked: SceneParameters) -> bool:
    """Whether tiles of a mosaic tell of a scene that its cells show, in pixels of the sensor: of no ghosts far off."""
    near = asked.ghost_shift is not None or abs(scene.values()[2]) <= REACH_PX
    return near and is_told_by_samples(scene)


def _told_by_tiles(
    found: LadderResult,
    capture: Capture,
    mosaic: SampledTiles,
    asked: SceneParameters,
    noise: float,
    edges: LayerEdges | None,
) -> LadderResult:
    """What was found from a mosaic's cells, in pixels of the sensor, with ghosts, tint and incidence as its tiles tell.

    Where tiles show ghosts all samples together tell more exactly how far off.
    """
    estimate, cells = found.estimate, capture.cells
    if estimate is None or cells is None:
        return found
    scene, errors = found.scene, estimate.errors
    incidence, azimuth, _ = scene.values()
    known = asked.replace(refractive_index=scene.index, azimuth_deg=azimuth)
    of_windows = None if edges is None else WindowEdges(known, edges, capture.scale / mosaic.period)
    tiles = PaneOfTiles(mosaic, azimuth, of_windows)
    if asked.ghost_shift is None:
        shift, error = tiles.ghosts(known, incidence)
        if shift:
            about = scene.replace(ghost_shift=shift)
            shift, error = sampled_shift(cells.samples, capture.angles_deg, about, noise, error)
        scene = scene.replace(ghost_shift=shift)
        errors = dataclasses.replace(errors, ghost_shift=error if shift else None)
    is_open = asked.absorption is None and scene.has_ghosts
    tint = tiles.tint(scene, incidence_open=asked.incidence_deg is None) if is_open else None
    if tint is not None:
        absorption, error = tint
        scene, errors = scene.replace(absorption=absorption), dataclasses.replace(errors, absorption=error)
        # What looked polarized was tint.
        rivals = tuple(rival for rival in estimate.rivals if not rival.scene.polarized)
        estimate = dataclasses.replace(estimate, rivals=rivals)
    is_told = asked.incidence_deg is None and incidence >= _TOLD_BY_TILES_DEG
    told = tiles.incidence(scene) if is_told else None
    return _with_incidence(found, estimate, scene, errors, told)


def _with_incidence(
    found: LadderResult,
    estimate: SceneEstimate,
    scene: SceneParameters,
    errors: SceneErrors,
    told: tuple[float, float] | None,
) -> LadderResult:
    """What was found with another scene and its errors, the incidence that of the cells and what is told together."""
    if errors.incidence_deg is not None and told is not None:
        mean, error = weighted_incidence((found.scene.values()[0], _error_of_cells(found)), told)
        scene, errors = scene.replace(incidence_deg=mean), dataclasses.replace(errors, incidence_deg=error)
    return found.with_scene(scene, estimate, errors)


def _error_of_cells(found: LadderResult) -> float:
    """Standard error in degrees of the incidence that a mosaic's cells tell."""
    return math.hypot(found.errors.incidence_deg or math.inf, _OF_ALIASES_DEG)


_ASKED = "It is the one asked for."
_UNSUITED = "The one asked for does not suit what is given or found."
_NEARLY_FLAT = 1.6
"""Polarized light beside the plane of incidence, noise included, in units of it, up to which cells of a mosaic are of
a flat window: what aliases in them is some, more than noise, of one in three. Set by hand."""
_BLOCKS_OF_CELLS = 24
"""Blocks along the longer side of a mosaic's cells at most, in which things are looked for; by trial."""
_NOT_TAKEN = "Beside things that are polarized by themselves a plain pane explains all."
_LEFT_BESIDE, _MOST_BESIDE = 0.3, 1.3
"""Polarized light beyond the noise that a plain pane may leave beside such things, as a part of what no rung explained,
and, noise included, in units of it. Set by hand."""


def _unseparated(estimate: SceneEstimate, seconds: float, reason: str) -> LadderResult:
    scene = estimate.scene.replace(signal=False)
    tried = RungReport("none", None, None, seconds, True, reason)
    return LadderResult(scene, dataclasses.replace(estimate, scene=scene), (tried,))


@dataclass(frozen=True)
class _Step:
    """One rung of the way up, and its seconds."""

    rung: str
    attempt: RungFit
    seconds: float

    def score(self, n: int) -> float:
        return n * math.log(max(self.attempt.compared, 1e-9)) + self.attempt.n_parameters * math.log(n)

    def tried(self, evidence: Evidence, taken: bool, reason: str) -> RungReport:
        parts = (self.attempt.misfit, self.score(evidence.blocks.n), self.seconds)
        return RungReport(self.rung, *parts, taken, " ".join(filter(None, (reason, self.attempt.remark))))


def _climbed(evidence: Evidence, seconds: float, remark: str, *, climbs: bool = True) -> LadderResult:
    """Rung by rung up to the first that leaves nothing but noise, or the best of all; a remark is of the lowest."""
    wanted, plain = evidence.wanted, evidence.estimate.scene
    first = RungFit(plain, evidence.misfit, 1, True, remark, errors=evidence.estimate.errors)
    steps = [_Step(plain.rung, first, seconds)]
    for rung in RUNGS if climbs else ():
        if wanted not in ("auto", rung.name) or not rung.may_help(evidence):
            continue
        if rung.name == "polarized" and _second_choices(evidence, steps):
            continue
        began = time.perf_counter()
        attempt = rung.attempt(evidence)
        steps.append(_Step(rung.name, attempt, time.perf_counter() - began))
        if attempt.known and attempt.misfit <= noise_misfit(evidence.blocks.n):
            break
    best = _taken(evidence, steps)
    began = time.perf_counter()
    attempt = with_ghosts(evidence, best.attempt)
    taken = _Step(best.rung, attempt, best.seconds + time.perf_counter() - began)
    steps[steps.index(best)] = taken
    tried = tuple(step.tried(evidence, step is taken, _reason(evidence, steps, step, taken)) for step in steps)
    found = taken.attempt
    rivals = (*evidence.estimate.rivals, *_polarized_rivals(evidence)) if taken is steps[0] else found.rivals
    estimate = dataclasses.replace(evidence.estimate, scene=found.scene, errors=found.errors, rivals=rivals)
    return LadderResult(found.scene, estimate, tried)


def _polarized_rivals(evidence: Evidence) -> tuple[Rival, ...]:
    """Panes before polarized light that may be the true one where a plain one explains all that cells show."""
    is_open = evidence.wanted == "auto" and evidence.light_is_open
    return evidence.polarized_rivals if is_open and evidence.explained else ()


def _taken(evidence: Evidence, steps: list[_Step]) -> _Step:
    if evidence.wanted != "auto":
        known = [step for step in steps[1:] if step.attempt.known]
        return min(known or steps[-1:], key=lambda step: step.score(evidence.blocks.n))
    noise = noise_misfit(evidence.blocks.n)
    told = [step for step in steps[1:] if step.attempt.known and step.attempt.told_by_edges]
    # What aliases in cells may be more than noise before the right pane, too.
    if told and (_is_told_by_cells(evidence) or told[0].attempt.misfit <= noise):
        return told[0]
    able = [step for step in steps[1:] if step.attempt.known and _share(evidence, step) >= LEAST_EXPLAINED]
    lowest = [step for step in (steps[0], *able) if step.attempt.misfit <= noise] or _second_choices(evidence, steps)
    return lowest[0] if lowest else min((steps[0], *able), key=lambda step: step.score(evidence.blocks.n))


def _is_told_by_cells(evidence: Evidence) -> bool:
    """Whether a higher rung can be told by edges alone, of a mosaic's cells: their polarized light is explained."""
    return evidence.stokes.aliased and evidence.explained


def _second_choices(evidence: Evidence, steps: list[_Step]) -> list[_Step]:
    """Rungs that explain the polarized light, but have edges against them."""
    return [
        step for step in steps if step.attempt.second_choice and step.attempt.misfit <= noise_misfit(evidence.blocks.n)
    ]


def _share(evidence: Evidence, step: _Step) -> float:
    """Part of what the plain pane leaves that a rung explains."""
    return evidence.share_explained(step.attempt.compared)


def _reason(evidence: Evidence, steps: list[_Step], step: _Step, taken: _Step) -> str:
    if evidence.wanted != "auto":
        if step is not taken:
            return "Another one was asked for."
        return _ASKED if step.rung == evidence.wanted else _UNSUITED
    if step is steps[0]:
        if step is not taken:
            what = "edges" if evidence.explained else "polarized light"
            return f"It leaves {what} unexplained."
        explained = "It leaves no polarized light beyond the noise."
        return explained if evidence.explained else "No higher rung explains what it leaves."
    if not step.attempt.known:
        return "The photographs do not tell it."
    if evidence.explained and step.attempt.told_by_edges:
        return "The layers' edges and spectra tell it."
    share = _share(evidence, step)
    told = f"{100 * share:.0f} % of the polarized light that the {steps[0].rung} rung leaves"
    if step is taken:
        return f"It explains {told}."
    return f"It explains only {told}." if share < LEAST_EXPLAINED else f"It explains {told}, another one more."
