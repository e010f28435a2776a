"""The widget that separates the photographs of a napari layer, in another thread."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from polaropt.api import separate
from polaropt.capture import ANGLES_DEG, Capture
from polaropt.errors import InputError
from polaropt.napari.layers import CAPTURE, NAME, LayerData, layers_of_result
from polaropt.optics import GLASS_INDEX, WATER_INDEX

if TYPE_CHECKING:
    import napari

Surface = Literal["glass", "water"]


def capture_of(layer: napari.layers.Image) -> Capture:
    """The photographs behind a layer: those it was read from, or the layer itself where it is a stack of them.

    Parameters
    ----------
    layer : napari.layers.Image
        One of `layers_of_capture`, or one of (4, h, w) or (4, h, w, 3) with photographs at 0, 45, 90 and 135 degrees.

    Raises
    ------
    InputError
        It is neither.
    """
    capture = layer.metadata.get(CAPTURE)
    if isinstance(capture, Capture):
        return capture
    values = np.asarray(layer.data)
    if len(values) != len(ANGLES_DEG) or values.ndim - bool(layer.rgb) != 3:
        raise InputError(
            f"the layer {layer.name} holds no photographs through a polarizer; open them with polaropt, or take a "
            "stack of four at 0, 45, 90 and 135 degrees"
        )
    return Capture(values)


def separated_layers(
    capture: Capture, name: str, surface: Surface = "glass", index: float = GLASS_INDEX, error_maps: bool = True
) -> list[LayerData]:
    """Separate photographs; both layers as napari shows them.

    Parameters
    ----------
    capture : Capture
    name : str
        Of the capture, for the layers.
    surface : {"glass", "water"}
        A pane, or the one surface of water, whose index is known.
    index : float
        Refractive index of the pane.
    error_maps : bool
        Whether the standard errors are found.
    """
    water = surface == "water"
    result = separate(
        capture,
        refractive_index=WATER_INDEX if water else index,
        single_surface=water,
    )
    return layers_of_result(result, capture, name, uncertainty=error_maps)


def separation_widget() -> Any:
    """A widget of magicgui: choose a layer of photographs, separate them, get the layers.

    The separation runs in another thread, so that napari answers meanwhile; what is wrong with the photographs, and
    warnings of the result, napari shows as its notifications.
    """
    import napari.layers
    import napari.types
    from magicgui import magicgui
    from napari.qt.threading import FunctionWorker, thread_worker
    from qtpy.QtCore import QTimer

    def separate_photographs(photographs: Any, surface: Any, index: float, error_maps: bool) -> Any:
        capture = capture_of(photographs)
        name = photographs.metadata.get(NAME, photographs.name)
        work = thread_worker(separated_layers, progress={"desc": "Separating"}, start_thread=False)
        worker = work(capture, name, surface, index, error_maps)
        # When napari has connected itself to what it returns.
        QTimer.singleShot(0, worker.start)
        return worker

    separate_photographs.__annotations__ = {
        "photographs": napari.layers.Image,
        "surface": Surface,
        "index": float,
        "error_maps": bool,
        "return": FunctionWorker[list[napari.types.LayerDataTuple]],
    }
    return magicgui(
        separate_photographs,
        call_button="Separate",
        index={"value": GLASS_INDEX, "min": 1.0, "max": 4.0, "step": 0.01, "label": "index of glass"},
        error_maps={"value": True, "label": "error maps"},
    )
