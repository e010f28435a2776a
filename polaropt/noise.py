"""How noisy the photographs are, from what more than three polarizer angles say twice."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from polaropt.capture import Capture
from polaropt.pair_gain import BLOCK, divide_out_gain, orthogonal_pairs, pair_gain_of, plausible, trusted_blocks
from polaropt.stokes import analyzer_matrix

_MAD_TO_SIGMA = 1.4826
_LEAST = 1e-6
_ENOUGH = 1000
_FEWEST = 100
_SAMPLE = 65536
_COARSEST_STEP, _FEWEST_LEVELS = 1 / 14, 8
_PILE = 5e-4
# In steps of the grey levels: below, the noise is rounding, which does not look normal.
ROUNDED = 0.5
_MOST_VALUES, _BAND = 2**18, 16
"""Values of a photograph that are enough, and rows of a band that is taken from a larger one."""


@dataclass(frozen=True)
class Redundancy:
    """What more than three photographs say twice, of pixels that can be trusted.

    Attributes
    ----------
    residual : ndarray, shape (k - 3, n)
        As of `redundancy_residual`, after a pair gain is divided out.
    intensity : ndarray, shape (n,)
        Mean of the photographs.
    """

    residual: NDArray[np.float32]
    intensity: NDArray[np.float32]


def noise_level(capture: Capture, seen: Redundancy | None = None) -> float:
    """Standard deviation of the noise of one photograph (white = 1), quantization included.

    From the redundancy ``I0 + I90 - I45 - I135`` (its generalization for other sets of angles), robustly, after a
    pair gain is divided out. With three angles nothing is said twice: there it comes from the finest detail of
    the combination of the photographs in which the scene cancels best, an upper bound.

    Clipped pixels and their neighbours do not count. A capture demosaiced to full resolution has the noise of its raw
    pixels, measured before their interpolation.

    Parameters
    ----------
    capture : Capture
    seen : Redundancy, optional
        That of the capture, where it is at hand.
    """
    if capture.origin is not None and capture.origin.raw_noise is not None:
        return capture.origin.raw_noise
    step = quantization_step(capture.intensities)
    if len(capture.angles_deg) == 3:
        spread = _noise_of_three_photographs(capture, step)
    else:
        spread = robust_spread((seen or redundancy(capture)).residual, step / 2)
    return float(max(_LEAST, spread, step / np.sqrt(12)))


def redundancy_residual(intensities: Any, angles_deg: Sequence[float]) -> Any:
    """What is left of k > 3 photographs beyond a Stokes vector, in orthonormal combinations (k - 3, ...).

    White noise of standard deviation sigma in the photographs has the same sigma here.
    """
    left, _, _ = np.linalg.svd(analyzer_matrix(angles_deg))
    return np.tensordot(left[:, 3:].T.astype(intensities.dtype), intensities, axes=1)


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


def redundancy(capture: Capture) -> Redundancy:
    """Residuals of more than three photographs with their intensities; of a large capture, bands of rows."""
    rows = _sampled_rows(capture.intensities[0].size, capture.shape[-2])
    intensities, valid = capture.intensities[..., rows, :], capture.valid[..., rows, :]
    trusted = _trusted(intensities, valid)
    intensities = _without_gain(intensities, capture.angles_deg, valid)
    residual = redundancy_residual(intensities, capture.angles_deg)
    return Redundancy(residual[:, trusted], intensities[:, trusted].mean(axis=0))


def noise_of_blocks(capture: Capture, noise: float) -> float:
    """Noise of a pixel, were it white, that leaves means of blocks as uncertain as they are.

    Where grey levels are coarser than the noise, the rounding errors of neighbours are alike, and their mean hardly
    falls with their number. Elsewhere this is the noise itself.

    Parameters
    ----------
    capture : Capture
    noise : float
        `noise_level` of the capture.
    """
    if len(capture.angles_deg) == 3 or noise >= ROUNDED * quantization_step(capture.intensities):
        return noise
    intensities = _without_gain(capture.intensities, capture.angles_deg, capture.valid)
    residual = redundancy_residual(trusted_blocks(intensities, capture.valid), capture.angles_deg)
    return max(noise, BLOCK * float(residual.std())) if residual.size else noise


def _without_gain(
    intensities: NDArray[np.float32], angles_deg: Sequence[float], valid: NDArray[np.bool_]
) -> NDArray[np.float32]:
    """Photographs after a plausible pair gain is divided out."""
    if orthogonal_pairs(angles_deg) is None:
        return intensities
    gain = pair_gain_of(intensities, angles_deg, valid)
    return intensities if gain is None or not plausible(gain) else divide_out_gain(intensities, angles_deg, gain)


def _sampled_rows(size: int, height: int) -> slice | NDArray[np.intp]:
    """All rows of a photograph of `size` values, or bands of neighbouring rows all over a large one."""
    n_bands = max(1, math.floor(height * _MOST_VALUES / size / _BAND))
    if n_bands * _BAND >= height:
        return slice(None)
    starts = np.linspace(0, height - _BAND, n_bands).astype(np.intp)
    rows: NDArray[np.intp] = (starts[:, None] + np.arange(_BAND)).ravel()
    return rows


def _noise_of_three_photographs(capture: Capture, step: float) -> float:
    """Robust spread of second differences, in the combination of the photographs in which they are smallest.

    Light of two unpolarized layers has no s2 in the pane's frame: three photographs are then combinations of two
    pictures, and one combination holds noise alone.
    """
    detail = _second_differences(capture.intensities)
    trusted = _trusted(capture.intensities, capture.valid)[..., 1:-1, 1:-1]
    samples = detail[:, trusted if trusted.any() else np.ones_like(trusted)]
    small = np.abs(samples).max(axis=0) <= np.quantile(np.abs(samples).max(axis=0), 0.9)
    _, directions = np.linalg.eigh(np.cov(samples[:, small].astype(np.float64)))
    return robust_spread(np.tensordot(directions[:, 0].astype(np.float32), samples, axes=1), step / 6)


def _second_differences(images: NDArray[np.float32]) -> NDArray[np.float32]:
    """Mixed second differences in both directions (Immerkaer 1996), scaled so that white noise keeps its sigma."""
    down = images[..., :-2, :] - 2 * images[..., 1:-1, :] + images[..., 2:, :]
    return np.asarray((down[..., :-2] - 2 * down[..., 1:-1] + down[..., 2:]) / np.float32(6))


def _trusted(intensities: NDArray[np.float32], all_valid: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Pixels ([channel,] h, w) away from anything clipped, at white or at the lowest value."""
    valid: NDArray[np.bool_] = np.asarray(all_valid.all(axis=0))
    at_lowest = intensities == intensities.min()
    if np.count_nonzero(at_lowest) > _PILE * at_lowest.size:
        valid &= ~at_lowest.any(axis=0)
    # Beside clipped pixels those survive whose noise happens to be small: a biased sample.
    inner = _eroded(valid)
    for mask, enough in ((inner, _ENOUGH), (valid, _FEWEST)):
        if np.count_nonzero(mask) >= enough:
            return mask
    return np.ones_like(valid)


