"""What the photographs themselves tell about mistakes: gamma encoding, swapped files."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from polaropt.capture import Capture
from polaropt.noise import redundancy_residual
from polaropt.pair_gain import Floats, orthogonal_pairs, trusted_blocks

_FEWEST_BLOCKS = 50
_ENOUGH_BLOCKS = 3000
_CERTAIN = 0.15
# Blocks are no independent samples: an accusation needs far more than the usual three deviations.
_SURE, _LIKELY = 10.5, 6.0
# Differences in exposure between the photographs of one pair, as logarithms.
_EXPOSURES = (0.02, 0.02)
_LINEAR = (0.75, 1.3)
_BRIGHT = 0.4
_MUCH_BETTER = 0.5
_ABOVE_NOISE = 0.003


@dataclass(frozen=True)
class GammaFit:
    """Exponent that makes the photographs linear: 1 for linear data, about 2.2 for sRGB.

    Attributes
    ----------
    exponent : float
    standard_error : float
        Large where the light is hardly polarized.
    """

    exponent: float
    standard_error: float

    @property
    def certain(self) -> bool:
        """Whether the exponent means anything."""
        return self.standard_error < _CERTAIN * self.exponent

    @property
    def encoded(self) -> bool:
        """Whether the photographs are surely not linear."""
        return self._differs(_SURE)

    @property
    def likely_encoded(self) -> bool:
        """Whether they are not linear, if something else tells that the pairs do not add up."""
        return self._differs(_LIKELY)

    def _differs(self, deviations: float) -> bool:
        beyond = abs(np.log(self.exponent)) * self.exponent > deviations * self.standard_error
        return bool(self.certain and beyond and not _LINEAR[0] <= self.exponent <= _LINEAR[1])


def checked_blocks(capture: Capture) -> Floats:
    """Means (k, n) of 8x8 blocks that are valid throughout, evenly chosen where there are many."""
    blocks = trusted_blocks(capture.intensities, capture.valid)
    return blocks[:, :: max(1, blocks.shape[1] // _ENOUGH_BLOCKS)]


def fit_gamma(capture: Capture, blocks: Floats | None = None) -> GammaFit | None:
    """How the photographs are encoded, from sums of orthogonal pairs.

    If values are ``v = I^(1/gamma)``, the sum of an orthogonal pair depends on how strongly the light is polarized
    along it: ``log((v45 + v135) / (v0 + v90))`` has the slope ``(gamma - 1)/2`` against ``d0^2 - d45^2``, where d0 and
    d45 are the contrasts of the two pairs. That is the first order in their squares; it is repeated on the linearized
    values. A gain of one pair or of one photograph does not matter.

    Parameters
    ----------
    capture : Capture
    blocks : ndarray, shape (k, n), optional
        `checked_blocks` of the capture, if they are at hand.

    Returns
    -------
    GammaFit or None
        None where the angles are no two orthogonal pairs, or too few 8x8 blocks are unclipped.
    """
    pairs = orthogonal_pairs(capture.angles_deg)
    if pairs is None:
        return None
    blocks = checked_blocks(capture).astype(np.float64) if blocks is None else blocks.astype(np.float64)
    if blocks.shape[1] < _FEWEST_BLOCKS:
        return None
    exponent, error = 1.0, 0.0
    for _ in range(8):
        slope, error = _pair_slope(blocks**exponent, pairs)
        factor = float(np.clip(1 + 2 * slope, 0.5, 2))
        exponent = float(np.clip(exponent * factor, 0.1, 10))
        # Much below the error further rounds tell nothing.
        if abs(factor - 1) < max(1e-3, 0.2 * error):
            break
    return GammaFit(exponent, 2 * error * exponent)


def _pair_slope(blocks: Floats, pairs: tuple[tuple[int, int], tuple[int, int]]) -> tuple[float, float]:
    """Slope of the logarithmic ratio of the pair sums against d0^2 - d45^2, and its standard error."""
    sums = [blocks[a] + blocks[b] for a, b in pairs]
    # Dark blocks: noise makes both contrasts and ratio large together, which looks like an exponent.
    bright = sums[0] + sums[1] > _BRIGHT * np.median(sums[0] + sums[1])
    sums, blocks = [total[bright] for total in sums], blocks[:, bright]
    first, second = ((blocks[a] - blocks[b]) / total for (a, b), total in zip(pairs, sums, strict=True))
    # An exposure of its own in each photograph makes the ratio follow the contrasts themselves.
    columns = np.stack([first**2 - second**2, first, second, np.ones_like(first)], axis=1)
    weights, error = _robust_regression(columns, np.log(sums[1] / sums[0]), expected=(np.inf, *_EXPOSURES, np.inf))
    return float(weights[0]), error


def _robust_regression(columns: Floats, values: Floats, expected: tuple[float, ...]) -> tuple[Floats, float]:
    """Least squares without outliers beyond 3 robust deviations, and the first coefficient's standard error.

    `expected` holds how large each coefficient may be expected to be (a Gaussian prior).
    """
    kept = np.ones(values.shape, dtype=bool)
    weights: Floats = np.zeros(columns.shape[1])
    error = np.inf
    variance = float(np.var(values))
    for _ in range(5):
        used = columns[kept]
        normal = used.T @ used / max(variance, 1e-12) + np.diag([size**-2 for size in expected])
        if np.linalg.cond(normal) > 1e12:
            return weights, np.inf
        weights = np.linalg.solve(normal, used.T @ values[kept] / max(variance, 1e-12))
        error = float(np.sqrt(np.linalg.inv(normal)[0, 0]))
        residual = values - columns @ weights
        variance = float(np.mean(residual[kept] ** 2))
        kept = np.abs(residual) <= 3 * max(1.4826 * float(np.median(np.abs(residual))), 1e-9)
    return weights, error


def swapped_photographs(capture: Capture, blocks: Floats | None = None) -> tuple[tuple[int, int], ...]:
    """Pairs of photographs of which one looks swapped, by their indices; empty if the order looks right.

    A wrong order breaks ``I0 + I90 = I45 + I135`` (its generalization for other angles). Each exchange of two
    photographs is tried; those are named with which the identity holds at least twice as well. Where several serve
    equally all are named: exchanging 45 and 90 or 0 and 135, of four, forms the same pairs. Three angles tell nothing.

    `blocks` are the capture's `checked_blocks`, if they are at hand.
    """
    count = len(capture.angles_deg)
    blocks = checked_blocks(capture) if blocks is None else blocks
    if count < 4 or blocks.shape[1] < _FEWEST_BLOCKS:
        return ()
    given = _misfit(blocks, capture.angles_deg)
    exchanges = list(combinations(range(count), 2))
    misfits = np.array([_misfit(_exchanged(blocks, a, b), capture.angles_deg) for a, b in exchanges])
    best = float(misfits.min())
    if given < _ABOVE_NOISE or best > _MUCH_BETTER * given:
        return ()
    return tuple(exchanges[k] for k in np.flatnonzero(misfits <= 1.1 * best + 1e-6))


def _exchanged(blocks: Floats, first: int, second: int) -> Floats:
    order = np.arange(blocks.shape[0])
    order[[first, second]] = second, first
    return blocks[order]


def _misfit(blocks: Floats, angles_deg: Sequence[float]) -> float:
    """Size of what no Stokes vector explains, relative to the intensity, a constant gain apart."""
    residual: NDArray[np.floating] = redundancy_residual(blocks, angles_deg) / blocks.mean(axis=0)
    return float(np.mean(np.abs(residual - np.median(residual, axis=-1, keepdims=True))))
