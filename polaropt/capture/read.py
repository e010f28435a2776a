"""Files to a `Capture`: one file per angle, a stack, or the raw mosaic of a polarization camera."""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from polaropt.capture.capture import (
    ANGLES_DEG,
    SMALLEST_SIDE,
    Capture,
    FileContent,
    Origin,
    RawSamples,
    RegisteredCells,
    grey_levels,
)
from polaropt.capture.checks import blocks_of, swapped_blocks
from polaropt.capture.files.decode import AnyPath, linearize, parse_gamma, read_file, read_headless
from polaropt.capture.files.exif import relative_exposures, upright
from polaropt.capture.files.focal_length import check_view, focal_from_view
from polaropt.capture.mosaic import (
    SONY_CELL,
    check_cell_order,
    exchanged_order,
    looks_color,
    registered_cells,
    sampling_of,
    share_of_noise,
    wiener_photographs,
)
from polaropt.capture.noise import noise_level, noise_of_color_samples
from polaropt.capture.pair_gain import divide_out_gain, orthogonal_pairs, pair_gain_of, plausible
from polaropt.errors import InputError
from polaropt.numerics import block_mean, quantization_step, strips
from polaropt.optics import Analyzer, analyzer_matrix
from polaropt.progress import Progress

Mask = NDArray[np.bool_]
Images = NDArray[np.float32]

# Where values are clipped below full scale, see `_is_clipped`; all by trial.
_SMALLEST_PILE = 16
"""Pixels at the highest value."""
_SHARE, _LARGE_SHARE = 1e-5, 1e-3
"""Share of the pixels at the highest value: where that is the full scale of some depth, and elsewhere."""
_STEEP = 8
"""How many times as many there are as at each of the levels below."""
_LEVELS_BELOW = 32
"""Levels that are compared with; with no more in all nothing is told."""
_SAME_LENS = 1.01
"""Ratio of focal lengths of photographs that were not zoomed in between; set by hand."""
_LONGEST_SIDE = 65536
"""Height or width in pixels that a person can give; set by hand."""
_CLIPPED_FIELD = 1e-3
"""Share of clipped samples that a field for calibration may have: hot pixels; set by hand."""
_GAIN_RANGE = (0.5, 2.0)
"""Pair gains that a person can give; set by hand."""


@dataclass(frozen=True)
class Levels:
    """Values that become 0 and 1; values at white and above are clipped."""

    black: float
    white: float

    def apply(self, pixels: NDArray[Any], gamma: float | str | None = None) -> tuple[Images, Mask]:
        """Linear values of pixels (..., h, w) in an encoding, float32, and which of them are below white.

        Some rows at a time: the doubles of all would be several times the photographs.
        """
        values, valid = np.empty(pixels.shape, np.float32), np.empty(pixels.shape, np.bool_)
        for plane in np.ndindex(pixels.shape[:-2]):
            for rows in strips(*pixels.shape[-2:]):
                part = (*plane, rows)
                values[part] = linearize(self._scaled(pixels[part]), gamma)
                np.less(pixels[part], self.white, out=valid[part])
        return values, valid

    def _scaled(self, pixels: NDArray[Any]) -> NDArray[np.float32]:
        scale = 1 / (self.white - self.black)
        if pixels.dtype.kind == "f" and pixels.dtype.itemsize <= 4:
            return np.asarray((pixels - np.float32(self.black)) * np.float32(scale), dtype=np.float32)
        return np.asarray((pixels.astype(np.float64) - self.black) * scale, dtype=np.float32)


def find_levels(pixels: NDArray[Any], black: float, white: float | None, bits: int | None = None) -> Levels:
    """Check a file's values and find white where it is not given.

    Parameters
    ----------
    pixels : ndarray
        All photographs of a capture, as stored.
    black, white : float
        In the file's units. White None: full scale (1 for floating point), or a lower value at which integers are
        clipped.
    bits : int, optional
        Depth of integers, where it is known to be less than that of their type.

    Raises
    ------
    InputError
        No numbers, NaN, or no room between black and white.
    """
    if pixels.dtype.kind not in "uif":
        raise InputError(f"holds values of type {pixels.dtype}; integers or floating point numbers are needed")
    if pixels.size == 0:
        raise InputError("holds no pixels; give images of at least 16x16 px")
    if pixels.dtype.kind == "f" and not all(np.isfinite(part).all() for part in pixels):
        raise InputError("holds NaN or infinite values; replace them, or mask them in an npz file")
    if white is None:
        white = _white_of(pixels, bits)
    if white <= black:
        raise InputError(f"the white level {white:g} is not above the black level {black:g}; correct one of them")
    return Levels(black, white)


