"""numpy's files: npz, and npy of one array."""

from __future__ import annotations

import io
import zipfile
from typing import Any

import numpy as np
from numpy.typing import NDArray

from polaropt.capture.capture import FileContent
from polaropt.errors import InputError, one_line

Pixels = NDArray[Any]


def decode_npz(data: bytes) -> FileContent:
    try:
        with np.load(io.BytesIO(data), allow_pickle=False) as archive:
            arrays = {name: archive[name] for name in archive.files}
    except (zipfile.BadZipFile, ValueError, EOFError) as error:
        raise InputError(f"not a readable npz file ({one_line(error)}); write it again with numpy.savez") from None
    if "intensities" not in arrays:
        names = ", ".join(sorted(arrays)) or "nothing"
        raise InputError(f"holds {names} but no array 'intensities' of shape (angle, [channel,] height, width)")
    return _npz_content(arrays)


def _npz_content(arrays: dict[str, Pixels]) -> FileContent:
    intensities, valid = arrays["intensities"], arrays.get("valid")
    if intensities.ndim not in (2, 3, 4):
        raise InputError(f"'intensities' has shape {intensities.shape}; expected (angle, [channel,] height, width)")
    if valid is not None and valid.shape != intensities.shape:
        raise InputError(f"'valid' has shape {valid.shape} but 'intensities' {intensities.shape}; make them equal")
    if intensities.ndim == 4 and not (intensities.shape[-1] in (3, 4) and intensities.shape[1] > 4):
        intensities = np.moveaxis(intensities, 1, -1)
        valid = None if valid is None else np.moveaxis(valid, 1, -1)
    angles = arrays.get("angles_deg")
    angles_deg = None if angles is None else tuple(float(angle) for angle in np.atleast_1d(angles))
    mask = None if valid is None else valid.astype(bool)
    return FileContent(intensities, stack=intensities.ndim > 2, angles_deg=angles_deg, valid=mask)


def decode_array(data: bytes) -> FileContent:
    try:
        array = np.load(io.BytesIO(data), allow_pickle=False)
    except (ValueError, EOFError) as error:
        raise InputError(f"not a readable npy file ({one_line(error)}); write it again with numpy.save") from None
    return _npz_content({"intensities": array})