def _eroded(mask: NDArray[np.bool_]) -> NDArray[np.bool_]:
    rows = mask.copy()
    rows[..., 1:, :] &= mask[..., :-1, :]
    rows[..., :-1, :] &= mask[..., 1:, :]
    both = rows.copy()
    both[..., :, 1:] &= rows[..., :, :-1]
    both[..., :, :-1] &= rows[..., :, 1:]
    return both


def robust_spread(values: NDArray[np.float32], step: float) -> float:
    """Robust standard deviation of values on a grid of `step`.

    On a coarse grid the median deviation is a whole number of steps; a uniform jitter of one step fills the gaps, and
    its variance is taken off again. Where quantization itself is most of the noise the values are far from normal: the
    standard deviation without outliers is the better measure there.
    """
    center = float(np.median(values))
    jitter = np.random.default_rng(0).uniform(-0.5, 0.5, values.shape).astype(np.float32) * np.float32(step)
    jittered = values + jitter if step > 0 else values
    sigma = _MAD_TO_SIGMA * float(np.median(np.abs(jittered - np.float32(center))))
    if sigma < 2 * step:
        sigma = _clipped_deviation(jittered, center, sigma)
    return float(np.sqrt(max(0.0, sigma**2 - step**2 / 12)))


def _clipped_deviation(values: NDArray[np.float32], center: float, sigma: float) -> float:
    for _ in range(4):
        kept = values[np.abs(values - np.float32(center)) <= 3.5 * sigma]
        sigma = float(np.sqrt(np.mean(np.square(kept - np.float32(center), dtype=np.float64))))
    return sigma
