"""A capture with all that is known before it is solved: its photographs, its scene, and what speaks against them."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from polaropt.capture import Capture, Matching, Mistakes, find_mistakes, may_lie_apart, registered_noise
from polaropt.estimation import (
    Exposures,
    IndexFit,
    LadderResult,
    LikelierIndex,
    StillPhotographs,
    agreeing_photographs,
    clear_pane,
    find_scene,
    in_full,
    left_alone,
    likelier_index,
    likelier_index_of_mosaic,
    scene_source,
    still_photographs,
    surely_unglazed,
    tiles_of_mosaic,
    uneven_exposures,
    unglazed_pixels,
    with_incidence_checked,
    with_index,
    with_likelier_side,
)
from polaropt.optics import SceneErrors, SceneParameters
from polaropt.progress import Stages
from polaropt.solving import Settings, edges_of_layers, inpainted

# Noise that an estimation is told at least (white = 1): with less, what no model has (interpolation, light from beyond
# the frame, quantization) is taken for other rungs. By trial on random windows without noise (`studies.random_windows`,
# training photographs, numbers from 20000): scenes told 1e-3 are found as they are with that noise.
_LEAST_NOISE_OF_SCENE = 1e-3
# How far a separation has come when its noise is measured, and its photographs agree; set by hand, for the progress.
_NOISE_MEASURED, _MATCHED = 0.005, 0.02
# How far the estimation has come, in parts of the whole separation, for the progress alone: set by hand.
_INDEX_KNOWN, _INCIDENCE_CHECKED, _SCENE_FOUND, _INDEX_CHECKED = 0.02, 0.05, 0.15, 0.2


@dataclass(frozen=True)
class Case:
    """A capture with what was asked of it, and all that is known before it is solved."""

    capture: Capture
    still: StillPhotographs
    asked: SceneParameters
    settings: Settings
    doubtful_incidence: bool
    coated: bool
    likelier_index: LikelierIndex | None
    found: LadderResult
    given_errors: SceneErrors | None = None
    matching: Matching | None = None
    exposures: Exposures | None = None
    unglazed: NDArray[np.bool_] | None = None

    def of_next(self, capture: Capture) -> Case:
        """What is known of another frame of the same camera behind the same pane."""
        matching = self.matching
        if self.exposures is not None and matching is not None:
            capture = self.exposures.divided_out(capture)
            matching = replace(matching, capture=capture, of_scene=capture)
        return replace(self, capture=capture, matching=matching)

    @property
    def unpolarized(self) -> bool:
        """Whether nothing is polarized, as was found or given."""
        return not self.found.scene.signal

    def of_pane(self) -> Capture:
        """The capture as it is solved: what moves is left out or filled, and what shows no glass left out.

        Not of a mosaic, whose closed form loses more by what is filled in than by what is there: up to 6 dB.
        """
        capture, moving = self.capture, self.still.moving
        if moving is not None:
            capture = inpainted(capture, moving, self.found.scene, self.still.noise, self.still.growth)
        return capture if self.unglazed is None or capture.samples is not None else capture.left_out(self.unglazed)

    @property
    def known(self) -> dict[str, Any]:
        """What `diagnose` is told of it, whatever its solve says."""
        return {
            "estimate": self.found.estimate,
            "scene": self.found.scene,
            "unexplained": self.found.unexplained,
            "mistakes": self.still.mistakes,
            "moving": self.still.moving,
            "valid_share": self.still.valid_share,
            "doubtful_incidence": self.doubtful_incidence,
            "coated": self.coated,
            "likelier_index": self.likelier_index,
            "polarized_things": self.found.things is not None,
        }

    @property
    def errors(self) -> SceneErrors:
        """Standard errors of the scene, as they were found or given."""
        return self.found.errors if self.given_errors is None else self.given_errors

    @property
    def near_errors(self) -> SceneErrors:
        """The same without what rivals add; before polarized light in place these say how all numbers move."""
        estimate = self.found.estimate
        if estimate is None or self.given_errors is not None:
            return self.errors
        return SceneErrors() if estimate.rivals and estimate.scene.polarized else estimate.errors


def case_of(
    capture: Capture,
    asked: SceneParameters,
    settings: Settings,
    stages: Stages,
    *,
    index_assumed: bool,
    scene_errors: SceneErrors | None = None,
) -> Case:
    """All that is known of a capture before it is solved.

    Parameters
    ----------
    capture : Capture
    asked : SceneParameters
        None in it is to be found.
    settings : Settings
    stages : Stages
    index_assumed : bool
        Whether the index is what glass usually has, not one that somebody knows.
    scene_errors : SceneErrors, optional
        Standard errors of a scene that is complete; of one that is found its own count.
    """
    capture, still, matching, exposures = _agreeing(capture, asked, settings, stages)
    noise, mistakes = max(still.noise, _LEAST_NOISE_OF_SCENE), still.mistakes
    # A scene is estimated from the cells of a mosaic, in their pixels.
    of_scene, scale = still.capture if matching is None else still.seen(matching.of_scene), capture.scale
    stages.begin("Estimating the scene", _MATCHED)
    of_registered = max(registered_noise(capture, noise), _LEAST_NOISE_OF_SCENE)
    unglazed = unglazed_pixels(of_scene, noise, still.growth) if settings.leave_out_unglazed else None
    of_scene = of_scene if unglazed is None else of_scene.left_out(unglazed)
    registered = of_scene.registered
    source, smooth, of_source = scene_source(registered, of_registered, mistakes)
    thickness_px = None if settings.thickness_px is None else settings.thickness_px / scale
    kind = settings.thickness_kind
    fit = with_index(smooth, asked.scaled(1 / scale), of_source, thickness_px=thickness_px, thickness_kind=kind)
    stages.advance(_INDEX_KNOWN)
    checked = with_incidence_checked(source, fit.scene, of_source)
    stages.advance(_INCIDENCE_CHECKED)
    mosaic = None if checked.scene.complete else tiles_of_mosaic(of_scene, noise)
    edges = partial(edges_of_layers, of_scene, noise=noise, growth=still.growth)
    find = partial(
        find_scene,
        noise=of_source,
        model=settings.model,
        thickness_px=thickness_px,
        thickness_kind=kind,
        mosaic=mosaic,
        edges=lambda seen: edges(seen.scaled(scale)),
    )
    in_whole = partial(
        in_full,
        capture=of_scene,
        asked=asked,
        noise=noise,
        model=settings.model,
        mosaic=mosaic,
        sense_only=settings.thickness_px is not None,
        edges=edges,
    )
    of_cells = find(source, checked.scene).with_index(fit)
    if settings.model == "auto":
        of_cells = left_alone(of_cells, checked)
    found = in_whole(of_cells)
    stages.advance(_SCENE_FOUND)
    # An index that is told fits badly where the incidence is, too.
    index, sought = None, checked.scene
    asks_index = asked.refractive_index is not None and asked.incidence_deg is None and of_cells.things is None
    # Of a mosaic's windows of several panes no index is told.
    if asks_index and (mosaic is None or not found.scene.stacked):
        index = likelier_index(smooth, of_cells.scene, of_source)
        if mosaic is not None:
            index = likelier_index_of_mosaic(mosaic, found.scene.scaled(mosaic.period / scale), index)
    if index is not None and index.sure and index_assumed and asked.single_and_clear:
        sought = clear_pane(sought, index.index)
        fit = IndexFit(sought, index.error)
        found = in_whole(find(source, sought).with_index(fit))
        asked, index = asked.replace(refractive_index=None), None
    stages.advance(_INDEX_CHECKED)
    # Edges of things that are polarized by themselves tell no side; the scene found beside them has it by spectra.
    if asked.ghost_shift is None and of_cells.things is None:

        def of_source_edges(seen: SceneParameters) -> float:
            return sum(edges_of_layers(source, seen, of_source, still.growth))

        may_be_none = settings.model == "auto" and thickness_px is None and asked.n_panes in (None, 1)

        def in_place() -> LadderResult:
            return left_alone(find(source, sought.plainest.replace(ghost_shift=0.0)), checked)

        found = with_likelier_side(found, source, of_source_edges, of_source, in_place if may_be_none else None)
    if matching is not None:
        matching = matching.with_azimuth(found.scene.azimuth_deg)
    if exposures is not None:
        found = exposures.with_errors(found)
    unglazed = None if unglazed is None else surely_unglazed(unglazed, found.scene)
    return Case(
        capture,
        still,
        asked,
        settings,
        checked.doubtful,
        fit.coated,
        index,
        found,
        matching=matching,
        exposures=exposures,
        unglazed=unglazed,
        given_errors=None if found.estimate is not None else scene_errors,
    )


def _agreeing(
    capture: Capture, asked: SceneParameters, settings: Settings, stages: Stages
) -> tuple[Capture, StillPhotographs, Matching | None, Exposures | None]:
    """Photographs made to agree, what stands still of them, what was undone, and exposures that were divided out."""
    stages.begin("Measuring the noise", 0.0)
    still = still_photographs(capture)
    if not settings.match_photographs:
        return capture, still, None, None
    if may_lie_apart(still.capture, still.noise):
        stages.begin("Matching the photographs", _NOISE_MEASURED)
    capture, still, matching = agreeing_photographs(
        capture, still, lambda fraction: stages.advance((_MATCHED - _NOISE_MEASURED) * fraction)
    )
    exposures = _exposures_of(still, matching, asked, settings)
    if exposures is not None:
        still, matching = exposures.undone(still, Matching.of_none(capture) if matching is None else matching)
        capture = matching.capture
    return capture, still, matching, exposures


def _exposures_of(
    still: StillPhotographs, matching: Matching | None, asked: SceneParameters, settings: Settings
) -> Exposures | None:
    """What photographs, as they were made to agree, tell of their exposures; None where something else is wrong."""
    if settings.thickness_px is not None:
        return None
    of_scene = still.capture if matching is None else still.seen(matching.of_scene)
    registered, noise = of_scene.registered, max(registered_noise(of_scene, still.noise), _LEAST_NOISE_OF_SCENE)
    found = uneven_exposures(registered, asked.scaled(1 / of_scene.scale), noise, settings.model)
    if found is None or still.mistakes == Mistakes():
        return found
    # Exposures may pass for a wrong order or an encoding, and no less the other way round.
    return found if find_mistakes(found.divided_out(registered)) == Mistakes() else None
