"""What moves, as one of the photographs saw it: where the others cannot tell how the light is polarized.

In the photograph that shows the pane's reflection least the reflection is taken for what it is around; the rest is
transmission. The others are what the two layers would have given them. A solve that left these pixels out would do
worse: priors alone cannot fill tens of pixels, and what they put there reaches the pixels around.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from polaropt.capture import Capture
from polaropt.inversion import Canvas, layers_in_place
from polaropt.numerics import smoothly_filled
from polaropt.optics import SceneParameters, engine_for
from polaropt.solving.problem import component_strips

Images = NDArray[np.float32]
Mask = NDArray[np.bool_]

_LEAST_SHARE = 1e-3
"""Share of a layer in a photograph that is divided by: a pane passes and mirrors more."""
_CORRECTIONS = 2
"""Times that the transmission is corrected for its double images; a third changes nothing."""


def inpainted(capture: Capture, moving: Mask, scene: SceneParameters, noise: float) -> Capture:
    """Photographs whose moving pixels hold what one of them saw, and the others would have seen at the same time.

    Parameters
    ----------
    capture : Capture
    moving : ndarray of bool, shape (h, w)
    scene : SceneParameters
        A complete scene.
    noise : float
        Standard deviation of one photograph's noise (white = 1).

    Returns
    -------
    Capture
        There they are valid where that one is.
    """
    height, width = capture.shape[-2:]
    pse = engine_for(scene, capture.angles_deg, noise, (height, width))
    canvas = Canvas(height, width, 0, 0, 0, 0)
    photographs = capture.planes
    valid = capture.valid.reshape(photographs.shape)

    def parts(layers: Images) -> Images:
        return np.concatenate([strip.components for strip in component_strips(pse, canvas, layers)], axis=-2)

    of_transmission, of_reflection = parts(np.ones((2, 1, height, width), np.float32))
    layers = layers_in_place(photographs, of_transmission, of_reflection, noise)
    known = valid.all(axis=0) & ~moving
    layers[1] = np.where(moving, np.maximum(smoothly_filled(layers[1], known), 0), layers[1])
    shares = of_transmission / np.maximum(of_reflection, np.float32(_LEAST_SHARE))
    shown = int(np.argmax(shares[:, 0, moving].mean(axis=-1)))
    of_shown = np.maximum(of_transmission[shown], np.float32(_LEAST_SHARE))
    layers[0] = np.where(moving, (photographs[shown] - of_reflection[shown] * layers[1]) / of_shown, layers[0])
    seen = parts(layers).sum(axis=0)
    for _ in range(_CORRECTIONS):
        off = photographs[shown] - seen[shown]
        layers[0] = np.where(moving, np.maximum(layers[0] + off / of_shown, 0), layers[0])
        seen = parts(layers).sum(axis=0)
    return capture.replace(
        intensities=np.where(moving, seen, photographs).reshape(capture.intensities.shape),
        valid=np.where(moving, valid[shown], valid).reshape(capture.valid.shape),
    )
