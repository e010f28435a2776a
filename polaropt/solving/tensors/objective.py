"""The objective of a batch in whitened coordinates, with value and gradient of each capture.

The counterpart of `polaropt.solving.objective` on a device: the photographs are simulated from the layers' spectra,
which the coordinates are, and the spectral prior costs no transform.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
import torch
from torch import Tensor
from torch.nn.functional import avg_pool2d, pad

from polaropt.inversion import applied, roots_of
from polaropt.numerics import column_multiplicity, opponent_basis, squared_frequencies
from polaropt.solving.objective import ROBUST_SIGMAS, LayerPenalties, Term, Weights
from polaropt.solving.tensors.batch import CaptureBatch, placed
from polaropt.solving.tensors.closed_form import BatchClosedForm
from polaropt.solving.tensors.windows import BatchExpectation
from priors.base import CHROMA_WEIGHT, Regularizer
from priors.edge_independence import EdgeIndependence
from priors.gradient_sparsity import GradientSparsity
from priors.natural_image import in_basis
from priors.nonnegativity import Nonnegativity

Values = dict[str, Tensor]


class BatchMisfit:
    """Half the sum of squared residuals of the trusted photographs, in units of their noise.

    Parameters
    ----------
    batch : CaptureBatch
    robust : bool
        Pseudo-Huber instead of squares.
    """

    def __init__(self, batch: CaptureBatch, robust: bool = False) -> None:
        self._batch, self._robust = batch, robust

    def value_and_slope(self, spectra: Tensor) -> tuple[Tensor, Tensor]:
        """Values (capture,) at half spectra of layers in the colour basis, and their gradient's half spectra."""
        batch = self._batch
        residual = (batch.simulated(spectra) - batch.photographs) * batch.precision
        if self._robust:
            root = (1 + (residual / ROBUST_SIGMAS).square()).sqrt()
            value, slope = ROBUST_SIGMAS**2 * _summed(root - 1), residual / root
        else:
            value, slope = 0.5 * _summed(residual.square()), residual
        return value, batch.spread(slope * batch.precision)

    def gradient(self, layers: Tensor) -> Tensor:
        """Gradient at canvas layers (capture, 2, channel, H, W) in the colour basis."""
        batch = self._batch
        return batch.images(self.value_and_slope(batch.transformed(layers))[1])


def _summed(images: Tensor) -> Tensor:
    """Sums (capture,) over all but the first axis."""
    return images.flatten(1).sum(dim=1, dtype=torch.float64)


class FramePriors(Protocol):
    """The priors of one capture that judge its layers within the frame."""

    @property
    def edge_independence(self) -> EdgeIndependence:
        """Edges that both layers share."""

    @property
    def gradient_sparsity(self) -> GradientSparsity:
        """Gradients of each layer."""

    @property
    def nonnegativity(self) -> Nonnegativity:
        """Negative light."""


@dataclass(frozen=True)
class BatchPenalties:
    """The priors within the frame, as factors of each capture, (capture, 2, 1, 1)."""

    strength: Tensor
    floor: Tensor
    typical: Tensor
    negative: Tensor
    shared: Tensor
    """(capture, 1, 1)"""
    exponent: float

    @classmethod
    def of(cls, each: Sequence[FramePriors], device: torch.device) -> BatchPenalties:
        """Those of all captures."""
        exponent = each[0].gradient_sparsity.exponent

        def of_layers(numbers: list[list[float]]) -> Tensor:
            return placed(np.array(numbers, np.float32), device)[:, :, None, None]

        sparse = [penalties.gradient_sparsity.layers for penalties in each]
        shared = np.array([penalties.edge_independence.strength for penalties in each], np.float32)
        return cls(
            of_layers([[layer.strength / layer.scale ** (exponent / 2) for layer in layers] for layers in sparse]),
            of_layers([[layer.floor for layer in layers] for layers in sparse]),
            of_layers([[*penalties.edge_independence.typical] for penalties in each]),
            of_layers([[*penalties.nonnegativity.strength] for penalties in each]),
            placed(shared, device)[:, None, None],
            exponent,
        )


@dataclass(frozen=True)
class SpectralPrior:
    """The spectral prior: stiffness (capture, 2, channel, H, W // 2 + 1), and the canvas layers that it is around in
    the colour basis, (capture, 2, channel, H, W) or (capture, 2, channel, 1, 1)."""

    stiffness: Tensor
    mean: Tensor


