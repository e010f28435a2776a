"""Bilinear shifts of images continued by their edge values, and their exact transpose.

A frame is padded once, wide enough for all shifts; on the padded frame a shift is an offset in its flat memory, so
every pass runs over contiguous samples. One code for numpy arrays and torch tensors: `xp` is the array's namespace.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from array_api_compat import is_torch_namespace

# Rounding of cos and sin must not make a whole shift a fractional one.
_SNAP = 1e-12


@dataclass(frozen=True)
class Shift:
    """One bilinear shift as sums of neighbours in the padded frame's flat memory."""

    offset: int
    """Of the nearest sample, for the first pixel of the frame."""
    scale: float
    """Weight of the nearest sample."""
    across: float
    """Weight of the sample one column before, as a share of the nearest's; 0 for whole columns."""
    down: float
    """Weight of the sample one row before, likewise."""


class PaddedFrame:
    """Images of one size, continued by their edge values as far as a set of shifts reaches.

    Parameters
    ----------
    height, width : int
        Size of the frame in pixels.
    displacements : sequence of (dx, dy)
        Columns to the right and rows down, of any size and sign.

    Attributes
    ----------
    shifts : list of Shift
        One per displacement.
    stride : int
        Samples from one row to the next.
    size : int
        Samples that a shift yields: the frame's rows with padded columns.
    padded_size : int
        Samples of a padded image.
    """

    def __init__(self, height: int, width: int, displacements: Sequence[tuple[float, float]]) -> None:
        columns = [_split(dx, width) for dx, _ in displacements]
        rows = [_split(dy, height) for _, dy in displacements]
        self._shape = (height, width)
        self._left, right = _margins(columns)
        self._top, bottom = _margins(rows)
        self.stride = self._left + width + right
        # One more row, so that the last row of any shift can be read with its padding.
        self._padded_height = self._top + height + bottom + (1 if self.stride > width else 0)
        self.size = height * self.stride
        self.padded_size = self._padded_height * self.stride
        self.shifts = [self._shift(column, row) for column, row in zip(columns, rows, strict=True)]

    def _shift(self, column: tuple[int, float], row: tuple[int, float]) -> Shift:
        return Shift(
            offset=(self._top - row[0]) * self.stride + self._left - column[0],
            scale=(1 - column[1]) * (1 - row[1]),
            across=column[1] / (1 - column[1]),
            down=row[1] / (1 - row[1]),
        )

    def extend(self, images: Any, xp: Any) -> Any:
        """Images (..., h, w), continued by their edge values, as flat planes (..., samples)."""
        rows = _continued(images, self._top, self._padded_height, -2, xp)
        padded = _continued(rows, self._left, self.stride, -1, xp)
        return xp.reshape(padded, (*images.shape[:-2], -1))

    def fold(self, planes: Any, xp: Any) -> Any:
        """Transpose of `extend`."""
        height, width = self._shape
        padded = xp.reshape(planes, (*planes.shape[:-1], self._padded_height, self.stride))
        return _folded(_folded(padded, self._left, width, -1, xp), self._top, height, -2, xp)

    def crop(self, planes: Any, xp: Any) -> Any:
        """Images (..., h, w) of the shifted samples (..., size)."""
        height, width = self._shape
        return xp.reshape(planes, (*planes.shape[:-1], height, self.stride))[..., :width]

    def spread(self, images: Any, xp: Any) -> Any:
        """Transpose of `crop`, with `stride` + 1 zeros on both sides, (..., size + 2 stride + 2)."""
        height, width = self._shape
        lead = images.shape[:-2]
        gap = zeros((*lead, height, self.stride - width), images, xp)
        rows = xp.concat([images, gap], axis=-1) if self.stride > width else images
        ends = zeros((*lead, self.stride + 1), images, xp)
        return xp.concat([ends, xp.reshape(rows, (*lead, -1)), ends], axis=-1)

    def reach(self, shift: Shift) -> int:
        """Samples before the nearest one that a shift needs."""
        return (1 if shift.across else 0) + (self.stride if shift.down else 0)

    def shifted(self, planes: Any, shift: Shift, xp: Any) -> Any:
        """Images (..., h, w) that a shift makes of extended planes (..., samples)."""
        reach = self.reach(shift)
        samples = planes[..., shift.offset - reach : shift.offset + self.size]
        return shift.scale * self.crop(self.interpolate(samples, shift), xp)

    def add_shifted_back(self, images: Any, shift: Shift, planes: Any, xp: Any) -> None:
        """Transpose of `shifted`: add images (..., h, w) to planes (..., samples)."""
        reach, ahead = self.reach(shift), self.stride + 1
        samples = self.spread(images, xp)[..., ahead - reach : ahead + self.size + reach]
        planes[..., shift.offset - reach : shift.offset + self.size] += shift.scale * self.interpolate_transposed(
            samples, shift
        )

    def interpolate(self, samples: Any, shift: Shift) -> Any:
        """Sums of neighbours, short of the shift's `scale`; takes `reach` samples more than it gives."""
        if shift.down:
            samples = _add_scaled(samples[..., self.stride :], samples[..., : -self.stride], shift.down)
        if shift.across:
            samples = _add_scaled(samples[..., 1:], samples[..., :-1], shift.across)
        return samples

    def interpolate_transposed(self, samples: Any, shift: Shift) -> Any:
        """As `interpolate`, with the neighbours after each sample."""
        if shift.down:
            samples = _add_scaled(samples[..., : -self.stride], samples[..., self.stride :], shift.down)
        if shift.across:
            samples = _add_scaled(samples[..., :-1], samples[..., 1:], shift.across)
        return samples


