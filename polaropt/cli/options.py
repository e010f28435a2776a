"""Options that several commands share, in groups, and what they mean."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from polaropt.cli.command import STARTING
from polaropt.errors import InputError

if TYPE_CHECKING:
    from polaropt.capture import Capture
    from polaropt.optics import SceneParameters
    from polaropt.progress import Stages


ThicknessKind = Literal["paper", "plate"]
_PANE = "The pane"
FREE = "free"
"""Of --index: it is to be found."""


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
            help="The same for what is behind the pane, where it is nearer or farther. Default: that of the "
            "reflection; `separate` finds another where it shows.",
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
        str | None,
        typer.Option(
            metavar="N",
            help="Refractive index: 1.5 for glass, 1.33 for water. free (not for `simulate`): the glass is "
            "unknown; then the index of one flat pane is found, as far as the photographs tell it (1.5 where they "
            "hardly do). Default: 1.5, and `separate` takes another where the photographs speak clearly for it.",
            rich_help_panel=_PANE,
        ),
    ] = None
    single_surface: Annotated[
        bool,
        typer.Option("--single-surface", metavar="", help="No back face: a water surface.", rich_help_panel=_PANE),
    ] = False

    panes: Annotated[
        int | None,
        typer.Option(
            metavar="N",
            help="Panes of the window, one behind another. Default: 1; `separate` finds up to three by their double "
            "images.",
            rich_help_panel=_PANE,
        ),
    ] = None
    gap_shift: Annotated[
        float | None,
        typer.Option(
            metavar="PX",
            help="Distance between the double images of one pane's back and the next one's front, in pixels.",
            rich_help_panel=_PANE,
        ),
    ] = None
    gap_azimuth: Annotated[
        float | None,
        typer.Option(
            metavar="DEG",
            help="Direction in which these lie, as panes are never quite parallel. Default: the azimuth.",
            rich_help_panel=_PANE,
        ),
    ] = None
    tint: Annotated[
        float | None,
        typer.Option(
            metavar="SHARE",
            help="Share of the light that tinted glass passes, 0 to 1; the transmission is what is seen through it. "
            "Default: 1; `separate` finds less where a dimmed double image tells it (from about a quarter of the light "
            "taken on).",
            rich_help_panel=_PANE,
        ),
    ] = None
    earlier: Annotated[
        Path | None,
        typer.Option(
            "--scene",
            metavar="REPORT.json",
            help="Take the whole scene from the report of an earlier separation of the same view, or from the "
            "scene.json of captures that share one, instead of finding it.",
            rich_help_panel=_PANE,
        ),
    ] = None
    focal_px: Annotated[
        float | None,
        typer.Option(
            metavar="PX",
            help="Focal length in pixels of a lens so wide that the incidence changes over the picture; the azimuth is "
            "then the direction into which the pane's normal leans. Default: none; `separate` finds it where it shows.",
            rich_help_panel=_PANE,
        ),
    ] = None

    def scene(self, capture: Capture | None = None) -> SceneParameters:
        """The scene, with None for what is to be estimated.

        Parameters
        ----------
        capture : Capture, optional
            To whose size an earlier scene is scaled.
        """
        from polaropt.optics import SceneParameters

        self.check()
        if self.earlier is not None:
            from polaropt.reporting import scene_of_report

            return scene_of_report(self.earlier, None if capture is None else capture.shape[-2:])
        return SceneParameters(
            self.incidence,
            self.azimuth,
            self.shift,
            self.refractive_index,
            single_surface=self.single_surface,
            transmission_ghost_shift=self.transmission_shift,
            focal_px=self.focal_px,
            n_panes=1 if self.single_surface else self.panes,
            gap_shift=self.gap_shift,
            gap_azimuth_deg=self.gap_azimuth,
            absorption=self._absorption(),
        )

    @property
    def refractive_index(self) -> float | None:
        """The number of --index, or None for one that is to be found; that of glass where nothing is said."""
        from polaropt.optics import GLASS_INDEX

        if self.index is None:
            return GLASS_INDEX
        if self.index == FREE:
            return None
        try:
            return float(self.index)
        except ValueError:
            raise InputError(f"--index is {self.index!r}; give a number of 1 or more, or {FREE}") from None

    @property
    def known_index(self) -> float:
        """The number of --index, where nothing is to be found."""
        if self.refractive_index is None:
            raise InputError(f"--index {self.index} is to find it; give a number of 1 or more")
        return self.refractive_index

    def _absorption(self) -> float | None:
        if self.tint is None:
            return 0.0 if self.single_surface else None
        return -math.log(self.tint)

    def check(self) -> None:
        """InputError where two options contradict each other."""
        if self.earlier is not None:
            given = [field.name for field in fields(self) if getattr(self, field.name) != field.default]
            others = [f"--{name.replace('_', '-')}" for name in given if name != "earlier"]
            if others:
                raise InputError(f"--scene gives the whole pane; leave it or {others[0]} out")
        from polaropt.optics import DARKEST_TINT, FARTHEST_SHIFT_PX, MOST_PANES

        if self.shift is not None and self.thickness_px is not None:
            raise InputError("--shift and --thickness-px both set the ghost shift; give one of them")
        if self.focal_px is not None and self.thickness_px is not None:
            raise InputError("--thickness-px and --focal-px cannot be had together: the shift is found, or set --shift")
        for name, value in (
            ("--shift", self.shift),
            ("--transmission-shift", self.transmission_shift),
            ("--thickness-px", self.thickness_px),
            ("--panes", self.panes),
            ("--tint", self.tint),
        ):
            if self.single_surface and value is not None:
                raise InputError(f"{name} is for a pane with a back face; leave it or --single-surface out")
        if self.panes is not None and not 1 <= self.panes <= MOST_PANES:
            raise InputError(f"--panes is {self.panes}; give a whole number from 1 to {MOST_PANES}")
        if self.tint is not None and not DARKEST_TINT <= self.tint <= 1:
            raise InputError(f"--tint is {self.tint:g}; give the share of the light that passes, {DARKEST_TINT:g} to 1")
        if self.thickness_px is not None and (self.panes or 1) > 1:
            raise InputError("--thickness-px is for a single pane; give --shift and --gap-shift, or leave it out")
        for name, value in (("--gap-shift", self.gap_shift), ("--gap-azimuth", self.gap_azimuth)):
            if value is not None and (self.panes or 1) == 1:
                raise InputError(f"{name} is for a window of several panes; give --panes too, or leave it out")
        if self.gap_azimuth is not None and self.gap_shift is None:
            raise InputError("--gap-azimuth is the direction of --gap-shift; give both, or leave it out")
        if self.thickness_px is not None and not 0 <= self.thickness_px <= FARTHEST_SHIFT_PX:
            raise InputError(f"--thickness-px is {self.thickness_px:g}; give 0 to {FARTHEST_SHIFT_PX:g}")


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
    match: Annotated[
        bool,
        typer.Option(
            metavar="",
            help="Photographs that are shifted (up to 128 pixels), turned or scaled against each other, in which both "
            "layers have moved by themselves (a camera held by hand), that are not equally sharp or exposed, or whose "
            "analyzers differ in gain (a mosaic), are made to agree before anything else, and it is said.",
            rich_help_panel=_FILES,
        ),
    ] = True
    unglazed: Annotated[
        bool,
        typer.Option(
            metavar="",
            help="Places that show no glass, such as window frames and walls, are looked for and left out, and it is "
            "said.",
            rich_help_panel=_PANE,
        ),
    ] = True

    def check(self, pane: PaneOptions, scene: SceneParameters) -> None:
        """InputError where there is no such model, or it has no place for what is told of the pane, its scene."""
        from polaropt.estimation import check_model, model_names

        if self.model not in model_names():
            raise InputError(f"--model {self.model!r} does not exist; choose one of: {', '.join(model_names())}")
        if self.model != "auto" and pane.earlier is not None:
            raise InputError("--scene gives the whole pane; leave it or --model out")
        check_model(scene, self.model)
        if scene.complete and self.model not in ("auto", scene.rung):
            raise InputError(
                f"--model {self.model} has nothing to find, as the whole pane is given; leave one of them out"
            )


AsJson = Annotated[bool, typer.Option("--json", metavar="", help="Print one JSON object, for machines.")]


@dataclass(frozen=True)
class OutputOptions:
    """Sentences for people, or JSON for machines."""

    json: AsJson = False


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


def cell_order_of(text: str | None) -> tuple[float, ...] | None:
    """The angles of --cell-order, if they were given."""
    return None if text is None else numbers(text, "--cell-order")


def sides_of(text: str | None) -> tuple[int, ...] | None:
    """Height and width of --shape, if they were given; InputError for anything else."""
    if text is None:
        return None
    sides = numbers(text, "--shape")
    if len(sides) != 2 or any(not side.is_integer() for side in sides):
        raise InputError(f"--shape is {text!r}; give height and width in pixels, such as 2048,2448")
    return tuple(int(side) for side in sides)


_FILES = "Reading the photographs"
SensorKind = Annotated[
    str, typer.Option(metavar="KIND", help="Kind of mosaic: auto, mono or color.", rich_help_panel=_FILES)
]
CellOrder = Annotated[
    str | None,
    typer.Option(
        metavar="DEG,DEG,...",
        help="Angles in a mosaic's 2x2 cell: top left, top right, bottom left, bottom right. Default: 90,45,135,0, or "
        "where its orthogonal pairs do not add up a nearby order in which they do.",
        rich_help_panel=_FILES,
    ),
]
BlackLevel = Annotated[
    float,
    typer.Option(
        metavar="VALUE",
        help="Value of black in the file, where the camera adds one. Left out, it brightens both layers by twice as "
        "much; inspect tells how high it can be.",
        rich_help_panel=_FILES,
    ),
]
WhiteLevel = Annotated[
    float | None,
    typer.Option(
        metavar="VALUE",
        help="Value at which the camera clips. Default: found from the file.",
        rich_help_panel=_FILES,
    ),
]
HeadlessShape = Annotated[
    str | None,
    typer.Option(
        metavar="HEIGHT,WIDTH",
        help="Size in pixels of a raw mosaic in a file without a header.",
        rich_help_panel=_FILES,
    ),
]
PixelFormat = Annotated[
    str | None,
    typer.Option(
        metavar="NAME",
        help="How such a file is packed: Mono8, Mono10, Mono12, Mono16, Mono10p, Mono12p or Mono12Packed (GigE "
        "Vision). Default: 8 or 16 bits, by its size.",
        rich_help_panel=_FILES,
    ),
]
AngleSense = Literal["ccw", "cw"]
_RELATIVE = "relative"
_USUAL_ANGLES = "0,45,90,135"


@dataclass(frozen=True)
class ReadingOptions:
    """How the values of photographs are to be taken."""

    angles: Annotated[
        str | None,
        typer.Option(
            metavar="DEG,DEG,...",
            help="Polarizer angles in degrees, counter-clockwise from horizontal. relative, or relative,DEG,DEG,...: "
            "only the steps between them are known (0,45,90,135 unless given), the start is found from double images. "
            f"Default: those of {_USUAL_ANGLES} that the files' names end in, else these.",
            rich_help_panel=_FILES,
        ),
    ] = None
    angle_sense: Annotated[
        AngleSense,
        typer.Option(
            metavar="SENSE",
            help="Sense in which these angles are counted, as the picture shows it: ccw or cw (a filter turned the "
            "other way, mirrored pictures).",
            rich_help_panel=_FILES,
        ),
    ] = "ccw"
    sensor: SensorKind = "auto"
    cell_order: CellOrder = None
    black_level: BlackLevel = 0.0
    white_level: WhiteLevel = None
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
    resolution: Annotated[
        str,
        typer.Option(
            metavar="NAME",
            help="What comes of a mosaic: sensor (as many pixels as the sensor has) or cell (one pixel per pattern of "
            "2x2, in colour 4x4, pixels, in a quarter of the time).",
            rich_help_panel=_FILES,
        ),
    ] = "sensor"
    shape: HeadlessShape = None
    pixel_format: PixelFormat = None
    analyzer: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE.json",
            help="Gain, contrast and angle of each analyzer of the camera, as polaropt calibrate writes them.",
            rich_help_panel=_FILES,
        ),
    ] = None
    field_of_view_deg: Annotated[
        float | None,
        typer.Option(
            metavar="DEG",
            help="Angle that the camera sees along the picture's longer side, for scenes that need the focal length. "
            "Default: what the camera wrote into the file (EXIF), else found from the photographs.",
            rich_help_panel=_FILES,
        ),
    ] = None
    exposures: Annotated[
        str | None,
        typer.Option(
            metavar="T,T,...",
            help="How long each photograph was exposed, in the order of the files and in any unit; divided out. "
            "Default: what the camera wrote into the files (EXIF: time, aperture, speed).",
            rich_help_panel=_FILES,
        ),
    ] = None
    max_pixels: Annotated[
        int | None,
        typer.Option(
            metavar="N",
            help="Pixels that one file may hold, all its photographs together. Default: 200 million.",
            rich_help_panel=_FILES,
        ),
    ] = None
    keep_defects: Annotated[
        bool,
        typer.Option(
            "--keep-defects",
            metavar="",
            help="Keep samples of a mosaic that stand out by themselves, as hot and dead pixels do. Default: what lies "
            "around them takes their place.",
            rich_help_panel=_FILES,
        ),
    ] = False
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

    @property
    def relative(self) -> bool:
        """Whether only the steps between the angles are known."""
        return (self.angles or "").startswith(_RELATIVE)

    @property
    def angles_deg(self) -> tuple[float, ...]:
        """The angles, from an unknown start where they are relative."""
        given = (self.angles or "").removeprefix(_RELATIVE).removeprefix(",")
        return numbers(given or _USUAL_ANGLES, "--angles")

    def arguments(self) -> dict[str, Any]:
        """What `read_capture` takes beside the files."""
        return {
            "angles_deg": self.angles_deg,
            "sensor": self.sensor,
            "cell_order": cell_order_of(self.cell_order),
            "black_level": self.black_level,
            "white_level": self.white_level,
            "pair_gain": self.pair_gain,
            "gamma": self.gamma,
            "resolution": self.resolution,
            "angle_sense": self.angle_sense,
            "field_of_view_deg": self.field_of_view_deg,
            "shape": sides_of(self.shape),
            "pixel_format": self.pixel_format,
            "analyzer": self.analyzer,
            "exposures": None if self.exposures is None else numbers(self.exposures, "--exposures"),
            "keep_defects": self.keep_defects,
            **({} if self.max_pixels is None else {"max_pixels": self.max_pixels}),
        }

    def check(self, pane: PaneOptions) -> None:
        """InputError where what is said of the camera contradicts what is said of the pane."""
        if self.field_of_view_deg is not None and pane.focal_px is not None:
            raise InputError("--field-of-view-deg and --focal-px both set the focal length; give one of them")


@dataclass(frozen=True, kw_only=True)
class CaptureOptions(ReadingOptions):
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

    @property
    def angles_deg(self) -> tuple[float, ...]:
        """The angles: those that the names of the photographs end in, unless some are given."""
        return self._angles_of_names() or super().angles_deg

    def _angles_of_names(self) -> tuple[float, ...]:
        """What names such as vase_45.png tell, in the order of the files; empty where they or --angles say otherwise.

        A shell sorts 135 before 45.
        """
        from polaropt.batch import angles_in_names

        if self.angles is not None or len(self.captures) < 3:
            return ()
        named = angles_in_names(self.captures)
        return named if set(named) <= set(super().angles_deg) else ()

    def _check_number(self) -> None:
        """InputError that tells the angles which the names seem to tell, where three, or five and more, lack them."""
        from polaropt.batch import angles_in_names

        number = len(self.captures)
        if self.angles is not None or number in (1, 2, 4) or self._angles_of_names():
            return
        named = angles_in_names(self.captures)
        # Numbers that count photographs lie otherwise.
        steps = {round(angle % (180 / number), 6) for angle in named}
        if len(steps) == 1 and len({angle % 180 for angle in named}) == number:
            listed = ",".join(f"{angle:g}" for angle in named)
            raise InputError(
                f"{number} photographs need one angle each; give them, as the names seem to tell: --angles {listed}"
            )

    def contradictions(self) -> list[str]:
        """That the names of the photographs tell other angles than --angles; not where all are turned by as much."""
        from polaropt.batch import angles_in_names

        named, given = angles_in_names(self.captures), super().angles_deg
        usual = set(numbers(_USUAL_ANGLES, "--angles"))
        told = {angle % 180 for angle in named}
        # Numbers at the end of names may count photographs.
        if len(named) != len(given) or not (told <= usual or told == {angle % 180 for angle in given}):
            return []
        turns = {round((one - other) % 180, 6) for one, other in zip(given, named, strict=True)}
        if self._angles_of_names() or len(turns) == 1:
            return []
        files = ", ".join(f"{path.name} at {angle:g}" for path, angle in zip(self.captures, given, strict=True))
        return [f"the names tell other angles than --angles, which count ({files}): check their order."]

    def read(self, stages: Stages, until: float = 1.0) -> Capture:
        """Read the files, align them and look for the start of the angles where that is asked for.

        Parameters
        ----------
        stages : Stages
        until : float
            How far the command has come when this is done.
        """
        from polaropt.capture import read_capture

        self._check_number()
        # Shares of the progress, by what they take on large photographs: set by hand.
        read_until = until * (0.2 if self.align else 1.0)
        stages.begin("Reading", 0.0)
        capture = read_capture(self.captures, **self.arguments(), progress=stages.part(0.0, read_until))
        if self.align:
            from polaropt.capture import align

            stages.begin("Aligning", read_until)
            capture = align(capture, overwrite=True, progress=stages.part(read_until, until))
        if self.relative:
            from polaropt.estimation import find_start_angle

            stages.begin("Finding the angles' start", until)
            capture = find_start_angle(capture)
        stages.begin(STARTING, until)
        return capture

    def preparation(self, capture: Capture) -> list[str]:
        """What aligning and looking for the start of the angles did to a capture that was read, where asked for."""
        from polaropt.reporting import alignment_sentence, marked, start_sentence

        named = self._angles_of_names()
        told = f"Angles, as the names tell: {', '.join(f'{angle:g}' for angle in named)} deg."
        sentences = [told] if named and named != super().angles_deg else []
        sentences += marked(self.contradictions())
        sentences += [alignment_sentence(capture)] if self.align else []
        return [*sentences, start_sentence(capture)] if self.relative else sentences
