"""What the page asks for: look at a capture, separate it."""

from __future__ import annotations

import zipfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from polaropt.capture import ANGLES_DEG, Capture, align, read_capture, write_picture, write_png_view
from polaropt.errors import InputError
from polaropt.optics import GLASS_INDEX, WATER_INDEX
from polaropt.progress import Progress, Stages
from polaropt.reporting import (
    alignment_sentence,
    capture_findings,
    explained_attention,
    inspect_capture,
    inspection_picture,
    motion_sentences,
    page_template,
    reduced_intensity,
    result_sentences,
    viewing_exposure,
    write_separation,
)
from polaropt.separation import separate

RESULTS, ARCHIVE, LOOK, PHOTOGRAPH = "results", "polaropt-results.zip", "look.png", "photograph.png"
"""Of a capture's folder: what a separation writes, the same in one file, and pictures of the page alone."""
_HERE = "polaropt.web"
# Shares of the progress, by what they take on large photographs: set by hand.
_READ, _ALIGNED, _SEPARATED, _WRITTEN = 0.06, 0.3, 0.75, 0.97
_GAMMAS = ("", "srgb", "2.2")
_SURFACES = ("glass", "water")


@dataclass(frozen=True)
class Shown:
    """A picture under the slider."""

    name: str
    title: str
    alt: str
    width: int
    height: int


_COMPARABLE = (
    ("photograph", "Photograph", "Photograph: light of all polarizations, as without a filter."),
    ("transmission", "Transmission", "Transmission: what is behind the glass."),
    ("reflection", "Reflection", "Reflection: what the glass mirrors."),
)


@dataclass(frozen=True)
class Asked:
    """What a person says of the photographs on the page.

    Attributes
    ----------
    angles_deg : tuple of float or None
        One for each file; None for a mosaic or a stack.
    reading : dict
        What else `read_capture` takes.
    align : bool
        Whether photographs are moved onto the first one.
    water : bool
        A single surface of water in place of a pane.
    uncertainty : bool
        Whether error maps are made.
    """

    angles_deg: tuple[float, ...] | None = None
    reading: Mapping[str, Any] | None = None
    align: bool = False
    water: bool = False
    uncertainty: bool = True


def asked_of(document: Any, n_files: int) -> Asked:
    """What the page sends, checked.

    Parameters
    ----------
    document : object
        Of JSON.
    n_files : int

    Raises
    ------
    InputError
        Something in it is missing or cannot be.
    """
    if not isinstance(document, dict):
        raise InputError("the options are no object")
    if not n_files:
        raise InputError("there are no photographs yet; choose some first")
    gamma = _one_of(document, "gamma", _GAMMAS)
    reading = {
        "gamma": gamma or None,
        "resolution": _one_of(document, "resolution", ("sensor", "cell")),
        "shape": _sides(str(document.get("shape") or "")),
        "pixel_format": str(document.get("pixel_format") or "") or None,
    }
    return Asked(
        _angles(document.get("angles_deg"), n_files) if n_files > 1 else None,
        reading,
        align=bool(document.get("align")),
        water=_one_of(document, "surface", _SURFACES) == "water",
        uncertainty=bool(document.get("uncertainty", True)),
    )


def _one_of(document: Mapping[str, Any], name: str, known: Sequence[str]) -> str:
    value = document.get(name, known[0])
    if value not in known:
        raise InputError(f"{name} is {value!r}; choose one of: {', '.join(known)}")
    return str(value)


def _sides(text: str) -> tuple[int, int] | None:
    if not text.strip():
        return None
    parts = text.replace("x", ",").split(",")
    try:
        height, width = (int(part) for part in parts)
    except ValueError:
        raise InputError(f"the size is {text!r}; give height and width in pixels, such as 2048,2448") from None
    return height, width


