"""Photographs between which something moves."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from polaropt.capture import Capture
from tests.blends import Blend

SIDE, TOP, LEFT, STEP = 32, 40, 44, 6
"""Of the thing in pixels: its side, where it is in the first photograph, and how far it goes from one to the next."""


@dataclass(frozen=True)
class Moving:
    """A capture, and the pixels in which the thing is seen by each photograph (k, h, w), and at any time (h, w)."""

    capture: Capture
    seen_by: np.ndarray

    @property
    def where(self) -> np.ndarray:
        return np.asarray(self.seen_by.any(axis=0))


def column(k: int, step: int = STEP) -> int:
    """Where the thing begins in photograph k."""
    return LEFT + step * k


def thing(scene: Blend) -> np.ndarray:
    """What moves: a part of the mirrored scene."""
    return scene.layers[1][..., 80 : 80 + SIDE, 10 : 10 + SIDE]


def walked_by(scene: Blend, step: int = STEP) -> Moving:
    """Before the glass, a thing that is elsewhere in each photograph, of a scene of 112 pixels or more."""
    images = scene.capture.intensities.copy()
    seen_by = np.zeros((len(images), *images.shape[-2:]), bool)
    for k, image in enumerate(images):
        place = (..., slice(TOP, TOP + SIDE), slice(column(k, step), column(k, step) + SIDE))
        image[place] = thing(scene) / 2
        seen_by[(k, *place)] = True
    return Moving(Capture.of_planes(images, scene.capture.angles_deg), seen_by)
