"""A file of any format to pixels as stored, their encoding, and what a camera wrote about its lens."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import chain
from pathlib import Path

from polaropt.capture.capture import FileContent
from polaropt.capture.files.formats.arrays import declared_array, declared_npz, decode_array, decode_npz
from polaropt.capture.files.formats.camera_raw import CAMERA_RAW, decode_camera_raw
from polaropt.capture.files.formats.heif import FIRST_BYTES, declared_heif, decode_heif
from polaropt.capture.files.formats.pictures import declared_jpeg, declared_png, decode_jpeg, decode_png
from polaropt.capture.files.formats.tiff import declared_tiff, decode_tiff
from polaropt.capture.files.limits import MAX_PIXELS, Declared, check_declared, complaints, most_bytes
from polaropt.capture.files.opening import AnyPath, bytes_of
from polaropt.errors import InputError, one_line
from solvers.entry_points import READERS, PluginWarning, loaded, plugged


def read_file(path: AnyPath, max_pixels: int = MAX_PIXELS) -> FileContent:
    """Read a PNG, TIFF (one or several pages), JPEG, HEIC, npz or npy file, told apart by their first bytes.

    Raw files of photographers' cameras are known by their names (`CAMERA_RAW`) and come with one pixel per cell of
    their sensor's pattern: nothing is interpolated, scaled to its own brightest value or balanced.

    An alpha channel is dropped: it holds no light. Grey pictures stored as RGB keep their three channels.

    Parameters
    ----------
    path : path
    max_pixels : int
        Pixels that the file may hold, all its photographs together. Its header is asked before anything is decoded.

    Raises
    ------
    InputError
        Missing, a folder, unreadable, truncated, too large, of another format, or npz without `intensities`.
    """
    data = bytes_of(Path(path), most_bytes(max_pixels))
    try:
        with complaints():
            if Path(path).suffix.lower() in CAMERA_RAW:
                return decode_camera_raw(data, max_pixels)
            return decode(data, max_pixels)
    except InputError as error:
        raise InputError(f"{path}: {error}") from None
    except Exception as error:  # decoders raise whatever they like on damaged data
        raise InputError(
            f"{path}: cannot be read as an image ({one_line(error)}); it may be damaged or incomplete, copy it again"
        ) from None


def decode(data: bytes, max_pixels: int = MAX_PIXELS) -> FileContent:
    """Pixels of a file of a format in `DECODERS`.

    Damaged data raise whatever the decoder raises.
    """
    if not data:
        raise InputError("the file is empty; copy it again")
    # Those of other packages are imported where none of ours knows the file.
    for decoder in chain(DECODERS, _plugged_decoders()):
        if not data.startswith(decoder.first_bytes):
            continue
        if decoder.declared is not None:
            check_declared(decoder.declared(data), len(data), max_pixels)
        return decoder.decode(data)
    others = tuple(_plugged_decoders())
    *names, last = (decoder.name for decoder in (*DECODERS, *others))
    raise InputError(f"not a {', '.join(names)} or {last} file; convert it to one of these")


@dataclass(frozen=True)
class Decoder:
    """A file format: its name, what its files may begin with, and bytes to pixels.

    `declared`, where there is one, tells from the header what will be decoded: a file that asks for too much is refused
    before it is.
    """

    name: str
    first_bytes: tuple[bytes, ...]
    decode: Callable[[bytes], FileContent]
    declared: Callable[[bytes], Declared] | None = None


DECODERS = (
    Decoder("PNG", (b"\x89PNG",), decode_png, declared_png),
    Decoder("TIFF", (b"II*\0", b"MM\0*", b"II+\0", b"MM\0+"), decode_tiff, declared_tiff),
    Decoder("JPEG", (b"\xff\xd8",), decode_jpeg, declared_jpeg),
    Decoder("HEIC", FIRST_BYTES, decode_heif, declared_heif),
    Decoder("npz", (b"PK",), decode_npz, declared_npz),
    Decoder("npy", (b"\x93NUMPY",), decode_array, declared_array),
)


def _plugged_decoders() -> Iterator[Decoder]:
    """Formats that other packages plug in, each imported when it is asked for."""
    for name in plugged(READERS):
        decoder = loaded(READERS, name)
        if isinstance(decoder, Decoder):
            yield decoder
        elif decoder is not None:
            told = f"the reader {name!r} of another package is no Decoder and cannot be used"
            warnings.warn(told, PluginWarning, stacklevel=2)
