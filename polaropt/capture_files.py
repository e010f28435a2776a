"""Captures to files that `read_capture` reads back."""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from polaropt.capture import Capture
from polaropt.errors import InputError
from polaropt.image_io import AnyPath, write_bytes, write_png

_WHITE16 = 65535


def write_capture(capture: Capture, path: AnyPath) -> tuple[Path, ...]:
    """Write a capture; what is written can be read by `polaropt.read_capture`.

    Parameters
    ----------
    capture : Capture
    path : path
        ``*.npz``: everything, exactly. ``*.tif`` or ``*.tiff``: one stack of float32 pages, with the angles; invalid
        pixels are raised to white. ``*.png``: one 16-bit file per angle, ``name_045.png`` for 45 degrees; values are
        rounded to 1/65535, negative ones become 0, invalid ones white.

    Returns
    -------
    tuple of Path
        The files, in the order of the angles.

    Raises
    ------
    InputError
        Another suffix, channels that the format cannot hold, or a place that cannot be written.
    """
    target = Path(path)
    suffix = target.suffix.lower()
    if suffix == ".npz":
        _write_npz(capture, target)
        return (target,)
    if suffix not in (".png", ".tif", ".tiff"):
        raise InputError(f"{path}: captures are written as .npz, .tiff or .png; choose one of these suffixes")
    if capture.color and capture.shape[0] != 3:
        raise InputError(f"{path}: {suffix} files hold 1 or 3 channels, the capture has {capture.shape[0]}; write .npz")
    if suffix == ".png":
        return _write_pngs(capture, target)
    _write_tiff(capture, target)
    return (target,)


def _write_npz(capture: Capture, target: Path) -> None:
    buffer = io.BytesIO()
    angles = np.asarray(capture.angles_deg)
    np.savez_compressed(buffer, intensities=capture.intensities, angles_deg=angles, valid=capture.valid)
    write_bytes(target, buffer.getvalue())


def _write_tiff(capture: Capture, target: Path) -> None:
    import tifffile

    pages = _channels_last(np.where(capture.valid, capture.intensities, np.maximum(capture.intensities, 1)))
    buffer = io.BytesIO()
    photometric = "rgb" if capture.color else "minisblack"
    tifffile.imwrite(buffer, pages, photometric=photometric, metadata={"angles_deg": list(capture.angles_deg)})
    write_bytes(target, buffer.getvalue())


def _write_pngs(capture: Capture, target: Path) -> tuple[Path, ...]:
    levels = np.round(np.clip(capture.intensities.astype(np.float64), 0, 1) * _WHITE16)
    # The highest level means clipped.
    pixels = _channels_last(np.where(capture.valid, np.minimum(levels, _WHITE16 - 1), _WHITE16).astype(np.uint16))
    files = tuple(target.with_name(f"{target.stem}_{angle:03g}.png") for angle in capture.angles_deg)
    for name, image in zip(files, pixels, strict=True):
        write_png(name, image)
    return files


def _channels_last(images: NDArray[Any]) -> NDArray[Any]:
    return np.ascontiguousarray(np.moveaxis(images, 1, -1)) if images.ndim == 4 else images
