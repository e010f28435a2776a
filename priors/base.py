"""What a penalty on the two layers is, and the gradients that several of them share."""

from __future__ import annotations

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

Layers = NDArray[np.float32]
Plane = NDArray[np.float32]


class Regularizer(Protocol):
    """A penalty on layers (2, channel, h, w)."""

    def value_and_grad(self, layers: Layers) -> tuple[float, Layers]:
        """Value in float64 and gradient in the layers' dtype and shape."""


class ColorGradient:
    """Forward differences of one layer and their energy, all colours together.

    The energy weighs chroma more than luminance, since natural edges have little of it: with the mean over channels
    m, ``q = |grad x|^2 + (w - 1) |grad (x - m)|^2``, which for three channels is the opponent basis with energies
    weighted 1, w, w.

    Parameters
    ----------
    layer : ndarray, shape (channel, h, w)
    chroma_weight : float
    """

    def __init__(self, layer: Layers, chroma_weight: float) -> None:
        self._excess = np.float32(chroma_weight - 1)
        self._x = np.zeros_like(layer)
        self._y = np.zeros_like(layer)
        np.subtract(layer[..., 1:], layer[..., :-1], out=self._x[..., :-1])
        np.subtract(layer[..., 1:, :], layer[..., :-1, :], out=self._y[..., :-1, :])
        self._flows = [self._turned(difference) for difference in (self._x, self._y)]

    def _turned(self, difference: Layers) -> Layers:
        """Half the derivative of q by a difference: the difference itself, and more of its chroma."""
        if len(difference) == 1:
            return difference
        chroma: Layers = difference - difference.mean(axis=0)
        chroma *= self._excess
        chroma += difference
        return chroma

    def energy(self) -> Plane:
        """q per pixel, shape (h, w)."""
        plane: Plane = np.einsum("chw,chw->hw", self._x, self._flows[0])
        plane += np.einsum("chw,chw->hw", self._y, self._flows[1])
        return plane

    def backward(self, slope: Plane) -> Layers:
        """Gradient with respect to the layer of a function whose derivative by q is `slope`."""
        twice = 2 * slope
        flow_x, flow_y = (twice * flow for flow in self._flows)
        gradient: Layers = -flow_x
        gradient -= flow_y
        gradient[..., 1:] += flow_x[..., :-1]
        gradient[..., 1:, :] += flow_y[..., :-1, :]
        return gradient


CHROMA_WEIGHT = 9.0
"""Energy of chroma edges against luminance edges: the best of the forms tried on photographs."""
