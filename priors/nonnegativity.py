"""Light is not negative."""

from __future__ import annotations

from dataclasses import dataclass

from array_api_compat import array_namespace

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
        xp = array_namespace(layers)
        below = xp.where(layers < 0, layers, xp.zeros_like(layers))
        value = 0.0
        for i, strength in enumerate(self.strength):
            value += 0.5 * strength * float(xp.sum(below[i, ...] ** 2, dtype=xp.float64))
            below[i, ...] *= strength
        return value, below
