"""numpy's files: npz, and npy of one array."""

from __future__ import annotations

import io
import math
import zipfile
import zlib
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from polaropt.capture.capture import FileContent
from polaropt.capture.files.limits import Declared, declared
from polaropt.errors import InputError, in_one_line, one_line

Pixels = NDArray[Any]


_HEADERS: dict[tuple[int, int], Callable[[IO[bytes]], tuple[tuple[int, ...], bool, np.dtype[Any]]]] = {
    (1, 0): np.lib.format.read_array_header_1_0,
    (2, 0): np.lib.format.read_array_header_2_0,
}
_NAMES = ("intensities", "valid", "angles_deg")
"""Arrays of an npz that are read; all others are left alone."""
_AS_NUMPY_DOES = (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED)
_DAMAGED = (zipfile.BadZipFile, zlib.error, ValueError, EOFError, OSError, NotImplementedError, RuntimeError)


def declared_npz(data: bytes) -> Declared:
    """What the headers of an npz's arrays say."""
    with _archive(data) as archive:
        found = {}
        for name, member in _members(archive).items():
            with archive.open(member) as file:
                found[name] = _declared_array(file, member.file_size, _NPZ_ASKED)
    if "intensities" not in found:
        return Declared(0, 0)  # it is refused for that
    return Declared(found["intensities"].pixels, sum(of_array.n_bytes for of_array in found.values()))


def decode_npz(data: bytes) -> FileContent:
    with _archive(data) as archive:
        names = archive.namelist()
        arrays = {name: _array(archive, member) for name, member in _members(archive).items()}
    if "intensities" not in arrays:
        held = ", ".join(sorted(name.removesuffix(".npy") for name in names)) or "nothing"
        raise InputError(
            f"holds {in_one_line(held, _LONGEST_NAMES)} but no array 'intensities' of shape "
            "(angle, [channel,] height, width)"
        )
    return _npz_content(arrays)


_LONGEST_NAMES = 120
"""Characters of a list of names that are told; set by hand."""
_NPZ_ASKED = "not a readable npz file ({}); write it again with numpy.savez"


@contextmanager
def _archive(data: bytes) -> Iterator[zipfile.ZipFile]:
    """A zip file; InputError for one that is damaged."""
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            yield archive
    except InputError:
        raise
    except _DAMAGED as error:
        raise InputError(_NPZ_ASKED.format(one_line(error))) from None


def _members(archive: zipfile.ZipFile) -> dict[str, zipfile.ZipInfo]:
    """Those of the arrays that are read."""
    found = {name: archive.NameToInfo.get(f"{name}.npy") for name in _NAMES}
    members = {name: member for name, member in found.items() if member is not None}
    if any(member.compress_type not in _AS_NUMPY_DOES for member in members.values()):
        raise InputError(_NPZ_ASKED.format("compressed as numpy does not"))
    return members


def _array(archive: zipfile.ZipFile, member: zipfile.ZipInfo) -> Pixels:
    with archive.open(member) as file:
        return np.asarray(np.lib.format.read_array(file, allow_pickle=False))


def _declared_array(file: IO[bytes], n_bytes: int, otherwise: str) -> Declared:
    """What the header of an array in a file of so many bytes says; InputError where it does not fit them."""
    version = np.lib.format.read_magic(file)
    if version not in _HEADERS:
        raise InputError(otherwise.format(f"version {version[0]}.{version[1]} of the format is not known"))
    shape, _, dtype = _HEADERS[version](file)
    if dtype.hasobject:
        raise InputError(otherwise.format("it holds objects, not numbers"))
    if min(shape, default=0) < 0 or file.tell() + math.prod(shape) * dtype.itemsize != n_bytes:
        raise InputError(otherwise.format(f"its size is not that of an array of shape {shape}"))
    return declared(shape, dtype.itemsize)


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


_ARRAY_ASKED = "not a readable npy file ({}); write it again with numpy.save"


def declared_array(data: bytes) -> Declared:
    """What the header of an npy file says."""
    try:
        return _declared_array(io.BytesIO(data), len(data), _ARRAY_ASKED)
    except InputError:
        raise
    except (ValueError, EOFError) as error:
        raise InputError(_ARRAY_ASKED.format(one_line(error))) from None


def decode_array(data: bytes) -> FileContent:
    try:
        array = np.load(io.BytesIO(data), allow_pickle=False)
    except (ValueError, EOFError) as error:
        raise InputError(_ARRAY_ASKED.format(one_line(error))) from None
    content = _npz_content({"intensities": array})
    # No photograph is three pixels wide.
    in_color = array.ndim == 3 and array.shape[-1] == 3 < min(array.shape[:2])
    return replace(content, stack=False) if in_color else content
