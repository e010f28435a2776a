"""Linear layers made visible: exposure, and pictures side by side."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from polaropt.image_io import encode_srgb
from polaropt.photographs import in_color

Image = NDArray[np.float32]
Picture = NDArray[np.uint8]

_WHITE_SHARE = 0.99
_TITLE = 24
_GAP = 8
_LETTERS = 14


def viewing_exposure(layer: Image) -> float:
    """Factor that brings the 99 % quantile of a layer to white.

    Each layer has its own: a mirrored sky is up to fifty times as bright as what is behind the surface, and with one
    factor for both the other picture would be black.
    """
    bright = float(np.quantile(layer, _WHITE_SHARE))
    return 1 / bright if bright > 0 else 1.0


def side_by_side(rows: Sequence[Sequence[tuple[str, Image | None]]], exposure: float = 1.0) -> Picture:
    """Rows of linear images (h, w[, 3]) of one size with titles, as 8-bit sRGB (h, w, 3); None leaves a gap."""
    from PIL import Image as Pillow
    from PIL import ImageDraw, ImageFont

    height, width = next(image.shape[:2] for _, image in rows[0] if image is not None)
    size = (_GAP + max(map(len, rows)) * (width + _GAP), _GAP + len(rows) * (height + _TITLE + _GAP))
    canvas = Pillow.new("RGB", size, (255, 255, 255))
    draw, font = ImageDraw.Draw(canvas), ImageFont.load_default(_LETTERS)
    for i, row in enumerate(rows):
        for j, (title, image) in enumerate(row):
            left, top = _GAP + j * (width + _GAP), _GAP + i * (height + _TITLE + _GAP)
            draw.text((left, top + 2), title, fill=0, font=font)
            if image is not None:
                pixels = np.round(255 * encode_srgb(in_color(image) * exposure)).astype(np.uint8)
                canvas.paste(Pillow.fromarray(pixels), (left, top + _TITLE))
    return np.asarray(canvas, dtype=np.uint8)
