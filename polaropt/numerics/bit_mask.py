"""A mask of pixels in one bit each."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from polaropt.numerics.blocks import strips

Mask = NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class BitMask:
    """A mask (..., h, w) in an eighth of its memory: parts are unpacked when they are asked for.

    ``np.asarray`` unpacks all of it.

    Parameters
    ----------
    bits : ndarray of uint8, shape (..., h, (w + 7) // 8)
        Rows, packed as `numpy.packbits` does.
    width : int
        w.

    Examples
    --------
    >>> import numpy as np
    >>> from polaropt.numerics import BitMask
    >>> mask = np.arange(60).reshape(3, 20) % 7 > 0
    >>> bits = BitMask.of(mask)
    >>> bits.shape, bits.bits.nbytes, bool((bits[..., 1:3, 5:18] == mask[1:3, 5:18]).all())
    ((3, 20), 9, True)
    """

    bits: NDArray[np.uint8]
    width: int

    @classmethod
    def of(cls, mask: Mask) -> BitMask:
        """Pack a mask (..., h, w)."""
        return cls.made(mask.shape, mask.__getitem__)

    @classmethod
    def made(cls, shape: tuple[int, ...], part: Callable[[tuple[Any, ...]], Mask]) -> BitMask:
        """Pack a mask of a shape (..., h, w), some rows of a plane at a time: `part` makes them of their index."""
        mask = cls.empty(shape)
        for plane in np.ndindex(shape[:-2]):
            for rows in strips(*shape[-2:]):
                mask.keep((*plane, rows), part((*plane, rows)))
        return mask

    @classmethod
    def empty(cls, shape: tuple[int, ...]) -> BitMask:
        """Room for a mask of a shape (..., h, w), whose parts are still to be kept."""
        return cls(np.empty((*shape[:-1], -(-shape[-1] // 8)), np.uint8), shape[-1])

    def keep(self, part: tuple[Any, ...], values: Mask) -> None:
        """Pack whole rows into their place, an index of all axes but the last one."""
        self.bits[part] = np.packbits(values, axis=-1)

    @property
    def shape(self) -> tuple[int, ...]:
        """Shape of the mask."""
        return (*self.bits.shape[:-1], self.width)

    @property
    def size(self) -> int:
        """Number of pixels."""
        return math.prod(self.shape)

    @property
    def n_true(self) -> int:
        """Number of pixels that are True."""
        return int(np.bitwise_count(self.bits).sum(dtype=np.int64))

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> NDArray[Any]:
        whole = self._unpacked(self.bits, 0, self.width)
        return whole if dtype is None else whole.astype(dtype, copy=False)

    def __getitem__(self, part: tuple[Any, ...]) -> Mask:
        """A plane by its numbers, or some rows and columns of all: [..., rows, columns].

        Rows by a slice or their numbers, columns by a slice with step 1.
        """
        if all(isinstance(number, int) for number in part):
            return self._unpacked(self.bits[part], 0, self.width)
        leading, rows, columns = part
        left, right, step = columns.indices(self.width)
        if leading is not Ellipsis or step != 1:
            raise IndexError(f"a mask of bits gives [..., rows, columns] with neighbouring columns, not {part}")
        return self._unpacked(self.bits[..., rows, left // 8 : -(-right // 8)], left % 8, max(0, right - left))

    def __iter__(self) -> Iterator[Mask]:
        """The parts of the first axis, one unpacked at a time."""
        return (self._unpacked(bits, 0, self.width) for bits in self.bits)

    def all(self, axis: int | tuple[int, ...]) -> Mask:
        """Which pixels are True all along the first axis, or the first few, (..., h, w); there are no others."""
        axes = (axis,) if isinstance(axis, int) else axis
        if axes != tuple(range(len(axes))) or len(axes) > self.bits.ndim - 2:
            raise ValueError(f"a mask of bits knows its first axes alone, not {axis}")
        return self._unpacked(np.bitwise_and.reduce(self.bits, axis=axes), 0, self.width)

    @staticmethod
    def _unpacked(bits: NDArray[np.uint8], first: int, width: int) -> Mask:
        """So many pixels of packed rows, from the `first` on."""
        values = np.unpackbits(bits, axis=-1, count=first + width)
        return np.ascontiguousarray(values[..., first:]).view(np.bool_)


AnyMask = Mask | BitMask


def count_true(mask: AnyMask) -> int:
    """Number of pixels of a mask that are True."""
    return mask.n_true if isinstance(mask, BitMask) else int(np.count_nonzero(mask))
