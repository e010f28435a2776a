"""Where a solve can start, by name."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from polaropt.canvas import Canvas
from polaropt.capture import Capture
from polaropt.closed_form import ClosedForm, per_pixel_layers
from polaropt.forward import PSE
from polaropt.varying import VaryingPSE
from polaropt.varying_closed_form import varying_pixel_layers

Images = NDArray[np.float32]


def start_names() -> tuple[str, ...]:
    """Names that `start_layers` knows."""
    return ("closed-form", "cold", "per-pixel")


def start_layers(name: str, capture: Capture, pse: PSE | VaryingPSE, canvas: Canvas, known: ClosedForm) -> Images:
    """Canvas layers (2, channel, H, W) to start from.

    Parameters
    ----------
    name : {"closed-form", "cold", "per-pixel"}
    capture : Capture
    pse : PSE or VaryingPSE
    canvas : Canvas
    known : ClosedForm
        The closed form per frequency.
    """
    if name == "closed-form":
        return canvas.continued(canvas.crop(known.layers))
    if name == "per-pixel":
        layers = per_pixel_layers(capture, pse.scene) if isinstance(pse, PSE) else varying_pixel_layers(capture, pse)
        return canvas.continued(_with_channels(layers, capture))
    intensity = _with_channels(capture.stokes[:1], capture)
    flat = np.broadcast_to(intensity.mean((-1, -2), keepdims=True), intensity.shape)
    return canvas.continued(np.concatenate([intensity, flat]))


def _with_channels(layers: Images, capture: Capture) -> Images:
    return layers if capture.color else layers[:, None]
