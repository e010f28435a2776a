"""What JPEG has done to a photograph, as the file tells it, or its pixels where it was saved again as PNG or TIFF."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

# Mean of the luminance table that the standard recommends (ITU-T T.81, table K.1), whose quality encoders call 50.
_MEAN_AT_50 = 57.625
_LEVELS = 255.0
_TABLES, _SCAN = 0xDB, 0xDA
FRAMES = tuple(kind for kind in range(0xC0, 0xD0) if kind not in (0xC4, 0xC8, 0xCC))
"""Marks of a frame's header (ITU-T T.81, table B.1)."""
_ALONE = (0x01, *range(0xD0, 0xD9))
"""Marks that no segment follows."""

Floats = NDArray[np.float64]

# Luminance table of the standard (ITU-T T.81, table K.1), row by row.
_TABLE = np.array(
    [
        [16, 11, 10, 16, 24, 40, 51, 61],
        [12, 12, 14, 19, 26, 58, 60, 55],
        [14, 13, 16, 24, 40, 57, 69, 56],
        [14, 17, 22, 29, 51, 87, 80, 62],
        [18, 22, 37, 56, 68, 109, 103, 77],
        [24, 35, 55, 64, 81, 104, 113, 92],
        [49, 64, 78, 87, 103, 121, 120, 101],
        [72, 92, 95, 98, 112, 100, 103, 99],
    ]
)
# Brightness and a colour difference of red, green and blue (ITU-R BT.601), as JPEG files have them.
_BRIGHTNESS, _BLUENESS = np.array([0.299, 0.587, 0.114]), np.array([-0.168736, -0.331264, 0.5])
_BLOCK = 8
# Pixels a side that are looked at, in the middle of the photograph; set by hand.
_LOOKED_AT = 512
# Steps that are tried, coefficients that a step is judged by at least, and in steps the least of those; by trial.
_STEPS, _FEWEST, _LEAST = range(2, 80), 30, 0.6
# The mean cosine of a turn for each step is 1 on its multiples, and less by the rounding of pixels, 1 / 12 of variance;
# what of that is enough, by trial: twice the step has less where a fifth of them are odd.
_ON_MULTIPLES = 0.8
_ROUNDED = 1 / 12
# Frequencies with such a step that tell a JPEG: 28 to 55 of 63 in one, none in photographs that were none; by trial.
_TELLING = 6
# Share of them in colours up to which these have other blocks than the brightness; set by hand.
_OF_OTHER_BLOCKS = 0.25
_UNTOLD = -1


@dataclass(frozen=True)
class JpegFacts:
    """How strongly a JPEG, or a HEIF picture, was compressed.

    Attributes
    ----------
    quality : int or None
        On the scale of the usual encoders, 1 to 100, from the mean of the luminance table. None of HEIF, which tells
        none.
    halved_colors : bool
        Whether colours have fewer pixels than the brightness (chroma subsampling).
    step : float
        Standard deviation of the error that rounding its coefficients leaves to a pixel at most, white = 1, in the
        file's encoding; 0 of HEIF.
    saved_again : bool
        Whether the file is none, and its pixels tell that they came from one.
    """

    quality: int | None
    halved_colors: bool
    step: float
    saved_again: bool = False


def jpeg_segments(data: bytes) -> Iterator[tuple[int, bytes]]:
    """Marks and contents of all segments before the first scan."""
    for kind, start, stop in _marks(data):
        if kind != _SCAN:
            yield kind, data[start:stop]


def jpeg_scan(data: bytes) -> int:
    """Where the picture's own data begin: after all segments, whose thumbnail has an end mark of its own."""
    return next((start for kind, start, _ in _marks(data) if kind == _SCAN), len(data))


def _marks(data: bytes) -> Iterator[tuple[int, int, int]]:
    """Marks up to the first scan, found as decoders do: what lies between is passed. With each its contents' place."""
    position = 2
    while True:
        position = data.find(b"\xff", position)
        if position < 0:
            return
        while data[position : position + 1] == b"\xff":
            position += 1
        kind = data[position] if position < len(data) else _SCAN
        position += 1
        if kind == 0 or kind in _ALONE:
            continue
        length = int.from_bytes(data[position : position + 2], "big")
        yield kind, position + 2, position + length
        if kind == _SCAN:
            return
        position += max(length, 2)


def jpeg_facts(data: bytes) -> JpegFacts | None:
    """Facts from the header of a JPEG; None where it has no tables."""
    luminance: list[int] = []
    factors: list[int] = []
    for kind, segment in jpeg_segments(data):
        if kind == _TABLES and segment and not luminance:
            wide, number = divmod(segment[0], 16)
            values = segment[1 : 1 + 64 * (1 + wide)]
            if number == 0:
                luminance = [int.from_bytes(values[i : i + 1 + wide], "big") for i in range(0, len(values), 1 + wide)]
        elif kind in FRAMES and len(segment) >= 6:
            factors = [segment[6 + 3 * i + 1] for i in range(segment[5]) if 6 + 3 * i + 1 < len(segment)]
    if len(luminance) != 64:
        return None
    quality = _quality(sum(luminance) / 64 / _MEAN_AT_50)
    return JpegFacts(quality, len(factors) == 3 and len(set(factors)) > 1, _step(np.array(luminance)))


