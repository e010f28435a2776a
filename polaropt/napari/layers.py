"""What napari shows of photographs and of their layers: arrays with their names, colours and limits."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from polaropt.api import Separation
from polaropt.capture import CameraFacts, Capture, encode_srgb, planes_last
from polaropt.optics import dolp_aolp, stokes_from_intensities
from polaropt.reporting import LAYERS, grey_means, reduced_intensity, viewing_exposure

Image = NDArray[np.float32]
LayerData = tuple[NDArray[Any], dict[str, Any], str]
"""An array, what napari is told of it, and "image"."""
CAPTURE, NAME = "capture", "capture_name"
"""Keys in a layer's metadata under which the photographs are that it was made of, and what they are called."""
_VIEW_GAMMA = 1 / 2.2
"""At which napari shows linear values as sRGB does, nearly."""
_LEAST_LIMIT = 1e-6
"""Upper limit of what is shown of an image without any light."""


def layers_of_capture(capture: Capture, name: str) -> list[LayerData]:
    """Photographs as napari shows them: their light, and its degree and angle of polarization.

    Parameters
    ----------
    capture : Capture
    name : str
        Of the capture; every layer's name begins with it.

    Returns
    -------
    list of (ndarray, dict, "image")
        Layer data of npe2, the one to be on top last. The capture is in the metadata of each.
    """
    degree, angle = dolp_aolp(stokes_from_intensities(grey_means(capture, 1), capture.angles_deg))
    shared = {CAPTURE: capture, NAME: name}
    return [
        _map(angle, f"{name} angle of polarization (deg)", (0.0, 180.0), "hsv", shared),
        _map(degree, f"{name} degree of polarization", (0.0, 1.0), "magma", shared),
        view_of_layer(reduced_intensity(capture, 1), f"{name} light", capture.camera, shared),
    ]


def layers_of_result(result: Separation, capture: Capture, name: str, *, uncertainty: bool = True) -> list[LayerData]:
    """Both layers as napari shows them, with their standard errors.

    Parameters
    ----------
    result : Separation
    capture : Capture
        What was separated.
    name : str
        Of the capture; every layer's name begins with it.
    uncertainty : bool
        Whether the errors are found, which takes its time.

    Returns
    -------
    list of (ndarray, dict, "image")
        As of `layers_of_capture`.
    """
    errors = []
    if uncertainty:
        transmission, reflection = result.uncertainty
        errors = maps_of_errors(name, transmission, reflection, result.reflection_known)
    shown = [
        view_of_layer(layer, f"{name} {kind}", capture.camera, {})
        for layer, kind in zip(result.layers[::-1], LAYERS[::-1], strict=True)
    ]
    return [*errors, *shown]


def maps_of_errors(name: str, transmission: Image, reflection: Image, known: Image) -> list[LayerData]:
    """Standard errors ([channel,] h, w) of both layers, and what is known of the reflection's detail, (h, w)."""
    errors = [_over_colors(error) for error in (reflection, transmission)]
    return [
        _map(known, f"{name} reflection known", (0.0, 1.0), "gray", {}),
        *(
            _map(error, f"{name} {kind} error", (0.0, max(float(error.max()), _LEAST_LIMIT)), "magma", {})
            for error, kind in zip(errors, LAYERS[::-1], strict=True)
        ),
    ]


def view_of_layer(planes: Image, name: str, camera: CameraFacts | None, metadata: dict[str, Any]) -> LayerData:
    """Light ([channel,] h, w) to look at: grey linear under a gamma, colours encoded, linear in the metadata.

    napari shows colours as they come, without limits or gamma.
    """
    exposure = viewing_exposure(planes)
    if planes.ndim == 3 and planes.shape[0] == 3:
        linear = planes_last(planes)
        encoded = encode_srgb(linear * np.float32(exposure), camera)
        told = {"linear": linear, "exposure": exposure}
        return encoded, {"name": name, "rgb": True, "metadata": metadata | told}, "image"
    grey = planes if planes.ndim == 2 else planes.mean(axis=0)
    limits = (0.0, 1 / exposure)
    shown = {"name": name, "contrast_limits": limits, "gamma": _VIEW_GAMMA, "colormap": "gray", "metadata": metadata}
    return grey, shown, "image"


def _map(
    values: NDArray[Any], name: str, limits: tuple[float, float], colormap: str, metadata: dict[str, Any]
) -> LayerData:
    """A measured quantity, hidden until it is asked for."""
    shown = {"name": name, "contrast_limits": limits, "colormap": colormap, "metadata": metadata, "visible": False}
    return np.asarray(values, dtype=np.float32), shown, "image"


def _over_colors(error: Image) -> Image:
    """Root mean square over the colours, (h, w)."""
    if error.ndim == 2:
        return error
    mean: Image = np.sqrt(np.mean(np.square(error), axis=0))
    return mean
