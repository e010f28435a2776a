"""Options that say which photographs are read, and how their values are to be taken."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from polaropt.cli_options import numbers
from polaropt.errors import InputError

if TYPE_CHECKING:
    from polaropt.capture import Capture
    from polaropt.cli_options import PaneOptions

AngleSense = Literal["ccw", "cw"]
_RELATIVE = "relative"
_FILES = "Reading the photographs"


@dataclass(frozen=True)
class CaptureOptions:
    """The photographs and how their values are to be taken."""

    captures: Annotated[
        list[Path],
        typer.Argument(
            metavar="CAPTURE",
            help="The photographs: one file per polarizer angle in the order of --angles; or one stack (TIFF of "
            "several pages, npz); or one raw mosaic of a polarization camera.",
            show_default=False,
        ),
    ]
    angles: Annotated[
        str,
        typer.Option(
            metavar="DEG,DEG,...",
            help="Polarizer angles in degrees, counter-clockwise from horizontal. relative, or relative,DEG,DEG,...: "
            "only the steps between them are known (0,45,90,135 unless given), the start is found from double images.",
            rich_help_panel=_FILES,
        ),
    ] = "0,45,90,135"
    angle_sense: Annotated[
        AngleSense,
        typer.Option(
            metavar="SENSE",
            help="Sense in which these angles are counted, as the picture shows it: ccw or cw (a filter turned the "
            "other way, mirrored pictures).",
            rich_help_panel=_FILES,
        ),
    ] = "ccw"
    sensor: Annotated[
        str,
        typer.Option(metavar="KIND", help="Kind of mosaic: auto, mono or color.", rich_help_panel=_FILES),
    ] = "auto"
    cell_order: Annotated[
        str,
        typer.Option(
            metavar="DEG,DEG,...",
            help="Angles in a mosaic's 2x2 cell: top left, top right, bottom left, bottom right.",
            rich_help_panel=_FILES,
        ),
    ] = "90,45,135,0"
    black_level: Annotated[
        float,
        typer.Option(
            metavar="VALUE",
            help="Value of black in the file, where the camera adds one. Left out, it brightens both layers by twice "
            "as much; inspect tells how high it can be.",
            rich_help_panel=_FILES,
        ),
    ] = 0.0
    white_level: Annotated[
        float | None,
        typer.Option(
            metavar="VALUE",
            help="Value at which the camera clips. Default: found from the file.",
            rich_help_panel=_FILES,
        ),
    ] = None
    pair_gain: Annotated[
        float | None,
        typer.Option(
            metavar="FACTOR",
            help="Brightness of the 45/135 pair against the 0/90 pair. Default: measured for mosaics, else 1.",
            rich_help_panel=_FILES,
        ),
    ] = None
    gamma: Annotated[
        str | None,
        typer.Option(
            metavar="CODE",
            help="Undo this encoding: srgb or an exponent such as 2.2. Default: the values are linear.",
            rich_help_panel=_FILES,
        ),
    ] = None
    full_resolution: Annotated[
        bool,
        typer.Option(
            "--full-resolution",
            metavar="",
            help="Interpolate a mosaic to full size instead of one pixel per cell.",
            rich_help_panel=_FILES,
        ),
    ] = False
    field_of_view_deg: Annotated[
        float | None,
        typer.Option(
            metavar="DEG",
            help="Angle that the camera sees along the picture's longer side, for scenes that need the focal length. "
            "Default: what the camera wrote into the file (EXIF), else found from the photographs.",
            rich_help_panel=_FILES,
        ),
    ] = None
    align: Annotated[
        bool,
        typer.Option(
            "--align",
            metavar="",
            help="Move photographs that are shifted, turned or scaled against each other (a filter turned by hand, a "
            "camera not held still) onto the first one.",
            rich_help_panel=_FILES,
        ),
    ] = False

    def read(self) -> Capture:
        """Read the files, align them and look for the start of the angles where that is asked for."""
        from polaropt.reader import read_capture

        steps = self.angles.removeprefix(_RELATIVE).removeprefix(",")
        capture = read_capture(
            self.captures,
            numbers(steps or "0,45,90,135", "--angles"),
            self.sensor,
            numbers(self.cell_order, "--cell-order"),
            self.black_level,
            self.white_level,
            self.pair_gain,
            gamma=self.gamma,
            full_resolution=self.full_resolution,
            angle_sense=self.angle_sense,
            field_of_view_deg=self.field_of_view_deg,
        )
        if self.align:
            from polaropt.alignment import align

            capture = align(capture)
        if self.angles.startswith(_RELATIVE):
            from polaropt.angle_frame import find_start_angle

            capture = find_start_angle(capture)
        return capture

    def check(self, pane: PaneOptions) -> None:
        """InputError where what is said of the camera contradicts what is said of the pane."""
        if self.field_of_view_deg is not None and pane.focal_px is not None:
            raise InputError("--field-of-view-deg and --focal-px both set the focal length; give one of them")

    def told(self, capture: Capture) -> list[str]:
        """What aligning and looking for the start of the angles did to a capture that was read, where asked for."""
        sentences = []
        if self.align:
            from polaropt.alignment import alignment_sentence

            sentences.append(alignment_sentence(capture))
        if self.angles.startswith(_RELATIVE):
            from polaropt.angle_frame import start_sentence

            sentences.append(start_sentence(capture))
        return sentences
