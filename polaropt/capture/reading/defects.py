"""Defective pixels of a sensor: hot and dead ones, and those under dust, which no raw file is without.

A sample of a mosaic that stands out by itself is polarized light, and no lens draws such a point: light that falls on
one pixel falls on those beside it, too.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from polaropt.capture.capture import RawSamples

Places = NDArray[np.intp]
Values = NDArray[np.float32]

_TIMES_RANGE = 1.5
"""How many times the range of its kind a defective sample lies beyond that at least; set by hand: quick to ask, and it
leaves a sample in a hundred."""
_TIMES_BESIDE = 5.0
"""How many times farther off its kind than those beside it a defective sample is; set by hand: a point of light through
a lens of 0.7 px reaches 2.7, noise 5 in a sample of a million."""
_STANDING_OUT = 3
"""Which of the farthest samples beside it that is: others may be defective, too."""
_LEAST_STEPS = 3.0
"""Grey levels that a sample may be off by more than that."""
_LEAST_OFF = 1e-3
"""What it may be off by where values lie on no grid (white = 1)."""
_LEAST_BESIDE_CLIPPED = 0.25
"""What it may be off by where samples beside it clip, which hides how far these are off (white = 1)."""
_MOST = 0.01
"""Share of a sensor's pixels that are defective at most; where more stand out, the scene is such a pattern."""
_SIDE_PX = 5
"""Of the square of samples beside it."""
_AT_A_TIME = 20_000
_NEAREST = tuple((down, across) for down in (-1, 0, 1) for across in (-1, 0, 1) if (down, across) != (0, 0))


def defective_samples(samples: RawSamples, step: float) -> Places:
    """Samples that lie far off the nearest ones of their kind, where none beside them does.

    A sample's kind is its polarizer and its colour. What lies beside it may be of any kind: an edge or a texture puts
    these off, too.

    Parameters
    ----------
    samples : RawSamples
    step : float
        Distance of its grey levels (white = 1); 0 for none.

    Returns
    -------
    ndarray of int
        Their places in the flat frame; none where more stand out than a sensor has defects.
    """
    least = _LEAST_STEPS * step or _LEAST_OFF
    found = [np.empty(0, np.intp)]
    suspects = _suspects(samples, least)
    for begin in range(0, suspects.size, _AT_A_TIME):
        some = suspects[begin : begin + _AT_A_TIME]
        found.append(some[_stands_out(samples, some, least)])
    places = np.concatenate(found)
    return places if places.size <= _MOST * samples.values.size else found[0]


def without_defects(samples: RawSamples, places: Places) -> RawSamples:
    """The same with what the nearest samples of their kind have in the middle instead of those at some places."""
    if not places.size:
        return samples
    rows, columns = np.unravel_index(places, samples.values.shape)
    values, valid = samples.values.copy(), samples.valid.copy()
    around = _of_kind(samples, rows, columns)
    values[rows, columns] = np.median(samples.values[around], axis=0)
    valid[rows, columns] = samples.valid[around].all(axis=0)
    return replace(samples, values=values, valid=valid)


def _suspects(samples: RawSamples, least: float) -> Places:
    """Samples that lie far beyond the range of the nearest ones of their kind, of which the two farthest don't count.

    It is a quick question: what little it finds is looked at more closely.
    """
    period, (height, width) = samples.sampling.period, samples.values.shape
    found = np.zeros((height, width), dtype=bool)
    for row in range(period):
        for column in range(period):
            own = samples.values[row::period, column::period]
            padded = np.pad(own, 1, mode="reflect")
            rows, columns = own.shape
            beside = [
                padded[1 + down : 1 + down + rows, 1 + across : 1 + across + columns] for down, across in _NEAREST
            ]
            high, low = _second_largest(beside), -_second_largest([-values for values in beside])
            far = np.float32(_TIMES_RANGE) * (high - low) + np.float32(least)
            found[row::period, column::period] = (own - high > far) | (low - own > far)
    return np.flatnonzero(found)


def _second_largest(images: list[Values]) -> Values:
    """The second largest value in each pixel."""
    largest, second = np.maximum(images[0], images[1]), np.minimum(images[0], images[1])
    for image in images[2:]:
        np.maximum(second, np.minimum(largest, image), out=second)
        np.maximum(largest, image, out=largest)
    return second


def _stands_out(samples: RawSamples, places: Places, least: float) -> NDArray[np.bool_]:
    """Whether each of some samples is farther off its kind than what lies beside it, by far."""
    height, width = samples.values.shape
    rows, columns = np.unravel_index(places, (height, width))
    own, clipped = _off(samples, rows, columns)
    reach = _SIDE_PX // 2
    beside = []
    for down in range(-reach, reach + 1):
        for across in range(-reach, reach + 1):
            if (down, across) == (0, 0):
                continue
            y, x = _mirrored(rows, down, height), _mirrored(columns, across, width)
            clipped |= ~samples.valid[y, x]
            beside.append(_off(samples, y, x)[0])
    # What bends or slopes evenly is off its kind evenly.
    usual = np.median(beside, axis=0)
    spread = np.sort(np.abs(np.stack(beside) - usual), axis=0)
    farthest = spread[-_STANDING_OUT]
    allowed = _TIMES_BESIDE * farthest + np.where(clipped, _LEAST_BESIDE_CLIPPED, least)
    return np.asarray(np.abs(own - usual) > allowed)


def _off(samples: RawSamples, rows: Places, columns: Places) -> tuple[Values, NDArray[np.bool_]]:
    """How far samples are from the median of the nearest ones of their kind, and whether one of these clips."""
    around = _of_kind(samples, rows, columns)
    off = samples.values[rows, columns] - np.median(samples.values[around], axis=0)
    return off.astype(np.float32), np.asarray(~samples.valid[around].all(axis=0))


def _of_kind(samples: RawSamples, rows: Places, columns: Places) -> tuple[Places, Places]:
    """Rows and columns (8, n) of the nearest samples of the same polarizer and colour, mirrored at the frame's ends."""
    period, (height, width) = samples.sampling.period, samples.values.shape
    steps = np.array(_NEAREST)[:, :, None] * period
    return _mirrored(rows, steps[:, 0], height), _mirrored(columns, steps[:, 1], width)


def _mirrored(places: Places, steps: Places | int, side: int) -> Places:
    """Places some steps on, or as many back where these lead out of the frame."""
    there = places + steps
    return np.where((there < 0) | (there >= side), places - steps, there)
