"""What is said to people of a capture, a scene and a separation: the only place that makes sentences of them."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, NamedTuple

from polaropt.capture import PLAUSIBLE_GAIN, Capture, EncodingHint
from polaropt.judging import SeparationWarning
from polaropt.optics import FIELDS, Field, SceneParameters, largest_turn
from polaropt.reporting.inspection import Inspection, exposed_apart
from polaropt.reporting.meanings import meaning_of
from polaropt.reporting.pictures import LAYERS
from polaropt.reporting.report import is_set, scene_report

if TYPE_CHECKING:
    from polaropt.estimation import LadderResult


_LAYOUTS = {
    "files": "one file per angle",
    "stack": "a stack",
    "mono mosaic": "a mono mosaic",
    "color mosaic": "a colour mosaic",
    "memory": "made in memory",
}
# Share of white below which the brightest value asks whether white lies lower. Set by hand: 12 bits in a file
# of 16 end at 0.0625.
_DIM_BRIGHTEST = 0.1
# Share of white from which the darkest value may be a black level. Set by hand: about one level of 8 bits.
_LEAST_BLACK = 0.004
# Degree of polarization that nothing is below in a capture worth separating. Set by hand.
_WEAK_DOLP = 0.02
# Share of pixels from which a shorter exposure is advised. Set by hand.
_MUCH_SATURATED = 0.05
# Standard error below which a second digit of it is more than anybody knows. Set by hand.
_HUNDREDTH = 0.01

Subject = Literal[
    "size",
    "values",
    "black",
    "noise",
    "saturation",
    "polarization",
    "gain",
    "exposure",
    "jpeg",
    "encoding",
    "order",
    "defects",
    "position",
    "sharpness",
    "motion",
    "unglazed",
]


@dataclass(frozen=True)
class Finding:
    """What an inspection says of one subject: the fact, and what a person must look at; either may be empty."""

    subject: Subject
    fact: str = ""
    attention: str = ""

    @property
    def sentence(self) -> str:
        """Both in one line."""
        return " ".join(filter(None, (self.fact, *marked(filter(None, [self.attention])))))


def marked(sentences: Iterable[str]) -> Iterator[str]:
    """Sentences that need attention, marked as such."""
    return (f"ATTENTION: {sentence}" for sentence in sentences)


def capture_findings(inspection: Inspection) -> tuple[Finding, ...]:
    """All that there is to say of a capture, subject by subject."""
    findings = (
        _size(inspection),
        _values(inspection),
        _black(inspection),
        _noise(inspection),
        _saturation(inspection),
        _polarization(inspection),
        _gain(inspection),
        _gains(inspection),
        _jpeg(inspection),
        _encoding(inspection),
        _order(inspection),
        _defects(inspection),
        _position(inspection),
        _sharpness(inspection),
        _motion(inspection),
        _unglazed(inspection),
    )
    return tuple(finding for finding in findings if finding.sentence)


def inspection_sentences(inspection: Inspection) -> list[str]:
    """One line per subject; what needs attention is marked."""
    return [finding.sentence for finding in capture_findings(inspection)]


def attention(inspection: Inspection, warnings: Collection[SeparationWarning]) -> list[str]:
    """What an inspection says that a person must look at, and that the separation's warnings do not say already."""
    # How weak the polarization is the separation measures against the noise.
    repeated: set[Subject] = {"polarization"}
    if SeparationWarning.GAMMA_ENCODED in warnings:
        repeated.add("encoding")
    if SeparationWarning.MISALIGNED in warnings:
        repeated.add("position")
    if SeparationWarning.MOVING in warnings:
        repeated.add("motion")
    findings = capture_findings(inspection)
    return [finding.attention for finding in findings if finding.attention and finding.subject not in repeated]


