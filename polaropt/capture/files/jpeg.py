"""What JPEG has done to a photograph, as the file tells it."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

# Mean of the luminance table that the standard recommends (ITU-T T.81, table K.1), whose quality encoders call 50.
_MEAN_AT_50 = 57.625
_LEVELS = 255.0
_TABLES, _SCAN = 0xDB, 0xDA
FRAMES = tuple(kind for kind in range(0xC0, 0xD0) if kind not in (0xC4, 0xC8, 0xCC))
"""Marks of a frame's header (ITU-T T.81, table B.1)."""
_ALONE = (0x01, *range(0xD0, 0xD9))
"""Marks that no segment follows."""


@dataclass(frozen=True)
class JpegFacts:
    """How strongly a JPEG was compressed.

    Attributes
    ----------
    quality : int
        On the scale of the usual encoders, 1 to 100, from the mean of the luminance table.
    halved_colors : bool
        Whether colours have fewer pixels than the brightness (chroma subsampling).
    step : float
        Standard deviation of the error that rounding its coefficients leaves to a pixel at most, white = 1, in the
        file's encoding.
    """

    quality: int
    halved_colors: bool
    step: float


def jpeg_segments(data: bytes) -> Iterator[tuple[int, bytes]]:
    """Marks and contents of all segments before the first scan, found as decoders do: what lies between is passed."""
    position = 2
    while True:
        position = data.find(b"\xff", position)
        if position < 0:
            return
        while data[position : position + 1] == b"\xff":
            position += 1
        kind = data[position] if position < len(data) else _SCAN
        position += 1
        if kind == _SCAN:
            return
        if kind == 0 or kind in _ALONE:
            continue
        length = int.from_bytes(data[position : position + 2], "big")
        yield kind, data[position + 2 : position + length]
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
    scale = 100 * sum(luminance) / 64 / _MEAN_AT_50
    quality = round(5000 / scale if scale > 100 else 100 - scale / 2)
    # Rounding to multiples of q leaves q^2 / 12; the transform is orthonormal.
    step = math.sqrt(sum(value**2 for value in luminance) / 64 / 12) / _LEVELS
    return JpegFacts(min(100, max(1, quality)), len(factors) == 3 and len(set(factors)) > 1, step)
