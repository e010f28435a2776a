"""Options that several commands share, in groups, and what they mean."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from polaropt.errors import InputError

if TYPE_CHECKING:
    from polaropt.scene import SceneParameters

ThicknessKind = Literal["paper", "plate"]
_PANE = "The pane"


@dataclass(frozen=True)
class PaneOptions:
    """What is known of the pane."""

    incidence: Annotated[
        float | None,
        typer.Option(
            metavar="DEG",
            help="Angle between the line of sight and the pane's normal, 0 to 90.",
            rich_help_panel=_PANE,
        ),
    ] = None
    azimuth: Annotated[
        float | None,
        typer.Option(
            metavar="DEG",
            help="Direction in the picture into which the pane is tilted, counter-clockwise from horizontal.",
            rich_help_panel=_PANE,
        ),
    ] = None
    shift: Annotated[
        float | None,
        typer.Option(
            metavar="PX",
            help="Distance between the double images of a reflection, in pixels along the azimuth.",
            rich_help_panel=_PANE,
        ),
    ] = None
    transmission_shift: Annotated[
        float | None,
        typer.Option(
            metavar="PX",
            help="The same for what is behind the pane, where it is nearer or farther. Default: found where it shows, "
            "else that of the reflection.",
            rich_help_panel=_PANE,
        ),
    ] = None
    thickness_px: Annotated[
        float | None,
        typer.Option(
            metavar="PX",
            help="Thickness of the pane in pixels; ties the shift to the incidence.",
            rich_help_panel=_PANE,
        ),
    ] = None
    thickness_kind: Annotated[
        ThicknessKind,
        typer.Option(
            metavar="KIND",
            help="How thickness becomes shift: paper (as published) or plate (exact offset).",
            rich_help_panel=_PANE,
        ),
    ] = "paper"
    index: Annotated[
        float,
        typer.Option(metavar="N", help="Refractive index: 1.5 for glass, 1.33 for water.", rich_help_panel=_PANE),
    ] = 1.5
    single_surface: Annotated[
        bool,
        typer.Option("--single-surface", help="No back face: a water surface.", rich_help_panel=_PANE),
    ] = False

    focal_px: Annotated[
        float | None,
        typer.Option(
            metavar="PX",
            help="Focal length in pixels of a lens so wide that the incidence changes over the picture; the azimuth is "
            "then the direction into which the pane's normal leans. Found where it shows, unless given.",
            rich_help_panel=_PANE,
        ),
    ] = None

    def scene(self) -> SceneParameters:
        """The scene, with None for what is to be estimated."""
        from polaropt.scene import SceneParameters

        self.check()
        return SceneParameters(
            self.incidence,
            self.azimuth,
            self.shift,
            self.index,
            single_surface=self.single_surface,
            transmission_ghost_shift=self.transmission_shift,
            focal_px=self.focal_px,
        )

    def check(self) -> None:
        """InputError where two options contradict each other."""
        if self.shift is not None and self.thickness_px is not None:
            raise InputError("--shift and --thickness-px both set the ghost shift; give one of them")
        if self.focal_px is not None and self.thickness_px is not None:
            raise InputError("--thickness-px and --focal-px cannot be had together: the shift is found, or set --shift")
        for name, value in (
            ("--shift", self.shift),
            ("--transmission-shift", self.transmission_shift),
            ("--thickness-px", self.thickness_px),
        ):
            if self.single_surface and value is not None:
                raise InputError(f"{name} is for a pane with a back face; leave it or --single-surface out")
        if self.thickness_px is not None and not 0 <= self.thickness_px < math.inf:
            raise InputError(f"--thickness-px is {self.thickness_px:g}; give 0 or more")


@dataclass(frozen=True)
class LadderOptions:
    """How much of the pane is modelled."""

    model: Annotated[
        str,
        typer.Option(
            metavar="NAME",
            help="Scene model: none (the intensity, not separated), pixelwise (no double images), ghosts, perspective "
            "(a wide lens), polarized (light that is polarized before it meets the glass), curved (a bent pane), "
            "or auto: the simplest that explains the capture.",
            rich_help_panel=_PANE,
        ),
    ] = "auto"

    def check(self) -> None:
        """InputError where there is no such model."""
        from polaropt.model_selection import model_names

        if self.model not in model_names():
            raise InputError(f"--model {self.model!r} does not exist; choose one of: {', '.join(model_names())}")


@dataclass(frozen=True)
class SpeechOptions:
    """How much is said, and to whom."""

    json: Annotated[bool, typer.Option("--json", help="Print one JSON object, for machines.")] = False


def numbers(text: str, option: str) -> tuple[float, ...]:
    """Numbers separated by commas.

    Raises
    ------
    InputError
        Something else.
    """
    try:
        return tuple(float(part) for part in text.split(","))
    except ValueError:
        raise InputError(f"{option} is {text!r}; give numbers separated by commas, such as 0,45,90,135") from None
