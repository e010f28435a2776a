"""An orthonormal basis of the colours: one luminance and the rest chroma, whose edges are far fainter."""

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