def _angles(values: Any, n_files: int) -> tuple[float, ...]:
    angles = values if isinstance(values, list) else []
    if len(angles) != n_files or not all(isinstance(angle, int | float) for angle in angles):
        raise InputError("an angle is missing; give the polarizer's angle of each photograph in degrees")
    try:
        return tuple(float(angle) for angle in angles)
    except OverflowError:
        raise InputError("an angle is beyond any number; give degrees") from None


def look(folder: Path, files: Sequence[Path], asked: Asked, tell: Progress) -> str:
    """Inspect a capture: what it is, with a picture of its polarization.

    Parameters
    ----------
    folder : Path
        Gets the picture.
    files : sequence of Path
    asked : Asked
    tell : callable
        Takes what is being done and the fraction done.

    Returns
    -------
    str
        HTML.

    Raises
    ------
    InputError
        The files are no capture.
    """
    stages = Stages(tell)
    capture = _read(files, asked, stages, 0.6)
    stages.begin("Inspecting", 0.6)
    findings = capture_findings(inspect_capture(capture))
    stages.begin("Drawing", 0.9)
    write_picture(folder / LOOK, inspection_picture(capture))
    prepared = [alignment_sentence(capture)] if asked.align else []
    return page_template(_HERE, "look.html").render(
        facts=[*prepared, *(finding.fact for finding in findings if finding.fact)],
        attention=[finding.attention for finding in findings if finding.attention],
        picture=LOOK,
    )


def separated(folder: Path, files: Sequence[Path], asked: Asked, tell: Progress) -> str:
    """Separate a capture: its files, all of them in one to download, and what the page shows.

    Parameters and errors are those of `look`.
    """
    stages = Stages(tell)
    read_until = _ALIGNED if asked.align else _READ
    capture = _read(files, asked, stages, read_until)
    results = folder / RESULTS
    results.mkdir(exist_ok=True)
    for old in results.iterdir():
        old.unlink()
    result = separate(
        capture,
        refractive_index=WATER_INDEX if asked.water else GLASS_INDEX,
        single_surface=asked.water,
        index_known=asked.water,
        progress=stages.part(read_until, _SEPARATED),
    )
    stages.include(result.seconds, result.cpu_seconds)
    report = write_separation(
        results, result, capture, stages=stages, reached=_SEPARATED, uncertainty=asked.uncertainty
    )
    stages.begin("Packing", _WRITTEN)
    intensity = reduced_intensity(capture, 1)
    write_png_view(folder / PHOTOGRAPH, intensity, viewing_exposure(intensity), capture.camera)
    # TIFF and PNG are compressed already.
    with zipfile.ZipFile(folder / ARCHIVE, "w", zipfile.ZIP_STORED) as archive:
        for name in report["written"]:
            archive.write(results / name, f"polaropt-results/{name}")
    return page_template(_HERE, "result.html").render(
        warnings=explained_attention(report),
        sentences=[*result_sentences(report), *motion_sentences(report)],
        written=report["written"],
        comparable=[Shown(*words, capture.shape[-1], capture.shape[-2]) for words in _COMPARABLE],
        full_width=capture.shape[-1],
        results=RESULTS,
        archive=ARCHIVE,
    )


def _read(files: Sequence[Path], asked: Asked, stages: Stages, until: float) -> Capture:
    read_until = until * (0.2 if asked.align else 1.0)
    stages.begin("Reading", 0.0)
    try:
        capture = read_capture(
            files if len(files) > 1 else files[0],
            asked.angles_deg or ANGLES_DEG,
            **(asked.reading or {}),
            progress=stages.part(0.0, read_until),
        )
    except InputError as error:
        # A person knows the photographs by their names, not where they lie for now.
        sentence = str(error)
        for path in files:
            sentence = sentence.replace(str(path), path.name)
        raise InputError(sentence) from None
    capture = capture.with_origin(files=tuple(path.name for path in files))
    if asked.align:
        stages.begin("Aligning", read_until)
        capture = align(capture, overwrite=True, progress=stages.part(read_until, until))
    return capture
