"""A result at a glance: a table for the terminal, layers and scene for a notebook, a figure."""

from __future__ import annotations

import os
from dataclasses import fields
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from polaropt.capture import Capture, encode_srgb, planes_last, read_json
from polaropt.errors import InputError, check_installed
from polaropt.numerics import block_mean
from polaropt.optics import SEARCHED, SceneParameters, scale_between
from polaropt.reporting.pictures import LAYERS, Image, reduced_intensity, viewing_exposure
from polaropt.reporting.report import json_values, scene_report
from polaropt.reporting.words import amount_of, shown_fields

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from polaropt.separation import Separation

# Longest side in pixels of a layer in a notebook; set by hand.
_LONG_SIDE = 480


def _rows(result: Separation) -> list[tuple[str, str]]:
    """Names and values: the scene, how it was found, and what speaks against it."""
    scene = scene_report(result.scene, result.asked)["scene"]
    errors = json_values(result.errors)
    rows = [(field.label, amount_of(field, scene[field.name], errors.get(field.name))) for field in shown_fields(scene)]
    warned = ", ".join(warning.name for warning in result.diagnostics.warnings)
    if not result.scene.signal:
        rows = [("scene", "not polarized: the intensity is returned as transmission")]
    how_found = [
        ("model", result.scene.rung),
        ("solve", f"{result.solver.n_evaluations} evaluations"),
        ("time", f"{sum(result.seconds.values()):.1f} s altogether"),
        ("warnings", warned or "none"),
    ]
    return [*rows, *how_found]


def _title(result: Separation) -> str:
    _, *channels, height, width = result.layers.shape
    return f"Separation of {width}x{height} px" + (f", {channels[0]} channels" if channels else "")


def result_lines(result: Separation) -> list[str]:
    """A result as a short table."""
    rows = _rows(result)
    width = max(len(name) for name, _ in rows)
    return [_title(result), *(f"  {name:{width}}  {value}" for name, value in rows)]


def result_html(result: Separation, capture: Capture) -> str:
    """Layers and scene for a notebook, as a piece of a page."""
    from base64 import b64encode

    from imagecodecs import jpeg_encode

    pictures = []
    for name, layer in zip(LAYERS, result.layers, strict=True):
        image = _small(layer)
        exposed = image * np.float32(viewing_exposure(image))
        pixels = np.round(255 * encode_srgb(exposed, capture.camera)).astype(np.uint8)
        data = b64encode(jpeg_encode(np.ascontiguousarray(pixels))).decode("ascii")
        pictures.append(
            f'<figure style="margin:0"><img alt="{name}" src="data:image/jpeg;base64,{data}" style="max-width:100%">'
            f"<figcaption>{name}</figcaption></figure>"
        )
    rows = "".join(f"<tr><th>{escape(name)}</th><td>{escape(value)}</td></tr>" for name, value in _rows(result))
    return (
        f'<div><p><b>{_title(result)}</b></p><div style="display:flex;flex-wrap:wrap;gap:1em">{"".join(pictures)}</div>'
        f"<table>{rows}</table></div>"
    )


def _small(planes: Image) -> Image:
    return planes_last(np.asarray(block_mean(planes, -(-max(planes.shape[-2:]) // _LONG_SIDE)), dtype=np.float32))


def plot_layers(result: Separation, capture: Capture) -> Figure:
    """Photograph and layers side by side as a figure of matplotlib.

    Raises
    ------
    InputError
        It is not installed.
    """
    check_installed(("matplotlib",), "a plot", "'polaropt[plot]'")
    from matplotlib import pyplot

    light = planes_last(reduced_intensity(capture, 1))
    shown = [("photograph", light), *zip(LAYERS, map(planes_last, result.layers), strict=True)]
    figure, axes = pyplot.subplots(1, len(shown), figsize=(4 * len(shown), 4), layout="constrained")
    for axis, (title, image) in zip(axes, shown, strict=True):
        axis.imshow(
            encode_srgb(image * np.float32(viewing_exposure(image)), capture.camera), cmap="gray", vmin=0, vmax=1
        )
        axis.set_title(title)
        axis.set_axis_off()
    return figure


def scene_of_report(path: Path, shape: tuple[int, ...] | None = None) -> SceneParameters:
    """The scene of an earlier separation, for photographs of the same view.

    Parameters
    ----------
    path : Path
        Its ``report.json``, or the ``scene.json`` of captures that share one.
    shape : (int, int), optional
        Height and width of these photographs: lengths in pixels are scaled to them. Default: they have the same size.

    Raises
    ------
    InputError
        Another file, a separation without a scene, or photographs of another shape.
    """
    if os.path.isdir(path):
        raise InputError(f"{path}: is a folder; give the report.json in it")
    try:
        report = read_json(path)
        size = int(report["input"]["height"]), int(report["input"]["width"])
        scene = SceneParameters(**_numbers_of(dict(report["scene"])))
        if min(size) < 1:
            raise ValueError
    except InputError as error:
        told = str(error)
        raise InputError(told if told.startswith(f"{path}: ") else f"{path}: {told}") from None
    except (ValueError, KeyError, TypeError, OverflowError):
        raise InputError(
            f"{path}: is no report of a separation; give the report.json that one wrote, or the scene.json of a batch"
        ) from None
    if not scene.signal:
        raise InputError(f"{path}: nothing was polarized there, so that it holds no scene; leave it out")
    if shape is None:
        return scene
    factor = scale_between(size, shape)
    if factor is None:
        sizes = f"{size[1]}x{size[0]} px, these have {shape[1]}x{shape[0]}"
        raise InputError(f"{path}: is of photographs of {sizes}; give one of the same view")
    return scene.scaled(factor)


def _numbers_of(scene: dict[str, Any]) -> dict[str, Any]:
    """Fields of a scene as in ``report.json``, which has lists for pairs and the rung beside them."""
    names = {field.name for field in fields(SceneParameters)}
    if not set(SEARCHED) <= scene.keys():
        raise KeyError("incidence, azimuth or shift")
    return {name: tuple(value) if isinstance(value, list) else value for name, value in scene.items() if name in names}
