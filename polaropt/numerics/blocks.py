"""Means over blocks of pixels, gaps filled from the blocks around them, and the middle of a frame."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

Images = NDArray[np.float32]
Real = NDArray[np.floating[Any]]
Mask = NDArray[np.bool_]

_STRIP_VALUES = 2**22
"""Values of a frame that are worked on at a time: 32 MB of doubles; set by hand, changes the memory alone."""


def strips(height: int, values_per_row: int, multiple: int = 1) -> Iterator[slice]:
    """Rows of a frame from top to bottom, so many at a time that what is made of them stays small.

    Parameters
    ----------
    height : int
    values_per_row : int
        All that a row of the frame holds: of every photograph and colour.
    multiple : int
        Of which a strip's rows are one, but for the last.
    """
    rows = multiple * max(1, _STRIP_VALUES // (values_per_row * multiple))
    for top in range(0, height, rows):
        yield slice(top, min(top + rows, height))


def fill_gaps(images: Images, valid: Mask) -> Images:
    """Replace invalid pixels of images (..., channel, h, w) by the mean of the finest block around them that has any.

    `valid` has the shape (channel, h, w).
    """
    filled = np.where(valid, images, np.float32(0))
    means, shares = filled, valid.astype(np.float32)
    gaps = np.stack(np.nonzero(~valid))
    size = 1
    while gaps.size and max(shares.shape[-2:]) > 1:
        means, shares = block_mean(means, 2, partial=True), block_mean(shares, 2, partial=True)
        size *= 2
        blocks = (gaps[0], gaps[1] // size, gaps[2] // size)
        share = shares[blocks]
        there = share > 0
        values = means[(..., *blocks)][..., there] / share[there]
        filled[(..., *gaps[:, there])] = values
        gaps = gaps[:, ~there]
    return filled


def block_mean(images: Real, size: int | tuple[int, int], partial: bool = False) -> Real:
    """Means over whole blocks of the last two axes, (..., h // rows, w // columns).

    Parameters
    ----------
    images : ndarray of floats, shape (..., h, w)
    size : int or (int, int)
        Side of a block, or its rows and columns.
    partial : bool
        Keep the incomplete blocks at the far sides, zeros beyond.
    """
    down, across = size if isinstance(size, tuple) else (size, size)
    if down == across == 1:
        return images
    height, width = images.shape[-2:]
    if partial:
        images = np.pad(images, [(0, 0)] * (images.ndim - 2) + [(0, -height % down), (0, -width % across)])
        height, width = images.shape[-2:]
    rows, columns = height // down, width // across
    inside = images[..., : rows * down, : columns * across]
    if down == across == 2:
        # Four strided views are several times faster than numpy's sums over short axes.
        pairs = inside[..., ::2, :] + inside[..., 1::2, :]
        return np.asarray((pairs[..., ::2] + pairs[..., 1::2]) * images.dtype.type(0.25))
    blocks = inside.reshape(*images.shape[:-2], rows, down, columns, across)
    # Column sums first: contiguous rows are the fast direction.
    return np.asarray(blocks.sum(axis=-3).sum(axis=-1) / (down * across))


def whole_blocks(valid: Mask, size: int) -> Mask:
    """Which whole blocks of the last two axes are valid throughout, (..., h // size, w // size)."""
    rows, columns = (side // size for side in valid.shape[-2:])
    inside = valid[..., : rows * size, : columns * size]
    return np.asarray(inside.reshape(*valid.shape[:-2], rows, size, columns, size).all(axis=-3).all(axis=-1))


def middle(images: Images, most: int) -> Images:
    """Images (..., h, w) cut to at most so many pixels a side around their middle."""
    return images[(..., *middle_part(images.shape, most))]


def middle_part(shape: tuple[int, ...], most: int) -> tuple[slice, slice]:
    """Rows and columns of the middle of a frame (..., h, w), at most so many pixels each."""
    top, left = (max(0, (side - most) // 2) for side in shape[-2:])
    return slice(top, top + most), slice(left, left + most)
