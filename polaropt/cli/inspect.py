"""``polaropt inspect`` and ``polaropt estimate``: what a capture is, and how the pane stands, without separating."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from polaropt.cli.command import progress_bar, say, say_json
from polaropt.cli.options import CaptureOptions, LadderOptions, PaneOptions, SpeechOptions
from polaropt.reporting import error_of

if TYPE_CHECKING:
    from polaropt.capture import Capture
    from polaropt.estimation import FoundScene


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


def inspect_command(capture: CaptureOptions, picture: PictureOption, speech: SpeechOptions) -> None:
    """Tell what a capture is, before anything is solved.

    Size, depth, noise, gain of the two polarizer pairs, saturation and polarization; whether the values look
    gamma-encoded and whether two files look swapped. What needs attention is marked ATTENTION.
    """
    from polaropt.reporting import inspect_capture

    photographs = capture.read()
    inspection = inspect_capture(photographs)
    if picture.output is not None:
        _write_picture(photographs, picture.output)
    said = [*capture.told(photographs), *inspection.sentences()]
    if speech.json:
        written = [] if picture.output is None else [str(picture.output)]
        say_json({**inspection.as_dict(), "sentences": said, "written": written})
        return
    say(*said)
    if picture.output is not None:
        say(f"Written: {picture.output}")


def _write_picture(photographs: Capture, target: Path) -> None:
    from polaropt.capture import result_file, write_png
    from polaropt.errors import InputError
    from polaropt.reporting import inspection_picture

    if target.suffix.lower() != ".png":
        raise InputError(f"{target}: the picture is a PNG; give a name that ends in .png")
    with result_file(target) as temporary:
        write_png(temporary, inspection_picture(photographs))


def estimate_command(capture: CaptureOptions, pane: PaneOptions, ladder: LadderOptions, speech: SpeechOptions) -> None:
    """Estimate how the pane stands: incidence, azimuth and the distance between double images.

    Nothing is separated. What is given with an option stays as it is.
    """
    from polaropt.capture import noise_level
    from polaropt.estimation import find_scene

    scene = pane.scene()
    ladder.check()
    capture.check(pane)
    photographs = capture.read()
    with progress_bar(not speech.json) as progress:
        if progress is not None:
            progress("Estimating the scene", 0.0)
        found = find_scene(
            photographs,
            scene,
            noise_level(photographs),
            ladder.model,
            thickness_px=pane.thickness_px,
            thickness_kind=pane.thickness_kind,
        )
    hint = photographs.focal_px
    if speech.json:
        from polaropt.reporting import plain, scene_report

        polarized = found.estimate is None or found.estimate.polarized
        told = {"errors": plain(found.errors), "rungs": plain(found.tried), "polarized": polarized}
        say_json({**scene_report(found.scene, scene, hint), **told})
        return
    say(*capture.told(photographs), *estimate_sentences(found, pane, hint))


def estimate_sentences(found: FoundScene, pane: PaneOptions, focal_hint_px: float | None = None) -> list[str]:
    """The scene, line by line, and what it rests on."""
    from polaropt.optics import largest_turn

    incidence, azimuth, shift = found.scene.values()
    lines = [
        f"incidence  {incidence:7.2f} deg  {error_of(found.errors.incidence_deg)}{_source(pane.incidence)}",
        f"azimuth    {azimuth:7.2f} deg  {error_of(found.errors.azimuth_deg)}{_source(pane.azimuth)}",
    ]
    if found.scene.focal_px is not None:
        told = found.scene.focal_px in (pane.focal_px, focal_hint_px)
        source = "(given)" if told else "(estimated)"
        lines.append(f"focal      {found.scene.focal_px:7.0f} px   {error_of(found.errors.focal_px)}{source}")
    if found.scene.bent:
        lines.append(f"bend       {100 * largest_turn(found.scene.bend_deg_per_px):7.1f} deg  in 100 px (estimated)")
    if found.scene.varies:
        lines.append("incidence and azimuth change over the picture; those above are at its middle")
    elif pane.single_surface:
        lines.append("a single surface, without ghosts")
    else:
        lines.append(f"shift      {shift:7.2f} px   {error_of(found.errors.ghost_shift)}{_shift_source(pane)}")
    lines.append(f"index      {pane.index:7.2f}      (given or assumed)")
    lines += [f"rung       {tried.rung}: {'taken' if tried.taken else 'left'}. {tried.reason}" for tried in found.tried]
    if found.estimate is not None and not found.estimate.polarized:
        lines.append("ATTENTION: the light is not polarized beyond the noise; these numbers mean nothing.")
    return lines


def _source(given: float | None) -> str:
    return "(estimated)" if given is None else "(given)"


def _shift_source(pane: PaneOptions) -> str:
    return _source(pane.shift) if pane.thickness_px is None else "(from the thickness)"
