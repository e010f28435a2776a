"""``polaropt sequence``: frames of a polarization camera, one after another."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from itertools import chain, groupby
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from polaropt.cli.command import SOME_FAILED, Interrupted, count_bar, say, say_json
from polaropt.cli.options import LadderOptions, PaneOptions, ReadingOptions
from polaropt.cli.separate import OutputOptions, SolveOptions, separating
from polaropt.errors import InputError

if TYPE_CHECKING:
    from polaropt.capture import Capture, FrameReader
    from polaropt.sequence import Frames


_SEQUENCE = "The sequence"
_LISTED = 5
"""Missing numbers, and lost frames, that are listed at most; set by hand."""
Format = Literal["zarr", "tiff"]


@dataclass(frozen=True, kw_only=True)
class SequenceOptions:
    """What the frames are, how the pane is followed, and what is written."""

    frames: Annotated[
        list[str],
        typer.Argument(
            metavar="FRAMES",
            help="Raw mosaics of a polarization camera: a TIFF of several pages, an npy array (frame, height, width), "
            "a folder of numbered files, files in their order, or a file of many frames without a header (--shape).",
            show_default=False,
        ),
    ]
    pane_still: Annotated[
        bool,
        typer.Option(
            "--pane-still",
            metavar="",
            help="The pane stands still against the camera: it is found from the first frames and kept. Default: it is "
            "followed.",
            rich_help_panel=_SEQUENCE,
        ),
    ] = False
    first: Annotated[
        int, typer.Option(metavar="N", help="Frames that the pane is found from.", rich_help_panel=_SEQUENCE)
    ] = 5
    average: Annotated[
        int,
        typer.Option(
            metavar="N",
            help="Average up to so many frames of a still scene, as long as they lie on each other.",
            rich_help_panel=_SEQUENCE,
        ),
    ] = 1
    format: Annotated[
        Format,
        typer.Option(
            metavar="NAME",
            help="Files of the layers: zarr (layers.zarr, a chunk each frame) or tiff (a stack for each layer).",
            rich_help_panel=_SEQUENCE,
        ),
    ] = "zarr"
    video: Annotated[
        bool,
        typer.Option(
            "--video",
            metavar="",
            help="Write side_by_side.mp4, too: photograph, transmission, reflection.",
            rich_help_panel=_SEQUENCE,
        ),
    ] = False
    uncertainty: Annotated[
        bool,
        typer.Option(
            "--uncertainty/--no-uncertainty",
            metavar="",
            help="Find the standard errors of the layers and write them along time, too; without, it is done sooner.",
            rich_help_panel=_SEQUENCE,
        ),
    ] = False
    frames_per_second: Annotated[float, typer.Option(metavar="N", help="Of the video.", rich_help_panel=_SEQUENCE)] = (
        10.0
    )

    def check(self) -> None:
        """InputError where a number is outside its range or a package is missing."""
        from polaropt.sequence import check_packages

        for name, value in (("--first", self.first), ("--average", self.average)):
            if value < 1:
                raise InputError(f"{name} is {value}; give 1 or more")
        if not 0 < self.frames_per_second <= 1000:
            raise InputError(f"--frames-per-second is {self.frames_per_second:g}; give more than 0, 1000 at most")
        check_packages(self.format, self.video)


def sequence_command(
    sequence: SequenceOptions,
    capture: ReadingOptions,
    pane: PaneOptions,
    ladder: LadderOptions,
    solving: SolveOptions,
    folder: OutputOptions,
) -> None:
    """Separate the frames of a camera that films through one pane.

    The pane is found from the first frames and followed; what holds for all frames is found once. White
    level, kind of sensor and gain of the 45/135 pair are those of the first frame.

    Writes into the folder: layers.zarr (or transmission.tiff and reflection.tiff), frames.csv (a row for each frame),
    sequence.json; where --uncertainty asks for them, standard errors of the layers (in layers.zarr, or
    transmission_error.tiff and reflection_error.tiff); where --video asks for it, side_by_side.mp4. Ctrl-C keeps the
    frames that are done. A frame after the first that cannot be read or separated, such as a black one, is told in
    frames.csv and has black layers. A run that fails leaves the folder as it was.

    Exit code 3: a frame was lost; 2: the call is wrong; 130: interrupted.
    """
    from polaropt.capture import result_folder
    from polaropt.sequence import SEQUENCE_FILES, SequenceFiles, open_frames

    sequence.check()
    chosen = separating(pane, ladder, solving)
    del chosen["scene"]
    capture.check(pane)
    if capture.align or capture.relative:
        raise InputError(
            "frames are mosaics, whose photographs are taken at once; leave --align and relative angles out"
        )
    reading = capture.arguments()
    if capture.angles != ReadingOptions.angles:
        raise InputError("frames are mosaics, whose cells have an angle each; leave --angles out, see --cell-order")
    if reading.pop("exposures") is not None:
        raise InputError("frames are mosaics, whose photographs are taken at once; leave --exposures out")
    shape, pixel_format = reading.pop("shape"), reading.pop("pixel_format")
    limit = {name: reading.pop(name) for name in ("max_pixels",) if name in reading}
    frames = open_frames(sequence.frames, shape, pixel_format, **limit)
    number = -(-frames.number // sequence.average)
    silent = folder.json or folder.quiet
    interrupted = False
    with result_folder(folder.output, SEQUENCE_FILES) as work, count_bar(number, "Separating", not silent) as told:
        written = SequenceFiles(
            work,
            sequence.format,
            video=sequence.video,
            frames_per_second=sequence.frames_per_second,
            uncertainty=sequence.uncertainty,
        )
        with written as files:
            try:
                lost: dict[int, str] = {}
                for result, photographs, seconds in _separated(frames, sequence, reading, pane, chosen, lost):
                    while len(files.rows) in lost:
                        files.add_lost(lost[len(files.rows)])
                    files.add(result, photographs, seconds)
                    if told is not None:
                        told(len(files.rows), len(lost))
                while len(files.rows) in lost:
                    files.add_lost(lost[len(files.rows)])
            except KeyboardInterrupt:
                interrupted = True
            if interrupted and not files.rows:
                raise KeyboardInterrupt
            asked = {"frames": frames.name, "missing_numbers": frames.missing, "pane_still": sequence.pane_still}
            document = files.finish({**asked, **_told(capture)})
    if folder.json:
        say_json({"output": str(folder.output), **document})
    elif not folder.quiet:
        say(*_sentences(document, folder.output, sequence))
    if interrupted:
        raise Interrupted(f"{len(files.rows)} frame{'s are' if len(files.rows) > 1 else ' is'} written")
    if document["lost"]:
        raise typer.Exit(SOME_FAILED)


def _told(capture: ReadingOptions) -> dict[str, Any]:
    return {"resolution": capture.resolution, "sensor": capture.sensor}


def _separated(
    frames: Frames,
    sequence: SequenceOptions,
    reading: dict[str, Any],
    pane: PaneOptions,
    chosen: dict[str, Any],
    lost: dict[int, str],
) -> Iterator[tuple[Any, Capture, float]]:
    """Each frame's separation, its capture and seconds; why frames in between are lost goes where it is asked for."""
    from polaropt.sequence import separate_sequence

    captures: list[Capture] = []

    def taken() -> Iterator[Capture]:
        for one in _captures(frames, sequence, reading, lost):
            captures.append(one)
            yield one

    mode: Literal["follow", "still"] = "still" if sequence.pane_still else "follow"
    began = time.perf_counter()
    read = taken()
    first = next(read)
    # An earlier scene is scaled to the frames.
    scene, read = pane.scene(first), chain((first,), read)
    for result in separate_sequence(read, scene, pane=mode, first=sequence.first, **chosen):
        now = time.perf_counter()
        # The first frames are read ahead, to find the pane.
        yield result, captures.pop(0), now - began
        began = time.perf_counter()


