"""Independent scenes: an edge of one layer is not an edge of the other."""

from __future__ import annotations

from dataclasses import dataclass

from array_api_compat import array_namespace

from priors.base import CHROMA_WEIGHT, ColorGradient, Layers


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
        xp = array_namespace(layers)
        edges = [ColorGradient(layers[i, ...], CHROMA_WEIGHT) for i in (0, 1)]
        # Both from one quotient: u = 1 - w and du/dq = w^2 / typical with w = typical / (q + typical).
        rests = [typical / (edge.energy() + typical) for edge, typical in zip(edges, self.typical, strict=True)]
        value = float(xp.sum((1 - rests[0]) * (1 - rests[1]), dtype=xp.float64))
        gradient = xp.stack(
            [edges[i].backward(self.strength / self.typical[i] * rests[i] ** 2 * (1 - rests[1 - i])) for i in (0, 1)]
        )
        return self.strength * value, gradient
