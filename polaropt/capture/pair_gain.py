"""Two orthogonal pairs of polarizer angles: each pair sums to the intensity, up to the sensor's gain.

On polarization cameras ``I45 + I135 = g (I0 + I90)`` with g between 1.01 and 1.03; taken as 1 it biases every Stokes
image.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from polaropt.numerics import AnyMask, block_mean, strips, whole_blocks
from polaropt.optics import analyzer_matrix

Floats = NDArray[np.floating[Any]]
Change = Callable[[Floats], Floats]
Pairs = tuple[tuple[int, int], tuple[int, int]]

BLOCK = 8
"""Side in pixels of the blocks over which noise is averaged; set by hand."""
PLAUSIBLE_GAIN = (0.9, 1.1)
"""Gains that a sensor's pairs can have: those of real cameras are 1.01 to 1.03; set by hand."""
_DARK = 0.05
"""Blocks below this share of the brightest (99 % of them are below it) do not count: black levels; set by hand."""
_FEWEST_BLOCKS = 12
"""Blocks that a gain needs; set by hand."""
_SURE = 3.0
"""Standard errors beyond which photographs that do not add up are no chance: 99.7 % of a normal distribution."""


def orthogonal_pairs(angles_deg: Sequence[float], tolerance_deg: float = 0.5) -> Pairs | None:
    """Indices of the two orthogonal pairs among four angles, the pair nearest to 0/90 first; None if there are none."""
    if len(angles_deg) != 4:
        return None
    angles = np.asarray(angles_deg, dtype=np.float64) % 180
    for partner in (1, 2, 3):
        rest = [k for k in (1, 2, 3) if k != partner]
        if all(abs(abs(angles[a] - angles[b]) - 90) <= tolerance_deg for a, b in ((0, partner), (rest[0], rest[1]))):
            pairs = ((0, partner), (rest[0], rest[1]))
            nearest = [abs(np.sin(np.radians(2 * angles[a]))) for a, _ in pairs]
            return pairs if nearest[0] <= nearest[1] else (pairs[1], pairs[0])
    return None


def pair_signs(pairs: Pairs) -> Floats:
    """1 for both photographs of the first pair, -1 for those of the second: with these they add up to nothing."""
    signs = np.ones(4)
    signs[list(pairs[1])] = -1
    return signs


def trusted_blocks(intensities: Floats, valid: AnyMask, block: int = BLOCK, change: Change | None = None) -> Floats:
    """Block means of photographs (k, [channel,] h, w) where all of a block is valid in all of them, shape (k, n).

    `change`, if any, is made of the photographs before. Some rows at a time: photographs are much memory.
    """
    return np.concatenate(colour_blocks(intensities, valid, block, change), axis=1)


