"""How values are encoded, and how they become linear."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from polaropt.errors import InputError

GAMMA_RANGE = (0.1, 10.0)
"""Exponents of encodings that can be given or measured: usual ones are 1.8 to 2.6; set by hand."""


def parse_gamma(gamma: float | str | None) -> float | str | None:
    """Check an encoding: None (linear), "srgb" or an exponent such as 2.2."""
    if gamma is None or (isinstance(gamma, str) and gamma.strip().lower() == "srgb"):
        return None if gamma is None else "srgb"
    try:
        exponent = float(gamma)
    except (TypeError, ValueError):
        exponent = np.nan
    if not GAMMA_RANGE[0] <= exponent <= GAMMA_RANGE[1]:
        raise InputError(f'gamma {gamma!r} is no encoding; give "srgb" or an exponent from 0.1 to 10, such as 2.2')
    return exponent


def linearize(encoded: NDArray[np.float32], gamma: float | str | None) -> NDArray[np.float32]:
    """Encoded values (white = 1) to linear ones, odd about 0 so that noise around black stays noise.

    Parameters
    ----------
    encoded : ndarray of float32
    gamma : None, "srgb" or float
        None: they are linear already.
    """
    if gamma is None:
        return encoded
    size = np.abs(encoded)
    if gamma == "srgb":
        linear = np.where(size <= 0.04045, size / 12.92, ((size + 0.055) / 1.055) ** 2.4)
    else:
        linear = size ** float(gamma)
    return np.asarray(np.copysign(linear, encoded), dtype=np.float32)
