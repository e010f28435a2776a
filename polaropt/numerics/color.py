"""Colours: an orthonormal basis of one luminance and fainter chroma, and grey shown as three equal channels."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Basis = NDArray[np.float64]
Image = NDArray[np.float32]

# Share of the edges' energy that is taken to lie as in the opponent basis, so that grey pictures have chroma; and that
# of a picture without edges. Set by hand.
ALWAYS_OPPONENT, LEAST_ENERGY = 1e-4, 1e-12


def opponent_basis(n_channels: int) -> Basis:
    """Orthonormal rows: the mean of all channels first, differences after it, shape (n, n).

    For three channels these are (r+g+b)/sqrt(3), (r-b)/sqrt(2) and (r-2g+b)/sqrt(6), up to order and sign.
    """
    ones = np.ones((n_channels, 1))
    columns = np.concatenate([ones, np.eye(n_channels)[:, : n_channels - 1]], axis=1)
    basis, triangle = np.linalg.qr(columns)
    return (basis * np.sign(np.diag(triangle))).T


def principal_colors(image: Image, blur_px: float) -> Basis:
    """Orthonormal rows in which the edges of an image are not correlated: the strongest first, shape (n, n).

    Of most photographs the first is nearly grey.

    Parameters
    ----------
    image : ndarray, shape (channel, h, w)
    blur_px : float
        Standard deviation of a blur that leaves out what is finer.
    """
    from scipy.ndimage import gaussian_filter

    n = image.shape[0]
    basis = opponent_basis(n)
    if n == 1:
        return basis
    smooth = gaussian_filter(image, (0, blur_px, blur_px))
    edges = [np.diff(smooth, axis=axis).reshape(n, -1).astype(np.float64) for axis in (1, 2)]
    energy = sum(edge @ edge.T for edge in edges) / smooth[0].size
    always = ALWAYS_OPPONENT * np.trace(energy) + LEAST_ENERGY
    rows = np.linalg.eigh(energy + always * basis.T @ np.diag(np.arange(n, 0, -1)) @ basis)[1].T[::-1]
    largest = np.take_along_axis(rows, np.abs(rows).argmax(axis=1)[:, None], axis=1)
    return np.asarray(rows * np.sign(largest))


def in_color(image: Image) -> Image:
    """Grey to three equal channels; colour as it is."""
    return np.repeat(image[..., None], 3, axis=-1) if image.ndim == 2 else image
