"""Detail of layers that is none: it repeats with the polarizers of a mosaic, as light that no pane explains makes it.

Things that are polarized each by itself, a wavy pane, or filters with errors leave light in the samples that changes
slowly from place to place and from polarizer to polarizer. Layers follow it by detail near the frequencies of the
mosaic's pattern: rows and columns that alternate. The scene's own detail knows nothing of the pattern: near these
frequencies and farther from them there is as much of it.
"""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from polaropt.solving.windows import WindowSize, add_to, in_rows, mirrored_around, row_of, spectra_of

Images = NDArray[np.float32]

_CELLS = 16
"""Side of a window in cells of the mosaic, with which its frequencies are `_NEAR` units apart."""
_NEAR, _FAR = 3.5, 7.0
"""Frequencies that are the pattern's, and up to which others tell how much detail there is, in periods per window."""
_CLEARLY = 3.0
"""Multiple of that detail's power from which on there is more than detail.

Of all three it holds: on 60 mosaics of training photographs, sharp but for 0.6 px, behind panes at 25 to 75 degrees, in
which things behind the glass are polarized by 15 % at random, the transmission gains 1.4 (mono) and 0.9 dB (colour);
where nothing is polarized by itself it loses 0.003 dB, 0.1 at most. A multiple of 2 loses as much as 0.2, frequencies
nearer by gain 0.02 less, windows half as large lose 0.3 dB of mono and 2 dB of colour mosaics."""
_FIRMNESS = np.float32(100.0)
"""How much more layers are held to what is expected of them near the pattern: those that a wrong model would draw below
zero escape by such detail otherwise. Costs 0.02 dB where the model holds."""


def mosaic_pattern(layers: Images, period: int) -> Images:
    """What in layers repeats with the polarizers beyond the detail that is there anyway.

    Parameters
    ----------
    layers : ndarray of float32, shape (2, channel, h, w)
        Solved for from the samples of a mosaic.
    period : int
        Of its pattern, in pixels.

    Returns
    -------
    ndarray of float32, same shape
    """
    size = _size(period)
    extended = mirrored_around(layers, size)
    found = np.zeros_like(extended)
    places = _places(period)

    def turn(i: int) -> None:
        spectra = spectra_of(row_of(extended, i, size), size)
        flat = spectra.reshape(*spectra.shape[:3], -1)
        # Of all colours together.
        power = (np.square(flat.real) + np.square(flat.imag)).sum(axis=1)
        detail, near = power @ places.detail, power @ places.near
        excess = np.maximum(1 - _CLEARLY * detail / np.maximum(near, np.finfo(np.float32).tiny), 0)
        flat *= (excess @ places.spread)[:, None]
        add_to(row_of(found, i, size), spectra, size)

    in_rows(turn, extended.shape[-2] // size.step_px - 1)
    inside = tuple(slice(size.step_px, size.step_px + side) for side in layers.shape[-2:])
    return np.ascontiguousarray(found[..., inside[0], inside[1]])


def firmness(shape: tuple[int, int], period: int) -> Images:
    """Factor (h, w // 2 + 1) by which images of a shape are held more to what is expected of them, by frequency."""
    height, width = shape
    rows, columns = np.fft.fftfreq(height)[:, None], np.fft.rfftfreq(width)
    near = [_distance(rows, columns, *at) <= _NEAR / (_CELLS * period) for at in _frequencies(period)]
    return np.where(np.any(near, axis=0), _FIRMNESS, np.float32(1))


class _Places(NamedTuple):
    """Frequencies of a window beside each of the pattern's: weights of means (frequency, n), of what is detail and of
    what is near, and where the latter lie (n, frequency)."""

    detail: Images
    near: Images
    spread: Images


def _size(period: int) -> WindowSize:
    return WindowSize(_CELLS * period, 0.0)


def _frequencies(period: int) -> list[tuple[float, float]]:
    """What repeats after so many rows and columns, in periods per pixel, but for what does not change at all.

    Of a frequency and the one opposite, which are the same in images, the first.
    """
    each = [(i, j) for i in range(period) for j in range(period) if i or j]
    return [(i / period, j / period) for i, j in each if (i, j) <= (-i % period, -j % period)]


def _distance(rows: NDArray[np.float64], columns: NDArray[np.float64], y: float, x: float) -> NDArray[np.float64]:
    """From frequencies in periods per pixel to (y, x) or the one opposite; those that differ by whole ones are the
    same."""
    apart = [np.hypot((rows - s * y + 0.5) % 1 - 0.5, (columns - s * x + 0.5) % 1 - 0.5) for s in (1, -1)]
    return np.asarray(np.minimum(*apart))


@lru_cache
def _places(period: int) -> _Places:
    side = _size(period).side_px
    rows, columns = np.fft.fftfreq(side)[:, None], np.fft.rfftfreq(side)
    apart = np.stack([side * _distance(rows, columns, *at).ravel() for at in _frequencies(period)])
    slow = side * _distance(rows, columns, 0.0, 0.0).ravel()
    near = apart <= _NEAR
    detail = (apart <= _FAR) & (slow > _NEAR) & ~near.any(axis=0)
    weights = [(part / part.sum(axis=1, keepdims=True)).T.astype(np.float32) for part in (detail, near)]
    return _Places(weights[0], weights[1], near.astype(np.float32))
