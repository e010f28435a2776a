"""What keeps a separation from being worse than none where something is wrong with the photographs."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from polaropt.capture import (
    MOST_NEGATIVE,
    Capture,
    Mistakes,
    align,
    correlated_noise,
    noise_level,
    noise_of_rounded_blocks,
)
from polaropt.errors import InputError
from polaropt.estimation.flat.estimate import SceneEstimate, estimate_scene
from polaropt.estimation.flat.window import MOST_FOUND
from polaropt.estimation.ladder import LadderResult, RungReport
from polaropt.optics import INCIDENCE_LIMITS_DEG, SceneParameters, in_place_correction

# Share by which a given incidence may correct the layers more or less than the one found. Set by hand.
_MUCH_CORRECTION = 1 / 3
# Standard errors of the incidence found within which any may be right: 95 % of a normal distribution.
_SURE = 2.0
# How many times the right correction leaves the transmission as far off as none at all, on the other side.
_NO_BETTER = 2
# Incidences that are looked at within these errors. Set by hand.
_N_INCIDENCES = 5
_PLAIN = ("pixelwise", "ghosts")


def mended(capture: Capture, mistakes: Mistakes) -> Capture:
    """The photographs as the scene is estimated from them: moved onto each other, and linear.

    Edges that do not lie on each other, and contrasts that an encoding has changed, look like polarized light. The
    layers suffer little from half a pixel; but the estimate may then find another pane, one across with its layers
    exchanged, and everything is lost. The layers themselves are those of the photographs as they were given.
    """
    if mistakes.shift_px:
        try:
            return align(capture)
        except InputError:
            return capture
    return linear(capture, mistakes.gamma) if mistakes.encoded else capture


class SceneSource(NamedTuple):
    """What a scene is estimated from.

    Attributes
    ----------
    white : Capture
        Photographs whose noise is white, or nearly so.
    smooth : Capture
        The same as they were taken, where neighbours have noise in common: for what is told by gradients, which making
        it white steepens at edges.
    noise : float
        Of one photograph, white; that of means over blocks is the same in both.
    """

    white: Capture
    smooth: Capture
    noise: float


def scene_source(capture: Capture, noise: float, mistakes: Mistakes) -> SceneSource:
    """The photographs that the scene is estimated from, see `mended`, and the noise of one of them.

    What the scene is told by are means over blocks: the noise is theirs, where coarse grey levels make it another.
    """
    source = mended(capture, mistakes)
    noise = noise if source is capture else noise_level(source)
    spectrum = correlated_noise(source, noise)
    if spectrum is None:
        return SceneSource(source, source, noise_of_rounded_blocks(source, noise))
    return SceneSource(spectrum.whitened(source), source, noise * spectrum.slow)


@dataclass(frozen=True)
class CheckedScene:
    """What is to be found of a scene, and whether the photographs speak against the incidence that was given.

    It is harmful where the layers would be further from the truth than the plain intensity is.
    """

    scene: SceneParameters
    doubtful: bool = False
    harmful: bool = False


def with_incidence_checked(source: Capture, asked: SceneParameters, noise: float) -> CheckedScene:
    """Compare an incidence that was given with the one that would be found.

    Where the layers would be corrected by a third too much or too little with it, the azimuth found without it is
    kept: with a wrong incidence the one across often seems to explain the photographs better.
    """
    # What is known of a single pane says nothing of several.
    if asked.incidence_deg is None or asked.plainest.complete or asked.stacked:
        return CheckedScene(asked)
    open_scene = asked.replace(incidence_deg=None, focal_px=None)
    found = estimate_scene(source, open_scene, noise=noise)
    if not found.polarized:
        return CheckedScene(asked)
    # Several panes look like one at a steeper angle.
    windows = [asked.replace(n_panes=n) for n in range(1, MOST_FOUND + 1)] if asked.n_panes is None else [asked]
    if any(abs(correction(window) / correction(found.scene) - 1) <= _MUCH_CORRECTION for window in windows):
        return CheckedScene(asked)
    azimuth = found.scene.azimuth_deg if asked.azimuth_deg is None else asked.azimuth_deg
    return CheckedScene(asked.replace(azimuth_deg=azimuth), doubtful=True, harmful=_overcorrected(asked, found))


def _overcorrected(asked: SceneParameters, found: SceneEstimate) -> bool:
    """Whether more than twice what is right would be taken off the intensity, by any incidence that may be right.

    The plain intensity is the whole correction off; more than twice that correction is further off on the other side.
    """
    lowest, highest = INCIDENCE_LIMITS_DEG
    incidence, error = found.scene.incidence_deg or 0.0, _SURE * min(found.errors.incidence_deg or 0.0, highest)
    near = np.clip(np.linspace(incidence - error, incidence + error, _N_INCIDENCES), lowest, highest)
    return correction(asked) > _NO_BETTER * max(
        correction(found.scene.replace(incidence_deg=float(angle))) for angle in near
    )


def left_alone(found: LadderResult, asked: CheckedScene) -> LadderResult:
    """The scene that was found, or none where the plain intensity is the better guess of the transmission.

    That is where a pane across, its layers exchanged, explains the photographs about as well, and where an incidence
    that was given would do harm. Who insists asks for a rung by its name.
    """
    estimate = found.estimate
    if estimate is None or not found.scene.signal:
        return found
    if asked.harmful:
        reason = "With the incidence that was given the transmission would be worse than the plain intensity."
    elif estimate.better_left and found.scene.rung in _PLAIN:
        reason = "A pane whose plane of incidence lies across explains the photographs about as well."
    else:
        return found
    scene = found.scene.replace(signal=False)
    tried = (*(replace(rung, taken=False) for rung in found.tried), RungReport("none", None, None, 0.0, True, reason))
    return LadderResult(scene, replace(estimate, scene=scene), tried)


def correction(scene: SceneParameters) -> float:
    """What is taken off the intensity for each unit of polarized light, all bounces in place."""
    incidence = max(INCIDENCE_LIMITS_DEG[0], scene.incidence_deg or 0.0)
    return in_place_correction(incidence, scene.index, *scene.sheets)


def linear(capture: Capture, gamma: float) -> Capture:
    """Photographs raised to a power; what noise has left below black stays there."""
    images = np.sign(capture.intensities) * np.abs(capture.intensities) ** np.float32(gamma)
    raised = capture.replace(intensities=np.maximum(images, MOST_NEGATIVE))
    return raised if capture.origin is None else raised.with_origin(raw_noise=None)