def _size(it: Inspection) -> Finding:
    angles = ", ".join(f"{angle:g}" for angle in it.angles_deg)
    kind = "grey" if it.channels == 1 else f"{it.channels} channels"
    return Finding(
        "size",
        f"{len(it.angles_deg)} photographs of {it.width}x{it.height} px, {kind}, polarizer at {angles} degrees "
        f"({_LAYOUTS.get(it.layout, it.layout)}).{_left_out(it)}{_exposures(it)}{_held(it)}{_colors(it)}",
    )


def _exposures(it: Inspection) -> str:
    if not it.exposures:
        return ""
    if not exposed_apart(it.exposures):
        return " All were exposed alike."
    listed = ", ".join(f"{exposure:.3g}" for exposure in it.exposures)
    told = f"{listed}, as given" if it.exposures_given else f"{listed} s at ISO 100"
    return f" They were exposed differently ({told}), which is divided out."


def _held(it: Inspection) -> str:
    if it.orientation == 1:
        return ""
    return " They were turned upright, as the camera tells how it was held; angles count from the upright horizontal."


def _colors(it: Inspection) -> str:
    if not it.profile:
        return ""
    if not it.shown_in_srgb:
        return (
            f" Their colours are in {it.profile}, which is kept in the linear values; pictures show them as if in sRGB."
        )
    return f" Their colours are those of {it.profile}: the layers keep them and say so, pictures show them in sRGB."


def _jpeg(it: Inspection) -> Finding:
    """What JPEG takes: double images are fine detail, and blocks of 8x8 pixels are the same in all photographs."""
    if it.jpeg is None:
        return Finding("jpeg")
    is_heif = it.jpeg.quality is None
    facts = [] if is_heif else [f"quality about {it.jpeg.quality}"]
    facts += ["colours at half the resolution"] if it.jpeg.halved_colors else []
    what = "were JPEG files before they were saved again" if it.jpeg.saved_again else "are JPEG files"
    what = "are HEIC files" if is_heif else what
    what += f" ({', '.join(facts)})" if facts else ""
    return Finding(
        "jpeg",
        attention=f"the photographs {what}: double images and fine detail "
        "may be lost, and the pane's numbers and both layers are less certain; save TIFF or camera raw files at once.",
    )


def _gains(it: Inspection) -> Finding:
    if not it.uneven_gains:
        return Finding("exposure")
    told = ", or ".join(f"that at {angle:g} degrees {gain:.3f} times as bright" for angle, gain in it.uneven_gains)
    angle, gain = it.uneven_gains[0]
    exposures = ",".join(f"{gain:.3g}" if each == angle else "1" for each in it.angles_deg)
    seen = "or one was exposed" if it.swapped_deg else "one photograph looks exposed"
    return Finding(
        "exposure",
        attention=f"{seen} unlike the others, {told} as these tell; if it was, give its exposure "
        f"(--exposures {exposures}).",
    )


def _left_out(it: Inspection) -> str:
    rows, columns = it.left_out_px
    if not rows and not columns:
        return ""
    return f" {rows} rows and {columns} columns at the far sides make no whole cell and were left out."


def _values(it: Inspection) -> Finding:
    grid = "continuous" if it.grey_levels is None else f"about {it.grey_levels} grey levels from black to white"
    if it.sample_type:
        levels = f"black is {it.black_level:g}, white {it.white_level:g}"
        fact = f"Values are stored as {it.sample_type}, {grid}; {levels}."
    else:
        fact = f"Values are {grid}."
    if it.brightest >= _DIM_BRIGHTEST:
        return Finding("values", fact)
    return Finding(
        "values",
        fact,
        f"the brightest value is {100 * it.brightest:.2g} % of white; "
        "if the camera clips earlier, give its white level (4095 for 12 bits).",
    )