def spectral_prior(
    batch: CaptureBatch,
    known: BatchClosedForm,
    expected: BatchExpectation | None,
    within: Sequence[LayerPenalties],
    slope: Tensor | None,
) -> SpectralPrior:
    """The prior of `default_penalties`.

    Parameters
    ----------
    batch : CaptureBatch
    known : BatchClosedForm
    expected : BatchExpectation or None
    within : sequence of LayerPenalties
    slope : Tensor or None
        Gradient of the misfit at the layers that are expected; of a mosaic's samples, None.
    """
    if expected is None:
        spectral = placed(np.stack([penalties.spectral for penalties in within]), batch.device)
        return SpectralPrior(spectral[:, :, None, None, None] / known.prior, known.mean)
    stiffness = within[0].confidence / expected.variance
    if slope is None:
        return SpectralPrior(stiffness, expected.layers)
    return SpectralPrior(stiffness, expected.layers + batch.images(batch.transformed(slope) / stiffness))


class BatchObjective:
    """Value and gradient of all captures at whitened coordinates (capture, n).

    Parameters
    ----------
    batch : CaptureBatch
    misfit : BatchMisfit
    known : (Tensor, Tensor)
        What the photographs tell: (capture, 2, H, W // 2 + 1), and of both together, (capture, H, W // 2 + 1).
    within : sequence of FramePriors
    prior : SpectralPrior
    weights : Weights
    others : sequence of dict
        Penalties without a pass of their own, by name: those of each capture.
    start : Tensor, shape (capture, 2, channel, H, W)
        In the colour basis: where the curvature of the edges is measured.
    """

    def __init__(
        self,
        batch: CaptureBatch,
        misfit: BatchMisfit,
        known: tuple[Tensor, Tensor],
        within: Sequence[FramePriors],
        prior: SpectralPrior,
        weights: Weights,
        others: Sequence[Mapping[str, Regularizer]],
        start: Tensor,
    ) -> None:
        self._batch, self._misfit, self._prior, self._weights, self._others = batch, misfit, prior, weights, others
        self._penalties = BatchPenalties.of(within, batch.device)
        width = batch.canvas.shape[1]
        colors = len(batch.basis)
        # Chroma counts more: the opponent basis with energies of their own. A mosaic's colours have another basis.
        opponent = placed(opponent_basis(colors).astype(np.float32), batch.device)
        self._to_opponent = opponent @ batch.basis.T
        weight_of_color = [1.0, *[CHROMA_WEIGHT] * (colors - 1)]
        self._of_color = torch.tensor(weight_of_color, device=batch.device)[:, None, None]
        # The half spectrum stands for two; scaled, the transform keeps lengths.
        self._length = placed(np.sqrt(column_multiplicity(width)).astype(np.float32), batch.device)
        flat = prior.mean.expand(*prior.mean.shape[:3], *batch.canvas.shape)
        self._mean = batch.transformed(flat)
        rows, columns = squared_frequencies(*batch.canvas.shape)
        squared = placed((rows[:, None] + columns).astype(np.float32), batch.device)
        curved = 2 * self._slopes(self._energies(start)[0])[1].mean(dim=(-1, -2))
        hessian = known[0][:, :, None] + prior.stiffness
        hessian = hessian + (curved[:, :, None, None, None] * self._of_color) * squared
        roots = roots_of(hessian.transpose(0, 1), known[1][:, None].expand(*hessian.shape[:1], *hessian.shape[2:]))
        self._inverse, self._root = roots

    def coordinates(self, layers: Tensor) -> Tensor:
        """Coordinates (capture, n) of canvas layers in the colour basis."""
        # Of the difference: a stiff prior tells the rounding of two transforms apart.
        own = self._batch.transformed(layers - self._prior.mean) * self._length
        return self._flat(applied(self._root, own.transpose(0, 1), torch).transpose(0, 1))

    def in_colors(self, z: Tensor) -> Tensor:
        """Canvas layers (capture, 2, channel, H, W) at coordinates, in the colours of the photographs."""
        return self._batch.in_colors(self._batch.images(self._coefficients(z) + self._mean))

    def value_and_grad(self, z: Tensor) -> tuple[Tensor, Tensor]:
        """Values (capture,) in double precision and gradients (capture, n) at coordinates (capture, n)."""
        values, spectra = self._evaluated(z)
        total = sum(self._weights.factor(name) * value for name, value in values.items())
        gradient = applied(self._inverse, (spectra * self._length).transpose(0, 1), torch).transpose(0, 1)
        return torch.as_tensor(total), self._flat(gradient)

    def terms(self, z: Tensor) -> list[dict[str, Term]]:
        """Raw value and weight of every term of each capture at coordinates, also of those switched off."""
        values, _ = self._evaluated(z)
        raw = {name: value.cpu().tolist() for name, value in values.items()}
        return [
            {name: Term(float(each[i]), self._weights.factor(name)) for name, each in raw.items()}
            for i in range(z.shape[0])
        ]

    def _evaluated(self, z: Tensor) -> tuple[Values, Tensor]:
        """Raw values by name, and half spectra of the gradient by the layers, weighted."""
        weights, batch = self._weights, self._batch
        coefficients = self._coefficients(z)
        spectra = coefficients + self._mean
        misfit, slope = self._misfit.value_and_slope(spectra)
        frames = batch.canvas.crop(batch.images(spectra))
        values, local = self._local(frames)
        stiff = self._prior.stiffness * coefficients
        energy = (coefficients.conj() * stiff).real * self._length.square()
        values = {"misfit": misfit, **values, "natural_image": 0.5 * _summed(energy)}
        total = (
            weights.factor("misfit") * slope
            + batch.transformed(batch.pad_zeros(local))
            + weights.factor("natural_image") * stiff
        )
        return values, total

    def _local(self, frames: Tensor) -> tuple[Values, Tensor]:
        """Values of the priors within the frame, by name, and their weighted gradient, in the colour basis."""
        weights, penalties, batch = self._weights, self._penalties, self._batch
        energies, differences = self._energies(frames)
        sparse, slopes = self._slopes(energies)
        rests = penalties.typical / (energies + penalties.typical)
        both = penalties.shared * (1 - rests[:, 0]) * (1 - rests[:, 1])
        of_shared = weights.factor("edge_independence") * penalties.shared[:, None]
        slopes = slopes + of_shared / penalties.typical * rests.square() * (1 - rests.flip(1))
        of_edges = _backward(differences, (2 * slopes)[:, :, None] * self._of_color)
        gradient = torch.as_tensor(in_basis(self._to_opponent.T, of_edges, torch))
        colors = batch.in_colors(frames)
        below = colors.clamp(max=0)
        negative = penalties.negative[:, :, None]
        values = {
            "edge_independence": _summed(both),
            "gradient_sparsity": sparse,
            "nonnegativity": 0.5 * _summed(negative * below.square()),
        }
        of_colors = weights.factor("nonnegativity") * negative * below
        for name in self._others[0]:
            values[name], of_other = self._other(name, colors)
            of_colors = of_colors + weights.factor(name) * of_other
        return values, gradient + batch.opponent(of_colors)

    def _other(self, name: str, colors: Tensor) -> tuple[Tensor, Tensor]:
        """A penalty of another package, capture by capture."""
        parts = [own[name].value_and_grad(layers) for own, layers in zip(self._others, colors, strict=True)]
        values = torch.tensor([value for value, _ in parts], dtype=torch.float64, device=colors.device)
        return values, torch.stack([gradient for _, gradient in parts])

    def _energies(self, frames: Tensor) -> tuple[Tensor, tuple[Tensor, Tensor]]:
        """Gradient energy (capture, 2, h, w) of layers of frame or canvas, and differences of opponent colours."""
        if frames.shape[-2:] != (self._batch.canvas.height, self._batch.canvas.width):
            frames = self._batch.canvas.crop(frames)
        frames = torch.as_tensor(in_basis(self._to_opponent, frames, torch))
        across, down = pad(frames.diff(dim=-1), (0, 1)), pad(frames.diff(dim=-2), (0, 0, 0, 1))
        energy = (self._of_color * (across.square() + down.square())).sum(dim=2)
        return energy, (across, down)

    def _slopes(self, energies: Tensor) -> tuple[Tensor, Tensor]:
        """Values (capture,) of the sparsity, and its weighted derivative by the energies."""
        penalties = self._penalties
        half = penalties.exponent / 2
        pooled = _pooled(energies) + penalties.floor
        powers = pooled**half
        value = _summed(penalties.strength * (powers - penalties.floor**half))
        factor = self._weights.factor("gradient_sparsity")
        return value, _pooled(factor * half * penalties.strength * powers / pooled)

    def _coefficients(self, z: Tensor) -> Tensor:
        batch, canvas = self._batch, self._batch.canvas.shape
        shape = (len(z), 2, len(batch.basis), canvas[0], canvas[1] // 2 + 1)
        spectra = torch.view_as_complex(z.reshape(*shape, 2)).transpose(0, 1)
        coefficients: Tensor = applied(self._inverse, spectra, torch).transpose(0, 1) / self._length
        return coefficients

    @staticmethod
    def _flat(spectra: Tensor) -> Tensor:
        return torch.view_as_real(spectra.contiguous()).flatten(1)


def _pooled(planes: Tensor) -> Tensor:
    """Mean over 3x3 pixels of (capture, 2, h, w), nothing beyond the frame: its own transpose."""
    return avg_pool2d(planes, 3, stride=1, padding=1)


def _backward(differences: tuple[Tensor, Tensor], slope: Tensor) -> Tensor:
    """Gradient by the layers of a function with this slope by each squared difference."""
    across, down = (slope * difference for difference in differences)
    gradient = -across - down
    gradient[..., 1:] += across[..., :-1]
    gradient[..., 1:, :] += down[..., :-1, :]
    return gradient
