"""Raw mosaics in files without a header."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from polaropt.capture.capture import FileContent
from polaropt.capture.files.limits import MAX_PIXELS, most_bytes
from polaropt.capture.files.opening import AnyPath, bytes_of
from polaropt.errors import InputError

Pixels = NDArray[Any]


@dataclass(frozen=True)
class PixelFormat:
    """How a camera packs raw values, by its name in the GenICam Pixel Format Naming Convention.

    Attributes
    ----------
    bits : int
        Depth of a value.
    group : (int, int)
        Values that are packed together, and the bytes that they take.
    unpack : callable
        From bytes (n, bytes of a group) to values (n, values of a group).
    """

    bits: int
    group: tuple[int, int]
    unpack: Callable[[NDArray[np.uint16]], NDArray[np.uint16]]

    def n_bytes(self, shape: tuple[int, int]) -> int:
        """Bytes of a mosaic of this height and width."""
        together, n_bytes = self.group
        return -(-shape[0] * shape[1] // together) * n_bytes

    def pixels(self, data: bytes, shape: tuple[int, int]) -> Pixels:
        """Values (h, w) of so many bytes."""
        parts = np.frombuffer(data, dtype=np.uint8).reshape(-1, self.group[1]).astype(np.uint16)
        values = self.unpack(parts).ravel()[: shape[0] * shape[1]].reshape(shape)
        return values.astype(np.uint8) if self.bits == 8 else values


def _little_endian(parts: NDArray[np.uint16]) -> NDArray[np.uint16]:
    return np.asarray(parts[:, :1] | (parts[:, 1:2] << 8), dtype=np.uint16)


def _mono_10p(parts: NDArray[np.uint16]) -> NDArray[np.uint16]:
    return np.stack([(parts[:, i] >> 2 * i) | ((parts[:, i + 1] << 8 - 2 * i) & 0x3FF) for i in range(4)], axis=1)


def _mono_12p(parts: NDArray[np.uint16]) -> NDArray[np.uint16]:
    first, middle, last = parts.T
    return np.stack([first | ((middle & 0xF) << 8), (middle >> 4) | (last << 4)], axis=1)


def _mono_12_packed(parts: NDArray[np.uint16]) -> NDArray[np.uint16]:
    first, middle, last = parts.T
    return np.stack([(first << 4) | (middle & 0xF), (last << 4) | (middle >> 4)], axis=1)


PIXEL_FORMATS = {
    "Mono8": PixelFormat(8, (1, 1), lambda parts: parts),
    "Mono10": PixelFormat(10, (1, 2), _little_endian),
    "Mono12": PixelFormat(12, (1, 2), _little_endian),
    "Mono16": PixelFormat(16, (1, 2), _little_endian),
    "Mono10p": PixelFormat(10, (4, 5), _mono_10p),
    "Mono12p": PixelFormat(12, (2, 3), _mono_12p),
    "Mono12Packed": PixelFormat(12, (2, 3), _mono_12_packed),
}
"""Formats of files without a header. Mono12Packed is GigE Vision's, whose middle byte holds the low bits of both."""
_BY_DEPTH = {1.0: "Mono8", 2.0: "Mono16"}
"""What bytes per pixel say of a format where none is named; packed ones are two, and must be named."""


def read_headless(
    path: AnyPath, shape: tuple[int, int], pixel_format: str | None = None, max_pixels: int = MAX_PIXELS
) -> FileContent:
    """Read a raw mosaic that a camera wrote without a header.

    Parameters
    ----------
    path : path
    shape : (int, int)
        Height and width in pixels.
    pixel_format : str, optional
        One of `PIXEL_FORMATS`. Default: 8 or 16 bits, by the file's size.
    max_pixels : int
        Pixels that the file may hold.

    Raises
    ------
    InputError
        A size that does not fit the shape, or a format that does not exist or must be named.
    """
    data = bytes_of(Path(path), most_bytes(max_pixels))
    packing, name = _packing_of(path, len(data), shape, pixel_format)
    height, width = shape
    expected = packing.n_bytes(shape)
    if len(data) != expected:
        raise InputError(
            f"{path}: has {len(data)} bytes, but {width}x{height} pixels in {name} take {expected}; "
            "correct the shape or the pixel format"
        )
    return FileContent(packing.pixels(data, shape), bits=packing.bits)


def headless_frames(
    path: AnyPath, shape: Sequence[int], pixel_format: str | None = None
) -> tuple[int, Callable[[int], Pixels], int]:
    """Raw mosaics that a camera wrote one after another into a file without a header.

    Parameters
    ----------
    path, shape, pixel_format
        As of `read_headless`; the format must be named where there are several frames.

    Returns
    -------
    int
        Number of frames.
    callable
        From the place of a frame to its pixels (h, w).
    int
        Their depth in bits.

    Raises
    ------
    InputError
        As `read_headless`; a size that is no whole number of frames.
    """
    height, width = (int(side) for side in shape)
    try:
        size = Path(path).stat().st_size
    except OSError as error:
        raise InputError(f"{path}: cannot be opened ({error.strerror})") from None
    packing, name = _packing_of(path, size, (height, width), pixel_format)
    of_frame = packing.n_bytes((height, width))
    if size == 0 or size % of_frame:
        raise InputError(
            f"{path}: has {size} bytes, no whole number of frames of {of_frame} ({width}x{height} pixels in {name}); "
            "correct the shape or the pixel format"
        )

    def read(i: int) -> Pixels:
        data = np.fromfile(path, dtype=np.uint8, count=of_frame, offset=i * of_frame)
        return packing.pixels(data.tobytes(), (height, width))

    return size // of_frame, read, packing.bits


def _packing_of(path: AnyPath, size: int, shape: tuple[int, int], pixel_format: str | None) -> tuple[PixelFormat, str]:
    """How a file of so many bytes is packed, and what that is called."""
    height, width = shape
    if pixel_format is None:
        pixel_format = _BY_DEPTH.get(size / (height * width))
        if pixel_format is None:
            raise InputError(
                f"{path}: has {size} bytes, {size / (height * width):.4g} a pixel of {width}x{height}; "
                f"correct the shape, or name the pixel format: {', '.join(PIXEL_FORMATS)}"
            )
    packing = PIXEL_FORMATS.get(pixel_format)
    if packing is None:
        raise InputError(f"pixel format {pixel_format!r} does not exist; choose one of {', '.join(PIXEL_FORMATS)}")
    return packing, pixel_format
