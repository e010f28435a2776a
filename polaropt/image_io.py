"""Files to pixels and pixels to files; the one place that knows gamma.

Everything inside polaropt is linear. Values in files are taken as linear too, unless a person says how they are
encoded.
"""

from __future__ import annotations

import io
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from polaropt.decoding import FileContent, decode, one_line
from polaropt.errors import InputError

AnyPath = str | PathLike[str]
Pixels = NDArray[Any]


def read_file(path: AnyPath) -> FileContent:
    """Read a PNG, TIFF (one or several pages), JPEG or npz file, told apart by their first bytes.

    An alpha channel is dropped: it holds no light. Grey pictures stored as RGB keep their three channels.

    Raises
    ------
    InputError
        Missing, a folder, unreadable, truncated, of another format, or npz without `intensities`.
    """
    data = _bytes_of(Path(path))
    try:
        return decode(data)
    except InputError as error:
        raise InputError(f"{path}: {error}") from None
    except Exception as error:  # decoders raise whatever they like on damaged data
        raise InputError(
            f"{path}: cannot be read as an image ({one_line(error)}); it may be damaged or incomplete, copy it again"
        ) from None


def write_tiff(path: AnyPath, image: ArrayLike) -> None:
    """Write a linear image (h, w) or (h, w, 3) as float32 TIFF, values as they are."""
    import tifffile

    pixels = np.ascontiguousarray(image, dtype=np.float32)
    kind = "rgb" if pixels.ndim == 3 and pixels.shape[-1] == 3 else "minisblack"
    buffer = io.BytesIO()
    tifffile.imwrite(buffer, pixels, photometric=kind, metadata=None)
    write_bytes(path, buffer.getvalue())


def write_png_view(path: AnyPath, image: ArrayLike) -> None:
    """Write a linear image (h, w) or (h, w, 3) as 8-bit sRGB PNG to look at, clipped at black and white."""
    encoded = encode_srgb(np.asarray(image, dtype=np.float32))
    write_png(path, np.round(255 * encoded).astype(np.uint8))


def write_png(path: AnyPath, pixels: Pixels) -> None:
    """Write 8- or 16-bit pixels (h, w) or (h, w, 3) as PNG, values as they are."""
    import imagecodecs

    write_bytes(path, bytes(imagecodecs.png_encode(np.ascontiguousarray(pixels))))


def write_bytes(path: AnyPath, data: bytes) -> None:
    """Write a file; InputError with the reason where that is impossible."""
    try:
        Path(path).write_bytes(data)
    except OSError as error:
        raise InputError(f"{path}: cannot be written ({error.strerror}); choose another place") from None


def encode_srgb(linear: NDArray[np.floating[Any]]) -> NDArray[np.float32]:
    """Linear values 0..1 to sRGB values 0..1 (IEC 61966-2-1), clipped."""
    clipped = np.clip(linear, 0, 1).astype(np.float32)
    power = 1.055 * np.power(clipped, np.float32(1 / 2.4)) - 0.055
    return np.asarray(np.where(clipped <= 0.0031308, 12.92 * clipped, power), dtype=np.float32)


def parse_gamma(gamma: float | str | None) -> float | str | None:
    """Check an encoding: None (linear), "srgb" or an exponent such as 2.2."""
    if gamma is None or (isinstance(gamma, str) and gamma.strip().lower() == "srgb"):
        return None if gamma is None else "srgb"
    try:
        exponent = float(gamma)
    except (TypeError, ValueError):
        exponent = np.nan
    if not 0.1 <= exponent <= 10:
        raise InputError(f'gamma {gamma!r} is no encoding; give "srgb" or an exponent from 0.1 to 10, such as 2.2')
    return exponent


def linearize(encoded: NDArray[np.float32], gamma: float | str | None) -> NDArray[np.float32]:
    """Encoded values (white = 1) to linear ones, odd about 0 so that noise around black stays noise.

    Parameters
    ----------
    encoded : ndarray of float32
    gamma : None, "srgb" or float
        None: they are linear already.
    """
    if gamma is None:
        return encoded
    size = np.abs(encoded)
    if gamma == "srgb":
        linear = np.where(size <= 0.04045, size / 12.92, ((size + 0.055) / 1.055) ** 2.4)
    else:
        linear = size ** float(gamma)
    return np.asarray(np.copysign(linear, encoded), dtype=np.float32)


def _bytes_of(path: Path) -> bytes:
    try:
        return path.read_bytes()
    except FileNotFoundError:
        raise InputError(f"{path}: no such file; check the name") from None
    except IsADirectoryError:
        raise InputError(f"{path}: is a folder; give the image files in it") from None
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or one_line(error)
        raise InputError(f"{path}: cannot be opened ({reason})") from None