def _black(it: Inspection) -> Finding:
    """The black level cannot be measured: what it adds, a pane takes for twice as much light in both layers."""
    if not it.sample_type or it.darkest is None or it.black_level != 0 or it.darkest < _LEAST_BLACK * it.white_level:
        return Finding("black")
    return Finding(
        "black",
        f"Hardly anything is darker than {it.darkest:.4g}. Part of that may be the camera's own black level, "
        "which photographs do not tell: give it if you know it (black level); else both layers come out brighter by "
        "twice it.",
    )


def _noise(it: Inspection) -> Finding:
    sentence = f"The noise of one photograph is {100 * it.noise:.2g} % of white (standard deviation)."
    if it.slow_noise > 1:
        sentence += (
            " Neighbouring pixels have it in common, as where photographs were demosaicked, resized or smoothed: slow "
            f"changes are {it.slow_noise:.2g} times as noisy as they would be else, which is taken into account."
        )
    return Finding("noise", sentence)


def _saturation(it: Inspection) -> Finding:
    if it.saturated_share == 0:
        return Finding("saturation", "Nothing is saturated.")
    advice = "; a shorter exposure would help" if it.saturated_share > _MUCH_SATURATED else ""
    share = f"{100 * it.saturated_share:.2g} % of the pixels are saturated at one angle or more"
    return Finding("saturation", f"{share}{advice}.")


def _polarization(it: Inspection) -> Finding:
    fact = f"Degree of polarization: median {it.dolp_median:.2f}, 95 % below {it.dolp_95:.2f}."
    if it.dolp_95 < _WEAK_DOLP:
        return Finding("polarization", fact, "the light is hardly polarized; there is little to separate by.")
    angle = f"Angle of polarization: {it.aolp_deg:.0f} degrees, spread {it.aolp_spread_deg:.0f}."
    return Finding("polarization", f"{fact} {angle}")


def _gain(it: Inspection) -> Finding:
    if it.pair_gain is None:
        return Finding("gain")
    low, high = PLAUSIBLE_GAIN
    if not low <= it.pair_gain <= high:
        return Finding(
            "gain",
            attention=f"the 45/135 pair is {it.pair_gain:.3f} times as bright as the 0/90 pair, too far from 1 for a "
            "sensor; check the order of the files, their exposure and the black level.",
        )
    done = "divided out" if it.pair_gain_removed != 1 else "left as it is"
    return Finding("gain", f"The 45/135 pair is {it.pair_gain:.3f} times as bright as the 0/90 pair ({done}).")


def _encoding(it: Inspection) -> Finding:
    measured = ""
    if it.gamma_exponent is not None:
        digits = max(2, _digits_of(it.gamma_error))
        measured = f"measured exponent {it.gamma_exponent:.{digits}f} {error_of(it.gamma_error)}".strip()
    hint = f"file format: {it.encoding_hint}" if it.encoding_hint else ""
    if it.encoding_hint is EncodingHint.PROFILE and it.profile_exponent is not None:
        hint += f", with an exponent of {it.profile_exponent:.2g}"
    reasons = "; ".join(filter(None, (measured, hint)))
    if it.looks_encoded:
        return Finding(
            "encoding",
            attention=f"the values look gamma-encoded ({reasons}); if they are, read them with gamma srgb or 2.2"
            + (", as exposures can be divided out of linear values alone." if exposed_apart(it.exposures) else "."),
        )
    if it.looks_encoded is False:
        return Finding("encoding", f"The values are linear ({measured}).")
    if it.swapped_deg or it.visible_shift_px:
        return Finding("encoding")
    because = f" ({reasons})" if reasons else ""
    return Finding("encoding", f"Whether the values are gamma-encoded cannot be told{because}.")


