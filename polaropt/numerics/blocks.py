"""Means over blocks of pixels, gaps filled from what is around them, and the middle of a frame."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

Images = NDArray[np.float32]
Real = NDArray[np.floating[Any]]
Mask = NDArray[np.bool_]

_STRIP_VALUES = 2**20
"""Values of a frame that are worked on at a time: 8 MB of doubles; set by hand, changes the memory alone."""


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
    gaps = np.stack(np.nonzero(~valid))
    filled[(..., *gaps)] = gap_values([(filled, valid)])[1]
    return filled


_LARGEST_GAP = 256
"""Side of the blocks up to which gaps are filled strip by strip; wider ones are filled from all strips together."""
GAP_STRIP = _LARGEST_GAP
"""Rows of a strip whose gaps are filled by itself are a multiple of it."""


def gap_values(parts: Iterable[tuple[Images, Mask]]) -> tuple[NDArray[np.intp], Images]:
    """Where images are invalid, and what `fill_gaps` puts there.

    Parameters
    ----------
    parts : iterable of (images, valid)
        Strips from top to bottom, (..., channel, rows, w) and (channel, rows, w): one, or such of a multiple of
        `GAP_STRIP` rows, but for the last.

    Returns
    -------
    gaps : ndarray, shape (3, n)
        Channel, row and column.
    values : ndarray, shape (..., n)
    """
    top, gaps, values, levels = 0, [], [], []
    for images, valid in parts:
        of_part = np.stack(np.nonzero(~valid))
        level = _Level(np.where(valid, images, np.float32(0)), valid.astype(np.float32), 1)
        filled, level = level.filled(of_part, _LARGEST_GAP)
        values.append(filled)
        gaps.append(of_part + np.array([[0], [top], [0]]))
        levels.append(level)
        top += valid.shape[-2]
    everywhere, found = np.concatenate(gaps, axis=-1), np.concatenate(values, axis=-1)
    if np.isnan(found).any():
        means = np.concatenate([level.means for level in levels], axis=-2)
        shares = np.concatenate([level.shares for level in levels], axis=-2)
        coarser, _ = _Level(means, shares, _LARGEST_GAP).filled(everywhere, 2 * max(top, valid.shape[-1]))
        found = np.where(np.isnan(found), coarser, found)
    # Where nothing at all is valid.
    found[np.isnan(found)] = 0
    return everywhere, found


@dataclass(frozen=True)
class _Level:
    """Means over blocks of a side of images that are 0 where invalid, and shares of valid pixels in them."""

    means: Images
    shares: Images
    size: int

    def filled(self, gaps: NDArray[np.intp], largest: int) -> tuple[Images, _Level]:
        """Mean of the valid pixels of the finest block around each gap that has any, NaN where none has, (..., n).

        With the level of the blocks of the largest size that is looked at.
        """
        level = self
        values = np.full((*self.means.shape[:-3], gaps.shape[1]), np.nan, dtype=np.float32)
        left = np.arange(gaps.shape[1])
        while level.size < largest:
            means, shares = (block_mean(part, 2, partial=True) for part in (level.means, level.shares))
            level = _Level(means, shares, 2 * level.size)
            blocks = (gaps[0, left], gaps[1, left] // level.size, gaps[2, left] // level.size)
            share = shares[blocks]
            there = share > 0
            values[..., left[there]] = means[(..., *blocks)][..., there] / share[there]
            left = left[~there]
        return values, level


_ENOUGH, _LEAST_WEIGHT = 0.25, 1e-6
"""Share of known pixels in a block at which its mean stands for itself, as at the edge of a small gap, and one that is
divided by. Set by hand."""
_ROUNDS, _FINEST_ROUNDS = 12, 2
"""In which a pixel that is not known becomes the mean of its neighbours; at full size, where they cost most, in few.
Behind what moves in 20 random windows to fit on (`studies.random_windows`, even seeds from 8000) the reflection is
0.4 dB closer with them, and 0.03 dB with as many at full size."""


def smoothly_filled(images: Images, known: Mask) -> Images:
    """Replace unknown pixels of images by means over surroundings as fine as there are, without steps between them.

    Parameters
    ----------
    images : ndarray of float32, shape (..., h, w)
    known : ndarray of bool, shape (..., h, w)
        May lack leading axes.

    Returns
    -------
    ndarray of float32, shape (..., h, w)
        Images of which nothing is known are black.

    References
    ----------
    S. J. Gortler, R. Grzeszczuk, R. Szeliski, M. F. Cohen, The lumigraph, SIGGRAPH 1996: pull and push.
    """
    weights = known.astype(np.float32)
    return np.asarray(np.where(known, images, _pushed(images * weights, weights, _FINEST_ROUNDS)), dtype=np.float32)


def _pushed(sums: Images, weights: Images, rounds: int) -> Images:
    """Sums over their weights where these are enough; else what the same at half the size has there, in part or all."""
    means = sums / np.maximum(weights, np.float32(_LEAST_WEIGHT))
    if max(sums.shape[-2:]) == 1 or weights.min() >= _ENOUGH:
        return np.asarray(means)
    halves = [np.asarray(block_mean(part, 2, partial=True), dtype=np.float32) for part in (sums, weights)]
    coarse = _pushed(halves[0], halves[1], _ROUNDS)
    around = enlarged(coarse, 2, sums.shape[-2:])
    share = np.minimum(weights / np.float32(_ENOUGH), 1)
    filled = around + share * (means - around)
    for _ in range(rounds):
        around = _neighbours(filled)
        filled = around + share * (means - around)
    return np.asarray(filled)


def _neighbours(images: Images) -> Images:
    """Mean of the four neighbours of each pixel of images (..., h, w); beyond the frame it is as at its edge."""
    padded = np.pad(images, [(0, 0)] * (images.ndim - 2) + [(1, 1), (1, 1)], mode="edge")
    rows = padded[..., :-2, 1:-1] + padded[..., 2:, 1:-1]
    columns = padded[..., 1:-1, :-2] + padded[..., 1:-1, 2:]
    return np.asarray((rows + columns) * images.dtype.type(0.25))


def enlarged(planes: Images, block: int, shape: tuple[int, ...]) -> Images:
    """Planes whose every pixel stands for a block, linear between the blocks' middles, of a shape."""
    for axis, length in ((-2, shape[0]), (-1, shape[1])):
        n = planes.shape[axis]
        place = np.clip((np.arange(length) + 0.5) / block - 0.5, 0, n - 1)
        lower = place.astype(np.intp)
        share = (place - lower).astype(np.float32)
        share = share[:, None] if axis == -2 else share
        upper = np.minimum(lower + 1, n - 1)
        between = np.take(planes, lower, axis) * (1 - share) + np.take(planes, upper, axis) * share
        planes = np.asarray(between, dtype=np.float32)
    return planes


def spread_blocks(values: NDArray[Any], size: int, shape: tuple[int, ...]) -> NDArray[Any]:
    """Values of blocks (rows, columns) in each of their pixels (h, w), beyond the last whole block as in it."""
    row, column = (np.minimum(np.arange(side) // size, n - 1) for side, n in zip(shape, values.shape, strict=True))
    return values[np.ix_(row, column)]


def block_shares(valid: Mask, size: int) -> Images:
    """Shares of valid pixels (..., h, w) in blocks, as `block_mean` would have them."""
    parts = strips(valid.shape[-2], valid.size // valid.shape[-2], size)
    return np.concatenate([block_mean(valid[..., rows, :].astype(np.float32), size) for rows in parts], axis=-2)


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


def middle_part(shape: tuple[int, ...], most: int) -> tuple[slice, slice]:
    """Rows and columns of the middle of a frame (..., h, w), at most so many pixels each."""
    top, left = (max(0, (side - most) // 2) for side in shape[-2:])
    return slice(top, top + most), slice(left, left + most)