def _captures(
    frames: Frames, sequence: SequenceOptions, reading: dict[str, Any], lost: dict[int, str]
) -> Iterator[Capture]:
    """Frames as captures, all read as the first one is; a later one that is none is lost, and the film goes on."""
    from polaropt.capture import FrameReader

    arguments = {name: value for name, value in reading.items() if name != "angles_deg"}
    reader = FrameReader(bits=frames.bits, **arguments)
    raws: Iterator[Any] = frames.tried()
    read: Callable[[Any], Capture] = reader.read
    if sequence.average > 1:
        raws, read = _averaged(frames, sequence.average, reader, arguments)
    for i, raw in enumerate(raws):
        try:
            if isinstance(raw, InputError):
                raise raw
            capture = read(raw)
        except InputError as error:
            if not i:
                raise raw if error is raw else InputError(f"{frames.name}, frame {i}: {error}") from None
            lost[i] = str(error)
            continue
        yield capture


def _averaged(
    frames: Frames, number: int, reader: FrameReader, arguments: dict[str, Any]
) -> tuple[Iterator[Any], Callable[[Any], Capture]]:
    """Means of frames, and what reads them: their noise is another one in each."""
    import numpy as np

    from polaropt.capture import mosaic_capture
    from polaropt.sequence import averaged

    try:
        first = reader.read(frames.read(0))
    except InputError as error:
        raise InputError(f"{frames.name}, frame 0: {error}") from None
    assert first.origin is not None
    like_first = {
        "white_level": first.origin.white_level,
        "pair_gain": first.origin.pair_gain,
        "sensor": "color" if first.color else "mono",
        "cell_order": arguments["cell_order"] or first.origin.cell_order,
    }

    def means() -> Iterator[Any]:
        # What cannot be read ends a mean, and has a place of its own.
        tried: Iterator[Any] = frames.tried()
        for lost, part in groupby(tried, lambda one: isinstance(one, InputError)):
            yield from part if lost else (mean.astype(np.float32) for mean in averaged(part, number))

    return means(), partial(mosaic_capture, **{**arguments, **like_first})


