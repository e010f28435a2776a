"""An inspection in sentences."""

from __future__ import annotations

from typing import TYPE_CHECKING

from polaropt.pair_gain import PLAUSIBLE_GAIN

if TYPE_CHECKING:
    from polaropt.inspection import Inspection

_LAYOUTS = {
    "files": "one file per angle",
    "stack": "a stack",
    "mono mosaic": "a mono mosaic, one pixel per 2x2 cell",
    "color mosaic": "a colour mosaic, one pixel per 4x4 block",
    "memory": "made in memory",
}
_DARK = 0.1
_NEARLY_BLACK = 0.004
_WEAK_DOLP = 0.02


def sentences(inspection: Inspection) -> tuple[str, ...]:
    """Facts first, then what needs attention."""
    facts = [_size(inspection), _depth(inspection), _black(inspection), _noise(inspection), _saturation(inspection)]
    facts += [
        _polarization(inspection),
        _gain(inspection),
        _encoding(inspection),
        _order(inspection),
        _position(inspection),
    ]
    return tuple(sentence for sentence in facts if sentence)


def _size(it: Inspection) -> str:
    angles = ", ".join(f"{angle:g}" for angle in it.angles_deg)
    kind = "grey" if it.channels == 1 else f"{it.channels} channels"
    return (
        f"{len(it.angles_deg)} photographs of {it.width}x{it.height} px, {kind}, polarizer at {angles} degrees "
        f"({_LAYOUTS.get(it.layout, it.layout)})."
    )


def _depth(it: Inspection) -> str:
    stored = f"Values are stored as {it.sample_type}, " if it.sample_type else "Values "
    grid = "continuous" if it.grey_levels is None else f"about {it.grey_levels} grey levels from black to white"
    levels = f"; black is {it.black_level:g}, white {it.white_level:g}" if it.sample_type else ""
    text = f"{stored}{grid}{levels}." if it.sample_type else f"{stored}are {grid}."
    if it.brightest < _DARK:
        text += (
            f" ATTENTION: the brightest value is {100 * it.brightest:.2g} % of white; "
            "if the camera clips earlier, give its white level (4095 for 12 bits)."
        )
    return text


def _black(it: Inspection) -> str:
    """The black level cannot be measured: what it adds, a pane takes for twice as much light in both layers."""
    if not it.sample_type or it.darkest is None or it.black_level != 0 or it.darkest < _NEARLY_BLACK * it.white_level:
        return ""
    return (
        f"Hardly anything is darker than {it.darkest:.4g}. Part of that may be the camera's own black level, which "
        "photographs do not tell: give it if you know it (black level); else both layers come out brighter by twice it."
    )


def _noise(it: Inspection) -> str:
    return f"The noise of one photograph is {100 * it.noise:.2g} % of white (standard deviation)."


def _saturation(it: Inspection) -> str:
    if it.saturated_share == 0:
        return "Nothing is saturated."
    advice = "; a shorter exposure would help" if it.saturated_share > 0.05 else ""
    return f"{100 * it.saturated_share:.2g} % of the pixels are saturated at one angle or more{advice}."


def _polarization(it: Inspection) -> str:
    text = f"Degree of polarization: median {it.dolp_median:.2f}, 95 % below {it.dolp_95:.2f}."
    if it.dolp_95 < _WEAK_DOLP:
        return f"{text} ATTENTION: the light is hardly polarized; there is little to separate by."
    return f"{text} Angle of polarization: {it.aolp_deg:.0f} degrees, spread {it.aolp_spread_deg:.0f}."


def _gain(it: Inspection) -> str:
    if it.pair_gain is None:
        return ""
    low, high = PLAUSIBLE_GAIN
    if not low <= it.pair_gain <= high:
        return (
            f"ATTENTION: the 45/135 pair is {it.pair_gain:.3f} times as bright as the 0/90 pair, too far from 1 for a "
            "sensor; check the order of the files, their exposure and the black level."
        )
    done = "divided out" if it.pair_gain_removed != 1 else "left as it is"
    return f"The 45/135 pair is {it.pair_gain:.3f} times as bright as the 0/90 pair ({done})."


def _encoding(it: Inspection) -> str:
    measured = "" if it.gamma_exponent is None else f"measured exponent {it.gamma_exponent:.2f} +- {it.gamma_error:.2f}"
    hint = f"file format: {it.encoding_hint}" if it.encoding_hint else ""
    reasons = "; ".join(text for text in (measured, hint) if text)
    if it.looks_encoded:
        return f"ATTENTION: the values look gamma-encoded ({reasons}); if they are, read them with gamma srgb or 2.2."
    if it.looks_encoded is False:
        return f"The values are linear ({measured})."
    if it.swapped_deg or it.visible_shift_px:
        return ""
    return f"Whether the values are gamma-encoded cannot be told{f' ({reasons})' if reasons else ''}."


def _order(it: Inspection) -> str:
    if it.swapped_deg:
        pairs = ", or ".join(f"{a:g} and {b:g}" for a, b in it.swapped_deg)
        return f"ATTENTION: photographs look swapped: {pairs} degrees; check the order of the files."
    if len(it.angles_deg) == 3:
        return "With three angles a wrong order of the files cannot be seen."
    return ""


def _position(it: Inspection) -> str:
    if it.visible_shift_px == 0:
        return ""
    return (
        f"ATTENTION: photographs look shifted against each other, by about {it.visible_shift_px:.1f} px; "
        "read them with align."
    )
