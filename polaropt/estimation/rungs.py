"""The rungs above the plain pane: each one attempt to explain the polarized light that the plain pane leaves.

A rung is one line of `RUNGS`: when it can help, and the attempt. What it changes of a scene is its own business.
"""

from __future__ import annotations

import math
from dataclasses import replace
from functools import partial

from polaropt.estimation.flat.errors import weighted_incidence
from polaropt.estimation.polarized.lens import fit_polarized_perspective
from polaropt.estimation.polarized.mixing import Mixture, looks_polarized
from polaropt.estimation.polarized.search import PolarizedFit, fit_polarized
from polaropt.estimation.rung import LEAST_EXPLAINED, Evidence, Rung, RungFit, noise_misfit
from polaropt.estimation.wide.blocks import SCATTERS
from polaropt.estimation.wide.edges import MOST_NEGATIVE, negative_light
from polaropt.estimation.wide.fits import (
    PerspectiveFit,
    fit_curved,
    fit_perspective,
    fit_told_perspective,
    fit_tolerant,
)
from polaropt.estimation.wide.ghosts import VaryingSpectra
from polaropt.estimation.wide.pane import LONGEST, STEEPEST
from polaropt.optics import SceneErrors, SceneParameters

# Standard error of its incidence up to which a pane that is not seen from far is known. Set by hand.
_WORST_ERROR_DEG = 3.0
# Distance in degrees from the end of a search up to which it ended there. Set by hand.
_AT_END_DEG = 0.01
# Share of what the plain pane leaves that a bent one must explain on large blocks to be looked at closely. By trial.
_LEAST_BENT = 0.4
# Share of what the plain pane leaves that a pane must explain where only blocks that agree count. By trial.
_MOSTLY = 0.8
# The same of a pane before a lens where the light of its layers may be polarized as well, which has most numbers, or
# where incidence or azimuth are told. By trial.
_NEARLY_ALL = 0.97
# Share of what the plain pane leaves that may lie off the plane of two Stokes vectors, from and up to, where polarized
# light may explain all, or most. By trial.
_ALL_BUT, _MOST_BUT = (-math.inf, 0.2), (0.2, 0.7)
# Misfit, in units of the noise, up to which a wrong pane may leave so little because polarized light mimics it. By
# trial.
_LITTLE = 2.0
# Score, in minus log likelihood per frequency and colour, that polarized light must gain, and where nothing but edges
# and spectra speaks of it. By trial.
_LEAST_GAIN, _LEAST_GAIN_OF_EDGES = 0.004, 0.03
# Standard error in degrees of a bent pane's incidence by edges that ghosts double, beside their own: of five random
# windows to fit on, root mean square.
_DOUBLED_DEG = 1.6
# Standard error of an incidence in degrees below which spectra of parts of the frame have nothing to add. Set by hand.
_SURER_DEG = 0.5
_NO_TURN_TOLD = "The polarized light does not tell how incidence and azimuth change over the picture."
_AGAINST_EDGES = "The layers' edges speak against it."


def _may_vary(evidence: Evidence) -> bool:
    """Whether incidence and azimuth over the frame are for us to find, and something is left to explain."""
    asked = evidence.asked
    free = asked.incidence_deg is None and asked.azimuth_deg is None
    # How the azimuth turns over the frame means nothing where the frame's own angle is unknown.
    free = free and not evidence.capture.start_unknown
    return free and (evidence.wanted != "auto" or not evidence.explained)


def _plain(evidence: Evidence) -> SceneParameters:
    """The plain pane with the ghost shifts that were asked for, else with all bounces in place."""
    asked = evidence.asked
    return evidence.estimate.scene.replace(
        ghost_shift=asked.ghost_shift or 0.0, transmission_ghost_shift=asked.transmission_ghost_shift
    )


