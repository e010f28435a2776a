"""What keeps a separation from being worse than none where something is wrong with the photographs."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from polaropt.alignment import align
from polaropt.capture import MOST_NEGATIVE, Capture
from polaropt.errors import InputError
from polaropt.mistakes import Mistakes
from polaropt.noise import noise_level


def mended(capture: Capture, mistakes: Mistakes) -> Capture:
    """The photographs as the scene is estimated from them: moved onto each other, and linear.

    Edges that do not lie on each other, and contrasts that an encoding has changed, look like polarized light. The
    layers suffer little from half a pixel; but the estimate may then find another pane, one across with its layers
    exchanged, and everything is lost. The layers themselves are those of the photographs as they were given.
    """
    if mistakes.moved:
        try:
            return align(capture)
        except InputError:
            return capture
    return linear(capture, mistakes.gamma) if mistakes.encoded else capture


def scene_source(capture: Capture, noise: float, mistakes: Mistakes) -> tuple[Capture, float]:
    """The photographs that the scene is estimated from, see `mended`, and the noise of one of them."""
    source = mended(capture, mistakes)
    return (capture, noise) if source is capture else (source, noise_level(source))


def linear(capture: Capture, gamma: float) -> Capture:
    """Photographs raised to a power; what noise has left below black stays there."""
    images = np.sign(capture.intensities) * np.abs(capture.intensities) ** np.float32(gamma)
    raised = Capture(np.maximum(images, MOST_NEGATIVE), capture.angles_deg, capture.valid)
    if capture.origin is not None:
        raised.origin = replace(capture.origin, raw_noise=None)
    return raised
