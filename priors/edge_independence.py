"""Independent scenes: an edge of one layer is not an edge of the other."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from priors.base import CHROMA_WEIGHT, ColorGradient, Layers, Plane


@dataclass(frozen=True)
class EdgeIndependence:
    """Penalty ``strength sum_scales sum_pixels u_t u_r`` with ``u = q / (q + typical)``, normalized gradients.

    q is the gradient energy of all colours; a scale is half the one before, made by averaging 2x2 pixels.

    Parameters
    ----------
    strength : float
    typical : (float, float)
        Gradient energy at which an edge counts half, of the transmission and the reflection.
    n_scales : int

    Notes
    -----
    In the sense of the text of the paper's Eq. (11) ("independent scenes are unlikely to have overlapping gradients"),
    without ground truth.
    """

    strength: float
    typical: tuple[float, float]
    n_scales: int = 3

    def value_and_grad(self, layers: Layers) -> tuple[float, Layers]:
        """Value and gradient at layers (2, channel, h, w)."""
        value, gradient = self._at_scale(layers)
        if self.n_scales > 1 and min(layers.shape[-2:]) >= 8:
            coarser = EdgeIndependence(self.strength, self.typical, self.n_scales - 1)
            coarse_value, coarse_gradient = coarser.value_and_grad(_halved(layers))
            value += coarse_value
            _add_halved_transposed(gradient, coarse_gradient)
        return value, gradient

    def _at_scale(self, layers: Layers) -> tuple[float, Layers]:
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


def _halved(layers: Layers) -> Layers:
    height, width = (side // 2 * 2 for side in layers.shape[-2:])
    even = layers[..., :height, :width]
    return np.float32(0.25) * (
        even[..., ::2, ::2] + even[..., 1::2, ::2] + even[..., ::2, 1::2] + even[..., 1::2, 1::2]
    )


def _add_halved_transposed(gradient: Layers, coarse: Layers) -> None:
    height, width = (2 * side for side in coarse.shape[-2:])
    quarter = np.float32(0.25) * coarse
    for row in (0, 1):
        for column in (0, 1):
            gradient[..., row:height:2, column:width:2] += quarter