def _white_of(pixels: NDArray[Any], bits: int | None) -> float:
    if pixels.dtype.kind == "f":
        if sum(np.count_nonzero(part > 1) for part in pixels) > pixels.size / 2:
            raise InputError(
                f"floating point values reach {float(pixels.max()):g}, while white is taken as 1; give the white level"
            )
        return 1.0
    full = float(np.iinfo(pixels.dtype).max if bits is None else 2**bits - 1)
    highest = float(pixels.max())
    return highest if highest < full and _is_clipped(pixels, highest) else full


def _is_clipped(pixels: NDArray[Any], highest: float) -> bool:
    """Whether pixels pile up at the highest value: many more than at the levels just below it.

    A pile at the full scale of a smaller depth (4095 for 12 bits, also shifted up to 16) is believed at once; elsewhere
    it must be large.
    """
    levels, counts = _histogram(pixels, highest / 2)
    below = counts[:-1][-_LEVELS_BELOW:]
    if levels.size <= _LEVELS_BELOW:
        return False
    pile = int(counts[-1])
    share = _SHARE if _is_full_scale(int(highest)) else _LARGE_SHARE
    return pile >= max(_SMALLEST_PILE, share * pixels.size) and pile >= _STEEP * float(below.mean())


def _histogram(pixels: NDArray[Any], least: float) -> tuple[NDArray[Any], NDArray[np.intp]]:
    """Values from `least` on and how often each occurs, counted part by part."""
    parts = [np.unique(part[part >= least], return_counts=True) for part in pixels]
    levels, which = np.unique(np.concatenate([part[0] for part in parts]), return_inverse=True)
    counts = np.zeros(len(levels), dtype=np.intp)
    np.add.at(counts, which, np.concatenate([part[1] for part in parts]))
    return levels, counts


def _is_full_scale(value: int) -> bool:
    """Whether a value is 2^n - 1 with n of 8 or more, possibly shifted left."""
    ones = value >> ((value & -value).bit_length() - 1) if value > 0 else 0
    return ones & (ones + 1) == 0 and ones.bit_length() >= 8


SENSORS = ("auto", "mono", "color")
SENSES = ("ccw", "cw")
RESOLUTIONS = ("sensor", "cell")


@dataclass(frozen=True)
class ReaderOptions:
    """The reader's arguments, checked."""

    angles_deg: tuple[float, ...]
    sensor: str
    cell_order: tuple[float, ...] | None
    black_level: float
    white_level: float | None
    pair_gain: float | None
    gamma: float | str | None
    resolution: str
    angle_sense: str
    field_of_view_deg: float | None
    analyzer: Analyzer | None
    exposures: tuple[float, ...] | None = None

    def counted(self, angles_deg: Sequence[float]) -> tuple[float, ...]:
        """Angles counter-clockwise from the image's x axis, given in the sense that was asked for."""
        return tuple(angles_deg) if self.angle_sense == "ccw" else tuple(-angle % 180 for angle in angles_deg)


def checked_options(
    angles_deg: Sequence[float],
    sensor: str,
    cell_order: Sequence[float] | None,
    black_level: float,
    white_level: float | None,
    pair_gain: float | None,
    gamma: float | str | None,
    resolution: str,
    *,
    angle_sense: str = "ccw",
    field_of_view_deg: float | None = None,
    analyzer: AnyPath | Analyzer | None = None,
    exposures: Sequence[float] | None = None,
) -> ReaderOptions:
    """Check every option of `polaropt.capture.read.read_capture` by itself; InputError with what to give instead."""
    if sensor not in SENSORS:
        raise InputError(f"sensor {sensor!r} does not exist; choose one of {', '.join(SENSORS)}")
    if resolution not in RESOLUTIONS:
        raise InputError(f"resolution {resolution!r} does not exist; choose one of {', '.join(RESOLUTIONS)}")
    if angle_sense not in SENSES:
        raise InputError(f"angle sense {angle_sense!r} does not exist; choose one of {', '.join(SENSES)}")
    if field_of_view_deg is not None:
        check_view(_number(field_of_view_deg, "the field of view"))
    listed: Sequence[Any] = angles_deg if isinstance(angles_deg, Iterable) else (angles_deg,)
    angles = tuple(_number(angle, "a polarizer angle") for angle in listed)
    black = _number(black_level, "the black level")
    white = None if white_level is None else _number(white_level, "the white level")
    if white is not None and white <= black:
        raise InputError(f"the white level {white:g} is not above the black level {black:g}; correct one of them")
    gain = None if pair_gain is None else _number(pair_gain, "the pair gain")
    if gain is not None and not _GAIN_RANGE[0] <= gain <= _GAIN_RANGE[1]:
        raise InputError(f"the pair gain is {gain:g}; give a value near 1 (0.5 to 2)")
    cell = None if cell_order is None else check_cell_order(cell_order)
    encoding = parse_gamma(gamma)
    return ReaderOptions(
        angles,
        sensor,
        cell,
        black,
        white,
        gain,
        encoding,
        resolution,
        angle_sense,
        field_of_view_deg,
        read_analyzer(analyzer),
        None if exposures is None else tuple(_exposure(value) for value in exposures),
    )


