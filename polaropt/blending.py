"""Frames of two photographs behind a simulated pane, with content beyond the frame for the ghosts."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from polaropt.capture import Capture
from polaropt.scene import SceneParameters
from polaropt.simulation import ANGLES_DEG, simulate

Image = NDArray[np.float32]

MARGIN = 64


@dataclass(frozen=True)
class Camera:
    """How the photographs are taken: polarizer angles, noise (white = 1), depth, seed of the noise."""

    angles_deg: Sequence[float] = ANGLES_DEG
    noise: float = 0.005
    bits: int | None = None
    seed: int = 0


def photograph_pair(
    transmission: Image, reflection: Image, scene: SceneParameters, camera: Camera, margin: int = MARGIN
) -> Capture:
    """Capture of two layers (h, w[, channel]); `margin` pixels on each side are in the layers only."""
    larger = simulate(transmission, reflection, scene, camera.angles_deg, camera.noise, camera.bits, camera.seed)
    if margin == 0:
        return larger
    inside = (..., slice(margin, -margin), slice(margin, -margin))
    return Capture(larger.intensities[inside], larger.angles_deg, larger.valid[inside])


def without_margin(image: Image, margin: int = MARGIN) -> Image:
    """The frame of a layer (h, w[, channel])."""
    return np.ascontiguousarray(image[margin:-margin, margin:-margin])