def with_ghosts(evidence: Evidence, attempt: RungFit) -> RungFit:
    """An attempt whose pane varies over the frame, with the ghost shift that the capture shows if that is open."""
    scene = attempt.scene
    # The likelihood of ghosts where incidence varies knows unpolarized light alone.
    if (
        not scene.varies
        or scene.polarized
        or evidence.asked.ghost_shift is not None
        or scene.single_surface
        or scene.n_bounces == 0
        or scene.stacked
    ):
        return attempt
    error = attempt.errors.incidence_deg or 0.0
    # Only a bent pane's incidence is told by edges alone.
    spectra = VaryingSpectra(evidence.stokes, scene, steady=not scene.bent or evidence.stokes.aliased)
    found, remark = spectra.likeliest_shift(), attempt.remark
    if found.shows:
        scene = scene.replace(ghost_shift=found.pixels)
        remark = f"{remark} Its double images lie {abs(found.pixels):.1f} px apart.".strip()
    incidence, _, shift = scene.values()
    if scene.bent and scene.has_ghosts:
        # Edges, which alone tell a bent pane's incidence, were looked at as if there were none.
        error = math.hypot(error, _DOUBLED_DEG)
    told = spectra.incidence(shift) if error > _SURER_DEG and not evidence.stokes.aliased else None
    if told is None:
        return replace(attempt, scene=scene, remark=remark)
    mean, error = weighted_incidence((incidence, error), (incidence + told[0], told[1]))
    errors = replace(attempt.errors, incidence_deg=error)
    return replace(attempt, scene=scene.replace(incidence_deg=mean), remark=remark, errors=errors)


def _may_be_told_to_vary(evidence: Evidence) -> bool:
    """Whether a lens is asked for, or something is left to explain, and incidence or azimuth are not for us to find."""
    asked = evidence.asked
    told = asked.incidence_deg is not None or asked.azimuth_deg is not None
    wanted = evidence.wanted == "perspective" or (evidence.wanted == "auto" and not evidence.explained)
    return told and wanted and not evidence.capture.start_unknown


def _told_perspective(evidence: Evidence) -> RungFit:
    """What is told of the pane stays as it is; the rest of it, and a lens that nothing tells, are fitted."""
    asked, told = evidence.asked, evidence.focal_px is not None
    azimuth, remark = asked.azimuth_deg, ""
    fit = fit_told_perspective(evidence.stokes, asked.incidence_deg, azimuth, evidence.focal_px)
    if azimuth is not None:
        # From far both are the same.
        opposite = (azimuth + 180) % 360
        other = fit_told_perspective(evidence.stokes, asked.incidence_deg, opposite, evidence.focal_px)
        if fit.misfit - other.misfit > SCATTERS * evidence.scatter:
            azimuth, fit = opposite, other
            remark = f"It leans to the other side than told: its azimuth is {opposite:.0f} degrees."
    incidence = fit.incidence_deg if asked.incidence_deg is None else asked.incidence_deg
    focal = evidence.focal_px or fit.focal_px
    scene = _plain(evidence).replace(
        incidence_deg=incidence, azimuth_deg=fit.azimuth_deg if azimuth is None else azimuth, focal_px=focal
    )
    errors = SceneErrors(
        fit.incidence_error_deg if asked.incidence_deg is None else None,
        fit.azimuth_error_deg if azimuth is None else None,
        focal_px=None if told else fit.focal_error_px,
    )
    known = evidence.wanted == "perspective"
    if not known:
        # Light that is polarized itself passes in part for a lens, of a pane that is nearly frontal.
        known = evidence.share_explained(fit.misfit) >= _NEARLY_ALL
        known &= evidence.shown(fit.misfit) and fit.incidence_error_deg <= _WORST_ERROR_DEG
        remark = remark if known else _NO_TURN_TOLD
    return RungFit(scene, fit.misfit, 2 - told, known, remark, errors)


def _perspective(evidence: Evidence) -> RungFit:
    fit, told = _best_fit(evidence)
    told_well = evidence.shown(fit.misfit) and fit.incidence_error_deg <= _WORST_ERROR_DEG
    if evidence.misfit - fit.misfit < LEAST_EXPLAINED * (evidence.misfit - 1) and not evidence.explained:
        tolerant = _tolerant(evidence)
        if tolerant is not None:
            return tolerant
    asked = evidence.wanted == "perspective"
    if asked and not told_well:
        return _from_afar(evidence)
    focal = evidence.focal_px if told else fit.focal_px
    scene = _plain(evidence).replace(incidence_deg=fit.incidence_deg, azimuth_deg=fit.azimuth_deg, focal_px=focal)
    negative = negative_light(evidence.blocks, scene)
    known = asked or (told_well and negative <= MOST_NEGATIVE)
    remark = _NO_TURN_TOLD
    if told_well and not known:
        remark = _less_than_no_light(negative)
    elif known and not (fit.edges_agree or asked):
        remark = "The layers' edges tell another incidence: the pane is not flat."
    elif known:
        refused = evidence.focal_px is not None and not told
        remark = "The focal length that the file tells does not fit." if refused else ""
    errors = SceneErrors(fit.incidence_error_deg, fit.azimuth_error_deg, focal_px=None if told else fit.focal_error_px)
    flat = fit.edges_agree or asked
    return RungFit(
        scene, fit.misfit, 2 if told else 3, known and flat, remark, errors, second_choice=known and not flat
    )


