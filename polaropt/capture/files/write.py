"""Pixels and captures to files.

Everything inside polaropt is linear. Values in files are taken as linear too, unless a person says how they are
encoded.
"""

from __future__ import annotations

import math
import struct
import tempfile
import zlib
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import ArrayLike, DTypeLike, NDArray

import polaropt
from polaropt.capture.capture import Capture, planes_last
from polaropt.capture.files.colors import in_srgb, linear_profile
from polaropt.capture.files.exif import CameraFacts
from polaropt.capture.files.opening import AnyPath
from polaropt.capture.mosaic import WHITE_16
from polaropt.capture.validity import FloatImages
from polaropt.errors import InputError
from polaropt.numerics import AnyMask, strips

Pixels = NDArray[Any]


# Deflate is what all readers know; a higher level takes longer and saves nothing on noisy floating point values.
_LEVEL = 1
# Rows that are compressed together, as often in TIFF; set by hand.
_ROWS_PER_STRIP = 64
# Bits of the mantissa of what is told to three digits (standard errors, shares): half a part in a thousand.
_COARSE_BITS = 10
_MANTISSA_BITS = 23


_MAKE, _MODEL, _ASCII = 271, 272, 2
"""Tags of TIFF for the camera, and their type."""
LINEAR_LIGHT = "linear light, white of the photographs is 1"
"""What the values of layers are in."""


def write_tiff(
    path: AnyPath, image: ArrayLike, camera: CameraFacts | None = None, *, note: str = "", unit: str = LINEAR_LIGHT
) -> None:
    """Write an image (h, w) or (h, w, 3) as float32 TIFF, values as they are, compressed without loss.

    Parameters
    ----------
    path : path
    image : array, shape (h, w) or (h, w, 3)
    camera : CameraFacts, optional
    note, unit : str
        As for `tiff_rows`.
    """
    pixels = np.ascontiguousarray(image, dtype=np.float32)
    with _opened(path) as file:
        _pack(file, pixels.shape, pixels.__getitem__, camera, note, unit)


def made_by() -> str:
    """What results say of the program that made them."""
    return f"polaropt {polaropt.__version__}"


def _pack(
    file: BinaryIO,
    shape: tuple[int, ...],
    rows_of: Callable[[slice], NDArray[np.float32]],
    camera: CameraFacts | None,
    note: str,
    unit: str,
) -> None:
    """Pixels (h, w[, channel]), asked for from top to bottom, as a TIFF: deflated after a predictor for floating point.

    A map of a large file into memory would count as memory.
    """
    import tifffile
    from imagecodecs import floatpred_encode, zlib_encode

    def packed() -> Iterator[bytes]:
        # tifffile takes strips that are packed already, or all pixels at once.
        for first in range(0, shape[0], _ROWS_PER_STRIP):
            strip = rows_of(slice(first, min(first + _ROWS_PER_STRIP, shape[0])))
            predicted: Any = floatpred_encode(strip.reshape(-1, shape[1], math.prod(shape[2:])), axis=-2)
            yield bytes(zlib_encode(predicted, level=_LEVEL))

    tifffile.imwrite(
        file,
        packed(),
        shape=shape,
        dtype=np.float32,
        photometric="rgb" if shape[2:] == (3,) else "minisblack",
        metadata=None,
        compression="zlib",
        predictor=3,
        rowsperstrip=_ROWS_PER_STRIP,
        software=made_by(),
        description=f"{note}; {unit}" if note else unit,
        datetime=(camera.taken or None) if camera is not None else None,
        iccprofile=None if camera is None or camera.colors.to_srgb is None else linear_profile(camera.colors.to_srgb),
        extratags=[(tag, _ASCII, 0, text.encode("ascii", "replace"), True) for tag, text in _names_of(camera)],
    )


def _names_of(camera: CameraFacts | None) -> list[tuple[int, str]]:
    named = [] if camera is None else [(_MAKE, camera.make), (_MODEL, camera.model)]
    return [(tag, text) for tag, text in named if text]


def _coarse(values: NDArray[np.float32]) -> NDArray[np.float32]:
    """Values rounded to `_COARSE_BITS`, which compress to a third."""
    dropped = _MANTISSA_BITS - _COARSE_BITS
    bits = np.ascontiguousarray(values).view(np.uint32) + np.uint32(1 << (dropped - 1))
    return (bits >> np.uint32(dropped) << np.uint32(dropped)).view(np.float32)


