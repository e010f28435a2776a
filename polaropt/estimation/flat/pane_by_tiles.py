"""What single tiles of the frame tell of a pane: double images, or none, how far they lie apart, and the incidence.

To mean spectra a picture that is blurred along one direction, as many are by themselves, looks like images a pixel or
two apart, and repeated things look like images further off; and steep panes, whose ghosts are many, look like others
with none. Tiles, each with spectra of its own, tell them apart, and close ghosts together with the incidence.

Where images lie apart their brightness goes by the incidence, and no edge that both layers have in common misleads: of
such windows tiles tell the incidence up to four times as exactly as edges, gradients and mean spectra do. Where all are
in place they tell it as exactly as these, by other signs.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np

from polaropt.capture import PlateFrame, StokesImages, plate_frame
from polaropt.estimation.flat.errors import weighted_incidence, weighted_mean, widened_incidence, widened_shift
from polaropt.estimation.flat.estimate import SceneEstimate
from polaropt.estimation.flat.ghost_overlap import refined_incidence
from polaropt.estimation.flat.ghosts import LEAST_SHIFT_PX, LIKE_BLUR_PX, is_of_two_faces
from polaropt.estimation.flat.windows.axis import window_of
from polaropt.estimation.flat.windows.likelihood import Window
from polaropt.estimation.flat.windows.tiles import TileFit, TileLikelihood, tile_likelihood
from polaropt.numerics import left_out, minimum_error
from polaropt.optics import INCIDENCE_SEARCH_DEG, SceneErrors, SceneParameters

_CLOSE_PX, _SURE_OF_CLOSE, _SURE_OF_FAR = 3.0, 2.0, 0.0
"""Shift up to which ghosts are close, and standard errors by which tiles must find close and far ones that mean spectra
show likelier than none. On 287 random windows to fit on of one pane (`studies.random_windows`, even seeds to 998) 22 of
26 false ghosts have less, and of 112 true ones none whose shift was found within a pixel."""
_STARTS_PX, _SURE_ALONE = (-1.0, 1.0), 2.5
"""Shifts from which tiles look for close ghosts, and standard errors by which those that only they show must be
likelier than none and than the same on the other side: a picture whose spectra fall otherwise than tiles take them to
looks like ghosts a pixel or two apart on either side. Of 480 panes of training photographs (46 to 80 degrees, noise
0.07 to 1.2 %, an engine of its own) 8 of 260 in place have such ghosts, none surer of their side than by 2.4, and 26 of
29 true ones that only tiles show are. Of 300 more (20 to 80 degrees, up to 3 px) so are 4 of 20 true ones that mean
spectra show and tiles find no likelier than none, and none of 60 false ones."""
_SURE_OF_NONE = 3.0
"""Standard errors by which tiles must find no double images likelier than those of one layer, to drop these: of three
reflections out of focus that had such (training photographs, 56 to 74 degrees) they do by 4.9 to 7.3."""
_SEARCHED_DEG, _SURER_DEG = 45.0, 55.0
"""Incidences from which tiles look for close ghosts, and from which they tell their shift better than mean spectra: on
540 panes with pairs of photographs that no figure is taken of and those inside scikit-image (shifts of 0 to 2.2 px,
noise 0.07 to 1.2 %) what they find below lies as often further off as closer, beyond 55 degrees closer in 80 of 86."""
LEAST_TILES = 9
"""Tiles and colours that can tell: standard errors of fewer say nothing."""
_ERROR_STEP_PX = 0.25
"""Beside a shift, where the likelihood is looked at for its standard error. Set by hand."""


def with_ghosts_by_tiles(
    estimate: SceneEstimate, stokes: StokesImages, asked: SceneParameters, *, is_flat: bool
) -> SceneEstimate:
    """The estimate of a single pane with the double images that tiles tell; ghosts that cannot be told are none.

    Parameters
    ----------
    estimate : SceneEstimate
        With a ghost shift that was found.
    stokes : StokesImages
    asked : SceneParameters
        What was given; an incidence that was not moves with the ghosts.
    is_flat : bool
        Whether a flat pane that is seen from far explains the polarized light: else no ghosts are looked for beside
        those that were found, as an incidence that changes over the frame looks like some.
    """
    if _is_a_trifle(estimate):
        estimate = _in_place(estimate)
    # Of a mosaic's cells the low pass shapes the spectra; towards grazing incidence every pane is a mirror.
    if stokes.aliased or not estimate.polarized or estimate.scene.values()[0] > INCIDENCE_SEARCH_DEG[1]:
        return estimate
    free = ("incidence_deg",) if asked.incidence_deg is None else ()
    if asked.transmission_ghost_shift is None and asked.ghost_shift is None:
        estimate = _without_shift_of_one_layer(estimate, stokes, free)
    if not is_of_two_faces(estimate.scene):
        return estimate
    incidence, azimuth, shift = estimate.scene.values()
    searched = is_flat and incidence >= _SEARCHED_DEG
    if not (shift or searched):
        return estimate
    frame = plate_frame(stokes, azimuth)
    tiles, index = tile_likelihood(frame), estimate.scene.index
    place = tiles.nearest(Window(incidence, 0.0), index, free)
    if len(place.misfits) < LEAST_TILES:
        return estimate
    found = tiles.nearest(Window(incidence, shift), index, free) if shift else None
    least = _SURE_OF_FAR if abs(shift) > _CLOSE_PX else _SURE_OF_CLOSE
    taken = None
    if found is not None and (found.surer_than(place) > least or tiles.surer_of_side(found, free) > _SURE_ALONE):
        taken = found
    if searched and abs(shift) <= _CLOSE_PX:
        taken = _likelier(tiles, place, taken, index, free)
    if taken is None:
        return _moved(estimate, frame, place, free) if shift else estimate
    return estimate if taken is found else _moved(estimate, frame, taken, free, _shift_error(tiles, taken))


def _without_shift_of_one_layer(estimate: SceneEstimate, stokes: StokesImages, free: tuple[str, ...]) -> SceneEstimate:
    """The estimate without double images of one layer that mean spectra alone show, where tiles surely find none.

    A reflection out of focus has spectra of its own, which to mean spectra look like a shift that only it has.
    """
    if estimate.scene.transmission_ghost_shift is None:
        return estimate
    incidence, azimuth, shift = estimate.scene.values()
    frame = plate_frame(stokes, azimuth)
    tiles, index = tile_likelihood(frame), estimate.scene.index
    place, found = (tiles.nearest(Window(incidence, px), index, free) for px in (0.0, shift))
    if len(place.misfits) < LEAST_TILES or place.surer_than(found) <= _SURE_OF_NONE:
        return estimate
    plain = replace(estimate, scene=estimate.scene.replace(transmission_ghost_shift=None))
    return _moved(_in_place(plain), frame, place, free)


def _is_a_trifle(estimate: SceneEstimate) -> bool:
    """Whether ghosts are so close that they are none, or may as well lie elsewhere close by."""
    shift, error = abs(estimate.scene.values()[2]), estimate.shift_error_of_side
    # Far ones with a rival are ghosts. A single tile tells no error.
    unsure = error is not None and shift < min(error, LIKE_BLUR_PX) and error < math.inf
    return shift < LEAST_SHIFT_PX or unsure


def _likelier(
    tiles: TileLikelihood, place: TileFit, taken: TileFit | None, refractive_index: float, free: tuple[str, ...]
) -> TileFit | None:
    """Close ghosts that were taken, or others near by that tiles surely find likelier than them or than none."""
    glance, names = tiles.luminance(), (*free, "pane_shift")
    starts = [replace(place.window, pane_shift=shift) for shift in _STARTS_PX]
    likely = min((glance.nearest(start, refractive_index, names) for start in starts), key=lambda fit: fit.misfit)
    if not LEAST_SHIFT_PX <= abs(likely.window.pane_shift) <= _CLOSE_PX:
        return taken
    other = tiles.nearest(likely.window, refractive_index, free)
    if taken is None:
        sure = other.surer_than(place) > _SURE_ALONE and tiles.surer_of_side(other, free) > _SURE_ALONE
        return other if sure else None
    surer = place.window.incidence_deg >= _SURER_DEG and other.surer_than(taken) > _SURE_OF_CLOSE
    return other if surer else taken


def _shift_error(tiles: TileLikelihood, fit: TileFit) -> float:
    """Standard error in pixels of the shift of a likeliest window, by leaving each tile out in turn."""
    window, step = fit.window, _ERROR_STEP_PX
    beside = (replace(window, pane_shift=window.pane_shift + move) for move in (-step, step))
    before, after = (tiles.fitted(moved, fit.refractive_index).misfits for moved in beside)
    rest = [left_out(misfits) for misfits in (before, fit.misfits, after)]
    return widened_shift(minimum_error(rest, step))


def _moved(
    estimate: SceneEstimate,
    frame: PlateFrame,
    fit: TileFit,
    free: tuple[str, ...],
    shift_error_px: float | None = None,
) -> SceneEstimate:
    """The estimate with a window's ghosts, and the incidence near its own at which edges overlap least."""
    scene = estimate.scene.replace(ghost_shift=fit.window.pane_shift)
    errors = replace(estimate.errors, ghost_shift=shift_error_px)
    estimate = replace(estimate, shift_error_of_side=shift_error_px)
    if not free:
        return replace(estimate, scene=scene, errors=errors)
    scene = scene.replace(incidence_deg=fit.window.incidence_deg)
    incidence, error = refined_incidence(frame, scene)
    # What hardly mirrors has no edges to go by.
    if math.isfinite(incidence):
        scene = scene.replace(incidence_deg=float(np.clip(incidence, *INCIDENCE_SEARCH_DEG)))
        errors = replace(errors, incidence_deg=widened_incidence(error))
    return replace(estimate, scene=scene, errors=errors)