def _quality(scale: float) -> int:
    """On the scale of the usual encoders, of tables that are so many times the standard's."""
    quality = 50 / scale if scale > 1 else 100 - 50 * scale
    return min(100, max(1, round(quality)))


def _step(table: NDArray[Any]) -> float:
    """`JpegFacts.step` of a table: rounding to multiples of q leaves q^2 / 12; the transform is orthonormal."""
    return math.sqrt(float(np.mean(np.square(table.astype(np.float64)))) / 12) / _LEVELS


def jpeg_traces(pixels: NDArray[Any]) -> JpegFacts | None:
    """Whether pixels were a JPEG before they were saved as something else, by the steps that its coefficients lie on.

    The cosine transform of blocks of 8x8 pixels has multiples of the file's steps, blurred by the rounding of pixels
    alone (Fan and de Queiroz 2003). What was scaled, turned or developed since does not show it.

    Parameters
    ----------
    pixels : ndarray, shape (h, w) or (h, w, 3)
        Integers; of 16 bits only those that are 8 bits stretched.

    Returns
    -------
    JpegFacts or None
    """
    levels = _eight_bits(pixels)
    if levels is None:
        return None
    bright = levels @ _BRIGHTNESS if levels.ndim == 3 else levels
    for corner in dict.fromkeys([(0, 0), _corner_of_blocks(bright)]):
        found = _steps_of(bright[corner[0] :, corner[1] :])
        known = found > 0
        if np.count_nonzero(known) >= _TELLING:
            scale = float(np.median(found[known] / _TABLE[known]))
            table = np.where(known, found, np.maximum(1, scale * _TABLE))
            return JpegFacts(_quality(scale), _halved(levels, corner), _step(table), saved_again=True)
    return None


def _eight_bits(pixels: NDArray[Any]) -> Floats | None:
    """The middle of a photograph, in levels of 8 bits around their middle; None where it has others."""
    grey_or_color = pixels.ndim == 2 or (pixels.ndim == 3 and pixels.shape[2] == len(_BRIGHTNESS))
    if not grey_or_color or pixels.dtype.kind != "u" or pixels.dtype.itemsize > 2:
        return None
    if min(pixels.shape[:2]) < 2 * _BLOCK:
        return None
    top, left = (max(0, side - _LOOKED_AT) // 2 // _BLOCK * _BLOCK for side in pixels.shape[:2])
    part = pixels[top : top + _LOOKED_AT, left : left + _LOOKED_AT]
    if part.dtype.itemsize == 2:
        full = int(np.iinfo(np.uint16).max) // int(_LEVELS)
        if np.any(part % full):
            return None
        part = part // full
    return part.astype(np.float64) - _LEVELS / 2


def _corner_of_blocks(bright: Floats) -> tuple[int, int]:
    """Row and column at which blocks begin, where a photograph was cut: there it jumps most."""
    return _most_uneven(np.abs(np.diff(bright, axis=0)).mean(axis=1)), _most_uneven(
        np.abs(np.diff(bright, axis=1)).mean(axis=0)
    )


def _most_uneven(jumps: Floats) -> int:
    whole = jumps[: len(jumps) // _BLOCK * _BLOCK].reshape(-1, _BLOCK)
    return (int(np.argmax(np.median(whole, axis=0))) + 1) % _BLOCK


def _steps_of(plane: Floats) -> NDArray[np.int_]:
    """Step of each frequency's coefficients; 0 where they lie on no multiples, `_UNTOLD` where they are too few."""
    from scipy.fft import dctn

    height, width = (side // _BLOCK for side in plane.shape)
    blocks = plane[: height * _BLOCK, : width * _BLOCK].reshape(height, _BLOCK, width, _BLOCK).swapaxes(1, 2)
    sizes = np.abs(dctn(blocks, axes=(-2, -1), norm="ortho")).reshape(-1, _BLOCK, _BLOCK)
    steps = np.full((_BLOCK, _BLOCK), _UNTOLD, dtype=np.int_)
    for row, column in list(np.ndindex(_BLOCK, _BLOCK))[1:]:
        size = np.sort(sizes[:, row, column])
        for step in _STEPS:
            # Nought is a multiple of all.
            told = size[np.searchsorted(size, _LEAST * step) :]
            if told.size < _FEWEST:
                break
            steps[row, column] = max(int(steps[row, column]), 0)
            turn = 2 * np.pi / step
            if np.cos(turn * told).mean() > _ON_MULTIPLES * math.exp(-(turn**2) * _ROUNDED / 2):
                steps[row, column] = step
    return steps


def _halved(levels: Floats, corner: tuple[int, int]) -> bool:
    """Whether colours have other blocks than the brightness: those of a picture of half the size."""
    if levels.ndim != 3:
        return False
    steps = _steps_of((levels @ _BLUENESS)[corner[0] :, corner[1] :])
    judged = np.count_nonzero(steps != _UNTOLD)
    return bool(judged >= _TELLING and np.count_nonzero(steps > 0) < _OF_OTHER_BLOCKS * judged)
