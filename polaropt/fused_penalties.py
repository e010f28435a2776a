"""The local penalties of the objective in compiled passes, with the differences of neighbours shared."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from polaropt.canvas import Canvas
from polaropt.objective import Penalties, Weights
from polaropt.penalty_kernels import Frame, add_gradient, add_negativity, energies, independence, sparsity
from priors.base import CHROMA_WEIGHT
from solvers.blocks import in_blocks

Images = NDArray[np.float32]

_ROWS = 32


class FusedPenalties:
    """Edge independence, gradient sparsity and nonnegativity of the layers within the frame.

    Parameters
    ----------
    penalties : Penalties
    canvas : Canvas
    colors : int
    """

    def __init__(self, penalties: Penalties, canvas: Canvas, colors: int) -> None:
        sparse = penalties.gradient_sparsity
        self._frame = Frame(canvas.top, canvas.left, canvas.height, canvas.width)
        self._chroma = np.float32(CHROMA_WEIGHT if colors > 1 else 1)
        self._exponent = sparse.exponent
        self._floor = np.array([layer.floor for layer in sparse.layers])
        self._factor = np.array([layer.strength / layer.scale ** (sparse.exponent / 2) for layer in sparse.layers])
        self._typical = np.array(penalties.edge_independence.typical)
        self._shared = penalties.edge_independence.strength
        self._negative = np.array(penalties.nonnegativity.strength)
        self._energy = np.empty((2, canvas.height, canvas.width), dtype=np.float32)
        self._slope = np.empty_like(self._energy)

    def value_and_grad(self, layers: Images, gradient: Images, weights: Weights) -> dict[str, float]:
        """Values by name at canvas layers (2, channel, H, W); their weighted gradient is added to `gradient`."""
        values = self._edges(layers, weights.factor("gradient_sparsity"))
        shared = weights.factor("edge_independence") * self._shared
        negative = weights.factor("nonnegativity")

        def rows(start: int, stop: int) -> float:
            add_gradient(
                layers,
                self._frame,
                self._chroma,
                self._energy,
                self._slope,
                self._typical,
                shared,
                gradient,
                start,
                stop,
            )
            return float(add_negativity(layers, self._frame, self._negative, negative, gradient, start, stop))

        values["nonnegativity"] = sum(in_blocks(rows, self._frame.height, _ROWS))
        return values

    def curvature(self, layers: Images, weights: Weights) -> NDArray[np.float64]:
        """Mean second derivative of the sparsity by the differences of neighbours, per colour of the basis."""
        self._edges(layers, weights.factor("gradient_sparsity"))
        per_layer = 2 * self._slope.mean(axis=(1, 2), dtype=np.float64)
        of_color = np.full(layers.shape[1], float(self._chroma))
        of_color[0] = 1.0
        return np.outer(per_layer, of_color)

    def _edges(self, layers: Images, weight: float) -> dict[str, float]:
        """Energies and the weighted slope of the sparsity, with the values of both penalties on edges."""
        height = self._frame.height

        def measure(start: int, stop: int) -> None:
            energies(layers, self._frame, self._chroma, self._energy, start, stop)

        def penalize(start: int, stop: int) -> tuple[float, float]:
            sparse = sparsity(self._energy, self._floor, self._factor, self._exponent, weight, self._slope, start, stop)
            return sparse, independence(self._energy, self._typical, start, stop)

        in_blocks(measure, height, _ROWS)
        sparse, shared = zip(*in_blocks(penalize, height, _ROWS), strict=True)
        return {"gradient_sparsity": sum(sparse), "edge_independence": self._shared * sum(shared)}