def _in_place(estimate: SceneEstimate) -> SceneEstimate:
    errors = replace(estimate.errors, ghost_shift=None, transmission_ghost_shift=None)
    return replace(estimate, scene=estimate.scene.replace(ghost_shift=0.0), errors=errors)


_OF_SCENE = {"incidence_deg": "incidence_deg", "pane_shift": "ghost_shift"}
"""Numbers of a window that tiles are asked for, and what they are called in a scene."""
_WIDER = {"incidence_deg": 3.5, "pane_shift": 4.5}
_IN_PLACE_WIDER = 4.5
"""What standard errors by the curvature are multiplied by, and the incidence's where all images are in place: tiles
overlap, and layers are not quite what they are taken to be. On 81 random windows with double images and 64 in place to
fit on (`studies.random_windows`, even seeds from 30000) 90 and 85 % of the true incidences then lie within two of what
all tell together, as many as without tiles, and these are half and three quarters as wide."""
_SUREST = 0.02
"""Standard error of a shift in pixels below which none is believed. Set by hand."""
_IN_PLACE_DEG = 25.0
"""Incidence from which on tiles are asked of a window whose images are in place: below, ghosts a third of a pixel apart
pass for another incidence. Set by hand."""
_CONTRADICTS, _FAR_DEG, _CONTRADICTS_FAR = 2.5, 3.0, 2.0
"""Standard errors of both by which tiles and what told it before may differ in the incidence, and how many beyond some
degrees: of those 81 they differ by up to 2.1 errors and 1.0 degrees, by more of some whose index or number of panes is
wrong. Where a bright reflection hides the other's edges they may be 5 degrees off, and know it."""


