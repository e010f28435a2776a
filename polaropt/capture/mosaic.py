"""Raw mosaics of polarization cameras: cells of polarizers, on colour sensors under a Bayer pattern of cells.

A colour sensor (IMX250MYR) has 4x4 blocks: each 2x2 polarizer cell has one colour, and the cells follow each other as
R G / G B. Sony's cell has the polarizers 90, 45 / 135, 0.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from polaropt.errors import InputError
from polaropt.numerics import block_mean

Raw = NDArray[Any]
Mask = NDArray[np.bool_]

SONY_CELL = (90.0, 45.0, 135.0, 0.0)
"""Polarizer angles of a cell of Sony's IMX250MZR and MYR: top left, top right, bottom left, bottom right."""
WHITE_16 = 2**16 - 1
"""White in 16 bits."""
_CORNERS = ((0, 0), (0, 1), (1, 0), (1, 1))
_COLOR_CONTRAST = 0.045
"""Between what mono and colour mosaics were measured to have, see `looks_color`."""
_TEST_BLOCK = (4, 8)
"""Cells that contrast is averaged over, every other row of cells."""


def check_cell_order(cell_order: Sequence[float]) -> tuple[float, ...]:
    """The four polarizer angles of a cell (top left, top right, bottom left, bottom right), in degrees."""
    try:
        cell = tuple(float(angle) for angle in cell_order)
    except (TypeError, ValueError):
        cell = ()
    wrapped = {round(angle % 180, 3) % 180 for angle in cell if np.isfinite(angle)}
    if len(cell) != 4 or len(wrapped) != 4:
        raise InputError(
            f"cell order {_listed(cell_order)} is not four different angles; "
            "give top left, top right, bottom left, bottom right, for example 90,45,135,0"
        )
    return cell


def split_mosaic(raw: Raw, color: bool, cell_order: Sequence[float] = SONY_CELL) -> tuple[Raw, tuple[float, ...]]:
    """One pixel per cell (mono, half size) or per 4x4 block (colour, quarter size).

    Parameters
    ----------
    raw : ndarray, shape (h, w)
        An odd last row or column, or an incomplete 4x4 block, is left out.
    color : bool
        Whether cells follow each other as R G / G B.
    cell_order : sequence of 4 floats
        Polarizer angles of a cell in degrees: top left, top right, bottom left, bottom right.

    Returns
    -------
    images : ndarray, shape (4, [4,] h, w)
        By ascending angle; for colour the cells R, G, G, B of a block.
    angles_deg : tuple of float
        The sorted angles.
    """
    cell = check_cell_order(cell_order)
    step = 4 if color else 2
    cut = raw[: raw.shape[0] // step * step, : raw.shape[1] // step * step]
    order = sorted(range(4), key=lambda k: cell[k])
    corners = [_CORNERS[k] for k in order]
    if color:
        planes = np.stack([np.stack([cut[r + 2 * a :: 4, c + 2 * b :: 4] for a, b in _CORNERS]) for r, c in corners])
    else:
        planes = np.stack([cut[r::2, c::2] for r, c in corners])
    return planes, tuple(cell[k] for k in order)


def merge_greens(cells: NDArray[np.float32]) -> NDArray[np.float32]:
    """R, G, G, B cells (4, 4, h, w) to colours (4, 3, h, w): the mean of the two greens, which has less noise."""
    return np.stack([cells[:, 0], (cells[:, 1] + cells[:, 2]) / 2, cells[:, 3]], axis=1)


def merge_green_masks(cells: Mask) -> Mask:
    """As `merge_greens`, for validity: both greens must be valid."""
    return np.stack([cells[:, 0], cells[:, 1] & cells[:, 2], cells[:, 3]], axis=1)


def looks_color(raw: Raw) -> bool:
    """Whether a raw mosaic has a Bayer pattern of cells, measured on the pixels.

    Neighbouring cells of a colour sensor alternate between two colours along every row and every column; those of a
    mono sensor do not. The alternating part of the second difference (blind to slopes) along rows and along columns is
    averaged over blocks of 4x8 cells: it cancels on mono textures and stays where scene, light or sensor have any
    colour. Its size relative to the brightness is `bayer_contrast`; above 4.5 % the mosaic counts as colour. Measured:
    0.1 to 0.4 % on real mono mosaics, up to 3.5 % on sharp mono photographs, 28 % and more on colour mosaics with the
    usual strong green, 5.7 % and more where the white balance was already applied.
    """
    return bayer_contrast(raw) > _COLOR_CONTRAST


def bayer_contrast(raw: Raw) -> float:
    """Alternating contrast between neighbouring cells, relative to the brightness: median over blocks."""
    even = raw[: raw.shape[0] // 2 * 2, : raw.shape[1] // 2 * 2].astype(np.float32)
    cells = (even[::2, ::2] + even[::2, 1::2] + even[1::2, ::2] + even[1::2, 1::2]) / np.float32(4)
    contrasts = [_alternation(cells[start::2]) for start in (0, 1)]
    contrasts += [_alternation(cells.T[start::2]) for start in (0, 1)]
    return max(contrasts)


def _alternation(rows: NDArray[np.floating[Any]]) -> float:
    """Alternation along rows, over blocks; the typical one of those that are bright enough."""
    second = rows[:, 1:-1] - (rows[:, :-2] + rows[:, 2:]) / 2
    second[:, ::2] *= -1
    brightness = block_mean(rows[:, 1:-1], _TEST_BLOCK)
    if not brightness.size:
        return 0.0
    bright = brightness >= max(float(np.quantile(brightness, 0.25)), 1e-9)
    return (
        float(np.median(np.abs(block_mean(second, _TEST_BLOCK)[bright]) / brightness[bright])) / 2
        if bright.any()
        else 0.0
    )


def _listed(values: Any) -> str:
    try:
        return ",".join(f"{value:g}" if isinstance(value, int | float) else str(value) for value in values)
    except TypeError:
        return str(values)


# polanalyser names its pictures after Sony's cell: 0 is its bottom right corner, and so on. Corner to list position:
_OF_CORNER = (2, 1, 3, 0)


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
    step = np.float32(max(float(highest - lowest), 1e-30) / WHITE_16)
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
