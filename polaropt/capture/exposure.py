"""A photograph that was exposed unlike the others, found from what they say twice."""

from __future__ import annotations

import numpy as np

from polaropt.capture.capture import Capture
from polaropt.capture.checks import checked_blocks
from polaropt.capture.pair_gain import Floats, orthogonal_pairs

# Difference of a gain from 1 that is worth a word, share of what does not add up that it must leave at most, how much
# better it must do than any other explanation, and blocks that tell it; by trial.
_NOTABLE, _LEFT, _BETTER, _FEWEST_BLOCKS = 0.02, 0.35, 0.7, 100
# Robust deviations beyond which a block, of something that moves or a highlight, does not count; set by hand.
_OUTLIERS = 5.0


def uneven_gains(capture: Capture) -> tuple[float, ...]:
    """Brightness of each photograph against the others, where one of them surely differs; empty where none does.

    ``I0 + I90 = I45 + I135`` holds whatever the light. Each photograph is tried alone: one whose gain explains what
    does not add up, clearly better than others or than a gain of one pair, is named. Behind a pane light is polarized
    along one direction, and what does not add up tells no more than that: gains of several photographs stay unknown.
    """
    pairs = orthogonal_pairs(capture.angles_deg)
    if pairs is None or (capture.origin is not None and "mosaic" in capture.origin.layout):
        return ()
    blocks = checked_blocks(capture)
    bright = blocks.mean(axis=0)
    if blocks.shape[1] < _FEWEST_BLOCKS or not (bright > 0).all():
        return ()
    signs = np.ones(4)
    signs[list(pairs[1])] = -1
    relative = signs[:, None] * blocks / bright
    residual = relative.sum(axis=0)
    off = np.abs(residual - np.median(residual))
    kept = off <= _OUTLIERS * np.median(off) + np.finfo(np.float32).eps
    relative, residual = relative[:, kept], residual[kept]
    shares = np.array([_explained(residual, photograph) for photograph in relative])
    of_pair = _explained(residual, relative[list(pairs[1])].sum(axis=0))[1]
    best = int(np.argmin(shares[:, 1]))
    coefficient, left = shares[best]
    others = min(of_pair, *np.delete(shares[:, 1], best))
    if left > _LEFT or left > _BETTER * others or coefficient >= 1:
        return ()
    gain = 1 / (1 - float(coefficient))
    return tuple(gain if k == best else 1.0 for k in range(4)) if abs(gain - 1) > _NOTABLE else ()


def _explained(residual: Floats, photograph: Floats) -> tuple[float, float]:
    """The share of a photograph that is too much, and the share of the residual's mean square that is left then."""
    coefficient = float(photograph @ residual / (photograph @ photograph))
    left = float(np.mean(np.square(residual - coefficient * photograph)))
    return coefficient, left / max(float(np.mean(np.square(residual))), np.finfo(np.float64).tiny)
