"""What a penalty on the two layers is, and the gradients that several of them share."""

from __future__ import annotations

from typing import Any, Protocol

from array_api_compat import array_namespace

# numpy arrays or torch tensors, float32 but in tests.
Layers = Any
Plane = Any


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
    layer : array, shape (channel, h, w)
    chroma_weight : float
    """

    def __init__(self, layer: Layers, chroma_weight: float) -> None:
        self._excess = chroma_weight - 1
        self._xp = xp = array_namespace(layer)
        x, y = xp.zeros_like(layer), xp.zeros_like(layer)
        x[..., :-1] = layer[..., 1:] - layer[..., :-1]
        y[..., :-1, :] = layer[..., 1:, :] - layer[..., :-1, :]
        self._differences = (x, y)
        self._flows = [self._turned(difference) for difference in self._differences]

    def _turned(self, difference: Layers) -> Layers:
        """Half the derivative of q by a difference: the difference itself, and more of its chroma."""
        if difference.shape[0] == 1:
            return difference
        chroma = difference - self._xp.mean(difference, axis=0)
        return difference + self._excess * chroma

    def energy(self) -> Plane:
        """q per pixel, shape (h, w)."""
        pairs = zip(self._differences, self._flows, strict=True)
        return sum(self._xp.sum(difference * flow, axis=0) for difference, flow in pairs)

    def backward(self, slope: Plane) -> Layers:
        """Gradient with respect to the layer of a function whose derivative by q is `slope`."""
        twice = 2 * slope
        flow_x, flow_y = (twice * flow for flow in self._flows)
        gradient = -flow_x - flow_y
        gradient[..., 1:] += flow_x[..., :-1]
        gradient[..., 1:, :] += flow_y[..., :-1, :]
        return gradient


CHROMA_WEIGHT = 9.0
"""Energy of chroma edges against luminance edges: the best of the forms tried on photographs."""