def _order(it: Inspection) -> Finding:
    if it.cell_order is not None and it.closing_orders:
        orders = " or ".join(_listed(order) for order in it.closing_orders)
        return Finding(
            "order",
            attention=f"the cell's orthogonal pairs do not add up in the order {_listed(it.cell_order)}; they do in "
            f"{orders}, or another with the same pairs: check the cell order.",
        )
    if it.cell_order is not None and it.cell_order_found:
        return Finding("order", attention=_found_order(it.cell_order))
    if it.swapped_deg:
        pairs = ", or ".join(f"{a:g} and {b:g}" for a, b in it.swapped_deg)
        return Finding("order", attention=f"photographs look swapped: {pairs} degrees; check the order of the files.")
    if len(it.angles_deg) == 3:
        return Finding("order", "With three angles a wrong order of the files cannot be seen.")
    return Finding("order")


def cell_order_attention(capture: Capture) -> list[str]:
    """In which order a mosaic's cell was read, where that is not the usual one and was not asked for."""
    origin = capture.origin
    found = origin is not None and origin.cell_order_found
    return [_found_order(origin.cell_order)] if found and origin is not None and origin.cell_order else []


def _found_order(cell_order: Iterable[float]) -> str:
    return (
        "the cell's orthogonal pairs do not add up in the usual order; it was read in the order "
        f"{_listed(cell_order)}, in which they do, as in others with the same pairs."
    )


def _listed(angles: Iterable[float]) -> str:
    return ",".join(f"{angle:g}" for angle in angles)


def _defects(it: Inspection) -> Finding:
    if not it.defects:
        return Finding("defects")
    who, them, their = ("sample stands out by itself", "it", "its")
    if it.defects > 1:
        who, them, their = ("samples stand out by themselves", "them", "their")
    return Finding(
        "defects", f"{it.defects} {who}, as hot and dead pixels do: what lies around {them} took {their} place."
    )


def _position(it: Inspection) -> Finding:
    if it.layer_shifts_px:
        # Which of the layers is behind the pane is told by how this stands.
        one, other = map(_farthest, it.layer_shifts_px)
        return Finding(
            "position",
            attention="each layer lies elsewhere by itself, as a camera that is held by hand sees them: one by up to "
            f"{one:.2f} px from where the first photograph shows it, the other by up to {other:.2f}; both are moved "
            "back when they are separated.",
        )
    if it.visible_shift_px == 0:
        return Finding("position")
    return Finding(
        "position",
        attention=f"photographs look shifted or turned against each other, by about {it.visible_shift_px:.1f} px; "
        "up to 128, and a quarter of the shorter side, they are moved back when they are separated, beyond read them "
        "with align.",
    )


def _sharpness(it: Inspection) -> Finding:
    blurred = _blurred(it.blurs_px)
    if not blurred:
        return Finding("sharpness")
    return Finding(
        "sharpness",
        attention=f"photographs are not equally sharp, least so {blurred}; they are made so when they are separated.",
    )


def _unglazed(it: Inspection) -> Finding:
    if not it.unglazed_share:
        return Finding("unglazed")
    share = f"{100 * it.unglazed_share:.2g} % of the picture"
    return Finding(
        "unglazed",
        f"{share} look as if they showed no glass: unpolarized, up to a clear edge. Where the pane found would have "
        "polarized them, they are left out when it is separated.",
    )


MOTION_UNSEEN = "With three angles it cannot be seen whether something moves between the photographs: four would tell."


def _motion(it: Inspection) -> Finding:
    if it.moving_share:
        return Finding("motion", attention=" ".join(motion_attention(it.moving_share)))
    return Finding("motion", MOTION_UNSEEN if len(it.angles_deg) == 3 else "")


def motion_attention(share: float) -> list[str]:
    """How much of the picture moves between the photographs; nothing where nothing does."""
    if not share:
        return []
    moved = f"something moves between the photographs, in {100 * share:.2g} % of the picture"
    return [f"{moved}: it is left out where but one of them saw it, else separated as one of them saw it."]


