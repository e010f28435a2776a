"""Search for a minimum within bounds from values alone, with NLopt.

References
----------
M. J. D. Powell, The BOBYQA algorithm for bound constrained optimization without derivatives, 2009.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Values = NDArray[np.float64]

_TOLERANCE = 0.02


@dataclass(frozen=True)
class Box:
    """Where a search starts, how far it steps at first, and its bounds; all of shape (n,)."""

    start: Values
    step: Values
    low: Values
    high: Values

    def minimum(self, score: Callable[[Values], float], most: int, tolerance: float = _TOLERANCE) -> Values:
        """Point of least score, to a tolerance in units of the step, after at most so many evaluations."""
        import nlopt

        if self.start.size == 0:
            return self.start
        # BOBYQA wants two unknowns at least.
        optimizer = nlopt.opt(nlopt.LN_BOBYQA if self.start.size > 1 else nlopt.LN_NELDERMEAD, self.start.size)
        optimizer.set_lower_bounds(self.low / self.step)
        optimizer.set_upper_bounds(self.high / self.step)
        optimizer.set_initial_step(1.0)
        optimizer.set_min_objective(lambda x, _: score(x * self.step))
        optimizer.set_maxeval(most)
        optimizer.set_xtol_abs(tolerance)
        start = np.clip(self.start, self.low, self.high) / self.step
        return np.asarray(optimizer.optimize(start) * self.step)
