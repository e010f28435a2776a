"""Raw files of photographers' cameras: one pixel per cell of the sensor's pattern, nothing is interpolated.

A cell is two pixels a side of a Bayer pattern, and three of Fujifilm's X-Trans, whose colours then share one middle.
Linear DNG, as of telephones, have all colours in every pixel.
"""

from __future__ import annotations

import io
from importlib.util import find_spec
from typing import Any

import numpy as np
from numpy.typing import NDArray

from polaropt.capture.capture import FileContent
from polaropt.capture.files.child import decoded_in_child
from polaropt.capture.files.exif import BASE_ISO, CameraFacts
from polaropt.capture.files.focal_length import exif_of_picture, focal_from_exif
from polaropt.capture.files.limits import MAX_PIXELS, Declared, check_declared, free_bytes
from polaropt.errors import InputError

CAMERA_RAW = (".arw", ".cr2", ".cr3", ".dng", ".nef", ".nrw", ".orf", ".pef", ".raf", ".rw2", ".rwl", ".srw")
"""Names that raw files of photographers' cameras end in."""
_FLIPS = {0: 1, 3: 3, 5: 8, 6: 6}
"""Orientations of EXIF by the numbers that rawpy has for them."""
_VALUES_PER_PIXEL = 3
"""Of all colours, as float32, for each pixel of a linear DNG; and as many bytes for what the library keeps."""
_CELLS = {(2, 2): 2, (6, 6): 3}
"""Side of a cell in pixels by the pattern's shape: Bayer, X-Trans."""


def decode_camera_raw(data: bytes, max_pixels: int = MAX_PIXELS) -> FileContent:
    """A photograph of one pixel per cell; its library works in a process with limits."""
    if find_spec("rawpy") is None:
        raise InputError("raw files of cameras need the package rawpy; install it with: pip install 'polaropt[raw]'")
    n_bytes = min(free_bytes(len(data)), 4 * _VALUES_PER_PIXEL * max_pixels)
    found = decoded_in_child(f"{__name__}:developed", data, {"max_pixels": max_pixels}, n_bytes)
    balance, (flip, seconds, speed, aperture, focal) = found["balance"], map(float, found["told"])
    camera = CameraFacts(
        orientation=_FLIPS.get(int(flip), 1),
        exposure=seconds * (speed if speed > 0 else BASE_ISO) / BASE_ISO if seconds > 0 else None,
        aperture=aperture if aperture > 0 else None,
    )
    red, green, blue = balance / balance.max() if balance.min() > 0 else np.ones(3)
    return FileContent(
        found["pixels"],
        valid=found["valid"],
        focal_px=focal if focal > 0 else None,
        camera=camera,
        white_balance=(float(red), float(green), float(blue)),
    )


def developed(data: bytes, max_pixels: int) -> dict[str, NDArray[Any]]:
    """Mean values of each colour of a cell, which are below white, the balance, and what the camera tells."""
    import rawpy

    with rawpy.imread(io.BytesIO(data)) as raw:
        check_declared(Declared(raw.sizes.raw_height * raw.sizes.raw_width, 0), len(data), max_pixels)
        values, white = raw.raw_image_visible, float(min(raw.camera_white_level_per_channel or (raw.white_level,)))
        black = np.asarray(raw.black_level_per_channel, dtype=np.float32)
        if values.ndim == 3 and values.shape[-1] >= 3:
            values = values[..., :3]
            pixels, valid = (values - black[:3]) / (white - black[:3]), values < white
        else:
            pixels, valid = _of_cells(values, white, black, *_pattern(raw))
        taken, flip, balance = raw.other, raw.sizes.flip, np.asarray(raw.camera_whitebalance[:3], dtype=np.float64)
    focal = focal_from_exif(exif_of_picture(data), (pixels.shape[1], pixels.shape[0])) or 0.0
    told = np.array([flip, taken.shutter_speed, taken.iso_speed, taken.aperture, focal])
    return {"pixels": np.asarray(pixels, np.float32), "valid": valid, "balance": balance, "told": told}


def _pattern(raw: Any) -> tuple[NDArray[np.intp], NDArray[Any], int]:
    """Number of the colour that each index stands for, indices of a pattern's pixels, and side of its cells."""
    pattern, names = raw.raw_pattern, raw.color_desc.decode()
    side = None if pattern is None else _CELLS.get(pattern.shape)
    if side is None or {names[i] for i in pattern.ravel()} != set("RGB"):
        raise InputError("its sensor's pattern is not known; develop it to linear TIFF files with equal settings")
    period = len(pattern)
    return np.array(["RGB".index(name) for name in names]), raw.raw_colors_visible[:period, :period], side


def _of_cells(
    values: NDArray[Any],
    white: float,
    black: NDArray[np.float32],
    colors: NDArray[np.intp],
    pattern: NDArray[Any],
    side: int,
) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
    """Means of each colour over cells, and which are below white; parameters as of `_pattern`."""
    top, left = _first_cell(colors[pattern], side)
    period, (rows, columns) = len(pattern), ((n - at) // side for n, at in zip(values.shape, (top, left), strict=True))
    sums: NDArray[np.float32] = np.zeros((rows, columns, 3), np.float32)
    valid: NDArray[np.bool_] = np.ones(sums.shape, dtype=bool)
    counts = np.zeros(3, np.float32)
    cells = period // side
    for i, j in np.ndindex(period, period):
        # Cells of X-Trans differ from one to the next; each pixel of the pattern has its own.
        down, across = i // side, j // side
        at = (top + i) % period, (left + j) % period
        index = int(pattern[at])
        color = int(colors[index])
        here = (slice(down, None, cells), slice(across, None, cells))
        part = values[top + i : top + rows * side : period, left + j : left + columns * side : period]
        sums[(*here, color)] += (part - black[index]) / (white - black[index])
        valid[(*here, color)] &= part < white
        counts[color] += not (down or across)
    sums /= counts
    return sums, valid


def _first_cell(colors: NDArray[np.intp], side: int) -> tuple[int, int]:
    """Where cells begin whose colours have one middle; a Bayer cell has none, and begins anywhere."""
    middle = (side - 1) / 2
    for top, left in np.ndindex(side, side):
        turned = np.roll(colors, (-top, -left), (0, 1))
        cells = [turned[i : i + side, j : j + side] for i, j in np.ndindex(*turned.shape) if not (i % side or j % side)]
        if all(np.allclose(np.argwhere(cell == color).mean(axis=0), middle) for cell in cells for color in range(3)):
            return top, left
    return 0, 0
