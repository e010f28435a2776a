"""Linear layers made visible: one exposure for both, and pictures side by side."""

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


def common_exposure(transmission: Image, reflection: Image) -> float:
    """Factor on both layers that brings the 99 % quantile of the brighter one to white.

    One factor, so that the two pictures compare as the layers do.
    """
    brightest = max(float(np.quantile(layer, _WHITE_SHARE)) for layer in (transmission, reflection))
    return 1 / brightest if brightest > 0 else 1.0


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
