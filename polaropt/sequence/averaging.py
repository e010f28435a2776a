"""Frames of a still scene averaged: less noise, as long as they lie on each other."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from polaropt.errors import InputError
from polaropt.numerics import block_mean

# Pixels of a mosaic after which its pattern of angles and colours comes again.
_PERIOD = 4
# Parts of a pixel by which frames may lie beside each other, and steps in which that is measured: set by hand. Farther
# off their mean would blur.
_CLOSE_PX = 0.25
_STEPS = 50

Mosaic = NDArray[Any]


def averaged(frames: Iterable[Mosaic], number: int) -> Iterator[NDArray[np.float64]]:
    """Means of up to so many raw mosaics that follow one another.

    A frame is moved onto the first of its mean by whole patterns of the mosaic, samples as they were measured; what
    then lies more than a quarter of a pixel beside it begins a mean of its own.

    Parameters
    ----------
    frames : iterable of ndarray, shape (h, w)
        Values as stored.
    number : int
        Frames of a mean, at most.

    Yields
    ------
    ndarray of float64, shape (h, w)
        In units of the frames.
    """
    if number < 1:
        raise InputError(f"--average is {number}; give 1 or more")
    mean: _Mean | None = None
    for frame in frames:
        if mean is None or mean.count == number or not mean.takes(frame):
            if mean is not None:
                yield mean.value()
            mean = _Mean(frame)
    if mean is not None:
        yield mean.value()


class _Mean:
    """A mean that grows by frames that lie on its first one."""

    def __init__(self, frame: Mosaic) -> None:
        self._first = frame
        self._total = frame.astype(np.float64)
        self._weight = np.ones(frame.shape)
        self.count = 1

    def value(self) -> NDArray[np.float64]:
        """The mean of what was taken."""
        return self._total / self._weight

    def takes(self, frame: Mosaic) -> bool:
        """Take a frame, if it lies on the first."""
        moved = _onto(_brightness(self._first), frame)
        if moved is None:
            return False
        image, seen = moved
        self._total += image * seen
        self._weight += seen
        self.count += 1
        return True


def _brightness(frame: Mosaic) -> NDArray[np.float32]:
    """The light of all polarizations and colours, a pixel for each pattern."""
    return np.asarray(block_mean(frame.astype(np.float32)[None], _PERIOD)[0], dtype=np.float32)


def _onto(first: NDArray[np.float32], frame: Mosaic) -> tuple[Mosaic, NDArray[np.bool_]] | None:
    """A frame moved by whole patterns, and where it shows something; None where it does not lie on the first."""
    from skimage import registration

    find_shift: Any = registration.phase_cross_correlation
    shift, *_ = find_shift(first, _brightness(frame), upsample_factor=_STEPS)
    whole = [round(float(step)) for step in shift]
    if _PERIOD * max(abs(step - n) for step, n in zip(shift, whole, strict=True)) > _CLOSE_PX:
        return None
    down, right = (_PERIOD * n for n in whole)
    seen = np.zeros(frame.shape, dtype=np.bool_)
    height, width = frame.shape
    seen[max(0, down) : height + min(0, down), max(0, right) : width + min(0, right)] = True
    return np.roll(frame, (down, right), axis=(0, 1)), seen
