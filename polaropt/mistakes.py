"""Mistakes in the taking of photographs that break the same identity: wrong order, movement, encoding.

``I0 + I90 = I45 + I135`` (its generalization for other angles) holds for any light at all, however it is polarized.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from polaropt.capture import Capture
from polaropt.capture_checks import GammaFit, checked_blocks, fit_gamma, swapped_photographs
from polaropt.noise import redundancy_residual
from polaropt.pair_gain import Floats
from polaropt.registration import measure_shifts
from polaropt.shift_check import visible_shift

_LEAST_SHIFT_PX, _MOVED_PX = 0.3, 0.5
_MAD_TO_SIGMA = 1.4826
_SAMPLE = 2**15
# Spread of the residual over its robust spread: 1 for noise, more where edges or bright places break the identity.
_HARDLY_BROKEN, _BROKEN = 1.02, 1.15


@dataclass(frozen=True)
class Mistakes:
    """What is surely wrong with photographs.

    Attributes
    ----------
    swapped : bool
        Whether they look as if they were given in a wrong order.
    shift_px : float
        How far they are shifted against each other, about; 0 where that is not surely more than 0.3 px.
    gamma : float
        Exponent that makes them linear; 1 where they do not look encoded beyond doubt.
    """

    swapped: bool = False
    shift_px: float = 0.0
    gamma: float = 1.0

    @property
    def moved(self) -> bool:
        """Whether they are shifted by more than half a pixel."""
        return self.shift_px > _MOVED_PX

    @property
    def encoded(self) -> bool:
        """Whether they look encoded."""
        return self.gamma != 1.0


def find_mistakes(capture: Capture) -> Mistakes:
    """Look for a wrong order, movement and encoding; what explains the others goes first."""
    blocks = checked_blocks(capture)
    swapped = bool(swapped_photographs(capture, blocks))
    ratio = identity_ratio(capture)
    # Unlike the order, movement can be seen beside a wrong order.
    shift = visible_shift(capture, _LEAST_SHIFT_PX)
    if not shift and ratio > _BROKEN and not swapped:
        shift = _measured_shift(capture)
    if swapped or shift:
        return Mistakes(swapped, shift)
    return Mistakes(gamma=_gamma(capture, blocks, ratio))


def identity_ratio(capture: Capture) -> float:
    """Spread of what no Stokes vector explains over its robust spread; 1 for three angles, where nothing is left."""
    if len(capture.angles_deg) < 4:
        return 1.0
    step = max(1, capture.intensities[0].size // _SAMPLE)
    valid = capture.valid.reshape(len(capture.angles_deg), -1)[:, ::step].all(axis=0)
    samples = capture.intensities.reshape(len(capture.angles_deg), -1)[:, ::step][:, valid]
    if samples.shape[1] < 2:
        return 1.0
    residual = redundancy_residual(samples, capture.angles_deg)
    residual = residual - np.median(residual, axis=-1, keepdims=True)
    robust = _MAD_TO_SIGMA * float(np.median(np.abs(residual)))
    return float(np.sqrt(np.mean(np.square(residual, dtype=np.float64)))) / robust if robust > 0 else 1.0


def _measured_shift(capture: Capture) -> float:
    """The same by the slower but sharper look."""
    if capture.origin is not None and "mosaic" in capture.origin.layout:
        return 0.0
    shifts = measure_shifts(capture)
    return shifts.largest if shifts.certain and shifts.largest > _LEAST_SHIFT_PX else 0.0


def _gamma(capture: Capture, blocks: Floats, ratio: float) -> float:
    fit: GammaFit | None = fit_gamma(capture, blocks)
    # However strongly light is polarized, it keeps the identity.
    if fit is None or not np.isfinite(fit.exponent) or ratio < _HARDLY_BROKEN:
        return 1.0
    return fit.exponent if fit.encoded or (ratio > _BROKEN and fit.likely_encoded) else 1.0
