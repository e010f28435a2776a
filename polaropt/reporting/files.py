"""The files of a separation."""

from __future__ import annotations

import json
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from polaropt.capture import (
    LINEAR_LIGHT,
    Capture,
    linearize,
    tiff_rows,
    write_picture,
    write_png_view,
    write_tiff,
)
from polaropt.judging import SeparationWarning
from polaropt.numerics import MUCH_VALUES, arrays_apart, give_back_freed
from polaropt.progress import Stages
from polaropt.reporting.inspection import inspect_still
from polaropt.reporting.names import RESULT_FILES
from polaropt.reporting.page import page_pictures, write_html_report
from polaropt.reporting.pictures import (
    FADED,
    LAYERS,
    MISFIT_WHITE,
    Image,
    UncertaintyPanels,
    UncertaintySummary,
    marked_picture,
    misfit_map,
    side_by_side,
    viewing_exposure,
)
from polaropt.reporting.report import json_values, rounded, separation_report
from polaropt.reporting.words import attention

if TYPE_CHECKING:
    from polaropt.separation import Separation


# Share of what follows a separation at which the error maps are made, for the progress alone: set by hand.
_JUDGED = 0.6
# Share of the writing that each layer takes, likewise.
_LAYER_WRITTEN = 0.3


def write_separation(
    folder: Path,
    result: Separation,
    capture: Capture,
    *,
    stages: Stages | None = None,
    reached: float = 0.0,
    uncertainty: bool = True,
    layers_only: bool = False,
) -> dict[str, Any]:
    """Write the layers (TIFF linear, PNG to look at), their uncertainty, ``report.json`` and ``report.html``.

    Where the model does not explain the photographs, ``misfit.tiff`` and ``misfit.png`` show where; where something
    moves between them, ``moving.png`` does; where no glass is seen, ``unglazed.png``.

    Parameters
    ----------
    folder : Path
    result : Separation
    capture : Capture
        What was separated.
    stages : Stages, optional
        Of all that was done until now, the separation's own included. Default: only those are told.
    reached : float
        How far the whole has come, for the progress.
    uncertainty : bool
        Whether the layers' standard errors are found, which takes its time.
    layers_only : bool
        Whether the layers and ``report.json`` are all that is written.

    Returns
    -------
    dict
        The report.
    """
    if stages is None:
        stages = Stages()
        stages.include(result.seconds, result.cpu_seconds)
    with arrays_apart(result.layers.size > MUCH_VALUES):
        return _write_separation(folder, result, capture, stages, reached, uncertainty and not layers_only, layers_only)


def _write_separation(
    folder: Path,
    result: Separation,
    capture: Capture,
    stages: Stages,
    reached: float,
    uncertainty: bool,
    layers_only: bool,
) -> dict[str, Any]:
    told, errors = None, None
    judged = reached + _JUDGED * (1 - reached) if uncertainty else reached
    if judged > reached:
        begun, span = stages, judged - reached
        begun.begin("Error maps", reached)
        told, errors = write_uncertainty(folder, result, lambda fraction: begun.advance(span * fraction))
    stages.begin("Writing", judged)
    # What tiles and error maps took is much beside the pictures that are made now.
    give_back_freed()
    camera = capture.camera
    exposures = {}
    for name in LAYERS:
        layer = result.layers[LAYERS.index(name)]
        exposures[name] = viewing_exposure(layer)
        note = _note(name, result)
        with tiff_rows(folder / f"{name}.tiff", layer.shape, camera=camera, note=note) as write:
            write(layer)
        write_png_view(folder / f"{name}.png", layer, exposures[name], camera, note)
        stages.advance((1 - judged) * _LAYER_WRITTEN * len(exposures))
    give_back_freed()
    # What a person must look at is what is left once the photographs agree.
    solved = capture if result.matching is None else result.matching.capture
    inspection = inspect_still(solved, result.moving)
    unexplained = SeparationWarning.MODEL_DOES_NOT_EXPLAIN in result.diagnostics.warnings
    misfit = misfit_map(result, solved) if unexplained and not layers_only else None
    for name, where in (("moving", result.moving), ("unglazed", result.unglazed)):
        if where is not None and not layers_only:
            write_picture(folder / f"{name}.png", marked_picture(capture, where), note=_note(name, result))
    misfit_told = None if misfit is None else _write_misfit(folder, misfit, _note("misfit", result))
    pictures = [] if layers_only else page_pictures(result, capture, exposures, errors, misfit)
    stages.end()
    names = {path.name for path in folder.iterdir()} | {"report.json"} | (set() if layers_only else {"report.html"})
    report = {
        "request": {"scene": result.asked, **json_values(result.settings)},
        **separation_report(result, capture, result.asked),
        "seconds": rounded(stages.seconds),
        "cpu_seconds": rounded(stages.cpu_seconds),
        "inspection": inspection.as_dict(),
        "attention": attention(inspection, result.diagnostics.warnings),
        "uncertainty": told,
        "misfit_map": misfit_told,
        "view": {"exposure": exposures, "encoding": "sRGB of exposure times the linear values"},
        "written": [name for name in RESULT_FILES if name in names],
    }
    document: dict[str, Any] = json_values(report)
    text = json.dumps(document, indent=2, allow_nan=False)
    (folder / "report.json").write_text(text + "\n", encoding="utf-8")
    if not layers_only:
        write_html_report(folder / "report.html", result, document, pictures)
    return document


