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
    """
    difference = np.asarray(image, dtype=np.float64) - np.asarray(reference, dtype=np.float64)
    if border:
        difference = difference[..., border:-border, border:-border]
    return float(10 * np.log10(peak**2 / max(float(np.mean(difference**2)), 1e-20)))
