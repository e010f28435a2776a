"""How noisy the photographs are, from what more than three polarizer angles say twice."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from polaropt.capture import Capture
from polaropt.stokes import analyzer_matrix

_MAD_TO_SIGMA = 1.4826
_LEAST = 1e-6


def noise_level(capture: Capture) -> float:
    """Standard deviation of the noise of one photograph (white = 1).

    From the redundancy ``I0 + I90 - I45 - I135`` (its generalization for other sets of angles), robustly; from the
    finest wavelet coefficients of one photograph where there are only three angles.
    """
    if len(capture.angles_deg) == 3:
        return max(_LEAST, _noise_of_one_photograph(capture))
    residual = redundancy_residual(capture.intensities, capture.angles_deg)
    trusted = np.broadcast_to(capture.valid.all(axis=0), residual.shape)
    values = residual[trusted] if trusted.any() else residual.ravel()
    # Differences of neighbours would be blind to gain errors; the median of the pixels themselves is removed instead.
    spread = _MAD_TO_SIGMA * float(np.median(np.abs(values - np.median(values))))
    return max(_LEAST, spread, _quantization_step(capture) / np.sqrt(12))


def redundancy_residual(intensities: Any, angles_deg: Sequence[float]) -> Any:
    """What is left of k > 3 photographs beyond a Stokes vector, in orthonormal combinations (k - 3, ...).

    White noise of standard deviation sigma in the photographs has the same sigma here.
    """
    left, _, _ = np.linalg.svd(analyzer_matrix(angles_deg))
    return np.tensordot(left[:, 3:].T.astype(intensities.dtype), intensities, axes=1)


def _noise_of_one_photograph(capture: Capture) -> float:
    from skimage.restoration import estimate_sigma

    first: NDArray[np.float32] = capture.intensities[0]
    return float(estimate_sigma(first, channel_axis=0 if capture.color else None, average_sigmas=True))


def _quantization_step(capture: Capture) -> float:
    """Smallest difference between values: a lower bound of the noise where all others cancel."""
    values = np.unique(capture.intensities[0].ravel()[:65536])
    return float(np.diff(values).min()) if values.size > 1 else 0.0