def _exposure(value: Any) -> float:
    number = _number(value, "an exposure")
    if number <= 0:
        raise InputError(f"an exposure is {number:g}; give how long each photograph was exposed, or in what proportion")
    return number


def _number(value: Any, what: str) -> float:
    try:
        number = float(value)
    except (TypeError, ValueError):
        number = np.nan
    if not np.isfinite(number):
        raise InputError(f"{what} is {value!r}; give a number")
    return number


def read_capture(
    paths: AnyPath | Sequence[AnyPath],
    angles_deg: Sequence[float] = ANGLES_DEG,
    sensor: str = "auto",
    cell_order: Sequence[float] | None = None,
    black_level: float = 0,
    white_level: float | None = None,
    pair_gain: float | None = None,
    *,
    gamma: float | str | None = None,
    resolution: str = "sensor",
    angle_sense: str = "ccw",
    field_of_view_deg: float | None = None,
    shape: Sequence[int] | None = None,
    pixel_format: str | None = None,
    analyzer: AnyPath | Analyzer | None = None,
    exposures: Sequence[float] | None = None,
    progress: Progress | None = None,
) -> Capture:
    """Read photographs taken through a polarizer.

    Several files are one photograph each, in the order of `angles_deg`. One file is a stack if it has several pages
    (TIFF) or is an npz with an array ``intensities``, (k, h, w), (k, h, w, 3) or, as `write_capture` has it,
    (k, channel, h, w); it is a raw mosaic if it holds a single image. The photographs of a mosaic are interpolated
    between its samples, which the capture keeps: what is solved for in the end are the samples.

    Parameters
    ----------
    paths : path or sequence of paths
        PNG or TIFF (8 or 16 bits, or floating point), JPEG, npz, npy; one raw mosaic without a header, see `shape`;
        raw files of a camera (DNG, CR3, ARW, NEF and others, ``pip install polaropt[raw]``), one per angle: half as
        wide, with one white level and balance for all, and their exposures divided out.
    angles_deg : sequence of float
        Polarizer angles in degrees, counter-clockwise from the image's x axis. The default gives way to angles stored
        in the file. Mosaics have theirs in `cell_order`.
    sensor : {"auto", "mono", "color"}
        Kind of mosaic. "auto" measures whether neighbouring cells alternate between colours
        (`polaropt.capture.mosaic.looks_color`).
    cell_order : sequence of 4 floats, optional
        Angles of a mosaic's cell: top left, top right, bottom left, bottom right. Default: Sony's, 90, 45, 135, 0, or
        where its orthogonal pairs do not add up and only one other way to pair the corners does, the nearest order of
        those (`Origin.cell_order_found`).
    black_level, white_level : float
        Values that become 0 and 1, in the file's units. White by default is the full scale of the integer type (1 for
        floating point), or a lower value at which many pixels pile up. Values at white and above are not valid.
    pair_gain : float, optional
        Divides the photographs of the 45/135 pair. Default: estimated for mosaics
        (`polaropt.capture.pair_gain.pair_gain_of`) and used if it is between 0.9 and 1.1; 1 for everything else.
    gamma : float or "srgb", optional
        Encoding to undo. Default: the values are linear.
    resolution : {"sensor", "cell"}
        Of what comes of a mosaic: as many pixels as the sensor has, or one per pattern of 2x2 (mono) or 4x4 pixels
        (colour), all angles and colours referred to its middle: a quarter of the time.
    angle_sense : {"ccw", "cw"}
        Sense in which `angles_deg`, `cell_order` and angles stored in the file are counted. "cw": clockwise, as of a
        filter turned the other way or of mirrored pictures.
    field_of_view_deg : float, optional
        Angle that the camera sees along the longer side. It is kept as a focal length for scenes that need one, as is
        the one in the file (EXIF) otherwise.
    shape : (int, int), optional
        Height and width of a raw mosaic in a file without a header.
    pixel_format : str, optional
        How such a file is packed: Mono8, Mono10, Mono12, Mono16, Mono10p, Mono12p, or Mono12Packed (GigE Vision).
        Default: 8 or 16 bits, by the file's size.
    analyzer : path or Analyzer, optional
        Gain, contrast and angle of a mosaic's analyzers, as ``polaropt calibrate`` writes them. The samples become
        what ideal analyzers would have measured: what is missing is small, and follows from the Stokes images.
    exposures : sequence of float, optional
        How long each photograph was exposed, in any unit: they are divided out. Default: what the files tell (EXIF:
        time, aperture and speed); nothing is done where one of them tells nothing.
    progress : callable, optional
        Called with what is being done and the fraction done, 0..1.

    Returns
    -------
    Capture
        With `origin` telling what was done.

    Raises
    ------
    InputError
        One line: the file, what is wrong, what to do.

    Examples
    --------
    A stack of four photographs of 16 bits, as one TIFF of four pages:

    >>> import numpy as np
    >>> import tifffile
    >>> from skimage.data import astronaut, coffee
    >>> from polaropt import SceneParameters, read_capture, simulate
    >>> taken = simulate(coffee()[150:246, 200:296], astronaut()[30:126, 160:256], SceneParameters(60.0, 20.0, 4.0))
    >>> pages = np.round(np.clip(np.moveaxis(taken.intensities, 1, -1), 0, 1) * 65535).astype(np.uint16)
    >>> tifffile.imwrite("glass.tiff", pages, photometric="rgb")
    >>> capture = read_capture("glass.tiff")
    >>> capture, capture.origin.layout
    (Capture(shape=(4, 3, 96, 96), angles_deg=(0.0, 45.0, 90.0, 135.0)), 'stack')
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
        resolution,
        angle_sense=angle_sense,
        field_of_view_deg=field_of_view_deg,
        analyzer=analyzer,
        exposures=exposures,
    )
    content, told = _content(files, shape, pixel_format, progress)
    _tell(progress, _OPENED)
    name = files[0] if len(files) == 1 else f"{files[0]} and the others"
    try:
        levels = find_levels(content.pixels, options.black_level, options.white_level, content.bits)
        if content.stack:
            capture = _from_photographs(content, levels, options, told)
        else:
            capture = _from_mosaic(content, levels, options)
    except InputError as error:
        raise InputError(f"{name}: {error}") from None
    assert capture.origin is not None
    layout = "files" if len(files) > 1 else capture.origin.layout
    focal = _focal_px(content, capture, options)
    _tell(progress, 1.0)
    return capture.with_origin(files=files, layout=layout, focal_px=focal, camera=content.camera, jpeg=content.jpeg)


_OPENED = 0.6
"""Fraction of the progress at which all files are decoded; the rest is values, gains and mosaics. Set by hand."""


def _tell(progress: Progress | None, fraction: float) -> None:
    if progress is not None:
        progress("Reading", fraction)


def mosaic_capture(
    raw: NDArray[Any],
    sensor: str = "auto",
    cell_order: Sequence[float] | None = None,
    black_level: float = 0,
    white_level: float | None = None,
    pair_gain: float | None = None,
    *,
    bits: int | None = None,
    gamma: float | str | None = None,
    resolution: str = "sensor",
    angle_sense: str = "ccw",
    field_of_view_deg: float | None = None,
    analyzer: AnyPath | Analyzer | None = None,
) -> Capture:
    """A raw mosaic in memory, such as a frame of a camera, as a capture.

    Parameters
    ----------
    raw : ndarray, shape (h, w)
        As stored: integers, or floating point with white = 1.
    bits : int, optional
        Depth of integers, where it is less than that of their type.
    sensor, cell_order, black_level, white_level, pair_gain, gamma, resolution, angle_sense, field_of_view_deg, analyzer
        As of `read_capture`.

    Raises
    ------
    InputError
        One line: what is wrong, what to do.
    """
    options = checked_options(
        ANGLES_DEG,
        sensor,
        cell_order,
        black_level,
        white_level,
        pair_gain,
        gamma,
        resolution,
        angle_sense=angle_sense,
        field_of_view_deg=field_of_view_deg,
        analyzer=analyzer,
    )
    pixels = np.asarray(raw)
    if pixels.ndim not in (2, 3):
        raise InputError(f"a mosaic has shape {pixels.shape}; give (height, width)")
    content = FileContent(pixels, bits=bits)
    levels = find_levels(pixels, options.black_level, options.white_level, bits)
    capture = _from_mosaic(content, levels, options)
    return capture.with_origin(focal_px=_focal_px(content, capture, options))


def _content(
    files: tuple[str, ...], shape: Sequence[int] | None, pixel_format: str | None, progress: Progress | None = None
) -> tuple[FileContent, tuple[float, ...]]:
    """What the files hold, and the exposures of photographs where all files tell them."""
    if shape is None:
        if pixel_format is not None:
            raise InputError("a pixel format is for one raw file without a header; give its shape too, or leave it out")
        if len(files) == 1:
            content = read_file(files[0])
            # A mosaic stays as it is: turned, its cell would be another one.
            return (_upright(content) if content.stack else content), ()
        return _one_per_angle(files, progress)
    if len(files) != 1:
        raise InputError("a shape is for one raw file without a header; leave it out")
    try:
        height, width = (int(side) for side in shape)
        whole = (height, width) == tuple(shape)
    except (TypeError, ValueError):
        whole, height, width = False, 0, 0
    if not whole or not 0 < min(height, width) <= max(height, width) <= _LONGEST_SIDE:
        raise InputError(f"the shape is {shape!r}; give height and width in pixels, such as 2048,2448")
    return read_headless(files[0], (height, width), pixel_format), ()


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


def _one_per_angle(files: Sequence[str], progress: Progress | None) -> tuple[FileContent, tuple[float, ...]]:
    """The photographs of files, upright, and their exposures where all files tell them."""
    contents: list[FileContent] = []
    for i, name in enumerate(files):
        _tell(progress, _OPENED * i / len(files))
        content = _upright(read_file(name))
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


def _from_photographs(content: FileContent, levels: Levels, options: ReaderOptions, told: tuple[float, ...]) -> Capture:
    if options.analyzer is not None:
        raise InputError("an analyzer's calibration is for one raw mosaic; leave it out")
    if options.sensor != "auto" or options.resolution != "sensor":
        asked = "resolution 'cell'" if options.resolution != "sensor" else f"sensor {options.sensor!r}"
        raise InputError(f"{asked} is for one raw mosaic, not for {len(content.pixels)} photographs; leave it out")
    if len(content.pixels) < 3:
        raise InputError(f"holds {len(content.pixels)} photograph(s); at least 3 polarizer angles are needed")
    stored = content.angles_deg if options.angles_deg == ANGLES_DEG else None
    angles = options.counted(stored or options.angles_deg)
    colored = content.pixels.ndim == 4
    intensities, valid = levels.apply(np.moveaxis(content.pixels, -1, 1) if colored else content.pixels, options.gamma)
    if content.valid is not None:
        valid = np.moveaxis(content.valid, -1, 1) if colored else content.valid
    exposures = _exposures_of(len(intensities), options.exposures, told)
    if exposures:
        relative = np.array(exposures, dtype=np.float32) / np.float32(min(exposures))
        intensities /= relative.reshape(-1, *[1] * (intensities.ndim - 1))
    origin = replace(
        _origin("stack", content, levels, options),
        exposures=exposures,
        exposures_given=options.exposures is not None,
        orientation=content.camera.orientation,
    )
    return _finished(intensities, valid, angles, origin, options.pair_gain or 1.0)


def _exposures_of(n: int, given: tuple[float, ...] | None, told: tuple[float, ...]) -> tuple[float, ...]:
    """Exposures of n photographs: as given, or as the files tell them."""
    if given is None:
        return told
    if len(given) != n:
        raise InputError(f"{len(given)} exposures are given for {n} photographs; give one for each")
    return given


def _from_mosaic(content: FileContent, levels: Levels, options: ReaderOptions) -> Capture:
    raw = _single_plane(content.pixels)
    if options.exposures is not None:
        raise InputError("exposures are for several photographs; a mosaic's are taken at once, leave them out")
    cell_order = options.cell_order or SONY_CELL
    if options.angles_deg != ANGLES_DEG and sorted(options.angles_deg) != sorted(cell_order):
        raise InputError("one single image is taken as a mosaic; give its angles as the cell order")
    intensities, valid = levels.apply(raw)
    color = looks_color(intensities) if options.sensor == "auto" else options.sensor == "color"
    sampling, angles = sampling_of(color, cell_order)
    height, width = (side // sampling.period * sampling.period for side in raw.shape)
    if min(height, width) < SMALLEST_SIDE * sampling.period:
        raise InputError(
            f"the mosaic is {raw.shape[1]}x{raw.shape[0]} px; at least {SMALLEST_SIDE * sampling.period} px a side, "
            f"{SMALLEST_SIDE} cells, are needed"
        )
    samples = RawSamples(
        np.ascontiguousarray(linearize(intensities, options.gamma)[:height, :width]),
        np.ascontiguousarray(valid[:height, :width]),
        sampling,
    )
    origin = _origin("color mosaic" if color else "mono mosaic", content, levels, options)
    origin = replace(origin, cell_order=cell_order, left_out_px=(raw.shape[0] - height, raw.shape[1] - width))
    return _of_samples(samples, angles, origin, options)


def _of_samples(samples: RawSamples, angles: tuple[float, ...], origin: Origin, options: ReaderOptions) -> Capture:
    """The photographs of a mosaic whose values are linear, with what a scene is estimated from."""
    k, analyzer = len(angles), options.analyzer
    step = quantization_step(samples.values[None])
    if analyzer is not None:
        _check_angles_of(analyzer, angles)
        samples = _without_gains(samples, analyzer.gains)
    photographs, valid = registered_cells(samples.values, samples.valid, samples.sampling, k)
    # A calibration was made with an order that its fields agree with.
    if options.cell_order is None and analyzer is None:
        samples, photographs, valid, origin = _in_closing_order(samples, photographs, valid, angles, origin)
    sampling = samples.sampling
    gain = options.pair_gain or _sensor_gain(photographs, angles, valid)
    photographs = divide_out_gain(photographs, angles, gain)
    if gain != 1:
        pairs = orthogonal_pairs(angles)
        assert pairs is not None
        samples = _without_gains(samples, [gain if i in pairs[1] else 1.0 for i in range(k)])
    origin, counted = replace(origin, pair_gain=gain, grey_levels=grey_levels(step, origin)), options.counted(angles)
    if analyzer is not None:
        photographs += _seen_by(analyzer.missing, photographs, analyzer.matrix)
    color = sampling.n_channels > 1
    planes = (photographs, valid) if color else (photographs[:, 0], valid[:, 0])
    cells = Capture.of_planes(planes[0], counted, planes[1], replace(origin, low_passed=True))
    noise_share = share_of_noise(sampling)
    at_sensor = options.resolution == "sensor"
    level = (noise_of_color_samples(samples) if color else None) or noise_level(cells) / noise_share
    noise = max(level, step / math.sqrt(12))
    rows = None if analyzer is None else analyzer.matrix
    full = wiener_photographs(samples.values, samples.valid, sampling, angles, noise, photographs, rows)
    if analyzer is not None:
        beyond = _seen_by(analyzer.missing, full, analyzer_matrix(angles))
        samples = replace(samples, values=samples.values + sampling.sample(beyond))
    registered = RegisteredCells(cells, sampling.period if at_sensor else 1, noise_share, samples)
    if at_sensor:
        every = np.repeat(np.repeat(planes[1], sampling.period, axis=-2), sampling.period, axis=-1)
    else:
        full, every = block_mean(full, sampling.period), planes[1]
    full = full if color else full[:, 0]
    return Capture.of_planes(
        full, counted, every, replace(origin, raw_noise=noise), samples if at_sensor else None, registered
    )


def _in_closing_order(
    samples: RawSamples, cells: Images, valid: Mask, angles: tuple[float, ...], origin: Origin
) -> tuple[RawSamples, Images, Mask, Origin]:
    """Samples and their cells with another order of the cell, where pairs do not add up in the one that was taken."""
    swapped = swapped_blocks(blocks_of(cells, valid), angles, beyond_doubt=True)
    if not swapped or origin.cell_order is None:
        return samples, cells, valid, origin
    order = exchanged_order(origin.cell_order, swapped[0])
    index = np.arange(len(angles))
    index[list(swapped[0])] = swapped[0][::-1]
    sampling, _ = sampling_of(samples.sampling.n_channels > 1, order)
    # Closure tells neither which pair is 0/90 nor the sense of the angles.
    found = replace(origin, cell_order=order, cell_order_found=True, start_unknown=True)
    return replace(samples, sampling=sampling), cells[index], valid[index], found


def _check_angles_of(analyzer: Analyzer, angles: tuple[float, ...]) -> None:
    if not np.allclose(analyzer.angles_deg, angles):
        listed = ", ".join(f"{angle:g}" for angle in analyzer.angles_deg)
        raise InputError(f"the analyzer's calibration is of angles {listed}; give the cell order that it was made with")


def _without_gains(samples: RawSamples, gains: Sequence[float]) -> RawSamples:
    """Samples less the gain of each photograph's analyzer."""
    of_channels = np.repeat(np.array(gains)[:, None], samples.sampling.n_channels, axis=1)
    return replace(samples, values=samples.values / samples.sampling.laid_out(of_channels, samples.values.shape))


