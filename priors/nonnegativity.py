"""Light is not negative."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from priors.base import Layers


@dataclass(frozen=True)
class Nonnegativity:
    """Smooth one-sided penalty ``strength / 2 sum min(x, 0)^2``, so that no solver needs bounds.

    Parameters
    ----------
    strength : float
    """

    strength: float

    def value_and_grad(self, layers: Layers) -> tuple[float, Layers]:
        """Value and gradient at layers (2, channel, h, w)."""
        below = np.minimum(layers, 0)
        value = 0.5 * self.strength * float(np.square(below).sum(dtype=np.float64))
        gradient: Layers = np.float32(self.strength) * below
        return value, gradient
