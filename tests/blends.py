"""Small blended captures of photographs that ship inside scikit-image, with their true layers."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np
from skimage import data

from polaropt.capture.capture import Capture, planes_first
from polaropt.optics.scene import SceneParameters
from polaropt.simulation.simulator import simulate

MARGIN = 48


@dataclass(frozen=True)
class Blend:
    """A capture, its scene and the layers (2, [channel,] h, w) behind it."""

    capture: Capture
    scene: SceneParameters
    layers: np.ndarray


@cache
def _photographs() -> tuple[np.ndarray, ...]:
    """What is behind the glass and what is mirrored, read once; not to be written to."""
    photographs = (data.astronaut(), data.coffee())
    for photograph in photographs:
        photograph.flags.writeable = False
    return photographs


def blend(
    incidence_deg: float = 60.0,
    size: int = 96,
    *,
    azimuth_deg: float = 25.0,
    ghost_shift: float = 5.3,
    color: bool = True,
    noise: float = 0.005,
    angles_deg: tuple[float, ...] = (0.0, 45.0, 90.0, 135.0),
    exposure: float = 1.0,
    shot_noise: float = 0.0,
    **scene: object,
) -> Blend:
    """Astronaut behind the glass, a coffee cup mirrored; ghosts find content beyond the frame."""
    whole = size + 2 * MARGIN
    images = [exposure * photo[40 : 40 + whole, 150 : 150 + whole] / 255 for photo in _photographs()]
    if not color:
        images = [image.mean(axis=-1) for image in images]
    parameters = SceneParameters(incidence_deg, azimuth_deg, ghost_shift).replace(**scene)
    larger = simulate(images[0], images[1], parameters, angles_deg, noise=noise, shot_noise=shot_noise)
    inside = (..., slice(MARGIN, -MARGIN), slice(MARGIN, -MARGIN))
    capture = Capture.of_planes(larger.intensities[inside], angles_deg, larger.valid[inside])
    return Blend(capture, parameters, np.stack([planes_first(image)[inside] for image in images]))
