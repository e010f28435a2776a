"""Files to a `Capture`: one file per angle, a stack, or the raw mosaic of a polarization camera."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from polaropt.capture import Capture, Origin
from polaropt.decoding import FileContent
from polaropt.errors import InputError
from polaropt.focal_length import focal_from_view
from polaropt.image_io import AnyPath, linearize, read_file
from polaropt.levels import Levels, find_levels
from polaropt.mosaic import SONY_CELL, looks_color, merge_green_masks, merge_greens, split_mosaic
from polaropt.noise import noise_level
from polaropt.pair_gain import divide_out_gain, orthogonal_pairs, pair_gain_of, plausible
from polaropt.reader_options import ANGLES_DEG, ReaderOptions, checked_options

Mask = NDArray[np.bool_]
Images = NDArray[np.float32]


def read_capture(
    paths: AnyPath | Sequence[AnyPath],
    angles_deg: Sequence[float] = ANGLES_DEG,
    sensor: str = "auto",
    cell_order: Sequence[float] = SONY_CELL,
    black_level: float = 0,
    white_level: float | None = None,
    pair_gain: float | None = None,
    *,
    gamma: float | str | None = None,
    full_resolution: bool = False,
    angle_sense: str = "ccw",
    field_of_view_deg: float | None = None,
) -> Capture:
    """Read photographs taken through a polarizer.

    Several files are one photograph each, in the order of `angles_deg`. One file is a stack if it has several pages
    (TIFF) or is an npz with an array ``intensities`` (k, [channel,] h, w), and a raw mosaic if it holds a single image.
    A mosaic becomes one pixel per 2x2 cell (mono, half size) or per 4x4 block (colour, quarter size, the two greens
    averaged), so that no value is interpolated and the noise stays independent.

    Parameters
    ----------
    paths : path or sequence of paths
        PNG or TIFF (8 or 16 bits, or floating point), JPEG, npz.
    angles_deg : sequence of float
        Polarizer angles in degrees, counter-clockwise from the image's x axis. The default gives way to angles stored
        in the file. Mosaics have theirs in `cell_order`.
    sensor : {"auto", "mono", "color"}
        Kind of mosaic. "auto" measures whether neighbouring cells alternate between colours
        (`polaropt.mosaic.looks_color`).
    cell_order : sequence of 4 floats
        Angles of a mosaic's cell: top left, top right, bottom left, bottom right.
    black_level, white_level : float
        Values that become 0 and 1, in the file's units. White by default is the full scale of the integer type (1 for
        floating point), or a lower value at which many pixels pile up. Values at white and above are not valid.
    pair_gain : float, optional
        Divides the photographs of the 45/135 pair. Default: estimated for mosaics
        (`polaropt.pair_gain.pair_gain_of`) and used if it is between 0.9 and 1.1; 1 for everything else.
    gamma : float or "srgb", optional
        Encoding to undo. Default: the values are linear.
    full_resolution : bool
        Interpolate mosaics to full size with the package polanalyser (``pip install polaropt[demosaic]``).
    angle_sense : {"ccw", "cw"}
        Sense in which `angles_deg`, `cell_order` and angles stored in the file are counted. "cw": clockwise, as of a
        filter turned the other way or of mirrored pictures.
    field_of_view_deg : float, optional
        Angle that the camera sees along the longer side. It is kept as a focal length for scenes that need one, as is
        the one in the file (EXIF) otherwise.

    Returns
    -------
    Capture
        With `origin` telling what was done.

    Raises
    ------
    InputError
        One line: the file, what is wrong, what to do.
    """
    files = _listed_files(paths)
    options = checked_options(
        angles_deg,
        sensor,
        cell_order,
        black_level,
        white_level,
        pair_gain,
        gamma,
        full_resolution,
        angle_sense=angle_sense,
        field_of_view_deg=field_of_view_deg,
    )
    content = read_file(files[0]) if len(files) == 1 else _one_per_angle(files)
    name = files[0] if len(files) == 1 else f"{files[0]} and the others"
    try:
        levels = find_levels(content.pixels, options.black_level, options.white_level)
        if content.stack:
            capture = _from_photographs(content, levels, options)
        else:
            capture = _from_mosaic(content, levels, options)
    except InputError as error:
        raise InputError(f"{name}: {error}") from None
    assert capture.origin is not None
    layout = "files" if len(files) > 1 else capture.origin.layout
    focal = _focal_px(content, capture, options)
    capture.origin = replace(capture.origin, files=files, layout=layout, focal_px=focal)
    return capture


def _focal_px(content: FileContent, capture: Capture, options: ReaderOptions) -> float | None:
    """Focal length in the capture's pixels, as given or as the file has it."""
    if options.field_of_view_deg is not None:
        return focal_from_view(options.field_of_view_deg, max(capture.shape[-2:]))
    if content.focal_px is None:
        return None
    in_file = content.pixels.shape[2 if content.stack else 1]
    # One pixel of a mosaic stands for a whole cell.
    return float(content.focal_px / round(in_file / capture.shape[-1]))


