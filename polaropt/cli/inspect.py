"""``polaropt inspect`` and ``polaropt estimate``: what a capture is, and how the pane stands, without separating."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from polaropt.cli.command import say, say_json, watched
from polaropt.cli.options import CaptureOptions, LadderOptions, OutputOptions, PaneOptions
from polaropt.errors import InputError

if TYPE_CHECKING:
    from polaropt.capture import Capture
    from polaropt.separation import Case


@dataclass(frozen=True)
class PictureOption:
    """Where the picture goes."""

    output: Annotated[
        Path | None,
        typer.Option(
            "--output",
            "-o",
            metavar="PICTURE.png",
            help="Write a picture of intensity, degree and angle of polarization.",
        ),
    ] = None

    def check(self) -> None:
        """InputError where the name is not that of a PNG."""
        if self.output is not None and self.output.suffix.lower() != ".png":
            raise InputError(f"{self.output}: the picture is a PNG; give a name that ends in .png")


def inspect_command(capture: CaptureOptions, picture: PictureOption, output: OutputOptions) -> None:
    """Tell what a capture is, before anything is solved.

    Size, depth, noise, gain of the two polarizer pairs, saturation and polarization; whether the values look
    gamma-encoded, two files look swapped, pixels of a mosaic are defective, something moves between the photographs,
    these do not lie on each other or are not equally sharp, and how much looks as if it showed no glass. What needs
    attention is marked ATTENTION.
    """
    from polaropt.reporting import inspect_capture, inspection_sentences

    picture.check()
    with watched(not output.json) as stages:
        photographs = capture.read(stages, 0.7)
        stages.begin("Inspecting", 0.7)
        inspection = inspect_capture(photographs)
        if picture.output is not None:
            stages.begin("Drawing", 0.9)
            _write_picture(photographs, picture.output)
    sentences = [*capture.preparation(photographs), *inspection_sentences(inspection)]
    if output.json:
        written = [] if picture.output is None else [str(picture.output)]
        say_json({**inspection.as_dict(), "sentences": sentences, "written": written})
        return
    say(*sentences)
    if picture.output is not None:
        say(f"Written: {picture.output}")


def _write_picture(photographs: Capture, target: Path) -> None:
    from polaropt.capture import result_file, write_picture
    from polaropt.reporting import inspection_picture

    with result_file(target) as temporary:
        write_picture(temporary, inspection_picture(photographs))


def _doubts(case: Case) -> list[str]:
    """What `separate` would warn of before it solves, but for what is said anyway."""
    from polaropt.judging import SeparationWarning, diagnose

    # That the reflection is not told follows where nothing is polarized.
    names = ("NO_POLARIZATION", "REFLECTION_NOT_IDENTIFIABLE", "CELL_ORDER_FOUND", "MOVING")
    said = [SeparationWarning[name] for name in names]
    still = case.still
    judged = diagnose(still.capture, still.noise, misfit_ratio=1.0, reflection_unknown=0.0, **case.known)
    return [judged.sentence(warning) for warning in judged.warnings if warning not in said]


def estimate_command(capture: CaptureOptions, pane: PaneOptions, ladder: LadderOptions, output: OutputOptions) -> None:
    """Estimate how the pane stands: incidence, azimuth and the distance between double images.

    Nothing is separated. What is given with an option stays as it is; where the photographs speak against it, or
    against themselves, that is told.
    """
    from polaropt.reporting import (
        cell_order_attention,
        estimate_sentences,
        json_values,
        marked,
        matching_report,
        matching_sentences,
        motion_attention,
        scene_report,
        unglazed_sentences,
        unglazed_share,
    )

    ladder.check(pane, pane.scene())  # their checks, before anything is read
    capture.check(pane)
    with watched(not output.json) as stages:
        photographs = capture.read(stages, 0.3)
        scene = pane.scene(photographs)
        from polaropt.separation import scene_case  # after reading, so that an error in the files is told at once

        case = scene_case(
            photographs,
            scene,
            model=ladder.model,
            thickness_px=pane.thickness_px,
            thickness_kind=pane.thickness_kind,
            index_known=pane.index is not None,
            match_photographs=ladder.match,
            leave_out_unglazed=ladder.unglazed,
            progress=stages.part(0.3, 1.0),
        )
    found, scene = case.found, case.asked
    hint = photographs.focal_px
    doubts = [
        *cell_order_attention(photographs),
        *motion_attention(case.still.moving_share),
        *_doubts(case),
    ]
    matching = None if case.matching is None else matching_report(case.matching)
    share = unglazed_share(case.unglazed)
    if output.json:
        polarized = found.estimate is None or found.estimate.polarized
        basis = {"errors": json_values(found.errors), "rungs": json_values(found.tried), "polarized": polarized}
        beside = {"matching": matching, "unglazed_share": share}
        say_json(
            {
                **beside,
                **scene_report(found.scene, scene, hint),
                **basis,
                "attention": [*capture.contradictions(), *doubts],
            }
        )
        return
    sentences = estimate_sentences(found, scene, hint, from_thickness=pane.thickness_px is not None)
    left_out = (*matching_sentences(matching), *unglazed_sentences(share))
    say(*capture.preparation(photographs), *left_out, *sentences, *marked(doubts))
