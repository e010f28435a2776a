"""The bytes of a file to pixels as stored, their encoding, and what a camera wrote about its lens."""

from __future__ import annotations

import io
import logging
import zipfile
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from polaropt.capture.capture import EncodingHint, FileContent
from polaropt.capture.files.exif import BASE_ISO, CameraFacts, facts_of_picture, facts_of_tags, profile_name
from polaropt.capture.files.focal_length import exif_of_names, exif_of_picture, focal_from_exif
from polaropt.capture.files.jpeg import jpeg_facts
from polaropt.errors import InputError
from solvers.entry_points import READERS, loaded, plugged

AnyPath = str | PathLike[str]

GAMMA_RANGE = (0.1, 10.0)
"""Exponents of encodings that can be given or measured: usual ones are 1.8 to 2.6; set by hand."""


def read_file(path: AnyPath) -> FileContent:
    """Read a PNG, TIFF (one or several pages), JPEG, npz or npy file, told apart by their first bytes.

    Raw files of photographers' cameras are known by their names (`CAMERA_RAW`) and come with one pixel per Bayer cell,
    half as wide: nothing is interpolated, scaled to its own brightest value or balanced.

    An alpha channel is dropped: it holds no light. Grey pictures stored as RGB keep their three channels.

    Raises
    ------
    InputError
        Missing, a folder, unreadable, truncated, of another format, or npz without `intensities`.
    """
    data = _bytes_of(Path(path))
    try:
        return _decode_camera_raw(data) if Path(path).suffix.lower() in CAMERA_RAW else decode(data)
    except InputError as error:
        raise InputError(f"{path}: {error}") from None
    except Exception as error:  # decoders raise whatever they like on damaged data
        raise InputError(
            f"{path}: cannot be read as an image ({one_line(error)}); it may be damaged or incomplete, copy it again"
        ) from None


def parse_gamma(gamma: float | str | None) -> float | str | None:
    """Check an encoding: None (linear), "srgb" or an exponent such as 2.2."""
    if gamma is None or (isinstance(gamma, str) and gamma.strip().lower() == "srgb"):
        return None if gamma is None else "srgb"
    try:
        exponent = float(gamma)
    except (TypeError, ValueError):
        exponent = np.nan
    if not GAMMA_RANGE[0] <= exponent <= GAMMA_RANGE[1]:
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


Pixels = NDArray[Any]

_JPEG_END = b"\xff\xd9"


def decode(data: bytes) -> FileContent:
    """Pixels of a file of a format in `DECODERS`.

    Damaged data raise whatever the decoder raises.
    """
    if not data:
        raise InputError("the file is empty; copy it again")
    for decoder in DECODERS:
        if data.startswith(decoder.first_bytes):
            return decoder.decode(data)
    others = _plugged_decoders()
    for decoder in others:
        if data.startswith(decoder.first_bytes):
            return decoder.decode(data)
    *names, last = (decoder.name for decoder in (*DECODERS, *others))
    raise InputError(f"not a {', '.join(names)} or {last} file; convert it to one of these")


def _picture(pixels: Pixels, data: bytes, hint: EncodingHint) -> FileContent:
    focal = focal_from_exif(exif_of_picture(data), (pixels.shape[1], pixels.shape[0]))
    jpeg = jpeg_facts(data) if hint is EncodingHint.JPEG else None
    camera = facts_of_picture(data)
    return FileContent(without_alpha(pixels), encoding_hint=hint, focal_px=focal, camera=camera, jpeg=jpeg)


def without_alpha(pixels: Pixels) -> Pixels:
    """Drop the last of 2 or 4 channels (..., channel); a single channel becomes none."""
    if pixels.ndim < 3:
        return pixels
    channels = pixels.shape[-1]
    if channels in (2, 4):
        pixels = pixels[..., : channels - 1]
    return pixels[..., 0] if pixels.shape[-1] == 1 else pixels


def _png_hint(data: bytes) -> EncodingHint:
    head = data[:4096]
    if b"sRGB" in head:
        return EncodingHint.SRGB_PNG
    return EncodingHint.SHALLOW_PNG if data[24:25] == b"\x08" else EncodingHint.NONE


def _decode_png(data: bytes) -> FileContent:
    import imagecodecs

    return _picture(imagecodecs.png_decode(data), data, _png_hint(data))


def _decode_jpeg(data: bytes) -> FileContent:
    import imagecodecs

    if _JPEG_END not in data[_jpeg_scan(data) :]:
        raise InputError("the JPEG ends too early; it is incomplete, copy it again")
    return _picture(imagecodecs.jpeg8_decode(data), data, EncodingHint.JPEG)


def _jpeg_scan(data: bytes) -> int:
    """Where the picture's own data begin: after all header segments, whose thumbnail has an end mark of its own."""
    position = 2
    while position + 4 <= len(data) and data[position] == 0xFF and data[position + 1] != 0xDA:
        position += 2 + int.from_bytes(data[position + 2 : position + 4], "big")
    return position


