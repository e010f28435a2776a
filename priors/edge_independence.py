"""Independent scenes: an edge of one layer is not an edge of the other."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from priors.base import CHROMA_WEIGHT, ColorGradient, Layers, Plane


@dataclass(frozen=True)
class EdgeIndependence:
    """Penalty ``strength sum_pixels u_t u_r`` with ``u = q / (q + typical)``, normalized gradients.

    q is the gradient energy of all colours (`ColorGradient`).

    Parameters
    ----------
    strength : float
    typical : (float, float)
        Gradient energy at which an edge counts half, of the transmission and the reflection.

    Notes
    -----
    In the sense of the text of the paper's Eq. (11) ("independent scenes are unlikely to have overlapping gradients"),
    without ground truth.
    """

    strength: float
    typical: tuple[float, float]

    def value_and_grad(self, layers: Layers) -> tuple[float, Layers]:
        """Value and gradient at layers (2, channel, h, w)."""
        edges = [ColorGradient(layer, CHROMA_WEIGHT) for layer in layers]
        # Both from one quotient: u = 1 - w and du/dq = w^2 / typical with w = typical / (q + typical).
        rests = [_rest(edge.energy(), typical) for edge, typical in zip(edges, self.typical, strict=True)]
        value = float(np.einsum("hw,hw->", 1 - rests[0], 1 - rests[1], dtype=np.float64))
        gradient = np.empty_like(layers)
        for i, typical in enumerate(self.typical):
            slope = np.square(rests[i])
            slope *= 1 - rests[1 - i]
            slope *= np.float32(self.strength / typical)
            gradient[i] = edges[i].backward(slope)
        return self.strength * value, gradient


def _rest(energy: Plane, typical: float) -> Plane:
    rest: Plane = energy
    rest += np.float32(typical)
    np.divide(np.float32(typical), rest, out=rest)
    return rest
