"""Where the polarizer's angles start and which way they count, as ghosts and a wide lens tell.

Polarization gives the azimuth in the filter's frame, ghosts give it in the image. Ghosts along another direction than
the azimuth therefore say how far the filter's zero is turned from the image's x axis. One capture cannot tell a filter
that is turned from one whose angles count the other way: both are a difference between the two directions.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from enum import Enum

import numpy as np
from numpy.typing import NDArray

from polaropt.capture import Capture, check_capture, plate_frame, registered_noise, stokes_images
from polaropt.estimation.flat.estimate import LEAST_NOISE, SceneEstimate, estimate_scene
from polaropt.estimation.flat.ghosts import CrossSpectra, ShiftLikelihood, cross_spectra
from polaropt.estimation.rung import noise_misfit
from polaropt.estimation.wide.blocks import SCATTERS, PolarizedBlocks
from polaropt.estimation.wide.fits import fit_perspective
from polaropt.numerics import grid_minimum, jackknife_error, turn_between
from polaropt.optics import SceneParameters

Curve = NDArray[np.float64]

_OPEN = SceneParameters(None, None, None)
# Directions of ghosts and shifts in pixels that are looked at, and around the best ones. Set by hand.
_DIRECTIONS_DEG: Curve = np.arange(0, 180, 10.0)
_SHIFTS: Curve = np.arange(-16, 17.0)
_FINE_DEG: Curve = np.arange(-10, 10.5, 2.5)
_FINE_SHIFTS: Curve = np.arange(-4, 4.5) / 2
# Steps of the fit of the layers' spectra. Set by hand.
_ROUNDS = 2
_APART_DEG = 25.0
"""Directions closer than this share ghosts. Set by hand."""
_RIVAL = 0.6
"""Share of the likeliest direction's gain that others may have. By trial."""
_GAIN, _GAIN_LOWER = 8e-3, 20e-3
"""Measured log likelihood per frequency that ghosts must gain: edges that look like ghosts gain up to 6e-3, at a lower
incidence than the one found up to 15e-3."""
_STEADY_PX = 0.3
"""Standard error of the shift. Measured: a pane's ghosts have one shift all over the frame, whatever part is left out:
its error is mostly below 0.1. Edges of a few things in the picture gain as much, but their shift, or its sense, hangs
on those: its error is above 0.45."""
_EXCHANGED_DEG, _EXCHANGED = 56.0, 1.6
"""Incidence from which on the axis across may have been taken, about Brewster's angle of glass, and how many times as
much ghosts must gain on the other. By trial."""
_OBLIQUE_DEG = 60.0
LOWER_DEG = (-5.0, -2.5, 0.0)
"""Ghosts along another direction than supposed make a pane look more oblique than it is, from 60 degrees on: lower
incidences are looked at, too. By trial."""
LEAST_DEG, MOST_DEG = 32.0, 76.0
"""Between these incidences ghosts are bright and edges no match for them. By trial."""
_MOST_LEFT = 4.0
"""Polarized light that a constant azimuth may leave, in mean squares of its noise: what is left looks like ghosts, too.
By trial."""


