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
_CERTAIN = 0.15
_LINEAR = (0.8, 1.25)
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
        return self.certain and not _LINEAR[0] <= self.exponent <= _LINEAR[1]


def fit_gamma(capture: Capture) -> GammaFit | None:
    """How the photographs are encoded, from sums of orthogonal pairs.

    If values are ``v = I^(1/gamma)``, the sum of an orthogonal pair depends on how strongly the light is polarized along
    it: ``log((v45 + v135) / (v0 + v90))`` has the slope ``(gamma - 1)/2`` against ``d0^2 - d45^2``, where d0 and d45 are
    the contrasts of the two pairs (first order in their squares; repeated on the linearized values until it is 1). A
    constant gain of one pair does not matter.

    Returns
    -------
    GammaFit or None
        None where the angles are no two orthogonal pairs, or too few 8x8 blocks are unclipped.
    """
    pairs = orthogonal_pairs(capture.angles_deg)
    if pairs is None:
        return None
    blocks = trusted_blocks(capture.intensities, capture.valid).astype(np.float64)
    if blocks.shape[1] < _FEWEST_BLOCKS:
        return None
    exponent, error = 1.0, 0.0
    for _ in range(8):
        slope, error = _pair_slope(blocks**exponent, pairs)
        factor = float(np.clip(1 + 2 * slope, 0.5, 2))
        exponent = float(np.clip(exponent * factor, 0.1, 10))
        if abs(factor - 1) < 1e-3:
            break
    return GammaFit(exponent, 2 * error * exponent)


def _pair_slope(blocks: Floats, pairs: tuple[tuple[int, int], tuple[int, int]]) -> tuple[float, float]:
    sums = [blocks[a] + blocks[b] for a, b in pairs]
    contrasts = [(blocks[a] - blocks[b]) / total for (a, b), total in zip(pairs, sums, strict=True)]
    return _robust_slope(contrasts[0] ** 2 - contrasts[1] ** 2, np.log(sums[1] / sums[0]))


def _robust_slope(x: Floats, y: Floats) -> tuple[float, float]:
    """Slope of y against x and its standard error; outliers beyond 3 robust deviations are left out."""
    kept = np.ones(x.shape, dtype=bool)
    slope, error = 0.0, np.inf
    for _ in range(4):
        centered = x[kept] - x[kept].mean()
        spread = float(np.sum(centered**2))
        if spread <= 0:
            return 0.0, np.inf
        slope = float(np.sum(centered * y[kept])) / spread
        residual = y - slope * x
        residual -= np.median(residual[kept])
        deviation = 1.4826 * float(np.median(np.abs(residual)))
        error = float(np.sqrt(np.mean(residual[kept] ** 2) / spread))
        kept = np.abs(residual) <= 3 * max(deviation, 1e-9)
    return slope, error


def swapped_photographs(capture: Capture) -> tuple[tuple[int, int], ...]:
    """Pairs of photographs of which one looks swapped, by their indices; empty if the order looks right.

    A wrong order breaks ``I0 + I90 = I45 + I135`` (its generalization for other angles). Each exchange of two
    photographs is tried; those are named that mend the identity at least twice better than the given order. With four angles the
    identity cannot tell exchanging 45 and 90 from exchanging 0 and 135: then both are named. Three angles tell nothing.
    """
    count = len(capture.angles_deg)
    blocks = trusted_blocks(capture.intensities, capture.valid)
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
