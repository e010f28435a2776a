"""Several files, one, or one without a header: what they hold together."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from polaropt.capture.capture import Capture, FileContent
from polaropt.capture.files.decode import read_file
from polaropt.capture.files.exif import relative_exposures, upright
from polaropt.capture.files.focal_length import focal_from_view
from polaropt.capture.files.headless import read_headless
from polaropt.capture.files.limits import MAX_PIXELS
from polaropt.capture.files.opening import AnyPath
from polaropt.capture.reading.options import ReaderOptions
from polaropt.errors import InputError
from polaropt.progress import Progress

_SAME_LENS = 1.01
"""Ratio of focal lengths of photographs that were not zoomed in between; set by hand."""
_LONGEST_SIDE = 65536
"""Height or width in pixels that a person can give; set by hand."""
OPENED = 0.6
"""Fraction of the progress at which all files are decoded; the rest is values, gains and mosaics. Set by hand."""


def tell(progress: Progress | None, fraction: float) -> None:
    if progress is not None:
        progress("Reading", fraction)


def content_of(
    files: tuple[str, ...],
    shape: Sequence[int] | None,
    pixel_format: str | None,
    max_pixels: int = MAX_PIXELS,
    progress: Progress | None = None,
) -> tuple[FileContent, tuple[float, ...]]:
    """What the files hold, and the exposures of photographs where all files tell them."""
    if shape is None:
        if pixel_format is not None:
            raise InputError("a pixel format is for one raw file without a header; give its shape too, or leave it out")
        if len(files) == 1:
            content = read_file(files[0], max_pixels)
            # A mosaic stays as it is: turned, its cell would be another one.
            return (_upright(content) if content.stack else content), ()
        return _one_per_angle(files, max_pixels, progress)
    if len(files) != 1:
        raise InputError("a shape is for one raw file without a header; leave it out")
    try:
        height, width = (int(side) for side in shape)
        whole = (height, width) == tuple(shape)
    except (TypeError, ValueError):
        whole, height, width = False, 0, 0
    if not whole or not 0 < min(height, width) <= max(height, width) <= _LONGEST_SIDE:
        raise InputError(f"the shape is {shape!r}; give height and width in pixels, such as 2048,2448")
    return read_headless(files[0], (height, width), pixel_format, max_pixels), ()


def focal_px_of(content: FileContent, capture: Capture, options: ReaderOptions) -> float | None:
    """Focal length in the capture's pixels, as given or as the file has it."""
    if options.field_of_view_deg is not None:
        return focal_from_view(options.field_of_view_deg, max(capture.shape[-2:]))
    if content.focal_px is None:
        return None
    in_file = content.pixels.shape[2 if content.stack else 1]
    # One pixel of a mosaic stands for a whole cell.
    return float(content.focal_px / round(in_file / capture.shape[-1]))


def listed_files(paths: AnyPath | Sequence[AnyPath]) -> tuple[str, ...]:
    listed: Sequence[Any] = [paths] if isinstance(paths, str) or not isinstance(paths, Sequence) else paths
    try:
        files = [str(Path(path)) for path in listed]
    except TypeError:
        raise InputError(f"{paths!r} is no list of files; give paths") from None
    if not files:
        raise InputError("no file given; give one file per polarizer angle, a stack or a mosaic")
    twice = [name for name in files if files.count(name) > 1]
    if twice:
        raise InputError(f"{twice[0]}: given twice; each polarizer angle needs its own photograph")
    if len(files) == 2:
        raise InputError(f"{files[0]}: 2 files hold 2 polarizer angles; at least 3 different ones are needed")
    return tuple(files)


def _one_per_angle(
    files: Sequence[str], max_pixels: int, progress: Progress | None
) -> tuple[FileContent, tuple[float, ...]]:
    """The photographs of files, upright, and their exposures where all files tell them."""
    contents: list[FileContent] = []
    for i, name in enumerate(files):
        tell(progress, OPENED * i / len(files))
        content = _upright(read_file(name, max_pixels))
        if i == 0:
            first, stacked = content, np.empty((len(files), *content.pixels.shape), content.pixels.dtype)
        if content.stack:
            raise InputError(f"{name}: holds several photographs; give it alone, or one single-image file per angle")
        if content.pixels.shape != first.pixels.shape:
            sizes = f"{_size(content.pixels)}, but {files[0]} is {_size(first.pixels)}"
            raise InputError(f"{name}: is {sizes}; all photographs must have the same size")
        if content.pixels.dtype != first.pixels.dtype:
            depths = f"{content.pixels.dtype}, but {files[0]} holds {first.pixels.dtype}"
            raise InputError(f"{name}: holds {depths}; save all photographs with the same depth")
        if content.pixels.dtype.kind == "f" and not np.all(np.isfinite(content.pixels)):
            raise InputError(f"{name}: holds NaN or infinite values; replace them")
        stacked[i] = content.pixels
        # All pixels stand in one array now.
        contents.append(replace(content, pixels=stacked[i]))
    masks = [content.valid for content in contents if content.valid is not None]
    valid = np.stack(masks) if len(masks) == len(contents) else None
    lengths = [content.focal_px for content in contents if content.focal_px is not None]
    # A lens that was zoomed between the photographs has none.
    focal = lengths[0] if lengths and max(lengths) < _SAME_LENS * min(lengths) else None
    if first.white_balance is not None:
        # One balance for all: a camera's own changes from file to file, and would look like polarization.
        stacked *= np.asarray(first.white_balance, dtype=np.float32)
    compressed = [content.jpeg for content in contents if content.jpeg is not None]
    return FileContent(
        stacked,
        stack=True,
        valid=valid,
        encoding_hint=first.encoding_hint,
        focal_px=focal,
        camera=first.camera,
        jpeg=max(compressed, key=lambda facts: facts.step, default=None),
    ), relative_exposures([content.camera for content in contents])


def _upright(content: FileContent) -> FileContent:
    """A photograph, or several, as it is to be looked at; the camera's facts tell how it was held."""
    axes = (1, 2) if content.stack else (0, 1)
    turned = upright(content.pixels, content.camera.orientation, axes)
    valid = None if content.valid is None else upright(content.valid, content.camera.orientation, axes)
    return replace(content, pixels=turned, valid=valid)


def _size(pixels: NDArray[Any]) -> str:
    channels = f", {pixels.shape[2]} channels" if pixels.ndim == 3 else ", grey"
    return f"{pixels.shape[1]}x{pixels.shape[0]} px{channels}"
