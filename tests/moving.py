"""Photographs between which something moves."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from polaropt.capture import Capture
from tests.blends import Blend

SIDE, TOP, LEFT, STEP = 32, 40, 56, 6
"""Of the thing in pixels: its side, where it is in the third photograph, and how far it goes from one to the next."""


@dataclass(frozen=True)
class Moving:
    """A capture, and the pixels (h, w) in which the thing is seen at any time."""

    capture: Capture
    where: np.ndarray


def column(k: int) -> int:
    """Where the thing begins in photograph k."""
    return LEFT + STEP * (k - 2)


def thing(scene: Blend) -> np.ndarray:
    """What moves: a part of the mirrored scene."""
    return scene.layers[1][..., 80 : 80 + SIDE, 10 : 10 + SIDE]


def walked_by(scene: Blend) -> Moving:
    """Before the glass, a thing that is elsewhere in each photograph, of a scene of 112 pixels or more."""
    images = scene.capture.intensities.copy()
    where = np.zeros(images.shape[-2:], bool)
    for k, image in enumerate(images):
        place = (..., slice(TOP, TOP + SIDE), slice(column(k), column(k) + SIDE))
        image[place] = thing(scene) / 2
        where[place] = True
    return Moving(Capture.of_planes(images, scene.capture.angles_deg), where)
