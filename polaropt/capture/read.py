"""Files to a `Capture`: one file per angle, a stack, or the raw mosaic of a polarization camera."""

from __future__ import annotations

from collections.abc import Sequence

from polaropt.capture.capture import ANGLES_DEG, Capture
from polaropt.capture.files.limits import MAX_PIXELS
from polaropt.capture.files.opening import AnyPath
from polaropt.capture.reading.contents import OPENED, content_of, focal_px_of, listed_files, tell
from polaropt.capture.reading.levels import find_levels
from polaropt.capture.reading.mosaics import from_mosaic
from polaropt.capture.reading.options import checked_options
from polaropt.capture.reading.photographs import from_photographs
from polaropt.errors import InputError
from polaropt.optics import Analyzer
from polaropt.progress import Progress


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
    max_pixels: int = MAX_PIXELS,
    keep_defects: bool = False,
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
        PNG or TIFF (8 or 16 bits, or floating point), JPEG, HEIC (``pip install polaropt[heif]``), npz, npy; one raw
        mosaic without a header, see `shape`; raw files of a camera (DNG, CR3, ARW, NEF and others, ``pip install
        polaropt[raw]``), one per angle: half as wide (a third behind X-Trans), with one white level and balance for
        all, and their exposures divided out.
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
    max_pixels : int
        Pixels that a file may hold, all its photographs together: the header is asked before anything is decoded.
    keep_defects : bool
        Whether samples of a mosaic stay that stand out by themselves, as hot and dead pixels do. By default what the
        nearest samples of their polarizer and colour have takes their place (`Origin.defects` counts them).
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
    files = listed_files(paths)
    options = checked_options(
        angles_deg=angles_deg,
        sensor=sensor,
        cell_order=cell_order,
        black_level=black_level,
        white_level=white_level,
        pair_gain=pair_gain,
        gamma=gamma,
        resolution=resolution,
        angle_sense=angle_sense,
        field_of_view_deg=field_of_view_deg,
        analyzer=analyzer,
        exposures=exposures,
        max_pixels=max_pixels,
        keep_defects=keep_defects,
    )
    content, told = content_of(files, shape, pixel_format, options.max_pixels, progress)
    tell(progress, OPENED)
    name = files[0] if len(files) == 1 else f"{files[0]} and the others"
    try:
        levels = find_levels(content.pixels, options.black_level, options.white_level, content.bits)
        if content.stack:
            capture = from_photographs(content, levels, options, told)
        else:
            capture = from_mosaic(content, levels, options)
    except InputError as error:
        raise InputError(f"{name}: {error}") from None
    assert capture.origin is not None
    layout = "files" if len(files) > 1 else capture.origin.layout
    focal = focal_px_of(content, capture, options)
    tell(progress, 1.0)
    return capture.with_origin(files=files, layout=layout, focal_px=focal, camera=content.camera, jpeg=content.jpeg)