@dataclass(frozen=True)
class GhostDirection:
    """The likeliest direction of ghosts in the image, whatever the azimuth of the polarized light.

    Attributes
    ----------
    direction_deg : float
        Counter-clockwise from x, modulo 180.
    azimuth_deg, incidence_deg : float
        Of the pane, the azimuth in the frame of the capture's angles, modulo 180.
    gain : float
        Log likelihood per frequency that ghosts in this direction gain over none.
    rival : float
        What they gain in the best of the directions well apart from it.
    least : float
        What they must gain to be believed.
    shift_px, shift_error_px : float
        Their shift, and its standard error, by leaving parts of the frame out; infinite where they gain too little to
        ask.
    """

    direction_deg: float
    azimuth_deg: float
    incidence_deg: float
    gain: float
    rival: float
    least: float
    shift_px: float
    shift_error_px: float

    @property
    def certain(self) -> bool:
        """Whether the ghosts tell a direction at all."""
        told = self.gain > self.least and self.rival < _RIVAL * self.gain and self.shift_error_px < _STEADY_PX
        return told and LEAST_DEG <= self.incidence_deg <= MOST_DEG

    @property
    def elsewhere(self) -> bool:
        """Whether they surely lie along another direction than the azimuth."""
        aside_px = abs(self.shift_px * math.sin(math.radians(self.start_deg)))
        beside = aside_px > _ELSEWHERE * max(self.shift_error_px, _LEAST_ASIDE_PX)
        return self.certain and beside and abs(self.start_deg) >= _ELSEWHERE_DEG

    @property
    def start_deg(self) -> float:
        """Angle from the image's x axis to the polarizer's zero, -90 to 90."""
        return turn_between(self.direction_deg, self.azimuth_deg)


def find_start_angle(capture: Capture) -> Capture:
    """Find where a capture's polarizer angles start from, if only the steps between them are known.

    Parameters
    ----------
    capture : Capture
        Its angles count from an unknown start.

    Returns
    -------
    Capture
        With angles from the image's x axis, if the ghosts tell the start (`origin.start_deg`); else with its own ones
        and a note (`origin.start_unknown`) that double images and wide lenses, which need it, cannot be modelled.

    Raises
    ------
    InputError
        It is no capture.

    Examples
    --------
    The polarizer stood at 25, 70, 115 and 160 degrees, of which the steps alone are known:

    >>> from skimage.data import astronaut, coffee
    >>> from polaropt import Capture, SceneParameters, find_start_angle, simulate
    >>> layers = coffee()[90:282, 180:372], astronaut()[:192, 150:342]
    >>> taken = simulate(*layers, SceneParameters(60.0, 20.0, 6.0), angles_deg=(25, 70, 115, 160))
    >>> found = find_start_angle(taken.replace(angles_deg=(0, 45, 90, 135)))
    >>> found.start_unknown, abs(found.origin.start_deg - 25) < 3
    (False, True)
    """
    registered = check_capture(capture).registered
    noise = registered_noise(capture)
    incidence, azimuth, _ = estimate_scene(registered, _OPEN.replace(ghost_shift=0.0), noise=noise).scene.values()
    found = ghost_direction(registered, noise, incidence, azimuth)
    left = PolarizedBlocks(stokes_images(registered, noise)).constant_misfit(azimuth)
    if not found.certain or left > _MOST_LEFT:
        return capture.with_origin(start_unknown=True)
    angles = tuple((angle + found.start_deg) % 180 for angle in capture.angles_deg)
    return capture.replace(angles_deg=angles).with_origin(start_unknown=False, start_deg=found.start_deg)


def ghost_direction(
    capture: Capture, noise: float, incidence_deg: float, azimuth_deg: float, pane: SceneParameters = _OPEN
) -> GhostDirection:
    """Search the direction of ghosts freely.

    Parameters
    ----------
    capture : Capture
    noise : float
        Standard deviation of the noise of one photograph.
    incidence_deg, azimuth_deg : float
        Of the pane as far as polarization and edges tell them, ghosts apart.
    pane : SceneParameters
        Index and surfaces of the pane; its geometry is not used.
    """
    noise = max(noise, LEAST_NOISE)
    pane = _OPEN.replace(refractive_index=pane.refractive_index, single_surface=pane.single_surface)
    found = _of_axis(capture, noise, incidence_deg, azimuth_deg, pane)
    if not found.certain or incidence_deg < _EXCHANGED_DEG:
        return found
    # Where the axis across was taken for the right one, its layers exchanged, ghosts gain more on the right one.
    given = pane.replace(azimuth_deg=azimuth_deg + 90, ghost_shift=0.0)
    across_incidence = estimate_scene(capture, given, noise=noise).scene.values()[0]
    across = _of_axis(capture, noise, across_incidence, azimuth_deg + 90, pane)
    return replace(found, rival=across.gain) if across.gain > _EXCHANGED * found.gain else found


