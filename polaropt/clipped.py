"""Clipped photographs filled in from what the layers found so far would have given."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from polaropt.capture import Capture

FILLINGS = 2
"""Times that the closed form is repeated; a third hardly changes it."""
_MUCH = 2e-3


def worth_filling(capture: Capture) -> bool:
    """Whether so much is missing that a closed form, which cannot leave pixels out, suffers from it."""
    return bool(np.count_nonzero(capture.valid) < (1 - _MUCH) * capture.valid.size)


def filled(capture: Capture, expected: NDArray[np.float32]) -> Capture:
    """The capture with the expected photographs where its own cannot be trusted; what is clipped is white at least.

    Parameters
    ----------
    capture : Capture
    expected : ndarray, shape (k, channel, h, w)
    """
    seen = capture.intensities
    expected = expected.reshape(seen.shape)
    values = np.where(seen >= 1, np.maximum(expected, seen), expected)
    whole = capture.part(slice(None), slice(None))
    whole.intensities = np.where(capture.valid, seen, values).astype(np.float32)
    whole.valid = np.ones_like(capture.valid)
    return whole
