"""``polaropt calibrate``: gain, contrast and angle of a polarization camera's analyzers, from evenly lit fields."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

import polaropt
from polaropt.cli.command import say, say_json
from polaropt.cli.options import (
    AsJson,
    BlackLevel,
    CellOrder,
    HeadlessShape,
    PixelFormat,
    SensorKind,
    WhiteLevel,
    cell_order_of,
    sides_of,
)

if TYPE_CHECKING:
    from polaropt.optics import Calibration


@dataclass(frozen=True)
class FieldOptions:
    """The fields, how their values are to be taken, and where the result goes."""

    fields: Annotated[
        list[Path],
        typer.Argument(
            metavar="FLATS",
            help="Raw mosaics of an evenly lit, unpolarized field, without a filter (gains) or behind a polarizer in "
            "four or more turns (contrast and angles, too), the lamp unchanged.",
            show_default=False,
        ),
    ]
    output: Annotated[
        Path,
        typer.Option("--output", "-o", metavar="FILE.json", help="For separate --analyzer.", show_default=False),
    ]
    sensor: SensorKind = "auto"
    cell_order: CellOrder = None
    black_level: BlackLevel = 0.0
    white_level: WhiteLevel = None
    shape: HeadlessShape = None
    pixel_format: PixelFormat = None
    json: AsJson = False


def calibrate_command(options: FieldOptions) -> None:
    """Measure the analyzers of a polarization camera.

    Unpolarized fields tell the gain of each corner of the cell. Contrast and angles need four or more turns of a
    polarizer; all angles are known up to one common rotation, which the polarizer's own mount would have to tell.
    """
    from polaropt.capture import field_means, result_file
    from polaropt.optics import calibrate

    means, angles = field_means(
        options.fields,
        options.sensor,
        cell_order_of(options.cell_order),
        options.black_level,
        options.white_level,
        shape=sides_of(options.shape),
        pixel_format=options.pixel_format,
    )
    found = calibrate(means, angles)
    document = {"polaropt": polaropt.__version__, **asdict(found.analyzer), **_told(found)}
    with result_file(options.output) as temporary:
        temporary.write_text(json.dumps(document, indent=2) + "\n", encoding="utf-8")
    if options.json:
        say_json({"output": str(options.output), **document})
    else:
        say(*_sentences(found), f"Written: {options.output}")


def _told(found: Calibration) -> dict[str, Any]:
    return {
        "unpolarized_fields": found.n_unpolarized,
        "polarizer_turns": found.n_turns,
        "contrast_and_angles_measured": found.complete,
        "angles_open": found.angles_open,
        "residual": found.residual,
    }


def _sentences(found: Calibration) -> list[str]:
    of_it = found.analyzer
    lines = [
        f"{found.n_unpolarized} unpolarized fields, {found.n_turns} turns of a polarizer; "
        f"{100 * found.residual:.2g} % of the light is left unexplained."
    ]
    if not found.complete:
        lines.append("ATTENTION: Only the gains are told: contrast and angles need 4 or more turns of a polarizer.")
    if found.ambiguous:
        lines.append("ATTENTION: Four turns alone leave up to 1 % open: add a fifth, or an unpolarized field.")
    elif found.angles_open:
        lines.append(
            "ATTENTION: Turns 45 degrees apart leave open how far the two pairs are turned against each other: add one "
            "in between."
        )
    for angle, gain, contrast, true in zip(
        of_it.angles_deg, of_it.gains, of_it.contrasts, of_it.true_angles_deg, strict=True
    ):
        rest = f", contrast {contrast:.4f}, angle {true:.2f} deg" if found.complete else ""
        lines.append(f"  {angle:5g} deg: gain {gain:.4f}{rest}")
    return lines
