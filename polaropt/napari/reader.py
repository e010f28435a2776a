"""What napari opens: photographs taken through a polarizer, a raw mosaic, and folders that a separation wrote."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from itertools import takewhile
from pathlib import Path

import numpy as np

from polaropt.capture import planes_first, read_capture, read_file
from polaropt.errors import InputError
from polaropt.napari.layers import Image, LayerData, layers_of_capture, maps_of_errors, view_of_layer
from polaropt.reporting import LAYERS

Paths = str | Sequence[str]
_REPORT = "report.json"
_ERRORS = (*(f"{layer}_error" for layer in LAYERS), "reflection_known")
_OF_ANGLES = "_- 0123456789"
"""What the names of four photographs have before their angles."""


def reader_of(path: Paths) -> Callable[[Paths], list[LayerData]] | None:
    """The reader of these paths, None where they are nothing for polaropt.

    Several files are the photographs of one capture, at 0, 45, 90 and 135 degrees where they are four and nothing in
    them tells other angles. A single one that is no mosaic and no stack is left to other readers.

    Parameters
    ----------
    path : str or sequence of str
        A file or folder, or the files of one stack.

    Returns
    -------
    callable or None
        Takes the paths, and gives layer data of npe2.

    Raises
    ------
    InputError
        Several files that are no capture: one line, which napari shows.
    """
    files = [Path(path)] if isinstance(path, str) else [Path(one) for one in path]
    if len(files) == 1 and os.path.isdir(files[0]):
        folder = files[0]
        return (lambda _: layers_of_folder(folder)) if _is_result(folder) else None
    try:
        capture = read_capture(files if len(files) > 1 else files[0])
    except InputError:
        if len(files) > 1:
            raise
        return None
    return lambda _: layers_of_capture(capture, _name(files))


def _name(files: Sequence[Path]) -> str:
    """What the files' names have in common."""
    stems = [path.stem for path in files]
    alike = (len(set(letters)) == 1 for letters in zip(*stems, strict=False))
    common = "".join(letter for letter, _ in zip(stems[0], takewhile(bool, alike), strict=False))
    return stems[0] if len(stems) == 1 else common.rstrip(_OF_ANGLES) or stems[0]


def _is_result(folder: Path) -> bool:
    return all((folder / name).is_file() for name in (_REPORT, *(f"{layer}.tiff" for layer in LAYERS)))


def layers_of_folder(folder: Path) -> list[LayerData]:
    """Layers and errors that ``polaropt separate`` wrote, as napari shows them.

    Raises
    ------
    InputError
        A file of it cannot be read.
    """
    errors = [folder / f"{name}.tiff" for name in _ERRORS]
    maps = maps_of_errors(folder.name, *map(_planes, errors)) if all(path.is_file() for path in errors) else []
    shown = [
        view_of_layer(_planes(folder / f"{name}.tiff"), f"{folder.name} {name}", None, {}) for name in reversed(LAYERS)
    ]
    return [*maps, *shown]


def _planes(path: Path) -> Image:
    """An image of a file, ([channel,] h, w)."""
    pixels = np.asarray(read_file(path).pixels, dtype=np.float32)
    return pixels if pixels.ndim == 2 else planes_first(pixels)
