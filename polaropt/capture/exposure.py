"""A photograph that was exposed unlike the others, found from what they say twice."""

from __future__ import annotations

import numpy as np

from polaropt.capture.capture import Capture
from polaropt.capture.checks import checked_blocks
from polaropt.capture.pair_gain import Floats, orthogonal_pairs, pair_signs

# Difference of a gain from 1 that is worth a word, share of what does not add up that it must leave at most, how much
# better it must do than a gain of one pair, and blocks that tell it; by trial.
_NOTABLE, _LEFT, _BETTER, _FEWEST_BLOCKS = 0.02, 0.35, 0.7, 100
# What a photograph may leave beside the best one, relative and in all, to be as likely; by trial.
_AS_LIKELY, _ROOM = 3.0, 0.01
# Robust deviations beyond which a block, of something that moves or a highlight, does not count; set by hand.
_OUTLIERS = 5.0


def uneven_gains(capture: Capture) -> tuple[tuple[float, float], ...]:
    """Photographs of which one looks exposed unlike the others: their angles, and how bright they are beside them.

    ``I0 + I90 = I45 + I135`` holds whatever the light. Each photograph is tried alone: those are named, the likeliest
    first, whose gain explains what does not add up, clearly better than a gain of one pair. Behind a pane all light is
    polarized along one direction, so that two of them may look alike, and gains of several at once stay unknown.

    Parameters
    ----------
    capture : Capture

    Returns
    -------
    tuple of (float, float)
        Angle in degrees, and brightness relative to what the others tell; empty where nothing is wrong.
    """
    pairs = orthogonal_pairs(capture.angles_deg)
    if pairs is None or capture.of_mosaic:
        return ()
    blocks = checked_blocks(capture)
    bright = blocks.mean(axis=0)
    if blocks.shape[1] < _FEWEST_BLOCKS or not (bright > 0).all():
        return ()
    relative = pair_signs(pairs)[:, None] * blocks / bright
    residual = relative.sum(axis=0)
    off = np.abs(residual - np.median(residual))
    kept = off <= _OUTLIERS * np.median(off) + np.finfo(np.float32).eps
    relative, residual = relative[:, kept], residual[kept]
    shares = np.array([_explained(residual, photograph) for photograph in relative])
    of_pair = _explained(residual, relative[list(pairs[1])].sum(axis=0))[1]
    left = shares[:, 1]
    most = min(_LEFT, _BETTER * of_pair, _AS_LIKELY * float(left.min()) + _ROOM)
    likely = [int(k) for k in np.argsort(left) if left[k] <= most and shares[k, 0] < 1]
    found = [(capture.angles_deg[k], 1 / (1 - float(shares[k, 0]))) for k in likely]
    return tuple((angle, gain) for angle, gain in found if abs(gain - 1) > _NOTABLE)


def _explained(residual: Floats, photograph: Floats) -> tuple[float, float]:
    """The share of a photograph that is too much, and the share of the residual's mean square that is left then."""
    coefficient = float(photograph @ residual / (photograph @ photograph))
    left = float(np.mean(np.square(residual - coefficient * photograph)))
    return coefficient, left / max(float(np.mean(np.square(residual))), np.finfo(np.float64).tiny)
