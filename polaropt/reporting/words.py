"""The pane's numbers in a sentence."""

from __future__ import annotations

import math
from typing import Any

_NUMBERS = (
    ("incidence_deg", "incidence", "deg"),
    ("azimuth_deg", "azimuth", "deg"),
    ("ghost_shift", "ghost shift", "px"),
    ("transmission_ghost_shift", "of the transmission", "px"),
)
_LIGHT = (
    ("transmission_polarization", "light behind it polarized"),
    ("reflection_polarization", "mirrored light polarized"),
)


def pane_sentence(report: dict[str, Any]) -> str:
    """How the pane stands, each number with where it comes from.

    Parameters
    ----------
    report : dict
        As ``report.json``.
    """
    scene, estimated = report["scene"], report["estimated"]
    if not scene["signal"]:
        return "Not separated: the intensity is returned as transmission."
    varies = scene["focal_px"] is not None or any(scene["bend_deg_per_px"])
    parts = [
        f"{word} {scene[name]:.2f} {error_of(report['errors'][name])}{unit} ({_source(name, estimated)})"
        for name, word, unit in _NUMBERS
        if scene[name] is not None
        and not (name == "ghost_shift" and (scene["single_surface"] or (varies and not scene[name])))
    ]
    if varies:
        parts.insert(2, "both changing over the picture")
    if scene["focal_px"] is not None:
        error = error_of(report["errors"]["focal_px"])
        parts.append(f"focal length {scene['focal_px']:.0f} {error}px ({_source('focal_px', estimated)})")
    if any(scene["bend_deg_per_px"]):
        from polaropt.optics import largest_turn

        turn = 100 * largest_turn(scene["bend_deg_per_px"])
        parts.append(f"bent by {turn:.1f} deg in 100 px ({_source('bend_deg_per_px', estimated)})")
    parts += [_light(report, name, word) for name, word in _LIGHT if scene[name][0]]
    return f"Pane: {', '.join(parts)}, refractive index {scene['refractive_index']:g}."


def _light(report: dict[str, Any], name: str, word: str) -> str:
    """Degree and angle at which a layer's light arrives polarized."""
    (degree, angle), errors = report["scene"][name], report["errors"][name]
    of_degree, of_angle = errors or (None, None)
    source = "given" if errors is None else "estimated"
    return f"{word} {degree:.2f} {error_of(of_degree)}at {angle:.0f} {error_of(of_angle)}deg ({source})"


def error_of(error: float | None) -> str:
    """A standard error to be said after its value, two digits of it; nothing where there is none."""
    if error is None or not math.isfinite(error):
        return ""
    digits = max(0, 1 - math.floor(math.log10(error))) if error > 0 else 2
    return f"+- {error:.{min(digits, 2)}f} "


def _source(name: str, estimated: list[str]) -> str:
    return "estimated" if name in estimated else "given"
