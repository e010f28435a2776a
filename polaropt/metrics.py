"""How near an image comes to another."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike


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
    if np.shape(image) != np.shape(reference):
        raise ValueError(f"the images have shapes {np.shape(image)} and {np.shape(reference)}; give two equal ones")
    difference = np.asarray(image, dtype=np.float64) - np.asarray(reference, dtype=np.float64)
    if border:
        difference = difference[..., border:-border, border:-border]
    if difference.size == 0:
        raise ValueError(f"a border of {border} px leaves nothing of images of shape {np.shape(image)}")
    return float(10 * np.log10(peak**2 / max(float(np.mean(difference**2)), 1e-20)))
