"""``report.html``: one separation as a page of its own, for people."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from importlib.resources import files
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from polaropt.capture import Capture
from polaropt.convergence_chart import convergence_chart
from polaropt.html_pictures import page_pictures

if TYPE_CHECKING:
    from jinja2 import Template

    from polaropt.separation import Separation

_TEMPLATE = "report_template.html"
_RUNGS = {
    "none": "no polarization: nothing to separate by",
    "pixelwise": "a flat pane seen from afar, all bounces in place",
    "ghosts": "a flat pane seen from afar, with double images",
    "perspective": "a flat pane before a wide lens",
    "curved": "a bent pane before a wide lens",
    "polarized": "a flat pane, light that arrives polarized",
}
# Name in the scene, words, unit, digits, and the name of the standard error in the estimate.
_NUMBERS = (
    ("incidence_deg", "Angle of incidence", "deg", 2, "incidence_error_deg"),
    ("azimuth_deg", "Azimuth of the plane of incidence", "deg", 2, "azimuth_error_deg"),
    ("ghost_shift", "Ghost shift", "px", 2, "ghost_shift_error_px"),
    ("transmission_ghost_shift", "Ghost shift of the transmission", "px", 2, "transmission_ghost_shift_error_px"),
    ("focal_px", "Focal length", "px", 0, "focal_error_px"),
    ("refractive_index", "Refractive index", "", 3, "refractive_index_error"),
)
_LIGHT = (("transmission_polarization", "Light from behind"), ("reflection_polarization", "Mirrored light"))


@dataclass(frozen=True)
class Parameter:
    """One line of the page's table of the pane: name, value with unit, standard error, how it is known."""

    name: str
    value: str
    error: str
    how: str


def write_html_report(
    path: Path,
    result: Separation,
    capture: Capture,
    report: dict[str, Any],
    misfit: NDArray[np.float32] | None = None,
) -> None:
    """Write a page that needs nothing beside it: pictures, pane, course of the solve, warnings.

    Parameters
    ----------
    path : Path
    result : Separation
    capture : Capture
        What was separated.
    report : dict
        As in ``report.json``.
    misfit : ndarray, shape (h, w), optional
        Map of the misfit in standard deviations of the noise, where the model does not explain the photographs.
    """
    pictures = page_pictures(result, capture, report["view"]["exposure"], misfit)
    names = [Path(name).name for name in report["input"].get("files", ())]
    page = _template().render(
        title=_title(names),
        names=names,
        report=report,
        pane=_RUNGS.get(report["scene"]["rung"], report["scene"]["rung"]),
        warnings=[*report["attention"], *(warning["sentence"] for warning in report["diagnostics"]["warnings"])],
        pictures=pictures,
        comparable=[picture for picture in pictures if picture.comparable],
        parameters=parameters(report),
        chart=convergence_chart([point.value for point in result.solver.trace]),
        seconds=sum(report["seconds"].values()),
    )
    path.write_text(page, encoding="utf-8")


def _title(names: list[str]) -> str:
    if len(names) < 2:
        return f"Separation of {names[0]}" if names else "Separation"
    return f"Separation of {names[0]} and {len(names) - 1} more"


def parameters(report: dict[str, Any]) -> list[Parameter]:
    """The pane's numbers with their standard errors, where these are stated, as in ``report.json``."""
    scene = report["scene"]
    if not scene["signal"]:
        return []
    errors = report["diagnostics"]["estimate"] or {}
    found = [
        Parameter(
            words,
            _with_unit(f"{scene[name]:.{digits}f}", unit),
            _error(errors.get(error), unit) if name in report["estimated"] else "",
            "estimated" if name in report["estimated"] else "given",
        )
        for name, words, unit, digits, error in _NUMBERS
        if scene.get(name) is not None
    ]
    if scene["single_surface"]:
        found = [parameter for parameter in found if not parameter.name.startswith("Ghost shift")]
        found.append(Parameter("Back face", "none", "", "given"))
    return found + [
        Parameter(words, f"degree {scene[name][0]:.2f}, angle {scene[name][1]:.0f} deg", "", "polarized on arrival")
        for name, words in _LIGHT
        if scene[name][0] > 0
    ]


def _error(error: float | None, unit: str) -> str:
    return "" if error is None else _with_unit(f"± {error:.2g}", unit)


def _with_unit(number: str, unit: str) -> str:
    return f"{number} {unit}".strip()


@lru_cache(maxsize=1)
def _template() -> Template:
    from jinja2 import Environment, StrictUndefined

    # File names and sentences are text, not markup.
    page = Environment(autoescape=True, trim_blocks=True, lstrip_blocks=True, undefined=StrictUndefined)
    return page.from_string(files("polaropt").joinpath(_TEMPLATE).read_text(encoding="utf-8"))