def _note(name: str, result: Separation) -> str:
    """What a file says of itself and of how it was found; all of that is in ``report.json``."""
    asked = result.settings
    return f"{name}, model {result.scene.rung}, solver {asked.solver}, start {asked.init}"


# What the values of maps are in, where it is not light.
_OF_KNOWN = "share of the reflection's detail that is told, 0 to 1"
_OF_MISFIT = "standard deviations of the noise"


def _write_misfit(folder: Path, misfit: NDArray[np.float32], note: str) -> dict[str, Any]:
    """The map of the misfit, linear and to look at; what it holds."""
    write_tiff(folder / "misfit.tiff", misfit, note=note, unit=_OF_MISFIT)
    pixels = np.round(255 * np.clip(misfit / MISFIT_WHITE, 0, 1)).astype(np.uint8)
    write_picture(folder / "misfit.png", pixels, note=note)
    return {"unit": _OF_MISFIT, "largest": float(misfit.max()), "white_in_png": MISFIT_WHITE}


def write_uncertainty(
    folder: Path, result: Separation, tell: Callable[[float], None] | None = None
) -> tuple[dict[str, Any], UncertaintyPanels]:
    """Write standard errors and how much of the reflection is known: linear, and one picture of all three to look at.

    Parameters
    ----------
    folder : Path
        Gets ``transmission_error.tiff``, ``reflection_error.tiff``, ``reflection_known.tiff`` and ``uncertainty.png``.
    result : Separation
    tell : callable, optional
        Called with the fraction done, 0..1.

    Returns
    -------
    dict
        What the report says of them.
    UncertaintyPanels
        What the picture shows.
    """
    shape = result.layers.shape
    summary = UncertaintySummary(shape)
    with ExitStack() as files:

        def rows_of(name: str, size: tuple[int, ...], unit: str) -> Callable[[Image], None]:
            note = _note(name, result)
            return files.enter_context(tiff_rows(folder / f"{name}.tiff", size, coarse=True, note=note, unit=unit))

        of_layers = [rows_of(f"{name}_error", shape[1:], LINEAR_LIGHT) for name in LAYERS]
        of_known = rows_of("reflection_known", shape[-2:], _OF_KNOWN)
        for strip in result.uncertainty_strips(tell):
            for write, error in zip(of_layers, strip.uncertainty.standard_error, strict=True):
                write(error)
            of_known(strip.uncertainty.reflection_known)
            summary.add(strip)
    shown = summary.panels()
    white = shown.white
    panels: list[tuple[str, Image | None]] = [
        (f"{name}: error, white = {white[name]:.2g}", error / np.float32(white[name]))
        for name, error in shown.errors.items()
    ]
    panels.append((f"reflection: detail told, below {FADED:g} red", shown.known))
    # Values of the picture are in proportion to the errors.
    straight = [(title, None if panel is None else linearize(np.clip(panel, 0, 1), "srgb")) for title, panel in panels]
    write_picture(folder / "uncertainty.png", side_by_side([straight]), note=_note("uncertainty", result))
    told = {
        "typical_error": shown.typical,
        "reflection_faded": {"share_of_pixels": shown.faded_share, "told_below": FADED},
        "white_in_png": white,
    }
    return told, shown
