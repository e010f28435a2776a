"""Spreads that outliers do not move, of values that may lie on a grid, and what of an image is finest detail."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

MAD_TO_SIGMA = 1.4826
"""Standard deviation of normal values in units of their median absolute deviation: 1 / (sqrt(2) erfinv(1 / 2))."""
_SAMPLE = 65536
"""Values that the grid is looked for in: enough for the 2^16 levels of a file to show how far apart they are."""
_COARSEST_STEP, _FEWEST_LEVELS = 1 / 14, 8
"""Grids of fewer levels than those of 4 bits (15 steps) are taken for scenes of few values; set by hand."""


ROUNDED = 0.5
"""Noise in steps of the grey levels, below which it is rounding, which does not look normal; by trial."""


def quantization_step(intensities: NDArray[np.float32]) -> float:
    """Distance of the grey levels (white = 1), 0 for values that lie on no grid."""
    levels = np.unique(intensities[0].ravel()[:: max(1, intensities[0].size // _SAMPLE)])
    if levels.size < _FEWEST_LEVELS:
        return 0.0
    gaps = np.diff(levels.astype(np.float64))
    step = float(np.median(gaps[gaps <= 1.5 * np.quantile(gaps, 0.1)]))
    off_grid = np.abs(gaps / step - np.round(gaps / step))
    on_grid = float(np.mean(off_grid < 0.1)) > 0.9 and step > 2e-6
    return step if on_grid and step < _COARSEST_STEP else 0.0


def robust_spread(values: NDArray[np.float32], step: float) -> float:
    """Robust standard deviation of values on a grid of `step`.

    On a coarse grid the median deviation is a whole number of steps; a uniform jitter of one step fills the gaps, and
    its variance is taken off again. Where quantization itself is most of the noise the values are far from normal: the
    standard deviation without outliers is the better measure there.
    """
    center = float(np.median(values))
    jitter = np.random.default_rng(0).uniform(-0.5, 0.5, values.shape).astype(np.float32) * np.float32(step)
    jittered = values + jitter if step > 0 else values
    sigma = MAD_TO_SIGMA * float(np.median(np.abs(jittered - np.float32(center))))
    if sigma < 2 * step:
        sigma = _clipped_deviation(jittered, center, sigma)
    return float(np.sqrt(max(0.0, sigma**2 - step**2 / 12)))


def _clipped_deviation(values: NDArray[np.float32], center: float, sigma: float) -> float:
    for _ in range(4):
        kept = values[np.abs(values - np.float32(center)) <= 3.5 * sigma]
        sigma = float(np.sqrt(np.mean(np.square(kept - np.float32(center), dtype=np.float64))))
    return sigma


def second_differences(images: NDArray[np.float32]) -> NDArray[np.float32]:
    """Mixed second differences in both directions (Immerkaer 1996), scaled so that white noise keeps its sigma."""
    down = images[..., :-2, :] - 2 * images[..., 1:-1, :] + images[..., 2:, :]
    return np.asarray((down[..., :-2] - 2 * down[..., 1:-1] + down[..., 2:]) / np.float32(6))


def quietest_combination(samples: NDArray[np.float32]) -> NDArray[np.float32]:
    """Of samples (k, n) the combination (n,) of unit length that spreads least, the largest tenth apart."""
    sizes = np.abs(samples).max(axis=0)
    small = sizes <= np.quantile(sizes, 0.9)
    _, directions = np.linalg.eigh(np.cov(samples[:, small].astype(np.float64)))
    return np.tensordot(directions[:, 0].astype(np.float32), samples, axes=1)
