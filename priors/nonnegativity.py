"""Light is not negative."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from priors.base import Layers


@dataclass(frozen=True)
class Nonnegativity:
    """Smooth one-sided penalty ``sum_l strength_l / 2 sum min(x_l, 0)^2``, so that no solver needs bounds.

    Parameters
    ----------
    strength : (float, float)
        Weight of each layer: the inverse variance with which its pixels are known. A layer that is hardly known is
        not pushed up where its most probable value happens to be negative.
    """

    strength: tuple[float, float]

    def value_and_grad(self, layers: Layers) -> tuple[float, Layers]:
        """Value and gradient at layers (2, channel, h, w)."""
        below = np.minimum(layers, 0)
        strength = np.array(self.strength)
        squares = np.square(below).sum(axis=(1, 2, 3), dtype=np.float64)
        gradient: Layers = below * strength.astype(layers.dtype)[:, None, None, None]
        return 0.5 * float(strength @ squares), gradient