def _less_than_no_light(share: float) -> str:
    return f"A layer would have less than no light in {100 * share:.0f} % of the picture."


def _tolerant(evidence: Evidence) -> RungFit | None:
    """The pane that most of the frame agrees on where part of the scene is polarized itself; None without one."""
    found = fit_tolerant(evidence.stokes, evidence.estimate.scene, evidence.focal_px, _MOSTLY)
    fit, told = found.pane, evidence.focal_px
    # Blocks that count little agree with the steepest pane of all, too: there is no minimum.
    well = fit.incidence_error_deg <= _WORST_ERROR_DEG and fit.incidence_deg < math.degrees(STEEPEST) - _AT_END_DEG
    if not (fit.edges_agree and well and found.explained >= _MOSTLY):
        return None
    scene = _plain(evidence).replace(
        incidence_deg=fit.incidence_deg, azimuth_deg=fit.azimuth_deg, focal_px=told or fit.focal_px
    )
    misfit = evidence.blocks.misfit(fit.incidence_deg, fit.azimuth_deg, told or fit.focal_px)
    errors = SceneErrors(fit.incidence_error_deg, fit.azimuth_error_deg, focal_px=None if told else fit.focal_error_px)
    remark = "That is where most of the picture agrees; the rest of the scene may be polarized itself."
    agreed = 1 + (1 - min(found.explained, 1.0)) * (evidence.misfit - 1)
    return RungFit(scene, misfit, 2 if told else 3, True, remark, errors, agreed)


def _best_fit(evidence: Evidence) -> tuple[PerspectiveFit, bool]:
    """Pane and camera, and whether the focal length is the one told: a file may have been cropped since."""
    fit = fit_perspective(evidence.stokes, evidence.focal_px, evidence.estimate.scene)
    asked = evidence.asked.focal_px is not None
    if asked or evidence.focal_px is None or fit.misfit <= noise_misfit(evidence.blocks.n):
        return fit, evidence.focal_px is not None
    free = fit_perspective(evidence.stokes, None, evidence.estimate.scene)
    clearly = fit.misfit - free.misfit > SCATTERS * evidence.scatter
    return (free, False) if clearly else (fit, True)


def _from_afar(evidence: Evidence) -> RungFit:
    """The perspective rung where polarized light does not tell the tilt: the plain pane, seen by the lens."""
    focal = evidence.focal_px or LONGEST * max(evidence.capture.shape[-2:])
    incidence, azimuth, _ = evidence.estimate.scene.values()
    ways = (azimuth % 360, (azimuth + 180) % 360)
    leaning = min(ways, key=lambda way: evidence.blocks.misfit(incidence, way, focal))
    scene = _plain(evidence).replace(azimuth_deg=leaning, focal_px=focal)
    misfit = evidence.blocks.misfit(incidence, leaning, focal)
    remark = "Incidence and azimuth are those of the plain pane."
    return RungFit(scene, misfit, 1, True, remark, evidence.estimate.errors)


def _curved(evidence: Evidence) -> RungFit:
    plain = evidence.estimate.scene
    asked = evidence.wanted == "curved"
    # A pane that leaves most of it is not bent so: its edges are not worth their time.
    fit = fit_curved(evidence.stokes, plain, evidence.focal_px, 0.0 if asked else _LEAST_BENT)
    told = evidence.shown(fit.misfit) and fit.incidence_error_deg <= _WORST_ERROR_DEG
    scene = _plain(evidence).replace(
        incidence_deg=fit.incidence_deg,
        azimuth_deg=fit.azimuth_deg,
        focal_px=fit.focal_px,
        bend_deg_per_px=fit.bend_deg_per_px,
    )
    negative = negative_light(evidence.blocks, scene) if told else 0.0
    known = asked or (told and negative <= MOST_NEGATIVE and fit.edges_agree)
    remark = "" if known else "The polarized light does not tell how the pane is bent."
    if told and not known:
        remark = _AGAINST_EDGES if negative <= MOST_NEGATIVE else _less_than_no_light(negative)
    lens_found = evidence.focal_px is None and fit.focal_px is not None
    errors = SceneErrors(
        fit.incidence_error_deg,
        fit.azimuth_error_deg,
        focal_px=fit.focal_error_px if lens_found else None,
        bend_deg_per_px=fit.bend_error_deg_per_px,
    )
    return RungFit(scene, fit.misfit, 5 + lens_found, known, remark, errors)


