"""The numbers of a separation, and how they came about, as values for ``report.json``."""

from __future__ import annotations

import dataclasses
import math
import platform
from collections.abc import Mapping, Sequence
from enum import Enum
from importlib.metadata import PackageNotFoundError, version
from typing import TYPE_CHECKING, Any

import polaropt
from polaropt.optics import FIELDS, Field, SceneParameters
from polaropt.reporting.pictures import LAYERS

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from polaropt.capture import Capture, Matching
    from polaropt.separation import Separation
    from polaropt.solving import Term
    from solvers.base import SolverResult


_LIBRARIES = ("numpy", "scipy", "numba", "nlopt", "casadi", "torch")
# Arrays of more entries are pictures, which stand in files of their own.
_LONGEST_ARRAY = 16
_SECONDS_DIGITS, _SHARE_DIGITS, _EXPOSURE_DIGITS = 4, 4, 5


def separation_report(result: Separation, capture: Capture, given: SceneParameters) -> dict[str, Any]:
    """Scene, objective, solver, seconds, diagnostics, input and versions of one separation.

    Parameters
    ----------
    result : Separation
    capture : Capture
        What was separated; its origin names the files.
    given : SceneParameters
        What was asked for; None in it was estimated.

    Returns
    -------
    dict
        Plain values, ready for JSON; numbers that are not finite are None.
    """

    return {
        "input": capture_report(capture),
        "matching": None if result.matching is None else matching_report(result.matching),
        "unglazed_share": unglazed_share(result.unglazed),
        **scene_report(result.scene, given, capture.focal_px),
        "errors": json_values(result.errors),
        "n_bounces_kept": result.n_bounces,
        "rungs": json_values(result.tried),
        "objective": {name: _term(term) for name, term in result.terms.items()},
        "solver": {**solver_report(result.solver), "keep_start": result.settings.keep_start},
        "seconds": rounded(result.seconds),
        "cpu_seconds": rounded(result.cpu_seconds),
        "diagnostics": diagnostics_report(result.diagnostics),
        "versions": versions(),
    }


def _term(term: Term) -> dict[str, Any]:
    return {"raw": json_values(term.value), "weight": json_values(term.weight)}


def rounded(seconds: Mapping[str, float]) -> dict[str, float]:
    """Seconds of stages as the report tells them."""
    return {stage: round(value, _SECONDS_DIGITS) for stage, value in seconds.items()}


def scene_report(found: SceneParameters, given: SceneParameters, focal_hint_px: float | None = None) -> dict[str, Any]:
    """The scene's parameters, and the names of those that were estimated; not so a focal length the camera told."""
    estimated = [field.name for field in FIELDS if field.estimable and _added(field, found, given)]
    if found.single_surface and "ghost_shift" in estimated:
        estimated.remove("ghost_shift")
    # One clear pane is what is taken where nothing speaks against it.
    unsaid = {"n_panes", "gap_shift"} if not found.stacked else set()
    unsaid |= set() if found.absorption else {"absorption"}
    estimated = [name for name in estimated if name not in unsaid]
    if found.focal_px == focal_hint_px and "focal_px" in estimated:
        estimated.remove("focal_px")
    return {"scene": {"rung": found.rung, **json_values(found)}, "estimated": estimated}


def _added(field: Field, found: SceneParameters, given: SceneParameters) -> bool:
    return is_set(field, getattr(found, field.name)) and not is_set(field, getattr(given, field.name))


def is_set(field: Field, value: Any) -> bool:
    """Whether a scene says something of a field: zeros say flat, and unpolarized, whatever the angle."""
    if len(field.components) == 1:
        return value is not None
    return any(number for component, number in zip(field.components, value, strict=True) if component.period is None)


def capture_report(capture: Capture) -> dict[str, Any]:
    """Size and angles, and where the capture was read from."""
    origin = {} if capture.origin is None else json_values(capture.origin)
    if origin:
        origin["camera"].pop("exif")
    return {
        "width": capture.shape[-1],
        "height": capture.shape[-2],
        "channels": capture.shape[0] if capture.color else 1,
        "angles_deg": list(capture.angles_deg),
        **origin,
    }


