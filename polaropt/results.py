"""The files of a separation."""

from __future__ import annotations

import json
from collections.abc import Iterable
from dataclasses import dataclass, replace
from enum import Enum
from pathlib import Path
from typing import TYPE_CHECKING, Any

from polaropt.capture import Capture
from polaropt.image_io import write_png_view, write_tiff
from polaropt.inspection import Inspection, inspect_capture
from polaropt.report import plain, separation_report
from polaropt.scene import SceneParameters
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
    """Write the layers (TIFF linear, PNG to look at) and ``report.json`` into a folder.

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
    report = {
        "request": request,
        **separation_report(result, capture, request.scene),
        "inspection": inspection.as_dict(),
        "attention": attention(inspection, result.diagnostics.warnings),
        "view": {"exposure": exposures, "encoding": "sRGB of exposure times the linear values"},
    }
    document: dict[str, Any] = plain(report)
    text = json.dumps(document, indent=2, allow_nan=False)
    (folder / "report.json").write_text(text + "\n", encoding="utf-8")
    return document


def attention(inspection: Inspection, warnings: Iterable[Enum]) -> list[str]:
    """What an inspection says that a person must look at, and that the separation's warnings do not say already."""
    told: dict[str, Any] = {"dolp_95": 1.0}
    if any(warning.name == "GAMMA_ENCODED" for warning in warnings):
        told["looks_encoded"] = False
    sentences = replace(inspection, **told).sentences()
    return [sentence.partition(_MARK)[2] for sentence in sentences if _MARK in sentence]