def _may_be_polarized(evidence: Evidence, off: tuple[float, float] = _ALL_BUT) -> bool:
    """Whether constant polarization of the layers' light may explain what is left, or edges speak of it."""
    asked, first = evidence.asked, off == _ALL_BUT
    if asked.stacked:
        return False
    if evidence.wanted == "polarized":
        return first and not asked.polarized and asked.focal_px is None
    if not evidence.light_is_open or evidence.gains_explain:
        return False
    if evidence.explained:
        # Frontal glass polarizes so little that a slight polarization of either layer would do as well, and the
        # transmission does not need to know.
        return evidence.is_oblique and first and _edges_look_polarized(evidence)
    return off[0] <= (Mixture(evidence.stokes).misfit - 1) / (evidence.most_shown - 1) < off[1]


def _edges_look_polarized(evidence: Evidence) -> bool:
    """Whether edges and spectra speak of polarized light that a plain pane explains; of a mosaic, tiles must, too."""
    if evidence.tiles_tell_light and evidence.light_of_tiles is None:
        return False
    return looks_polarized(evidence.stokes, evidence.estimate.scene)


def _polarized(evidence: Evidence) -> RungFit:
    plain = evidence.estimate.scene
    fit = fit_polarized(evidence.stokes, evidence.asked, plain)
    if fit is None:
        return RungFit(plain, evidence.misfit, 1, False, "No polarization of the layers' light explains it.")
    misfit = _left_by(fit, evidence)
    enough = _LEAST_GAIN if evidence.misfit > _LITTLE else _LEAST_GAIN_OF_EDGES
    enough = 0.0 if misfit <= noise_misfit(evidence.blocks.n) < evidence.misfit else enough
    known = evidence.wanted == "polarized" or fit.gain > enough
    remark = "" if known else "Polarized light makes it hardly any likelier."
    told = fit.gain > _LEAST_GAIN_OF_EDGES
    return RungFit(fit.scene, misfit, 5, known, remark, fit.errors, told_by_edges=told, rivals=fit.rivals)


def _left_by(fit: PolarizedFit, evidence: Evidence) -> float:
    """Polarized light that a pane before polarized light leaves, as `Evidence.misfit`.

    Spectra know of images that lie apart, but not of what aliases in a mosaic's cells, which blocks count as noise.
    Before frontal glass what aliases would do for polarized light itself.
    """
    if not evidence.stokes.aliased or not evidence.is_oblique:
        return fit.misfit
    of_blocks = evidence.blocks.plane_misfit(fit.shown)
    return min(of_blocks, fit.misfit / evidence.blocks.aliases**2) if fit.scene.has_ghosts else of_blocks


def _may_be_polarized_and_vary(evidence: Evidence) -> bool:
    """Whether light may be polarized and incidence vary: both are for us to find, and something is left to explain."""
    open_light = not evidence.asked.polarized and not evidence.explained
    return _may_vary(evidence) and open_light and (evidence.wanted == "polarized" or not evidence.gains_explain)


def _polarized_perspective(evidence: Evidence) -> RungFit:
    fit = fit_polarized_perspective(evidence.stokes, _plain(evidence), evidence.asked.focal_px)
    told = (fit.errors.incidence_deg or 0.0) <= _WORST_ERROR_DEG
    nearly_all = evidence.share_explained(fit.misfit) >= _NEARLY_ALL and evidence.shown(fit.misfit)
    known = told and nearly_all and fit.negative <= MOST_NEGATIVE
    remark = "Incidence and azimuth change over the picture." if known else "Nor does it before a lens."
    if fit.negative > MOST_NEGATIVE:
        remark = _less_than_no_light(fit.negative)
    return RungFit(fit.scene, fit.misfit, fit.n_parameters, known, remark, fit.errors)


RUNGS = (
    Rung("polarized", _may_be_polarized, _polarized),
    Rung("perspective", _may_be_told_to_vary, _told_perspective),
    Rung("perspective", _may_vary, _perspective),
    Rung("curved", _may_vary, _curved),
    Rung("polarized", _may_be_polarized_and_vary, _polarized_perspective),
    Rung("polarized", partial(_may_be_polarized, off=_MOST_BUT), _polarized),
)
