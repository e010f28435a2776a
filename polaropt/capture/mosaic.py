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
from polaropt.optics import Sampling

Raw = NDArray[Any]

SONY_CELL = (90.0, 45.0, 135.0, 0.0)
"""Polarizer angles of a cell of Sony's IMX250MZR and MYR: top left, top right, bottom left, bottom right."""
WHITE_16 = 2**16 - 1
"""White in 16 bits."""
_BAYER = ((0, 1), (1, 2))
"""Colours of the cells of a block: red, green, green, blue."""
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


def sampling_of(color: bool, cell_order: Sequence[float] = SONY_CELL) -> tuple[Sampling, tuple[float, ...]]:
    """The pattern of a sensor, and the polarizer angles of its photographs, ascending.

    Parameters
    ----------
    color : bool
        Whether cells follow each other as R G / G B.
    cell_order : sequence of 4 floats
        Polarizer angles of a cell in degrees: top left, top right, bottom left, bottom right.
    """
    cell = check_cell_order(cell_order)
    angles = tuple(sorted(cell))
    photographs = np.array([angles.index(angle) for angle in cell]).reshape(2, 2)
    channels = np.zeros((2, 2), dtype=np.intp)
    if color:
        photographs = np.tile(photographs, (2, 2))
        channels = np.kron(_BAYER, np.ones((2, 2), dtype=np.intp))
    return Sampling(*(tuple(map(tuple, pattern.tolist())) for pattern in (photographs, channels))), angles


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