def _listed_files(paths: AnyPath | Sequence[AnyPath]) -> tuple[str, ...]:
    listed: Sequence[Any] = [paths] if isinstance(paths, str) or not isinstance(paths, Sequence) else paths
    try:
        files = [str(Path(path)) for path in listed]
    except TypeError:
        raise InputError(f"{listed!r} is no list of files; give paths") from None
    if not files:
        raise InputError("no file given; give one file per polarizer angle, a stack or a mosaic")
    twice = [name for name in files if files.count(name) > 1]
    if twice:
        raise InputError(f"{twice[0]}: given twice; each polarizer angle needs its own photograph")
    if len(files) == 2:
        raise InputError(f"{files[0]}: 2 files hold 2 polarizer angles; at least 3 different ones are needed")
    return tuple(files)


def _one_per_angle(files: Sequence[str]) -> FileContent:
    contents = [read_file(name) for name in files]
    first = contents[0]
    for name, content in zip(files, contents, strict=True):
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
    stacked = np.stack([content.pixels for content in contents])
    told = [content.focal_px for content in contents if content.focal_px is not None]
    # A lens that was zoomed between the photographs has none.
    focal = told[0] if told and max(told) < 1.01 * min(told) else None
    return FileContent(stacked, stack=True, encoding_hint=first.encoding_hint, focal_px=focal)


def _size(pixels: NDArray[Any]) -> str:
    channels = f", {pixels.shape[2]} channels" if pixels.ndim == 3 else ", grey"
    return f"{pixels.shape[1]}x{pixels.shape[0]} px{channels}"


def _from_photographs(content: FileContent, levels: Levels, options: ReaderOptions) -> Capture:
    if options.sensor != "auto" or options.full_resolution:
        asked = "full resolution" if options.full_resolution else f"sensor {options.sensor!r}"
        raise InputError(f"{asked} is for one raw mosaic, not for {len(content.pixels)} photographs; leave it out")
    if len(content.pixels) < 3:
        raise InputError(f"holds {len(content.pixels)} photograph(s); at least 3 polarizer angles are needed")
    stored = content.angles_deg if options.angles_deg == ANGLES_DEG else None
    angles = options.counted(stored or options.angles_deg)
    intensities, valid = levels.apply(content.pixels)
    valid = valid if content.valid is None else content.valid
    if intensities.ndim == 4:
        intensities, valid = np.moveaxis(intensities, -1, 1), np.moveaxis(valid, -1, 1)
    origin = _origin("stack", content, levels, options)
    return _finished(linearize(intensities, options.gamma), valid, angles, origin, options.pair_gain or 1.0)


def _from_mosaic(content: FileContent, levels: Levels, options: ReaderOptions) -> Capture:
    raw = _single_plane(content.pixels)
    if options.angles_deg != ANGLES_DEG and sorted(options.angles_deg) != sorted(options.cell_order):
        raise InputError("one single image is taken as a mosaic; give its angles as the cell order")
    intensities, valid = levels.apply(raw)
    color = looks_color(intensities) if options.sensor == "auto" else options.sensor == "color"
    linear = linearize(intensities, options.gamma)
    cells, angles = split_mosaic(linear, color, options.cell_order)
    masks, _ = split_mosaic(valid, color, options.cell_order)
    gain = options.pair_gain or _sensor_gain(cells, angles, masks)
    origin = _origin("color mosaic" if color else "mono mosaic", content, levels, options)
    if color:
        cells, masks = merge_greens(cells), merge_green_masks(masks)
    capture = _finished(cells, masks, options.counted(angles), origin, gain)
    return _in_full(linear, valid, capture, options) if options.full_resolution else capture


def _single_plane(pixels: NDArray[Any]) -> NDArray[Any]:
    """A mosaic stored as grey RGB is still one plane; a real colour picture is one photograph of several."""
    if pixels.ndim == 2:
        return pixels
    if all(np.array_equal(pixels[..., 0], pixels[..., channel]) for channel in range(1, pixels.shape[-1])):
        return pixels[..., 0]
    raise InputError(
        "one colour picture holds one polarizer angle at most; "
        "give one file per angle, a stack, or the camera's raw mosaic"
    )


def _sensor_gain(cells: Images, angles: tuple[float, ...], masks: Mask) -> float:
    gain = pair_gain_of(cells, angles, masks)
    return gain if gain is not None and plausible(gain) else 1.0


def _in_full(linear: Images, valid: Mask, cells: Capture, options: ReaderOptions) -> Capture:
    """The same mosaic at full size, with the gain and the noise measured on its cells."""
    from polaropt.demosaic import demosaic_full

    assert cells.origin is not None
    color = cells.origin.layout == "color mosaic"
    images, masks, angles = demosaic_full(linear, valid, color, options.cell_order)
    origin = replace(cells.origin, raw_noise=noise_level(cells))
    return _finished(images, masks, options.counted(angles), origin, cells.origin.pair_gain)


def _origin(layout: str, content: FileContent, levels: Levels, options: ReaderOptions) -> Origin:
    return Origin(
        files=(),
        layout=layout,
        sample_type=str(content.pixels.dtype),
        black_level=levels.black,
        white_level=levels.white,
        gamma=options.gamma,
        encoding_hint=content.encoding_hint,
        angle_sense=options.angle_sense,
    )


def _finished(images: Images, valid: Mask, angles: tuple[float, ...], origin: Origin, gain: float) -> Capture:
    if gain != 1 and orthogonal_pairs(angles) is None:
        raise InputError("a pair gain needs four angles in two orthogonal pairs, such as 0,45,90,135; leave it out")
    capture = Capture(divide_out_gain(images, angles, gain), angles, valid)
    capture.origin = replace(origin, pair_gain=gain)
    return capture