def with_tiles(
    frame: PlateFrame, scene: SceneParameters, errors: SceneErrors, asked: SceneParameters
) -> tuple[SceneParameters, SceneErrors]:
    """A window with its numbers where tiles and what told them before find them together, and their standard errors.

    Parameters
    ----------
    frame : PlateFrame
        At the azimuth of the scene.
    scene, errors : SceneParameters, SceneErrors
        Of a window that is seen from far, before unpolarized light. One surface, and double images that lie apart in
        each layer for itself, are left as they are.
    asked : SceneParameters
        None stands for what was to be found.
    """
    least = 0.0 if scene.has_ghosts else _IN_PLACE_DEG
    if not is_of_two_faces(scene) or not least <= scene.values()[0] <= INCIDENCE_SEARCH_DEG[1]:
        return scene, errors
    window, tiles = window_of(scene, frame.azimuth_deg), tile_likelihood(frame)
    tells_shift = scene.has_ghosts and scene.single_and_clear
    # Gaps of several panes, and what a tint dims, come out no better than from mean spectra.
    asks = {"incidence_deg": asked.incidence_deg is None, "pane_shift": asked.ghost_shift is None and tells_shift}
    free = tuple(name for name in _OF_SCENE if asks[name])
    fit = tiles.nearest(window, scene.index, free)
    by_tiles = tiles.errors(fit, free)
    if len(fit.misfits) < LEAST_TILES or not np.all(np.isfinite(by_tiles)):
        return scene, errors
    wider = _WIDER if scene.has_ghosts else {"incidence_deg": _IN_PLACE_WIDER}
    numbers: dict[str, Any] = {}
    known: dict[str, Any] = {}
    for name, error in zip(free, by_tiles, strict=True):
        before = getattr(errors, _OF_SCENE[name])
        others = getattr(window, name), math.inf if before is None else before
        told = getattr(fit.window, name), wider[name] * float(error)
        if name != "incidence_deg":
            mean = weighted_mean(others, told, _SUREST)
        elif contradicts(told, others):
            return scene, errors
        else:
            mean = weighted_incidence(others, told)
        numbers[_OF_SCENE[name]], known[_OF_SCENE[name]] = mean
    return scene.replace(**numbers), replace(errors, **known)


def contradicts(told: tuple[float, float], others: tuple[float, float]) -> bool:
    """Whether the incidence by tiles is none that others leave possible; each with its standard error, in degrees."""
    apart = abs(told[0] - others[0])
    return apart > (_CONTRADICTS if apart <= _FAR_DEG else _CONTRADICTS_FAR) * math.hypot(told[1], others[1])