def matching_report(matching: Matching) -> dict[str, Any]:
    """How far each photograph, or each layer in it, lay beside the first, and how much less sharp it was, in pixels.

    Turns (degrees, clockwise as seen) and scales are about the middle of the frame; null where there are none. And how
    long each was exposed, in units of the first one's exposure, and with which white balance: red and blue in units of
    green and of the first one's; null where that was not looked for, or alike. Of a mosaic the gains of its analyzers
    take the place of exposures.
    """
    transfer, motions = matching.transfer, matching.motions
    exposures = [round(each / matching.exposures[0], _EXPOSURE_DIGITS) for each in matching.exposures] or None
    of_mosaic = matching.capture.cells is not None
    layers = transfer.layers
    turned = motions if motions is not None and motions.turned else None
    return {
        "shifts_px": json_values(transfer.shifts_px if motions is None else transfer.shifts_px + motions.offsets),
        "rotations_deg": None if turned is None else json_values(turned.rotations_deg),
        "scales": None if turned is None else json_values(turned.scales),
        "layer_shifts_px": None if layers is None else dict(zip(LAYERS, json_values(layers.shifts_px), strict=True)),
        "blurs_px": json_values(transfer.blurs_px),
        "exposures": None if of_mosaic else exposures,
        "gains": exposures if of_mosaic else None,
        "white_balances": _beside_green(matching.white_balances) or None,
    }


def _beside_green(balances: Sequence[tuple[float, ...]]) -> list[list[float]]:
    beside = [(red / green, blue / green) for red, green, blue in balances]
    return [[round(each / first, _EXPOSURE_DIGITS) for each, first in zip(of, beside[0], strict=True)] for of in beside]


def unglazed_share(unglazed: NDArray[np.bool_] | None) -> float:
    """Share of the frame that shows no glass, as far as that was found."""
    return 0.0 if unglazed is None else round(float(unglazed.mean()), _SHARE_DIGITS)


def solver_report(solver: SolverResult) -> dict[str, Any]:
    """Status with its sentence, value, evaluations, seconds."""
    return {
        "status": solver.status.name,
        "sentence": solver.sentence,
        "success": solver.status.success,
        "value": json_values(solver.value),
        "n_evaluations": solver.n_evaluations,
        "n_iterations": solver.n_iterations,
        "restarts": solver.restarts,
        "seconds": round(solver.seconds, _SECONDS_DIGITS),
    }


def diagnostics_report(diagnostics: Any) -> dict[str, Any]:
    """All that was diagnosed; every warning with its sentence."""
    fields = json_values(diagnostics)
    warnings = [{"name": one.name, "sentence": diagnostics.sentence(one)} for one in diagnostics.warnings]
    return {**fields, "warnings": warnings}


def versions() -> dict[str, str | None]:
    """Versions of polaropt, Python and the libraries that decide the numbers."""
    return {
        "polaropt": polaropt.__version__,
        "python": platform.python_version(),
        **{name: _version(name) for name in _LIBRARIES},
    }


def _version(name: str) -> str | None:
    try:
        return version(name)
    except PackageNotFoundError:
        return None


def json_values(value: Any) -> Any:
    """Dataclasses, enumerations, numpy scalars and short arrays to what JSON can hold; large arrays are left out."""
    if dataclasses.is_dataclass(value):
        return {field.name: json_values(getattr(value, field.name)) for field in dataclasses.fields(value)}
    if isinstance(value, Enum) and not isinstance(value, str):
        return value.name
    if isinstance(value, Mapping):
        return {str(key): json_values(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [json_values(item) for item in value]
    if hasattr(value, "tolist"):  # numpy
        return json_values(value.tolist()) if value.size <= _LONGEST_ARRAY else None
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    return value if value is None or isinstance(value, bool | int | str) else str(value)
