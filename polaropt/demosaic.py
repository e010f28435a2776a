"""Raw mosaics to full resolution, by the optional package polanalyser."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from polaropt.errors import InputError
from polaropt.mosaic import check_cell_order

Raw = NDArray[Any]
Mask = NDArray[np.bool_]

# polanalyser names its pictures after Sony's cell: 0 is its bottom right corner, and so on. Corner to list position:
_OF_CORNER = (2, 1, 3, 0)
_WHITE16 = 65535


def demosaic_full(
    linear: NDArray[np.float32], valid: Mask, color: bool, cell_order: Sequence[float]
) -> tuple[NDArray[np.float32], Mask, tuple[float, ...]]:
    """Interpolate every polarizer angle (and colour) bilinearly at every pixel.

    Parameters
    ----------
    linear : ndarray of float32, shape (h, w)
        Linear raw values; they are rounded to 16 bits between their least and their greatest.
    valid : ndarray of bool, shape (h, w)
        Pixels that can be trusted.
    color : bool
        Whether the cells have a Bayer pattern, R G / G B.
    cell_order : sequence of 4 floats
        Polarizer angles of a cell in degrees: top left, top right, bottom left, bottom right.

    Returns
    -------
    images : ndarray of float32, shape (4, [3,] h, w)
        By ascending angle.
    valid : ndarray of bool, same shape
        False wherever an untrusted pixel contributes.
    angles_deg : tuple of float

    Raises
    ------
    InputError
        polanalyser or OpenCV is not installed.
    """
    cell = check_cell_order(cell_order)
    step = 4 if color else 2
    height, width = (side // step * step for side in linear.shape)
    integers, lowest, scale = _integers(linear[:height, :width])
    pictures = [lowest + scale * image.astype(np.float32) for image in _interpolate(integers, color)]
    masks = _masks(valid[:height, :width], color)
    order = sorted(range(4), key=lambda k: cell[k])
    images = np.stack([pictures[_OF_CORNER[k]] for k in order])
    trusted = np.stack([masks[k] for k in order])
    # OpenCV's channels come last, as blue, green, red.
    images = np.moveaxis(images, -1, 1)[:, ::-1] if color else images
    return (
        np.ascontiguousarray(images, dtype=np.float32),
        np.ascontiguousarray(np.broadcast_to(trusted[:, None] if color else trusted, images.shape)),
        tuple(cell[k] for k in order),
    )


def _interpolate(raw: Raw, color: bool) -> list[Raw]:
    try:
        import polanalyser
    except ImportError as error:
        raise InputError(
            f"full resolution needs the package {error.name or 'polanalyser'}; "
            "install it with: pip install polaropt[demosaic]"
        ) from None
    code = polanalyser.COLOR_PolarRGB if color else polanalyser.COLOR_PolarMono
    return list(polanalyser.demosaicing(np.ascontiguousarray(raw), code))


def _integers(linear: NDArray[np.float32]) -> tuple[Raw, np.float32, np.float32]:
    """16-bit values as OpenCV takes them; linear = lowest + step * integer."""
    lowest, highest = linear.min(), linear.max()
    step = np.float32(max(float(highest - lowest), 1e-30) / _WHITE16)
    return np.round((linear - lowest) / step).astype(np.uint16), np.float32(lowest), step


def _masks(valid: Mask, color: bool) -> list[Mask]:
    """Validity of each cell corner's full picture: of what its interpolation has read."""
    from scipy.ndimage import minimum_filter

    # Bilinear: the nearest samples; for colours twice, once among cells (2 px apart) and once among pixels.
    reach = 3 if color else 1
    masks = []
    for row, column in ((0, 0), (0, 1), (1, 0), (1, 1)):
        own = np.ones_like(valid)
        own[row::2, column::2] = valid[row::2, column::2]
        # OpenCV copies its outermost interpolated pixels from their neighbours, hence the padding by reflection.
        padded = np.pad(own, 2 * reach, mode="reflect")
        spread = minimum_filter(padded.astype(np.uint8), size=2 * reach + 1)
        inner = spread[2 * reach : -2 * reach, 2 * reach : -2 * reach].astype(bool)
        masks.append(_as_at_border(inner, reach))
    return masks


def _as_at_border(mask: Mask, width: int) -> Mask:
    """Rows and columns at the frame are interpolated from those inside: they are valid where both are."""
    result = mask.copy()
    for axis in (0, 1):
        view = np.moveaxis(result, axis, 0)
        for k in range(width):
            view[k] &= view[width]
            view[-1 - k] &= view[-1 - width]
    return result
