"""Photographs to make examples from: a person's own, or those that ship inside scikit-image."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from polaropt.capture import HEIF, AnyPath, linearize, parse_gamma, read_file
from polaropt.errors import InputError
from polaropt.numerics import in_color, strips

Image = NDArray[np.float32]

SHIPPED = ("astronaut", "coffee", "chelsea", "rocket")
_SUFFIXES = (".png", ".jpg", ".jpeg", ".tif", ".tiff", *HEIF)


def read_photograph(path: AnyPath, gamma: float | str | None = None) -> Image:
    """Read one photograph as (h, w) or (h, w, 3), white = 1.

    Parameters
    ----------
    path : path
    gamma : None, "srgb" or float
        Encoding to undo; None takes the values as they are.

    Raises
    ------
    InputError
        A file that cannot be read, or that holds several images.
    """
    content = read_file(path)
    if content.stack:
        raise InputError(f"{path}: holds several images; give one photograph")
    return _linear(content.pixels, gamma)


def shipped_photograph(name: str, gamma: float | str | None = "srgb") -> Image:
    """One of `SHIPPED`, (h, w, 3); nothing is downloaded. By default linear."""
    from skimage import data

    return _linear(np.asarray(getattr(data, name)()), gamma)


def photographs_in(folder: Path) -> list[Path]:
    """The photographs in a folder, by name.

    Raises
    ------
    InputError
        No folder, or fewer than two photographs in it.
    """
    if not os.path.isdir(folder):
        raise InputError(f"{folder}: is no folder; give one that holds photographs")
    photographs = sorted(path for path in folder.iterdir() if path.suffix.lower() in _SUFFIXES)
    if len(photographs) < 2:
        raise InputError(f"{folder}: holds {len(photographs)} photographs (PNG, JPEG, TIFF); at least 2 are needed")
    return photographs


def common_middle(images: Sequence[Image]) -> list[Image]:
    """Images (h, w[, 3]) cropped to the largest size that fits in all, about their middles; grey ones in colour
    where another has colour."""
    if any(image.ndim == 3 for image in images):
        images = [in_color(image) for image in images]
    height, width = (min(image.shape[axis] for image in images) for axis in (0, 1))
    return [cut(image, (height, width)) for image in images]


def cut(image: Image, size: tuple[int, int], place: tuple[float, float] = (0.5, 0.5)) -> Image:
    """A frame of `size`, at 0 (top, left) to 1 (bottom, right); the photograph is mirrored where it ends."""
    lack = [max(wanted - side, 0) for wanted, side in zip(size, image.shape, strict=False)]
    padding = [(missing // 2, missing - missing // 2) for missing in lack]
    if any(lack):
        image = np.pad(image, [*padding, *[(0, 0)] * (image.ndim - 2)], mode="symmetric")
    top, left = (round(where * (image.shape[axis] - size[axis])) for axis, where in enumerate(place))
    return np.ascontiguousarray(image[top : top + size[0], left : left + size[1]])


def _linear(pixels: NDArray[Any], gamma: float | str | None) -> Image:
    white = np.iinfo(pixels.dtype).max if pixels.dtype.kind == "u" else 1
    encoding, linear = parse_gamma(gamma), np.empty(pixels.shape, dtype=np.float32)
    for rows in strips(pixels.shape[0], pixels[0].size):
        linear[rows] = linearize(pixels[rows].astype(np.float32) / np.float32(white), encoding)
    return linear