def alignment_sentence(capture: Capture) -> str:
    """What aligning moved, turned and scaled."""
    origin = capture.origin
    if origin is None or not origin.shifts_px:
        return "Aligned: the photographs lie on each other as they are; nothing was moved."
    moves = ", ".join(
        f"({down:+.2f}, {right:+.2f})".replace("+0.00", "0").replace("-0.00", "0") for down, right in origin.shifts_px
    )
    shifts = f"Aligned: photographs moved back by (down, right) px {moves}, known to {origin.shift_error_px:.2g}"
    if not origin.rotations_deg:
        return f"{shifts}."
    turns = ", ".join(f"{angle:+.2f}" for angle in origin.rotations_deg[1:])
    growth = ", ".join(f"{100 * (scale - 1):+.2f}" for scale in origin.scales[1:])
    return f"{shifts}; turned back by {turns} deg clockwise and scaled back by {growth} % against the first."


def start_sentence(capture: Capture) -> str:
    """Where the polarizer's angles start, if only the steps between them were known."""
    if capture.origin is None or capture.origin.start_deg is None:
        return (
            "Start of the angles: the photographs do not tell it (no double images of a clear direction). The azimuth "
            "counts from the filter's start, and double images are not modelled."
        )
    return f"Start of the angles: {capture.origin.start_deg:+.0f} deg from horizontal, as the double images tell."


def shown_fields(scene: Mapping[str, Any]) -> list[Field]:
    """Fields that say something of a scene as in ``report.json``: not what it lacks."""
    varies = scene["focal_px"] is not None or any(scene["bend_deg_per_px"])
    absent: set[str] = set() if scene["n_panes"] != 1 else {"n_panes", "gap_shift", "gap_azimuth_deg"}
    absent |= set() if scene["absorption"] else {"absorption"}
    if scene["single_surface"]:
        absent |= {"ghost_shift", "transmission_ghost_shift"}
    elif varies and not scene["ghost_shift"]:
        absent |= {"ghost_shift"}
    return [field for field in FIELDS if field.name not in absent and is_set(field, scene[field.name])]


def source_of(name: str, estimated: Collection[str]) -> str:
    """Where the value of a field comes from, in a word."""
    if name in estimated:
        return "estimated"
    # Glass has 1.5 unless something else is asked for.
    return "given or assumed" if name == "refractive_index" else "given"


def pane_sentence(report: dict[str, Any]) -> str:
    """How the pane stands, each number with where it comes from.

    Parameters
    ----------
    report : dict
        As ``report.json``.
    """
    scene = report["scene"]
    if not scene["signal"]:
        return "Not separated: the intensity is returned as transmission."
    parts = {field.name: _phrase(field, report) for field in shown_fields(scene)}
    if scene["focal_px"] is not None or any(scene["bend_deg_per_px"]):
        parts["azimuth_deg"] += ", both changing over the picture"
    return f"Pane: {', '.join(parts.values())}."


def _phrase(field: Field, report: dict[str, Any]) -> str:
    """A field's words, numbers, errors and source."""
    amount = amount_of(field, report["scene"][field.name], report["errors"].get(field.name))
    source = _source_and_doubt(source_of(field.name, report["estimated"]), field, report["errors"].get(field.name))
    if field.name == "bend_deg_per_px":
        return f"bent by {amount} ({source})"
    if len(field.components) > 1:
        return f"{field.label} polarized {amount} ({source})"
    return f"{field.label} {amount} ({source})"


def _source_and_doubt(source: str, field: Field, error: Any) -> str:
    """Where a value comes from, and that it has no standard error where an estimated one has none."""
    errors = error if isinstance(error, list | tuple) else [error]
    countable = field.name == "n_panes"
    unknown = source == "estimated" and not countable and not any(map(error_of, errors))
    return f"{source}, error not known" if unknown else source


