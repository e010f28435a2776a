"""Raw files of photographers' cameras: one pixel per Bayer cell."""

from __future__ import annotations

import io

import numpy as np

from polaropt.capture.capture import FileContent
from polaropt.capture.files.exif import BASE_ISO, CameraFacts
from polaropt.capture.files.focal_length import exif_of_picture, focal_from_exif
from polaropt.errors import InputError

CAMERA_RAW = (".arw", ".cr2", ".cr3", ".dng", ".nef", ".orf", ".pef", ".raf", ".rw2")
"""Names that raw files of photographers' cameras end in."""
_FLIPS = {0: 1, 3: 3, 5: 8, 6: 6}
"""Orientations of EXIF by the numbers that rawpy has for them."""


def decode_camera_raw(data: bytes) -> FileContent:
    try:
        import rawpy
    except ImportError:
        raise InputError(
            "raw files of cameras need the package rawpy; install it with: pip install 'polaropt[raw]'"
        ) from None
    with rawpy.imread(io.BytesIO(data)) as raw:
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
    speed = taken.iso_speed if taken.iso_speed > 0 else BASE_ISO
    camera = CameraFacts(
        orientation=_FLIPS.get(flip, 1),
        exposure=taken.shutter_speed * speed / BASE_ISO if taken.shutter_speed > 0 else None,
        aperture=taken.aperture if taken.aperture > 0 else None,
    )
    red, green, blue = balance / balance.max() if balance.min() > 0 else np.ones(3)
    focal = focal_from_exif(exif_of_picture(data), (columns // 2, rows // 2))
    return FileContent(
        sums / count,
        valid=valid,
        focal_px=focal,
        camera=camera,
        white_balance=(float(red), float(green), float(blue)),
    )
