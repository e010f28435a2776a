"""Complete scenes as the few numbers that panes before polarized light are searched by."""

from __future__ import annotations

import math

import numpy as np

from polaropt import SceneParameters


def point_of(scene: SceneParameters) -> np.ndarray:
    """The point of a complete scene, see `polaropt.estimation.polarized.light`."""
    numbers = list(scene.values())
    for degree, angle in (scene.transmission_polarization, scene.reflection_polarization):
        double = 2 * math.radians(angle - numbers[1])
        numbers += [degree * math.cos(double), degree * math.sin(double)]
    return np.array(numbers)