def amount_of(field: Field, value: Any, error: Any) -> str:
    """Numbers of a field with their standard errors, where there are any, and units."""
    if field.name == "bend_deg_per_px":
        # The largest turn is known no worse than its three numbers together.
        known = error_of(100 * math.hypot(*error)) if error and None not in error else ""
        return f"{100 * largest_turn(value):.1f} {known}deg in 100 px"
    errors = error if isinstance(error, list | tuple) else [error] * len(field.components)
    values = value if isinstance(value, list | tuple) else [value]
    parts = (
        f"{number:.{max(component.digits, _digits_of(of_number))}f} {error_of(of_number)}{component.unit}".strip()
        for component, number, of_number in zip(field.components, values, errors, strict=True)
    )
    return " at ".join(parts)


def estimate_sentences(
    found: LadderResult, given: SceneParameters, focal_hint_px: float | None = None, *, from_thickness: bool = False
) -> list[str]:
    """The scene, line by line, and what it rests on.

    Parameters
    ----------
    found : LadderResult
    given : SceneParameters
        What was asked for; None in it was estimated.
    focal_hint_px : float, optional
        Focal length that the camera told.
    from_thickness : bool
        Whether the ghost shift follows from the incidence and a thickness that was given.
    """
    report = scene_report(found.scene, given, focal_hint_px)
    sources = {field.name: source_of(field.name, report["estimated"]) for field in FIELDS}
    if from_thickness:
        sources["ghost_shift"] = "from the thickness"
    fields = shown_fields(report["scene"])
    heads = max(len(field.label) for field in fields)
    lines = []
    for field in fields:
        error = getattr(found.errors, field.name, None)
        amount = amount_of(field, getattr(found.scene, field.name), error)
        lines.append(f"{field.label:{heads}}  {amount} ({_source_and_doubt(sources[field.name], field, error)})")
    if found.scene.varies:
        lines.append("incidence and azimuth change over the picture; those above are at its middle")
    elif given.single_surface:
        lines.append("a single surface, without ghosts")
    rungs = (
        f"{'rung':{heads}}  {tried.rung}: {'taken' if tried.taken else 'left'}. {tried.reason}".rstrip()
        for tried in found.tried
    )
    # A rung that is looked at in two ways is told once, unless there is more to tell.
    lines += dict.fromkeys(rungs)
    if found.estimate is not None and not found.estimate.polarized:
        lines += marked(["the light is not polarized beyond the noise; these numbers mean nothing."])
    return lines


def report_sentences(report: dict[str, Any], folder: Path) -> list[str]:
    """A separation in a few lines, and what was written.

    Parameters
    ----------
    report : dict
        As ``report.json``.
    folder : Path
        Where the files are.
    """
    exposures = " and ".join(f"{report['view']['exposure'][name]:.3g}" for name in LAYERS)
    lines = [
        *result_sentences(report),
        *marked(report_attention(report)),
        *motion_sentences(report),
        f"Written to {folder}:",
        "  transmission.tiff, reflection.tiff  linear values",
        f"  transmission.png, reflection.png    to look at: sRGB of {exposures} times the linear values",
    ]
    if report["uncertainty"] is not None:
        lines.append("  transmission_error.tiff, reflection_error.tiff, reflection_known.tiff, uncertainty.png")
        lines.append(f"                                      {_uncertainty_sentence(report['uncertainty'])}")
    if report["misfit_map"] is not None:
        lines.append(
            "  misfit.tiff, misfit.png             where the pane does not explain the photographs, in units of noise"
        )
    pictures = (
        ("moving.png", "what moves between the photographs", report["inspection"]["moving_share"]),
        ("unglazed.png", "what shows no glass", report["unglazed_share"]),
    )
    for name, what, share in pictures:
        if share and name in report["written"]:
            lines.append(f"  {name:<36}in red {what}, {100 * share:.2g} % of the picture")
    lines.append("  report.json                         scene, objective, solver, diagnostics, versions")
    if "report.html" in report["written"]:
        lines.append("  report.html                         the result as a page, with pictures and warnings")
    return lines


