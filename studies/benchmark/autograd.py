"""The objective as a differentiable torch function of the pixels: what one writes without a gradient of one's own.

The slow contestants of the benchmark minimize it; tests hold it equal to the objective of
`polaropt.solving.problem.Problem`.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch.nn import functional

from polaropt.numerics import column_multiplicity
from polaropt.solving import Problem, Weights
from priors.base import CHROMA_WEIGHT
from priors.gradient_sparsity import GradientSparsity, LayerSparsity

Tensor = torch.Tensor


class AutogradObjective:
    """Value by torch operations, gradient by automatic differentiation, in float32 with sums in float64.

    Parameters
    ----------
    problem : Problem
        Whose capture, pane, canvas and penalties are used.
    weights : Weights
        Factors on the terms; a term with factor 0 is not computed.
    sparsity : GradientSparsity, optional
        Replaces the problem's own.
    """

    def __init__(self, problem: Problem, weights: Weights, sparsity: GradientSparsity | None = None) -> None:
        capture, self._canvas = problem.capture, problem.canvas
        shape = (len(capture.angles_deg), -1, *capture.shape[-2:])
        valid = capture.valid.reshape(shape).astype(np.float32)

        self._weights, self._pse = weights, problem.pse
        self._photographs = _tensor(capture.intensities.reshape(shape))
        self._precision = _tensor(valid / np.float32(problem.noise))
        penalties = problem.penalties
        self._independence, self._nonnegativity = penalties.edge_independence, penalties.nonnegativity
        self._sparsity = sparsity or penalties.gradient_sparsity
        natural = penalties.natural_image
        # Half spectra stand for two halves.
        columns = column_multiplicity(self._canvas.shape[1]).astype(np.float32)
        self._stiffness = _tensor(natural.stiffness * columns)
        self._mean, self._basis = _tensor(natural.mean), _tensor(natural.basis)

    def value(self, layers: Tensor) -> Tensor:
        """Value (float64) at canvas layers (2, channel, H, W); differentiable."""
        within = self._canvas.crop(layers)
        total = self._of_edges(within)
        for name, term, point in (
            ("misfit", self._misfit, layers),
            ("nonnegativity", self._of_signs, within),
            ("natural_image", self._of_spectra, layers),
        ):
            if factor := self._weights.factor(name):
                total = total + factor * term(point)
        return total

    def value_and_grad(self, layers: NDArray[np.float32]) -> tuple[float, NDArray[np.float32]]:
        """Value and gradient at canvas layers (2, channel, H, W), from and to numpy."""
        point = torch.from_numpy(layers).requires_grad_()
        value = self.value(point)
        (gradient,) = torch.autograd.grad(value, point)
        return float(value.detach()), gradient.numpy()

    def _misfit(self, layers: Tensor) -> Tensor:
        shown = self._canvas.crop(self._pse.forward(layers))
        return 0.5 * _total(torch.square((shown - self._photographs) * self._precision))

    def _of_edges(self, within: Tensor) -> Tensor:
        energies = [_gradient_energy(within[i]) for i in (0, 1)]
        total = torch.zeros((), dtype=torch.float64)
        sparse = self._weights.factor("gradient_sparsity")
        for energy, layer in zip(energies, self._sparsity.layers, strict=True):
            if sparse and layer.strength:
                total = total + sparse * _sparsity(energy, layer, self._sparsity.exponent)
        shared = self._weights.factor("edge_independence") * self._independence.strength
        if shared:
            parts = [q / (q + typical) for q, typical in zip(energies, self._independence.typical, strict=True)]
            total = total + shared * _total(parts[0] * parts[1])
        return total

    def _of_signs(self, within: Tensor) -> Tensor:
        below = torch.square(functional.relu(-within))
        return sum(0.5 * strength * _total(below[i]) for i, strength in enumerate(self._nonnegativity.strength))

    def _of_spectra(self, layers: Tensor) -> Tensor:
        own = torch.einsum("oc,lchw->lohw", self._basis, layers) - self._mean
        spectrum = torch.view_as_real(torch.fft.rfft2(own, norm="ortho"))
        return 0.5 * _total(self._stiffness * torch.square(spectrum).sum(dim=-1))


def _gradient_energy(layer: Tensor) -> Tensor:
    """Gradient energy (h, w) of a layer (channel, h, w), all colours together: that of `priors.base.ColorGradient`."""
    down = functional.pad(layer[:, 1:] - layer[:, :-1], (0, 0, 0, 1))
    right = functional.pad(layer[..., 1:] - layer[..., :-1], (0, 1))
    energy = (torch.square(down) + torch.square(right)).sum(dim=0)
    if layer.shape[0] == 1:
        return energy
    chroma = [torch.square(flow - flow.mean(dim=0)).sum(dim=0) for flow in (down, right)]
    return energy + (CHROMA_WEIGHT - 1) * (chroma[0] + chroma[1])


def _sparsity(energy: Tensor, layer: LayerSparsity, exponent: float) -> Tensor:
    pooled = functional.avg_pool2d(energy[None, None], 3, stride=1, padding=1) + layer.floor
    half = exponent / 2
    return layer.strength / layer.scale**half * (_total(pooled**half) - pooled.numel() * layer.floor**half)


def _tensor(array: NDArray[Any]) -> Tensor:
    return torch.from_numpy(np.ascontiguousarray(array, dtype=np.float32))


def _total(plane: Tensor) -> Tensor:
    return plane.sum(dtype=torch.float64)
