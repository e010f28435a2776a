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
    m, ``q = w |grad x|^2 - (w - 1) C |grad m|^2``, which for three channels is the opponent basis with factors 1, w, w.

    Parameters
    ----------
    layer : ndarray, shape (channel, h, w)
    chroma_weight : float
    """

    def __init__(self, layer: Layers, chroma_weight: float) -> None:
        self._weight = np.float32(chroma_weight)
        self._x = np.zeros_like(layer)
        self._y = np.zeros_like(layer)
        np.subtract(layer[..., 1:], layer[..., :-1], out=self._x[..., :-1])
        np.subtract(layer[..., 1:, :], layer[..., :-1, :], out=self._y[..., :-1, :])
        self._mean_x = self._x.mean(axis=0)
        self._mean_y = self._y.mean(axis=0)

    def energy(self) -> Plane:
        """q per pixel, shape (h, w)."""
        total = np.einsum("chw,chw->hw", self._x, self._x) + np.einsum("chw,chw->hw", self._y, self._y)
        mean = self._mean_x * self._mean_x + self._mean_y * self._mean_y
        plane: Plane = self._weight * total - (self._weight - 1) * np.float32(self._x.shape[0]) * mean
        return plane

    def backward(self, slope: Plane) -> Layers:
        """Gradient with respect to the layer of a function whose derivative by q is `slope`."""
        twice = 2 * slope
        flow_x = twice * (self._weight * self._x - (self._weight - 1) * self._mean_x)
        flow_y = twice * (self._weight * self._y - (self._weight - 1) * self._mean_y)
        gradient: Layers = -flow_x
        gradient -= flow_y
        gradient[..., 1:] += flow_x[..., :-1]
        gradient[..., 1:, :] += flow_y[..., :-1, :]
        return gradient


CHROMA_WEIGHT = 9.0
"""Energy of chroma edges against luminance edges: the best of the forms tried on photographs."""