def result_sentences(report: dict[str, Any]) -> list[str]:
    """How photographs were made to agree, what was left out, pane, solve and the time of all, of ``report.json``."""
    return [
        *matching_sentences(report["matching"]),
        *unglazed_sentences(report["unglazed_share"]),
        pane_sentence(report),
        f"Solver: {solver_sentence(report['solver'])}",
        time_sentence(report["seconds"]),
    ]


# Share of the whole from which a stage is told by itself; set by hand.
_NOTABLE_STAGE = 0.02


def solver_sentence(solver: Mapping[str, Any]) -> str:
    """Evaluations, why the solver ended, and how far the layers were pulled back to the start.

    Parameters
    ----------
    solver : mapping
        As in ``report.json``.
    """
    ended = f"{solver['n_evaluations']} evaluations. {solver['sentence']}"
    share = solver["keep_start"]
    return f"{ended} The layers were then pulled {share:.0%} of the way back to the start." if share else ended


def time_sentence(seconds: Mapping[str, float]) -> str:
    """Seconds of all that was done, and of the stages that take most of it.

    Parameters
    ----------
    seconds : mapping of str to float
        Of each stage.
    """
    total = sum(seconds.values())
    notable = [(name, value) for name, value in seconds.items() if value >= _NOTABLE_STAGE * total]
    return f"{total:.1f} s altogether: {', '.join(f'{name.lower()} {value:.1f}' for name, value in notable)}."


# Shifts and blurs below which nobody asks, in pixels, and growth; set by hand.
_SAID_PX, _SAID_PERCENT = 0.02, 0.01


def matching_sentences(matching: Mapping[str, Any] | None) -> list[str]:
    """How photographs were made to agree, of ``report.json``; nothing where they did."""
    if matching is None:
        return []
    told = []
    if matching["rotations_deg"] is not None:
        turn = max(map(abs, matching["rotations_deg"]))
        growth = max(abs(100 * (scale - 1)) for scale in matching["scales"])
        scaled = f" and scaled by up to {growth:.2g} %" if growth > _SAID_PERCENT else ""
        told.append(f"turned back onto the first by up to {turn:.2g} degrees{scaled}")
    if matching["layer_shifts_px"] is not None:
        told.append(
            "moved onto the first, each layer by itself, as a camera held by hand sees them: "
            + _layers_apart(list(matching["layer_shifts_px"].values()))
        )
    elif (largest := _farthest(matching["shifts_px"])) > _SAID_PX:
        told.append(f"moved onto the first by up to {largest:.2f} px")
    if blurred := _blurred(matching["blurs_px"]):
        told.append(f"made as sharp as the sharpest, which these were not: {blurred}")
    if matching["exposures"]:
        told.append(f"brought to one exposure, of which they had {_ratios(matching['exposures'])}")
    if matching["gains"]:
        told.append(f"brought to one gain, of which their analyzers had {_ratios(matching['gains'])}")
    if matching["white_balances"]:
        largest = max(abs(100 * (ratio - 1)) for of in matching["white_balances"] for ratio in of)
        told.append(f"brought to one white balance, by up to {largest:.2g} % of red or blue beside green")
    return [f"The photographs were {' and '.join(told)}."] if told else []


def _ratios(numbers: Iterable[float]) -> str:
    *others, last = (f"{each:.4g}" for each in numbers)
    return f"{', '.join(others)} and {last} times the first one's"


def _farthest(shifts_px: Iterable[Iterable[float]]) -> float:
    return max(math.hypot(*shift) for shift in shifts_px)


def _layers_apart(shifts_px: Sequence[Iterable[Iterable[float]]]) -> str:
    behind, mirrored = map(_farthest, shifts_px)
    return f"what is behind the glass by up to {behind:.2f} px, what it mirrors by up to {mirrored:.2f} px"


def _blurred(blurs_px: Iterable[float]) -> str:
    """Which photographs are less sharp than others, and by how much."""
    blurs = [(number, blur) for number, blur in enumerate(blurs_px, 1) if blur > _SAID_PX]
    return ", ".join(f"{number} (a Gaussian of {blur:.2f} px)" for number, blur in blurs)