def _decode_tiff(data: bytes) -> FileContent:
    import tifffile

    with _complaints_of_tifffile() as complaints, tifffile.TiffFile(io.BytesIO(data)) as tiff:
        series = [s for s in tiff.series if not s.keyframe.is_reduced] or list(tiff.series)
        arrays = [_channels_last(one.asarray(), one.axes) for one in series]
        metadata = (tiff.shaped_metadata or ({},))[0]
        tags = {tag.code: tag.value for tag in tiff.pages.first.tags}
        profile = tags.get(_TIFF_PROFILE)
        named = tags.get(_TIFF_EXIF)
        exif = exif_of_names(named)
        colors = profile_name(profile if isinstance(profile, bytes) else None)
        camera = facts_of_tags(tags, named if isinstance(named, dict) else None, colors)
    if not arrays or any("page offset" in text or "first page" in text or "corrupted" in text for text in complaints):
        raise InputError("the TIFF ends too early; it is incomplete, copy it again")
    angles = metadata.get("angles_deg")
    angles_deg = tuple(float(angle) for angle in angles) if angles else None
    pages = [page for array, stack in arrays for page in (array if stack else array[None])]
    if len({page.shape for page in pages}) > 1:
        sizes = ", ".join(sorted({f"{page.shape[1]}x{page.shape[0]}" for page in pages}))
        raise InputError(f"its pages differ in size ({sizes}); all photographs must have the same")
    focal = focal_from_exif(exif, (pages[0].shape[1], pages[0].shape[0]))
    if len(pages) == 1:
        return FileContent(pages[0], angles_deg=angles_deg, focal_px=focal, camera=camera)
    return FileContent(np.stack(pages), stack=True, angles_deg=angles_deg, focal_px=focal, camera=camera)


_TIFF_EXIF, _TIFF_PROFILE = 0x8769, 0x8773
"""Tags of TIFF: the directory of EXIF's tags, and the colour profile."""


def _channels_last(pixels: Pixels, axes: str) -> tuple[Pixels, bool]:
    """Pages (k, h, w[, channel]) or one page (h, w[, channel]); and whether there is a page axis."""
    if "S" in axes:
        pixels = without_alpha(np.moveaxis(pixels, axes.index("S"), -1))
    leading = [axis for axis in axes if axis not in "YXS"]
    if not leading:
        return pixels, False
    height_at = len(leading)
    return pixels.reshape(-1, *pixels.shape[height_at:]), True


@contextmanager
def _complaints_of_tifffile() -> Iterator[list[str]]:
    """Collect what tifffile would print about a damaged file."""
    logger = logging.getLogger("tifffile")
    complaints: list[str] = []

    class Collector(logging.Handler):
        def emit(self, record: logging.LogRecord) -> None:
            complaints.append(record.getMessage())

    collector, propagated = Collector(), logger.propagate
    others = list(logger.handlers)
    logger.handlers, logger.propagate = [collector], False
    try:
        yield complaints
    finally:
        logger.handlers, logger.propagate = others, propagated


def _decode_npz(data: bytes) -> FileContent:
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


CAMERA_RAW = (".arw", ".cr2", ".cr3", ".dng", ".nef", ".orf", ".pef", ".raf", ".rw2")
"""Names that raw files of photographers' cameras end in."""
_FLIPS = {0: 1, 3: 3, 5: 8, 6: 6}
"""Orientations of EXIF by the numbers that rawpy has for them."""


def _decode_camera_raw(data: bytes) -> FileContent:
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


def _decode_npy(data: bytes) -> FileContent:
    try:
        array = np.load(io.BytesIO(data), allow_pickle=False)
    except (ValueError, EOFError) as error:
        raise InputError(f"not a readable npy file ({one_line(error)}); write it again with numpy.save") from None
    return _npz_content({"intensities": array})


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


def read_headless(path: AnyPath, shape: tuple[int, int], pixel_format: str | None = None) -> FileContent:
    """Read a raw mosaic that a camera wrote without a header.

    Parameters
    ----------
    path : path
    shape : (int, int)
        Height and width in pixels.
    pixel_format : str, optional
        One of `PIXEL_FORMATS`. Default: 8 or 16 bits, by the file's size.

    Raises
    ------
    InputError
        A size that does not fit the shape, or a format that does not exist or must be named.
    """
    data = _bytes_of(Path(path))
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


def one_line(error: Exception) -> str:
    """An error's own words, on one line."""
    words = " ".join(str(error).split()) or type(error).__name__
    return words if len(words) <= 120 else words[:117] + "..."


@dataclass(frozen=True)
class Decoder:
    """A file format: its name, what its files may begin with, and bytes to pixels."""

    name: str
    first_bytes: tuple[bytes, ...]
    decode: Callable[[bytes], FileContent]


DECODERS = (
    Decoder("PNG", (b"\x89PNG",), _decode_png),
    Decoder("TIFF", (b"II*\0", b"MM\0*", b"II+\0", b"MM\0+"), _decode_tiff),
    Decoder("JPEG", (b"\xff\xd8",), _decode_jpeg),
    Decoder("npz", (b"PK",), _decode_npz),
    Decoder("npy", (b"\x93NUMPY",), _decode_npy),
)


def _plugged_decoders() -> tuple[Decoder, ...]:
    """Formats that other packages plug in, imported where this package knows none."""
    found = (loaded(READERS, name) for name in plugged(READERS))
    return tuple(decoder for decoder in found if decoder is not None)
