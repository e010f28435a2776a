"""Colours: an orthonormal basis of one luminance and fainter chroma, and grey shown as three equal channels."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Basis = NDArray[np.float64]


def opponent_basis(n_channels: int) -> Basis:
    """Orthonormal rows: the mean of all channels first, differences after it, shape (n, n).

    For three channels these are (r+g+b)/sqrt(3), (r-b)/sqrt(2) and (r-2g+b)/sqrt(6), up to order and sign.
    """
    ones = np.ones((n_channels, 1))
    columns = np.concatenate([ones, np.eye(n_channels)[:, : n_channels - 1]], axis=1)
    basis, triangle = np.linalg.qr(columns)
    return (basis * np.sign(np.diag(triangle))).T


Image = NDArray[np.float32]


def in_color(image: Image) -> Image:
    """Grey to three equal channels; colour as it is."""
    return np.repeat(image[..., None], 3, axis=-1) if image.ndim == 2 else image
