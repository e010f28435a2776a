"""The incidence once more where ghosts are strong: edge overlap of layers from which all ghosts are taken out.

The linear elimination that the search rests on leaves each layer with doubled edges, which bias the incidence by up to
half a degree from about 65 degrees on. The Wiener filter's layers have no ghosts; averaged over blocks of 4x4 pixels
its smoothing no longer matters.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from polaropt.canvas import canvas_for
from polaropt.capture import Capture
from polaropt.closed_form import natural_image_layers
from polaropt.errors import InputError
from polaropt.forward import PSE
from polaropt.plate import ghosts_that_matter
from polaropt.scene import SceneParameters
from priors.base import CHROMA_WEIGHT, ColorGradient

Images = NDArray[np.float32]

STRONG_GHOSTS_DEG = 64.0
_STEP_DEG = 0.7
_FARTHEST = 1.5
_SIDE = 384
_BLOCK = 4


def refined_incidence(capture: Capture, scene: SceneParameters, noise: float) -> float:
    """Incidence in degrees near that of a complete scene at which the layers' coarse edges overlap least.

    Parameters
    ----------
    capture : Capture
    scene : SceneParameters
        Complete; its shift and azimuth are kept.
    noise : float
        Standard deviation of the noise of one photograph.

    Returns
    -------
    float
    """
    start, _, _ = scene.values()
    middle = _middle(capture)

    def overlap(incidence_deg: float) -> float:
        return coarse_overlap(_layers(middle, scene.replace(incidence_deg=incidence_deg), noise))

    step = min(_STEP_DEG, (89.5 - start) / 2)
    before, here, after = (overlap(start + shift) for shift in (-step, 0.0, step))
    # The vertex of the parabola through three points: a search would need four times as many closed forms.
    curvature = before - 2 * here + after
    if curvature <= 0:
        return start
    return start + step * min(max((before - after) / (2 * curvature), -_FARTHEST), _FARTHEST)


def coarse_overlap(layers: Images) -> float:
    """Cosine between the gradient magnitudes of two layers (2, channel, h, w), averaged over 4x4 pixels first."""
    channels = layers.shape[1]
    height, width = (side // _BLOCK * _BLOCK for side in layers.shape[-2:])
    blocks = layers[..., :height, :width].reshape(2, channels, height // _BLOCK, _BLOCK, width // _BLOCK, _BLOCK)
    coarse = blocks.mean(axis=(3, 5))
    t, r = (ColorGradient(layer, CHROMA_WEIGHT).energy() for layer in coarse)
    return float(np.sqrt(t * r).sum(dtype=np.float64) / np.sqrt(float(t.sum()) * float(r.sum()) + 1e-30))


def _layers(capture: Capture, scene: SceneParameters, noise: float) -> Images:
    pse = PSE(scene, capture.angles_deg, n_ghosts=ghosts_that_matter(scene, noise))
    canvas = canvas_for(pse, *capture.shape[-2:])
    layers: Images = canvas.crop(natural_image_layers(capture, pse, canvas, noise).layers)
    return layers


def _middle(capture: Capture) -> Capture:
    """The middle of a large capture: enough edges, and bounded time."""
    top, left = (max(0, (side - _SIDE) // 2) for side in capture.shape[-2:])
    inside = (..., slice(top, top + _SIDE), slice(left, left + _SIDE))
    try:
        return Capture(capture.intensities[inside], capture.angles_deg, capture.valid[inside])
    except InputError:  # Nothing to see there.
        return capture