def colour_blocks(
    intensities: Floats, valid: AnyMask, block: int = BLOCK, change: Change | None = None
) -> list[Floats]:
    """`trusted_blocks` of each colour, in their order."""
    of_means, of_whole = [], []
    height = intensities.shape[-2]
    for rows in strips(height, intensities.size // height, block):
        part = intensities[..., rows, :]
        of_means.append(block_mean(part if change is None else change(part), block))
        of_whole.append(whole_blocks(np.asarray(valid[..., rows, :].all(axis=0)), block))
    means, whole = np.concatenate(of_means, axis=-2), np.concatenate(of_whole, axis=-2)
    bright = means.mean(axis=0)
    trusted = whole & (means.min(axis=0) > 0)
    if bright.size:
        trusted &= bright > _DARK * np.quantile(bright, 0.99)
    blocks_of = means.shape[-2:]
    planes = zip(
        np.moveaxis(means.reshape(len(means), -1, *blocks_of), 1, 0), trusted.reshape(-1, *blocks_of), strict=True
    )
    return [plane[:, where] for plane, where in planes]


def redundancy_residual(intensities: Any, angles_deg: Sequence[float]) -> Any:
    """What is left of k > 3 photographs beyond a Stokes vector, in orthonormal combinations (k - 3, ...).

    White noise of standard deviation sigma in the photographs has the same sigma here.
    """
    left, _, _ = np.linalg.svd(analyzer_matrix(angles_deg))
    return np.tensordot(left[:, 3:].T.astype(intensities.dtype), intensities, axes=1)


def closure_share(intensities: Floats, angles_deg: Sequence[float], valid: AnyMask) -> float:
    """Share of the light by which photographs do not add up as those of any light would; 0 where that may be noise.

    Gains that differ by sigma leave about sigma / 2. Three photographs always add up.

    Parameters
    ----------
    intensities : ndarray, shape (k, [channel,] h, w)
        Linear photographs.
    angles_deg : sequence of k floats
        Their polarizer angles in degrees.
    valid : ndarray of bool or BitMask, same shape
        Pixels that can be trusted.
    """
    means = trusted_blocks(intensities, valid).astype(np.float64)
    if len(means) < 4 or means.shape[1] < _FEWEST_BLOCKS:
        return 0.0
    light, left = np.sqrt(np.sum(means**2, axis=0)), redundancy_residual(means, angles_deg)
    share = left @ light / (light @ light)
    error = math.sqrt(float(np.mean((left - share[:, None] * light) ** 2)) / float(light @ light))
    found = float(np.linalg.norm(share))
    return found if found > _SURE * error else 0.0


def pair_gain_of(intensities: Floats, angles_deg: Sequence[float], valid: AnyMask | None = None) -> float | None:
    """Gain g of the second orthogonal pair against the first, ``I45 + I135 = g (I0 + I90)``.

    Parameters
    ----------
    intensities : ndarray, shape (4, [channel,] h, w)
        Linear photographs.
    angles_deg : sequence of 4 floats
        Their polarizer angles in degrees: two orthogonal pairs.
    valid : ndarray of bool or BitMask, same shape, optional
        Pixels that can be trusted.

    Returns
    -------
    float or None
        The weighted median over 8x8 blocks that are valid throughout; None where the angles are no two orthogonal
        pairs or too little of the capture can be used.
    """
    pairs = orthogonal_pairs(angles_deg)
    if pairs is None:
        return None
    trusted = np.broadcast_to(np.True_, intensities.shape) if valid is None else valid
    means = trusted_blocks(intensities, trusted)
    if means.shape[1] < _FEWEST_BLOCKS:
        return None
    first, second = (means[a] + means[b] for a, b in pairs)
    return _weighted_median(second / first, first)


def gain_remover(intensities: Floats, angles_deg: Sequence[float], valid: AnyMask) -> Change | None:
    """What divides a plausible pair gain out of photographs; None where there is none."""
    gain = pair_gain_of(intensities, angles_deg, valid)
    return partial(divide_out_gain, angles_deg=angles_deg, gain=gain) if gain is not None and plausible(gain) else None


def divide_out_gain(intensities: Floats, angles_deg: Sequence[float], gain: float) -> Floats:
    """Photographs with the gain of the second orthogonal pair (45/135) removed."""
    pairs = orthogonal_pairs(angles_deg)
    if pairs is None or gain == 1:
        return intensities
    corrected = intensities.copy()
    corrected[list(pairs[1])] /= corrected.dtype.type(gain)
    return corrected


def plausible(gain: float | None) -> bool:
    """Whether a fitted gain can be a sensor's, and not the sign of swapped or encoded photographs."""
    return gain is not None and PLAUSIBLE_GAIN[0] <= gain <= PLAUSIBLE_GAIN[1]


def _weighted_median(values: Floats, weights: Floats) -> float:
    order = np.argsort(values)
    cumulated = np.cumsum(weights[order], dtype=np.float64)
    return float(values[order][np.searchsorted(cumulated, cumulated[-1] / 2)])