def _of_axis(
    capture: Capture, noise: float, incidence_deg: float, azimuth_deg: float, pane: SceneParameters
) -> GhostDirection:
    spectra = cross_spectra(plate_frame(stokes_images(capture, noise), azimuth_deg))
    found = _likeliest(spectra, pane, np.array([incidence_deg]), _GAIN)
    if not found.certain and incidence_deg > _OBLIQUE_DEG:
        lower = _likeliest(spectra, pane, incidence_deg + np.array(LOWER_DEG), _GAIN_LOWER)
        found = lower if lower.certain else found
    return found


def _likeliest(spectra: CrossSpectra, pane: SceneParameters, incidences: Curve, least: float) -> GhostDirection:
    """The direction in which ghosts gain most, at any of some incidences."""
    gains = np.empty(_DIRECTIONS_DEG.shape)
    places = []
    for k, direction in enumerate(_DIRECTIONS_DEG):
        likelihood = ShiftLikelihood(spectra.with_ghosts_along(float(direction)), pane)
        misfit = likelihood.misfit(incidences, _SHIFTS, rounds=_ROUNDS)
        places.append(np.unravel_index(np.argmin(misfit), misfit.shape))
        gains[k] = misfit[:, _SHIFTS.size // 2].min() - misfit.min()
    best = int(np.argmax(gains))
    apart = np.abs(turn_between(_DIRECTIONS_DEG, _DIRECTIONS_DEG[best])) > _APART_DEG
    row, column = places[best]
    direction, incidence, error = float(_DIRECTIONS_DEG[best]), float(incidences[row]), math.inf
    shift = float(_SHIFTS[column])
    if gains[best] > least:
        direction = _refined(spectra, pane, incidence, shift, direction)
        error = _shift_error(spectra.with_ghosts_along(direction), pane, incidence)
    azimuth, rival = spectra.azimuth_deg % 180, float(gains[apart].max())
    return GhostDirection(direction % 180, azimuth, incidence, float(gains[best]), rival, least, shift, error)


def _refined(
    spectra: CrossSpectra, pane: SceneParameters, incidence_deg: float, ghost_shift: float, direction_deg: float
) -> float:
    """The likeliest direction near one, the shift free to follow."""
    shifts = ghost_shift + _FINE_SHIFTS
    turned = [spectra.with_ghosts_along(direction_deg + turn) for turn in _FINE_DEG]
    misfit = np.array([ShiftLikelihood(part, pane).misfit(incidence_deg, shifts).min() for part in turned])
    return direction_deg + grid_minimum(_FINE_DEG, misfit)


def _shift_error(spectra: CrossSpectra, pane: SceneParameters, incidence_deg: float) -> float:
    """Standard error of the likeliest shift in pixels by the jackknife: each part is free to prefer any other shift."""
    shifts = []
    for part in spectra.left_out:
        misfit = ShiftLikelihood(part, pane).misfit(incidence_deg, _SHIFTS, rounds=_ROUNDS)
        shifts.append(grid_minimum(_SHIFTS, misfit))
    return jackknife_error(np.array(shifts))


_ELSEWHERE_DEG = 5.0
"""Angle between ghosts and azimuth from which on the angles start elsewhere. Of 17 single panes at 36 to 75 degrees
whose ghosts tell their direction (photographs that nothing was tuned on) it is off by 1.2 degrees, root mean square,
and by 2.9 at most."""
_ELSEWHERE, _LEAST_ASIDE_PX = 4.0, 0.2
"""Standard errors, and one at least, by which their images lie beside the azimuth then: patterns of the layers turn
those of ghosts a few pixels apart by 7 to 12 degrees. Set by hand."""
_MIRRORED_DEG, _MIRRORED_FROM_DEG = 6.0, 12.0
"""Angle up to which ghosts lie along the azimuth's mirror image, and between both from which on the sense is more often
wrong than where the angles start. Set by hand."""
_UNEXPLAINED = 1.5
"""Polarized light across, in mean squares of its noise, from which on the reversed sense is looked at. Set by hand."""
_EXPLAINED = 0.8
"""Share of it that a pane must explain with the sense reversed. Set by hand."""


class AngleMistake(Enum):
    """What is wrong with the angles."""

    REVERSED = "reversed"
    ROTATED = "rotated"


def angle_mistake(
    capture: Capture, noise: float, scene: SceneParameters, estimate: SceneEstimate | None, unexplained: float = 1.0
) -> AngleMistake | None:
    """What the image says against the polarizer angles.

    A constant azimuth takes up any start and sense of the angles; the image has to contradict. Ghosts lie along the
    azimuth: where they lie along another direction the angles start elsewhere, and if that direction is the azimuth's
    mirror image they more likely count the other way. Before a wide lens the azimuth turns over the frame: if the
    capture fits a flat pane with the sense reversed only, it is, and no bent pane is needed.

    Parameters
    ----------
    capture : Capture
    noise : float
        Standard deviation of the noise of one photograph.
    scene : SceneParameters
        The scene that was found.
    estimate : SceneEstimate or None
        How; None where nothing was estimated, and nothing is checked.
    unexplained : float
        Light polarized at 45 degrees to the plane of incidence that the scene leaves, in units of its noise.

    Returns
    -------
    AngleMistake or None
        None where nothing is said against them.
    """
    if estimate is None or not estimate.polarized or capture.start_unknown:
        return None
    if unexplained > _UNEXPLAINED or scene.rung == "curved":
        return AngleMistake.REVERSED if _fits_reversed(capture, noise, scene, unexplained) else None
    if scene.single_surface or scene.focal_px is not None or scene.polarized:
        return None
    if _gap_is_turned(scene):
        return None
    incidence, azimuth, _ = scene.values()
    # The low pass of a mosaic's cells, and what aliases there, passes for ghosts in any direction: of 123 mosaics with
    # right angles 7 were told that theirs start elsewhere, of 97 whose angles do one.
    if capture.low_passed or not LEAST_DEG <= incidence <= MOST_DEG - min(LOWER_DEG):
        return None
    found = ghost_direction(capture, noise, incidence, azimuth, scene)
    if not found.elsewhere:
        return None
    mirrored = turn_between(found.direction_deg, -found.azimuth_deg)
    reversed_sense = abs(mirrored) < _MIRRORED_DEG and abs(found.start_deg) > _MIRRORED_FROM_DEG
    return AngleMistake.REVERSED if reversed_sense else AngleMistake.ROTATED


def _gap_is_turned(scene: SceneParameters) -> bool:
    """Whether panes of a window have images beside the azimuth: what was found tells more than their direction."""
    if not scene.stacked or not scene.gap_shift or scene.gap_azimuth_deg is None:
        return False
    turned = turn_between(scene.gap_azimuth_deg, scene.values()[1])
    return abs(turned) > _ELSEWHERE_DEG


def _fits_reversed(capture: Capture, noise: float, scene: SceneParameters, unexplained: float) -> bool:
    """Whether a pane before a wide lens explains the capture with its angles counted the other way, and only so."""
    stokes = stokes_images(capture, noise)
    incidence, azimuth, _ = scene.values()
    plain = SceneParameters(incidence, -azimuth, 0.0, scene.index, single_surface=scene.single_surface)
    fit = fit_perspective(stokes.reversed(), plain=plain)
    gained = unexplained - fit.misfit
    clearly = gained > SCATTERS * math.sqrt(2 / fit.n) and gained > _EXPLAINED * (unexplained - 1)
    return clearly and fit.misfit < noise_misfit(fit.n)
