"""Raw files of photographers' cameras: one pixel per Bayer cell."""

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

CAMERA_RAW = (".arw", ".cr2", ".cr3", ".dng", ".nef", ".orf", ".pef", ".raf", ".rw2")
"""Names that raw files of photographers' cameras end in."""
_FLIPS = {0: 1, 3: 3, 5: 8, 6: 6}
"""Orientations of EXIF by the numbers that rawpy has for them."""
_VALUES_PER_PIXEL = 3
"""Of all colours, as float32, for each Bayer cell; and as many bytes for what the library keeps."""


def decode_camera_raw(data: bytes, max_pixels: int = MAX_PIXELS) -> FileContent:
    """A photograph of one pixel per Bayer cell; its library works in a process with limits."""
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
    """Mean values of each colour of a Bayer cell, which are below white, the balance, and what the camera tells."""
    import rawpy

    with rawpy.imread(io.BytesIO(data)) as raw:
        check_declared(Declared(raw.sizes.raw_height * raw.sizes.raw_width, 0), len(data), max_pixels)
        pattern, names = raw.raw_pattern, raw.color_desc.decode()
        if pattern is None or pattern.shape != (2, 2) or {names[i] for i in pattern.ravel()} != set("RGB"):
            raise InputError("its sensor has no Bayer pattern; develop it to linear TIFF files with equal settings")
        values, indices = raw.raw_image_visible, raw.raw_colors_visible
        rows, columns = (side // 2 * 2 for side in values.shape)
        white = float(min(raw.camera_white_level_per_channel or (raw.white_level,)))
        black = np.asarray(raw.black_level_per_channel, dtype=np.float32)
        sums = np.zeros((rows // 2, columns // 2, 3), np.float32)
        valid = np.ones(sums.shape, dtype=bool)
        count = np.zeros(3, np.float32)
        for i, j in np.ndindex(2, 2):
            part, index = values[i:rows:2, j:columns:2], int(indices[i, j])
            color = "RGB".index(names[index])
            sums[..., color] += (part - black[index]) / (white - black[index])
            valid[..., color] &= part < white
            count[color] += 1
        taken, flip, balance = raw.other, raw.sizes.flip, np.asarray(raw.camera_whitebalance[:3], dtype=np.float64)
    focal = focal_from_exif(exif_of_picture(data), (columns // 2, rows // 2)) or 0.0
    told = np.array([flip, taken.shutter_speed, taken.iso_speed, taken.aperture, focal])
    return {"pixels": sums / count, "valid": valid, "balance": balance, "told": told}