def _sentences(document: dict[str, Any], output: Path, sequence: SequenceOptions) -> list[str]:
    last = document["last"]
    count = f"{document['frames']} frame{'s' if document['frames'] > 1 else ''}"
    lines = [f"{count}, {document['frames_per_second']:.2g} a second."]
    if last["incidence_deg"] is not None:
        error = "" if last["incidence_deg_error"] is None else f" ± {last['incidence_deg_error']:.2g}"
        lines.append(f"The pane at the end: incidence {last['incidence_deg']:.2f}{error} deg ({last['rung']}).")
    missing = document["request"]["missing_numbers"]
    if missing:
        listed = ", ".join(map(str, missing[:_LISTED])) + (", ..." if len(missing) > _LISTED else "")
        lines.append(f"ATTENTION: no file has the number {listed}; the next one there is was taken to follow.")
    lost = list(document["lost"].items())
    lines += [f"ATTENTION: frame {frame} is lost, its layers are black: {why}." for frame, why in lost[:_LISTED]]
    if len(lost) > _LISTED:
        lines.append(f"ATTENTION: ... and {len(lost) - _LISTED} more frames are lost; frames.csv names all.")
    warned = [f"{name} in {number} of {document['frames']} frames" for name, number in document["warnings"].items()]
    lines += [f"ATTENTION: {', '.join(warned)}; frames.csv tells which."] if warned else []
    layers = "layers.zarr" if sequence.format == "zarr" else "transmission.tiff, reflection.tiff"
    if sequence.uncertainty and sequence.format == "tiff":
        layers += ", transmission_error.tiff, reflection_error.tiff"
    video = ", side_by_side.mp4" if sequence.video else ""
    return [*lines, f"Written to {output}: {layers}, frames.csv, sequence.json{video}."]
