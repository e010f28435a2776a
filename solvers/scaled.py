"""What solvers in float64 are given: the objective near 1."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from solvers.trace import Traced


class Scaled:
    """The objective in units of its first value, in float64: the constants of most solvers expect values near 1."""

    def __init__(self, traced: Traced) -> None:
        self._traced = traced
        self._unit = 0.0

    def __call__(self, x: NDArray[np.float64]) -> tuple[float, NDArray[np.float64]]:
        """Value and gradient at `x`."""
        # A fresh array, which `Traced` may keep.
        value, gradient = self._traced(x.astype(np.float32))
        if self._unit == 0.0:
            self._unit = abs(value) or 1.0
        return value / self._unit, np.divide(gradient, self._unit, dtype=np.float64)