def _seen_by(rows: NDArray[np.float64], photographs: Images, analyzer: NDArray[np.float64]) -> Images:
    """What analyzer rows (k, 3) measure of the light of photographs (k, ...) that others took."""
    return np.asarray(np.tensordot((rows @ np.linalg.pinv(analyzer)).astype(np.float32), photographs, axes=1))


def read_analyzer(analyzer: AnyPath | Analyzer | None) -> Analyzer | None:
    """An analyzer from the file of ``polaropt calibrate``; InputError for anything else."""
    if analyzer is None or isinstance(analyzer, Analyzer):
        return analyzer
    try:
        document = json.loads(Path(analyzer).read_text(encoding="utf-8"))
        lists = (document[name] for name in ("angles_deg", "gains", "contrasts", "true_angles_deg"))
        return Analyzer(*(tuple(float(value) for value in values) for values in lists))
    except OSError as error:
        raise InputError(f"{analyzer}: cannot be opened ({error.strerror or error})") from None
    except InputError as error:
        raise InputError(f"{analyzer}: {error}") from None
    except (ValueError, KeyError, TypeError):
        raise InputError(f"{analyzer}: is no calibration; make one with polaropt calibrate") from None


def field_means(
    paths: Sequence[AnyPath],
    sensor: str = "auto",
    cell_order: Sequence[float] | None = None,
    black_level: float = 0.0,
    white_level: float | None = None,
    *,
    shape: Sequence[int] | None = None,
    pixel_format: str | None = None,
) -> tuple[NDArray[np.float64], tuple[float, ...]]:
    """Mean of each corner's samples in raw mosaics of evenly lit fields, (n, k), and the corners' angles, ascending.

    Of the middle half of the frame, colours together. Arguments as of `read_capture`.

    Raises
    ------
    InputError
        A file that cannot be read, or a field that is clipped.
    """
    options = checked_options(ANGLES_DEG, sensor, cell_order, black_level, white_level, None, None, "sensor")
    sampling, angles = sampling_of(False, options.cell_order or SONY_CELL)
    means = []
    for path in paths:
        content, _ = _content((str(path),), shape, pixel_format)
        try:
            if content.stack:
                raise InputError("holds several photographs; give one raw mosaic a file")
            raw = _single_plane(content.pixels)
            levels = find_levels(raw, options.black_level, options.white_level, content.bits)
            values, valid = levels.apply(raw)
            height, width = (side // 8 * 4 for side in values.shape)
            if min(height, width) < SMALLEST_SIDE:
                raise InputError(f"is {raw.shape[1]}x{raw.shape[0]} px; at least 64x64 are needed")
            top, left = (side // 8 * 2 // 4 * 4 for side in values.shape)
            middle = (slice(top, top + height), slice(left, left + width))
            if np.mean(~valid[middle]) > _CLIPPED_FIELD:
                raise InputError("is clipped; take the field again with a shorter exposure")
            of_corners = sampling.spread(values[middle], len(angles))
            means.append(of_corners.sum(axis=(1, 2, 3), dtype=np.float64) / (height * width / len(angles)))
        except InputError as error:
            raise InputError(f"{path}: {error}") from None
    return np.array(means), angles


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
    return Capture.of_planes(divide_out_gain(images, angles, gain), angles, valid, replace(origin, pair_gain=gain))
