"""Raw mosaics one after another: a stack, a file of many frames, or numbered files."""

from __future__ import annotations

import os
import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from polaropt.capture import MAX_PIXELS, headless_frames, read_file, read_headless, tiff_frames
from polaropt.errors import InputError, one_line

_FRAMES = (".png", ".tif", ".tiff", ".npy")
_HEADLESS = (".raw", ".bin")

Mosaic = NDArray[Any]


@dataclass(frozen=True)
class Frames:
    """Frames of a sequence, read when they are asked for.

    Attributes
    ----------
    number : int
    read : callable
        From the place of a frame to its mosaic (h, w), as stored.
    bits : int or None
        Depth of its integers, where it is known to be less than that of their type.
    name : str
        Of the whole.
    missing : tuple of int
        Numbers that no file has, between those of the files.
    """

    number: int
    read: Callable[[int], Mosaic]
    bits: int | None
    name: str
    missing: tuple[int, ...] = ()

    def __iter__(self) -> Iterator[Mosaic]:
        return (self.read(i) for i in range(self.number))

    def tried(self) -> Iterator[Mosaic | InputError]:
        """Frames; in the place of one that cannot be read, why."""
        for i in range(self.number):
            try:
                yield self.read(i)
            except InputError as error:
                yield error


def open_frames(
    sources: Sequence[str],
    shape: Sequence[int] | None = None,
    pixel_format: str | None = None,
    max_pixels: int = MAX_PIXELS,
) -> Frames:
    """Open a TIFF stack, an npy array (frame, h, w), a raw file of many frames, a folder or numbered files.

    Parameters
    ----------
    sources : sequence of str
        One of these; or files in the order of the frames.
    shape : (int, int), optional
        Height and width in pixels of frames without a header.
    pixel_format : str, optional
        How these are packed.
    max_pixels : int
        Pixels that a frame may have.

    Raises
    ------
    InputError
        There are no frames, or they cannot be read.
    """
    if len(sources) == 1:
        path = Path(sources[0])
        if os.path.isdir(path):
            return _of_files(_in_folder(path, shape is not None), shape, pixel_format, str(path), max_pixels)
        if not os.path.exists(path):
            raise InputError(f"{path}: no such file or folder; check the name")
        if shape is not None:
            number, read, bits = headless_frames(path, shape, pixel_format)
            return Frames(number, read, bits, str(path))
        if path.suffix.lower() == ".npy":
            return _of_array(path)
        if path.suffix.lower() in (".tif", ".tiff"):
            return _of_tiff(path, max_pixels)
        raise InputError(f"{path}: is one picture; give a folder of frames, a stack (TIFF, npy), or --shape")
    return _of_files([Path(name) for name in sources], shape, pixel_format, sources[0], max_pixels)


def _in_folder(folder: Path, headless: bool) -> list[Path]:
    """Frames in the order of the numbers in their names."""
    known = _HEADLESS if headless else _FRAMES
    files = [path for path in folder.iterdir() if path.suffix.lower() in known and not path.name.startswith(".")]
    if not files:
        raise InputError(f"{folder}: holds no frames ({', '.join(known)}); give the folder of the mosaics")
    suffixes = sorted({path.suffix.lower() for path in files})
    if len(suffixes) > 1:
        raise InputError(f"{folder}: holds {' and '.join(suffixes)} files; name those that are frames")
    return sorted(files, key=lambda path: [int(part) if part.isdigit() else part for part in _parts(path.name)])


def numbers_missing(files: Sequence[Path]) -> tuple[int, ...]:
    """Numbers between those of files whose names differ in one number alone; none of others."""
    names = [_parts(path.name) for path in files]
    apart = [k for k, parts in enumerate(zip(*names, strict=False)) if len(set(parts)) > 1]
    if len({len(name) for name in names}) > 1 or len(apart) != 1 or not names[0][apart[0]].isdigit():
        return ()
    numbers = {int(name[apart[0]]) for name in names}
    return tuple(sorted(set(range(min(numbers), max(numbers))) - numbers))


def _parts(name: str) -> list[str]:
    """Text and numbers in turn, so that 10 comes after 9."""
    return re.split(r"(\d+)", name)


def _of_files(
    files: list[Path], shape: Sequence[int] | None, pixel_format: str | None, name: str, max_pixels: int
) -> Frames:
    def content(i: int) -> Any:
        if shape is not None:
            height, width = (int(side) for side in shape)
            return read_headless(files[i], (height, width), pixel_format, max_pixels)
        return read_file(files[i], max_pixels)

    first = content(0)
    if first.stack:
        raise InputError(f"{files[0]}: holds several pictures; give a stack alone, or one mosaic a file")

    def read(i: int) -> Mosaic:
        pixels: Mosaic = content(i).pixels
        if pixels.shape != first.pixels.shape or pixels.dtype != first.pixels.dtype:
            raise InputError(f"{files[i]}: differs from {files[0]} in size or depth; give frames of one camera")
        return pixels

    return Frames(len(files), read, first.bits, name, numbers_missing(files))


def _of_array(path: Path) -> Frames:
    try:
        array = np.load(path, mmap_mode="r", allow_pickle=False)
    except (ValueError, OSError, EOFError, OverflowError) as error:
        raise InputError(f"{path}: cannot be read ({one_line(error)}); write it with numpy.save") from None
    if not isinstance(array, np.ndarray):
        raise InputError(f"{path}: holds several arrays; write one with numpy.save")
    if array.ndim != 3:
        raise InputError(f"{path}: holds an array of shape {array.shape}; give (frame, height, width)")
    if not array.size:
        raise InputError(f"{path}: holds no frames")
    return Frames(len(array), lambda i: np.array(array[i]), None, str(path))


def _of_tiff(path: Path, max_pixels: int) -> Frames:
    number, read = tiff_frames(path, max_pixels)
    return Frames(number, read, None, str(path))
