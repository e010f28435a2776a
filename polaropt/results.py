"""The files of a separation."""

from __future__ import annotations

import json
from collections.abc import Iterable
from dataclasses import dataclass, replace
from enum import Enum
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from polaropt.capture import Capture
from polaropt.diagnostics import Warning
from polaropt.html_report import write_html_report
from polaropt.image_io import write_png, write_png_view, write_tiff
from polaropt.inspection import Inspection, inspect_capture
from polaropt.misfit_map import MISFIT_WHITE, misfit_map
from polaropt.report import plain, separation_report
from polaropt.scene import SceneParameters
from polaropt.uncertainty_files import write_uncertainty
from polaropt.view import viewing_exposure

if TYPE_CHECKING:
    from polaropt.objective import Weights
    from polaropt.separation import Separation
    from solvers.base import StoppingRule

LAYERS = ("transmission", "reflection")
_MARK = "ATTENTION: "


@dataclass(frozen=True)
class Request:
    """What was asked for; None in the scene is estimated, None elsewhere is the default."""

    scene: SceneParameters
    model: str = "auto"
    solver: str = "lbfgs"
    device: str | None = None
    init: str = "closed-form"
    robust: bool = False
    weights: Weights | None = None
    stopping: StoppingRule | None = None


def write_separation(folder: Path, result: Separation, capture: Capture, request: Request) -> dict[str, Any]:
    """Write the layers (TIFF linear, PNG to look at), their uncertainty, ``report.json`` and ``report.html``.

    Where the model does not explain the photographs, ``misfit.tiff`` and ``misfit.png`` show where.

    Parameters
    ----------
    folder : Path
    result : Separation
    capture : Capture
        What was separated.
    request : Request

    Returns
    -------
    dict
        The report.
    """
    exposures = {}
    for name in LAYERS:
        layer = getattr(result, name)
        exposures[name] = viewing_exposure(layer)
        write_tiff(folder / f"{name}.tiff", layer)
        write_png_view(folder / f"{name}.png", layer * exposures[name])
    inspection = inspect_capture(capture)
    unexplained = Warning.MODEL_DOES_NOT_EXPLAIN in result.diagnostics.warnings
    misfit = misfit_map(result, capture) if unexplained else None
    report = {
        "request": request,
        **separation_report(result, capture, request.scene),
        "inspection": inspection.as_dict(),
        "attention": attention(inspection, result.diagnostics.warnings),
        "uncertainty": write_uncertainty(folder, result),
        "misfit_map": None if misfit is None else _write_misfit(folder, misfit),
        "view": {"exposure": exposures, "encoding": "sRGB of exposure times the linear values"},
    }
    document: dict[str, Any] = plain(report)
    text = json.dumps(document, indent=2, allow_nan=False)
    (folder / "report.json").write_text(text + "\n", encoding="utf-8")
    write_html_report(folder / "report.html", result, capture, document, misfit)
    return document


def _write_misfit(folder: Path, misfit: NDArray[np.float32]) -> dict[str, Any]:
    """The map of the misfit, linear and to look at; what it holds."""
    write_tiff(folder / "misfit.tiff", misfit)
    write_png(folder / "misfit.png", np.round(255 * np.clip(misfit / MISFIT_WHITE, 0, 1)).astype(np.uint8))
    return {"unit": "standard deviations of the noise", "largest": float(misfit.max()), "white_in_png": MISFIT_WHITE}


def attention(inspection: Inspection, warnings: Iterable[Enum]) -> list[str]:
    """What an inspection says that a person must look at, and that the separation's warnings do not say already."""
    told: dict[str, Any] = {"dolp_95": 1.0}
    names = {warning.name for warning in warnings}
    if "GAMMA_ENCODED" in names:
        told["looks_encoded"] = False
    if "MISALIGNED" in names:
        told["visible_shift_px"] = 0.0
    sentences = replace(inspection, **told).sentences()
    return [sentence.partition(_MARK)[2] for sentence in sentences if _MARK in sentence]
