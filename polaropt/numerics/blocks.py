"""Means over blocks of pixels, gaps filled from the blocks around them, and the middle of a frame."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Images = NDArray[np.float32]
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


def block_mean(images: Images, size: int, partial: bool = False) -> Images:
    """Means over blocks of `size` pixels; `partial` keeps the incomplete blocks at the far sides, zeros beyond."""
    if size == 1:
        return images
    height, width = images.shape[-2:]
    if partial:
        more = [(0, 0)] * (images.ndim - 2) + [(0, -height % size), (0, -width % size)]
        images = np.pad(images, more)
        height, width = images.shape[-2:]
    rows, columns = height // size, width // size
    if size == 2:
        # Four strided views are several times faster than numpy's mean over two short axes.
        even, odd = images[..., : 2 * rows : 2, :], images[..., 1 : 2 * rows : 2, :]
        pairs = even + odd
        return np.asarray(0.25 * (pairs[..., : 2 * columns : 2] + pairs[..., 1 : 2 * columns : 2]), np.float32)
    if size % 2 == 0:
        return block_mean(block_mean(images, 2), size // 2)
    inside = images[..., : rows * size, : columns * size]
    return np.asarray(inside.reshape(*images.shape[:-2], rows, size, columns, size).mean(axis=(-3, -1)), np.float32)


def middle(images: Images, most: int) -> Images:
    """Images (..., h, w) cut to at most so many pixels a side around their middle."""
    return images[(..., *middle_part(images.shape, most))]


def middle_part(shape: tuple[int, ...], most: int) -> tuple[slice, slice]:
    """Rows and columns of the middle of a frame (..., h, w), at most so many pixels each."""
    top, left = (max(0, (side - most) // 2) for side in shape[-2:])
    return slice(top, top + most), slice(left, left + most)
