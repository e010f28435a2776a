"""Detail of layers that is none: it alternates with a mosaic's polarizers, as light that no pane explains makes it.

Things that are polarized each by itself, a wavy pane, or filters with errors leave light in the samples that changes
slowly from place to place and alternates with the polarizers. Layers follow it by rows and columns that alternate. The
scene's own detail knows nothing of the polarizers: at these frequencies and beside them there is as much of it.
"""

from __future__ import annotations

from functools import cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from polaropt.solving.windows import (
    WindowSize,
    add_to,
    apart_from,
    frame_of,
    in_rows,
    mirrored_around,
    row_of,
    spectra_of,
)

Images = NDArray[np.float32]
Alternations = tuple[tuple[float, float], ...]

_SIZE = WindowSize(32, 0.0)
# From these frequencies, in periods per window: nearer than the first, power stands out where there is more than
# between the first and the third, and where it does all that is nearer than the second goes with it.
_NEAR, _WITH_IT, _BESIDE = 1.5, 3.5, 7.0
# Multiple of the power beside them from which on there is more than detail. On 60 mosaics of training photographs
# behind panes at 25 to 75 degrees, sharp but for 0.6 px, in which things behind the glass are polarized by 15 %, the
# transmission gains 1.5 (mono) and 1.0 dB (colour) by these numbers; where nothing is polarized by itself it loses
# 0.004 dB, 0.05 at most. Stripes of the scene of 2.05 to 2.3 px, 0 to 12 degrees off rows or columns, lose 0.05 dB;
# with `_NEAR` of 2.5 they lose 2 dB. What repeats with every second row or column cannot be told from polarized light.
_CLEARLY = 3.0
# How much more layers are held to what is expected of them at these frequencies: where a wrong model would draw them
# below zero they escape by alternating otherwise. Costs 0.02 dB where the model holds.
_FIRMNESS = np.float32(100.0)


def mosaic_pattern(layers: Images, alternations: Alternations) -> Images:
    """What in layers alternates with the polarizers, beyond the detail that is there anyway.

    Parameters
    ----------
    layers : ndarray of float32, shape (2, channel, h, w)
        Solved for from the samples of a mosaic.
    alternations : tuple of (float, float)
        `Sampling.alternations` of its polarizers.

    Returns
    -------
    ndarray of float32, same shape
    """
    extended = mirrored_around(layers, _SIZE, "pixels")
    found = np.zeros_like(extended)
    places = _places(alternations)

    def turn(i: int) -> None:
        spectra = spectra_of(row_of(extended, i, _SIZE), _SIZE)
        flat = spectra.reshape(*spectra.shape[:3], -1)
        # Of all colours together.
        power = (np.square(flat.real) + np.square(flat.imag)).sum(axis=1)
        there = np.maximum(power @ places.near, np.finfo(np.float32).tiny)
        excess = np.maximum(1 - np.float32(_CLEARLY) * (power @ places.beside) / there, 0)
        flat *= (excess @ places.with_it)[:, None]
        add_to(row_of(found, i, _SIZE), spectra, _SIZE)

    in_rows(turn, extended.shape[-2] // _SIZE.step_px - 1)
    return np.ascontiguousarray(frame_of(found, _SIZE, *layers.shape[-2:]))


def firmness(height: int, width: int, alternations: Alternations) -> Images:
    """Factor (h, w // 2 + 1) by which layers of this size are held more to what is expected of them, by frequency."""
    apart = apart_from(alternations, np.fft.fftfreq(height), np.fft.rfftfreq(width))
    near = np.any(apart <= _WITH_IT / _SIZE.side_px, axis=0)
    return np.where(near, _FIRMNESS, np.float32(1))


class _Places(NamedTuple):
    """Frequencies of a window near each alternation and beside it, as weights of means (frequency, n), and those that
    go with it (n, frequency)."""

    near: Images
    beside: Images
    with_it: Images


@cache
def _places(alternations: Alternations) -> _Places:
    side = _SIZE.side_px
    apart = side * apart_from(alternations, np.fft.fftfreq(side), np.fft.rfftfreq(side)).reshape(len(alternations), -1)
    parts = apart <= _NEAR, (apart > _NEAR) & (apart <= _BESIDE)
    near, beside = ((part / part.sum(axis=1, keepdims=True)).T.astype(np.float32) for part in parts)
    return _Places(near, beside, (apart <= _WITH_IT).astype(np.float32))
