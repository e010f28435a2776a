"""Means over blocks of pixels, gaps filled from the blocks around them, and the middle of a frame."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

Images = NDArray[np.float32]
Real = NDArray[np.floating[Any]]
Mask = NDArray[np.bool_]


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


def middle(images: Images, most: int) -> Images:
    """Images (..., h, w) cut to at most so many pixels a side around their middle."""
    return images[(..., *middle_part(images.shape, most))]


def middle_part(shape: tuple[int, ...], most: int) -> tuple[slice, slice]:
    """Rows and columns of the middle of a frame (..., h, w), at most so many pixels each."""
    top, left = (max(0, (side - most) // 2) for side in shape[-2:])
    return slice(top, top + most), slice(left, left + most)
