"""What JPEG has done to a photograph, as the file tells it."""

from __future__ import annotations

import math
from dataclasses import dataclass

# Mean of the luminance table that the standard recommends (ITU-T T.81, table K.1), whose quality encoders call 50.
_MEAN_AT_50 = 57.625
_LEVELS = 255.0
_START, _TABLES, _SCAN = 0xD8, 0xDB, 0xDA
_FRAMES = (0xC0, 0xC1, 0xC2)


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


def jpeg_facts(data: bytes) -> JpegFacts | None:
    """Facts from the header of a JPEG; None where it has no tables."""
    luminance: list[int] = []
    factors: list[int] = []
    position = 2
    while position + 4 <= len(data) and data[position] == 0xFF and data[position + 1] != _SCAN:
        kind, length = data[position + 1], int.from_bytes(data[position + 2 : position + 4], "big")
        segment = data[position + 4 : position + 2 + length]
        if kind == _TABLES and not luminance:
            wide, number = divmod(segment[0], 16)
            values = segment[1 : 1 + 64 * (1 + wide)]
            if number == 0:
                luminance = [int.from_bytes(values[i : i + 1 + wide], "big") for i in range(0, len(values), 1 + wide)]
        elif kind in _FRAMES and len(segment) >= 6:
            factors = [segment[6 + 3 * i + 1] for i in range(segment[5]) if 6 + 3 * i + 1 < len(segment)]
        position += 2 + length
    if len(luminance) != 64:
        return None
    scale = 100 * sum(luminance) / 64 / _MEAN_AT_50
    quality = round(5000 / scale if scale > 100 else 100 - scale / 2)
    # Rounding to multiples of q leaves q^2 / 12; the transform is orthonormal.
    step = math.sqrt(sum(value**2 for value in luminance) / 64 / 12) / _LEVELS
    return JpegFacts(min(100, max(1, quality)), len(factors) == 3 and len(set(factors)) > 1, step)