def zeros(shape: tuple[int, ...], like: Any, xp: Any) -> Any:
    """Zeros of the dtype and on the device of another array."""
    return xp.zeros(shape, dtype=like.dtype, device=like.device if is_torch_namespace(xp) else None)


def _add_scaled(x: Any, y: Any, factor: float) -> Any:
    total = factor * y
    total += x
    return total


def _split(distance: float, n: int) -> tuple[int, float]:
    """Whole and fractional part of a distance; from n - 1 on every pixel shows the edge."""
    clamped = min(max(distance, 1.0 - n), n - 1.0)
    nearest = round(clamped)
    if abs(clamped - nearest) < _SNAP:
        return nearest, 0.0
    whole = math.floor(clamped)
    return whole, clamped - whole


def _margins(parts: Sequence[tuple[int, float]]) -> tuple[int, int]:
    """Samples needed before and after the frame along one axis."""
    before = max((whole + (1 if fraction else 0) for whole, fraction in parts), default=0)
    after = max((-whole for whole, _ in parts), default=0)
    return max(before, 0), max(after, 0)


def _part(axis: int, start: int, stop: int) -> tuple[Any, ...]:
    return (..., slice(start, stop)) if axis == -1 else (..., slice(start, stop), slice(None))


def _continued(x: Any, lead: int, length: int, axis: int, xp: Any) -> Any:
    """`x` with `lead` copies of its first sample before it and copies of its last after it."""
    n = x.shape[axis]
    if n == length:
        return x
    parts = [x]
    if lead:
        parts.insert(0, _copies(x[_part(axis, 0, 1)], lead, axis, xp))
    if length - n - lead:
        parts.append(_copies(x[_part(axis, n - 1, n)], length - n - lead, axis, xp))
    return xp.concat(parts, axis=axis)


def _copies(x: Any, count: int, axis: int, xp: Any) -> Any:
    shape = list(x.shape)
    shape[axis] = count
    return xp.broadcast_to(x, tuple(shape))


def _folded(y: Any, lead: int, n: int, axis: int, xp: Any) -> Any:
    """Transpose of `_continued`."""
    length = y.shape[axis]
    if n == length:
        return y
    if n == 1:
        return xp.sum(y, axis=axis, keepdims=True)
    first = xp.sum(y[_part(axis, 0, lead + 1)], axis=axis, keepdims=True)
    last = xp.sum(y[_part(axis, lead + n - 1, length)], axis=axis, keepdims=True)
    return xp.concat([first, y[_part(axis, lead + 1, lead + n - 1)], last], axis=axis)