def unglazed_sentences(share: float) -> list[str]:
    """That a share of the frame shows no glass; nothing where none does."""
    if not share:
        return []
    return [f"{100 * share:.2g} % of the picture show no glass, and were left out: what is there is seen directly."]


def motion_sentences(report: dict[str, Any]) -> list[str]:
    """That motion would not show, where three angles say nothing twice; of ``report.json``."""
    return [MOTION_UNSEEN] if len(report["input"]["angles_deg"]) == 3 else []


def report_attention(report: dict[str, Any]) -> list[str]:
    """All that a person must look at, of the capture and of the separation, in ``report.json``."""
    return [warned.sentence for warned in explained_attention(report)]


class Warned(NamedTuple):
    """What a person must look at: a sentence, and as HTML what it means and what to do; empty where it says all."""

    sentence: str
    meaning: str


def explained_attention(report: dict[str, Any]) -> list[Warned]:
    """The same with what each warning means."""
    of_result = report["diagnostics"]["warnings"]
    return [
        *(Warned(sentence, "") for sentence in report["attention"]),
        *(Warned(_warned(warning, report), meaning_of(warning["name"])) for warning in of_result),
    ]


def _warned(warning: dict[str, str], report: dict[str, Any]) -> str:
    """A warning's sentence, after the numbers that it rests on."""
    numbers = {
        SeparationWarning.INDEX_DOUBTFUL.name: _likelier_index,
        SeparationWarning.SCENE_UNCERTAIN.name: _loss,
    }.get(warning["name"])
    return warning["sentence"] if numbers is None else f"{numbers(report)} {warning['sentence']}"


def _likelier_index(report: dict[str, Any]) -> str:
    likelier, told = report["diagnostics"]["likelier_index"], report["scene"]["refractive_index"]
    return (
        f"Glass of index {likelier['index']:.2f} {error_of(likelier['error'])}explains the photographs better than one "
        f"pane of {told:g}."
    )


def _loss(report: dict[str, Any]) -> str:
    loss = report["diagnostics"]["loss"]
    field = next(field for field in FIELDS if field.name == loss["number"])
    error, units = error_of(loss["error"]), {component.unit for component in field.components}
    if len(units) > 1:
        # A degree and an angle have no error in common.
        known = f"{field.words} is not known exactly"
    else:
        known = f"{field.label} is " + (f"known to {error}{min(units)}".rstrip() if error else "hardly known")
    return (
        f"The {known}: against a pane that is known, its errors cost the transmission about "
        f"{loss['transmission_db']:.0f} dB and the reflection {loss['reflection_db']:.0f} dB."
    )


def _uncertainty_sentence(uncertainty: dict[str, Any]) -> str:
    typical, faded = uncertainty["typical_error"], uncertainty["reflection_faded"]["share_of_pixels"]
    # Near a mirror they may be beyond any number.
    of_layers = ["unbounded" if error is None else f"{error:.2g}" for error in typical.values()]
    return (
        f"standard errors, typically {' and '.join(of_layers)}; "
        f"the reflection's detail is unknown in {100 * faded:.0f} % of the picture"
    )


def error_of(error: float | None) -> str:
    """A standard error to be said after its value; nothing where there is none.

    Two digits of it but no more than hundredths, and below these one digit.
    """
    if error is None or not math.isfinite(error) or error <= 0:
        return ""
    return f"+- {error:.{_digits_of(error)}f} "


def _digits_of(error: float | None) -> int:
    """Digits after the point with which a standard error is said; 0 where there is none."""
    if error is None or not math.isfinite(error) or error <= 0:
        return 0
    first = -math.floor(math.log10(error))
    # Rounding may make a digit more of it: 0.0096 is 0.010.
    return max(0, min(first + 1, 2)) if error >= _HUNDREDTH else first