@contextmanager
def tiff_rows(
    path: AnyPath,
    shape: tuple[int, ...],
    *,
    coarse: bool = False,
    camera: CameraFacts | None = None,
    note: str = "",
    unit: str = LINEAR_LIGHT,
) -> Iterator[Callable[[FloatImages], None]]:
    """File of a linear image as `write_tiff` makes it, some rows at a time, which wait in a temporary file beside it.

    Parameters
    ----------
    path : path
    shape : tuple of int
        Of the image's planes, ([channel,] h, w).
    coarse : bool
        Whether three digits are enough, as of standard errors.
    camera : CameraFacts, optional
        Whose name, date and colours the file carries.
    note : str
        What the file is and how it was made, for its description; in ASCII.
    unit : str
        Of its values, likewise.

    Yields
    ------
    callable
        Takes the next rows of all planes, ([channel,] rows, w).
    """
    *channels, height, width = shape
    with _opened(path) as file, tempfile.TemporaryFile(dir=Path(path).parent) as waiting:

        def write(planes: FloatImages) -> None:
            for rows in strips(planes.shape[-2], planes.size // planes.shape[-2]):
                values = planes_last(np.asarray(planes[..., rows, :], dtype=np.float32))
                waiting.write((_coarse(values) if coarse else values).tobytes())

        yield write
        waiting.seek(0)
        per_row = width * math.prod(channels)

        def rows_of(rows: slice) -> FloatImages:
            return np.frombuffer(waiting.read(4 * (rows.stop - rows.start) * per_row), np.float32)

        _pack(file, (height, width, *channels), rows_of, camera, note, unit)


def write_png_view(
    path: AnyPath, planes: FloatImages, exposure: float = 1.0, camera: CameraFacts | None = None, note: str = ""
) -> None:
    """Write a linear image as 8-bit sRGB PNG to look at, clipped at black and white.

    Parameters
    ----------
    path : path
    planes : ndarray, shape (h, w) or (3, h, w)
    exposure : float
        What it is multiplied by.
    camera : CameraFacts, optional
        Whose EXIF the file carries, and whose colours the values are in.
    note : str
        As for `tiff_rows`.
    """
    *channels, height, width = planes.shape

    def rows_of(rows: slice) -> Pixels:
        seen = planes[..., rows, :]
        pixels = np.empty((seen.shape[-2], width, *channels), dtype=np.uint8)
        for some in strips(len(pixels), width * math.prod(channels)):
            part = planes_last(np.asarray(seen[..., some, :], dtype=np.float32))
            pixels[some] = np.round(255 * encode_srgb(part * np.float32(exposure), camera))
        return pixels

    _write_png(path, (height, width, *channels), np.uint8, rows_of, _of_picture(camera, note))


def write_png(path: AnyPath, pixels: Pixels) -> None:
    """Write 8- or 16-bit pixels (h, w) or (h, w, 3) as PNG, values as they are, which says what made it."""
    _write_png(path, pixels.shape, pixels.dtype, pixels.__getitem__, [])


_SIGNATURE = b"\x89PNG\r\n\x1a\n"
# Where a PNG's first chunk ends, the header's: its signature, and length, name, 13 bytes and check sum.
_AFTER_HEADER = len(_SIGNATURE) + 25
# Types of PNG's pixels by their axes, and its filter that tells a row's differences from the row above.
_GREY_OR_COLOR = {2: 0, 3: 2}
_UP = b"\2"
# Bytes of pixels from which on a PNG is made some rows at a time, and how many; set by hand.
_LARGE_PNG, _ROWS_OF_PNG = 2**24, 16
# sRGB's rendering intent for photographs: perceptual.
_PERCEPTUAL = b"\0"
_Chunks = list[tuple[bytes, bytes]]


def write_picture(path: AnyPath, pixels: Pixels, camera: CameraFacts | None = None, note: str = "") -> None:
    """Write 8-bit pixels in sRGB as PNG to look at, which says so, what made it and how, and what the camera tells."""
    _write_png(path, pixels.shape, pixels.dtype, pixels.__getitem__, _of_picture(camera, note))


def _of_picture(camera: CameraFacts | None, note: str) -> _Chunks:
    chunks = [(b"sRGB", _PERCEPTUAL)]
    if note:
        chunks.append((b"tEXt", b"Description\0" + note.encode("latin-1", "replace")))
    if camera is not None and camera.exif:
        chunks.append((b"eXIf", camera.exif))
    return chunks


def _write_png(
    path: AnyPath, shape: tuple[int, ...], dtype: DTypeLike, rows_of: Callable[[slice], Pixels], chunks: _Chunks
) -> None:
    """Write pixels as PNG with chunks (name, content) behind the header's, beside the one of what made it."""
    told = b"".join(_chunk(*chunk) for chunk in [*chunks, (b"tEXt", b"Software\0" + made_by().encode("latin-1"))])
    if math.prod(shape) * np.dtype(dtype).itemsize > _LARGE_PNG:
        with _opened(path) as file:
            file.writelines(_png_of_rows(shape, np.dtype(dtype), rows_of, told))
        return
    import imagecodecs

    data = bytes(imagecodecs.png_encode(np.ascontiguousarray(rows_of(slice(shape[0])))))
    # One after the other: joined they would be three times as much memory.
    write_bytes(path, data[:_AFTER_HEADER], told, memoryview(data)[_AFTER_HEADER:])


def _png_of_rows(
    shape: tuple[int, ...], dtype: np.dtype[Any], rows_of: Callable[[slice], Pixels], told: bytes
) -> Iterator[bytes]:
    """A PNG in pieces: libraries take all pixels at once and give all of the file, which is twice as much memory.

    Runs of equal bytes alone are looked for: of 24 megapixels of noisy photographs the file is 6 % smaller than
    libpng's and made in a sixth of the time.
    """
    header = (shape[1], shape[0], 8 * dtype.itemsize, _GREY_OR_COLOR[len(shape)], 0, 0, 0)
    yield _SIGNATURE + _chunk(b"IHDR", struct.pack(">IIBBBBB", *header)) + told
    packer = zlib.compressobj(_LEVEL, strategy=zlib.Z_RLE)
    above = np.zeros((1, math.prod(shape[1:]) * dtype.itemsize), dtype=np.uint8)
    for first in range(0, shape[0], _ROWS_OF_PNG):
        pixels = rows_of(slice(first, min(first + _ROWS_OF_PNG, shape[0])))
        rows = np.ascontiguousarray(pixels, dtype.newbyteorder(">")).reshape(len(pixels), -1).view(np.uint8)
        differences = rows - np.concatenate([above, rows[:-1]])
        above = rows[-1:]
        packed = packer.compress(b"".join(_UP + row.tobytes() for row in differences))
        if packed:
            yield _chunk(b"IDAT", packed)
    yield _chunk(b"IDAT", packer.flush())
    yield _chunk(b"IEND", b"")


def _chunk(name: bytes, content: bytes) -> bytes:
    return len(content).to_bytes(4, "big") + name + content + zlib.crc32(name + content).to_bytes(4, "big")


def write_bytes(path: AnyPath, *data: bytes | bytearray | memoryview) -> None:
    """Write a file; InputError with the reason where that is impossible."""
    with _opened(path) as file:
        file.writelines(data)


@contextmanager
def _opened(path: AnyPath) -> Iterator[BinaryIO]:
    """A file to write; InputError with the reason where that is impossible."""
    try:
        with Path(path).open("wb") as file:
            yield file
    except OSError as error:
        raise InputError(f"{path}: cannot be written ({error.strerror}); choose another place") from None


def encode_srgb(linear: NDArray[np.floating[Any]], camera: CameraFacts | None = None) -> NDArray[np.float32]:
    """Linear values 0..1 to sRGB values 0..1 (IEC 61966-2-1), clipped.

    Parameters
    ----------
    linear : ndarray, shape (..., 3) or any for grey
    camera : CameraFacts, optional
        Whose colours they are in; default: sRGB's primaries.
    """
    clipped = np.clip(linear if camera is None else in_srgb(linear, camera.colors.to_srgb), 0, 1).astype(np.float32)
    power = 1.055 * np.power(clipped, np.float32(1 / 2.4)) - 0.055
    return np.asarray(np.where(clipped <= 0.0031308, 12.92 * clipped, power), dtype=np.float32)


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
    angles = np.asarray(capture.angles_deg)
    with _opened(target) as file:
        np.savez_compressed(file, intensities=capture.intensities, angles_deg=angles, valid=capture.valid)


def _write_tiff(capture: Capture, target: Path) -> None:
    import tifffile

    def pages() -> Iterator[FloatImages]:
        for photograph, valid in zip(capture.intensities, capture.mask, strict=True):
            yield planes_last(np.where(valid, photograph, np.maximum(photograph, 1)))

    size = capture.shape[-2:]
    with _opened(target) as file:
        tifffile.imwrite(
            file,
            pages(),
            shape=(len(capture.angles_deg), *size, *capture.shape[:-2]),
            dtype=np.float32,
            photometric="rgb" if capture.color else "minisblack",
            metadata={"angles_deg": list(capture.angles_deg)},
            software=made_by(),
        )


def _in_order(angle: float) -> str:
    """An angle in a name that a shell sorts as the angle: 005, 022.5, 112.5."""
    whole, point, part = f"{angle:g}".partition(".")
    return f"{whole:0>3}{point}{part}" if angle >= 0 else f"{angle:g}"


def _write_pngs(capture: Capture, target: Path) -> tuple[Path, ...]:
    files = tuple(target.with_name(f"{target.stem}_{_in_order(angle)}.png") for angle in capture.angles_deg)
    for name, photograph, valid in zip(files, capture.intensities, capture.mask, strict=True):

        def rows_of(rows: slice, photograph: FloatImages = photograph, valid: AnyMask = valid) -> Pixels:
            seen, trusted = photograph[..., rows, :], valid[..., rows, :]
            pixels = np.empty((*seen.shape[-2:], *capture.shape[:-2]), dtype=np.uint16)
            for some in strips(len(pixels), pixels[0].size):
                levels: Any = np.round(np.clip(seen[..., some, :].astype(np.float64), 0, 1) * WHITE_16)
                # The highest level means clipped.
                levels = np.where(trusted[..., some, :], np.minimum(levels, WHITE_16 - 1), WHITE_16)
                pixels[some] = planes_last(levels)
            return pixels

        _write_png(name, (*capture.shape[-2:], *capture.shape[:-2]), np.uint16, rows_of, [])
    return files
