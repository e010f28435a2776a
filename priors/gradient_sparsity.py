"""Sparse gradients: natural layers have few edges, and where one colour has an edge the others have it, too."""

from __future__ import annotations

import math
from dataclasses import dataclass

from array_api_compat import array_namespace

from priors.base import CHROMA_WEIGHT, ColorGradient, Layers, Plane


@dataclass(frozen=True)
class LayerSparsity:
    """How sparse one layer's gradients are taken to be.

    Parameters
    ----------
    strength : float
        Weight of the penalty.
    scale : float
        Typical gradient energy of the layer, > 0.
    floor : float
        Gradient energy that cannot be told from none, > 0: smooths the penalty.
    """

    strength: float
    scale: float
    floor: float


@dataclass(frozen=True)
class GradientSparsity:
    """Penalty ``sum_l strength_l sum_pixels ((q + floor_l)^(p/2) - floor_l^(p/2)) / scale_l^(p/2)``.

    q is the gradient energy of all colours (`ColorGradient`), averaged over 3x3 pixels: edges are lines, not points.

    Parameters
    ----------
    layers : (LayerSparsity, LayerSparsity)
        Of the transmission and the reflection.
    exponent : float
        p, in (0, 2].

    Notes
    -----
    The floor holds the variance that the photographs leave to a gradient. Without it a layer that they hardly tell is
    flattened, since the most probable point of a sparse prior is far from its mean.

    References
    ----------
    A. Levin, Y. Weiss, User assisted separation of reflections from a single image using a sparsity prior, IEEE
    TPAMI 29, 2007. I. W. Selesnick, P.-Y. Chen, Total variation denoising with overlapping group sparsity, ICASSP 2013.
    """

    layers: tuple[LayerSparsity, LayerSparsity]
    exponent: float = 0.2

    def value_and_grad(self, layers: Layers) -> tuple[float, Layers]:
        """Value and gradient at layers (2, channel, h, w)."""
        gradient = array_namespace(layers).zeros_like(layers)
        total = 0.0
        for i, sparsity in enumerate(self.layers):
            if sparsity.strength:
                value, gradient[i, ...] = self._of_layer(layers[i, ...], sparsity)
                total += value
        return total, gradient

    def _of_layer(self, layer: Layers, sparsity: LayerSparsity) -> tuple[float, Layers]:
        xp = array_namespace(layer)
        edges = ColorGradient(layer, CHROMA_WEIGHT)
        half = self.exponent / 2
        factor = sparsity.strength / sparsity.scale**half
        energy = _pooled(edges.energy()) + sparsity.floor
        powers = energy**half
        total = float(xp.sum(powers, dtype=xp.float64))
        value = factor * (total - math.prod(powers.shape) * sparsity.floor**half)
        return value, edges.backward(_pooled(factor * half * powers / energy))


def _pooled(plane: Plane) -> Plane:
    """Mean over 3x3 pixels, nothing beyond the frame: its own transpose."""
    xp = array_namespace(plane)
    rows = xp.asarray(plane, copy=True)
    rows[1:, :] += plane[:-1, :]
    rows[:-1, :] += plane[1:, :]
    pooled = xp.asarray(rows, copy=True)
    pooled[:, 1:] += rows[:, :-1]
    pooled[:, :-1] += rows[:, 1:]
    return pooled / 9
