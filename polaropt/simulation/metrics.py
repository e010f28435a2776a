"""How near an image comes to another."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

_SIMILARITY_SIGMA_PX = 1.5
"""Deviation of the Gaussian window of SSIM (Wang et al. 2004)."""
_LEAST_SQUARE = 1e-20
"""Mean square that equal images are given: 200 dB."""


def psnr_db(image: ArrayLike, reference: ArrayLike, border: int = 0, peak: float = 1.0) -> float:
    """Peak signal-to-noise ratio in dB of images (..., h, w), less `border` pixels all round.

    Parameters
    ----------
    image, reference : array_like, shape (..., h, w)
    border : int
        Pixels left out at each side.
    peak : float
        The value of white.

    Returns
    -------
    float

    Raises
    ------
    ValueError
        Images of different shape, or a border that leaves nothing.
    """
    _check_shapes(image, reference)
    difference = np.asarray(image, dtype=np.float64) - np.asarray(reference, dtype=np.float64)
    if border:
        difference = difference[..., border:-border, border:-border]
    if difference.size == 0:
        raise ValueError(f"a border of {border} px leaves nothing of images of shape {np.shape(image)}")
    return float(10 * np.log10(peak**2 / max(float(np.mean(difference**2)), _LEAST_SQUARE)))


def similarity_map(image: ArrayLike, reference: ArrayLike, peak: float = 1.0) -> NDArray[np.float64]:
    """Structural similarity (SSIM) of images (..., h, w) around each pixel, mean over the axes before height and width.

    With a Gaussian window of 1.5 px, as in Wang, Bovik, Sheikh, Simoncelli, "Image quality assessment: from error
    visibility to structural similarity", IEEE TIP 2004.

    Parameters
    ----------
    image, reference : array_like, shape (..., h, w)
    peak : float
        The value of white.

    Returns
    -------
    ndarray, shape (h, w)
        Its mean is the SSIM.

    Raises
    ------
    ValueError
        Images of different shape.
    """
    from skimage import metrics

    structural_similarity: Any = metrics.structural_similarity
    _check_shapes(image, reference)
    height, width = np.shape(image)[-2:]
    planes = (np.reshape(np.asarray(each, dtype=np.float64), (-1, height, width)) for each in (image, reference))
    maps = [
        structural_similarity(
            *pair, data_range=peak, gaussian_weights=True, sigma=_SIMILARITY_SIGMA_PX, use_sample_covariance=False,
            full=True,
        )[1]
        for pair in zip(*planes, strict=True)
    ]  # fmt: skip
    return np.asarray(np.mean(maps, axis=0))


def _check_shapes(image: ArrayLike, reference: ArrayLike) -> None:
    if np.shape(image) != np.shape(reference):
        raise ValueError(f"the images have shapes {np.shape(image)} and {np.shape(reference)}; give two equal ones")
