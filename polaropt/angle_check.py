"""Whether polarizer angles are counted as the image shows them: what ghosts, and a wide lens, say against it."""

from __future__ import annotations

import math
from enum import Enum

import numpy as np

from polaropt.angle_frame import LEAST_DEG, LOWER_DEG, MOST_DEG, ghost_direction, start_unknown
from polaropt.attempts import SCATTERS, noise_misfit
from polaropt.capture import Capture
from polaropt.perspective_fit import fit_perspective
from polaropt.plate_frame import StokesImages, stokes_images
from polaropt.scene import SceneParameters
from polaropt.scene_estimation import SceneEstimate

_ALONG = 4e-3
"""Log likelihood per frequency that ghosts along the azimuth gain where there is no doubt about the angles."""
_ELSEWHERE_DEG = 12.0
_MIRRORED_DEG = 6.0
_UNEXPLAINED = 1.5
_EXPLAINED = 0.8


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
    if estimate is None or not estimate.polarized or start_unknown(capture):
        return None
    if unexplained > _UNEXPLAINED or scene.rung == "curved":
        return AngleMistake.REVERSED if _fits_reversed(capture, noise, unexplained) else None
    if scene.single_surface or scene.focal_px is not None or scene.polarized or _ghosts_along(estimate):
        return None
    incidence, azimuth, _ = scene.values()
    if not LEAST_DEG <= incidence <= MOST_DEG - min(LOWER_DEG):
        return None
    found = ghost_direction(capture, noise, incidence, azimuth)
    if not found.certain or abs(found.start_deg) < _ELSEWHERE_DEG:
        return None
    mirrored = (found.direction_deg + found.azimuth_deg + 90) % 180 - 90
    return AngleMistake.REVERSED if abs(mirrored) < _MIRRORED_DEG else AngleMistake.ROTATED


def _ghosts_along(estimate: SceneEstimate) -> bool:
    """Whether ghosts along the azimuth are beyond doubt."""
    without = np.abs(estimate.shift_grid) < 1e-9
    return bool(without.any()) and float(estimate.shift_misfit[without][0]) > _ALONG


def _fits_reversed(capture: Capture, noise: float, unexplained: float) -> bool:
    """Whether a pane before a wide lens explains the capture with its angles counted the other way, and only so."""
    stokes = stokes_images(capture, noise)
    mirror = np.array([1, 1, -1])
    images = stokes.images * mirror[:, None, None, None].astype(np.float32)
    fit = fit_perspective(StokesImages(images, stokes.covariance * np.outer(mirror, mirror), stokes.valid))
    gained = unexplained - fit.misfit
    clearly = gained > SCATTERS * math.sqrt(2 / fit.n) and gained > _EXPLAINED * (unexplained - 1)
    return clearly and fit.misfit < noise_misfit(fit.n)
