"""The objective in compiled passes: value and gradient in whitened coordinates, equal to the readable form."""

from __future__ import annotations

import math
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from polaropt.canvas import Canvas
from polaropt.closed_form import ClosedForm
from polaropt.fused_penalties import FusedPenalties
from polaropt.fused_preconditioner import FusedPreconditioner
from polaropt.objective import Misfit, Penalties, Term, Weights
from polaropt.preconditioner import AssumedHessian
from priors.natural_image import NaturalImage

Images = NDArray[np.float32]
Vector = NDArray[np.float32]


class MisfitInPlace(Protocol):
    """A misfit that writes its gradient where it is told."""

    def value_and_grad(self, layers: Images, gradient: Images, weight: float = 1.0) -> float:
        """Value at canvas layers; `gradient` is overwritten by weight times the gradient."""


class ReadableMisfit:
    """The readable misfit in the place of the compiled one: for residuals that count linearly."""

    def __init__(self, misfit: Misfit) -> None:
        self._misfit = misfit

    def value_and_grad(self, layers: Images, gradient: Images, weight: float = 1.0) -> float:
        """Value at canvas layers; `gradient` is overwritten by weight times the gradient."""
        value, slope = self._misfit.value_and_grad(layers)
        np.multiply(slope, np.float32(weight), out=gradient)
        return value


class FusedObjective:
    """The objective as a function of whitened coordinates, a flat float32 vector.

    One inverse and one forward transform serve both the coordinates and the spectral prior.

    Parameters
    ----------
    misfit : MisfitInPlace
    penalties : Penalties
    weights : Weights
    known : ClosedForm
    canvas : Canvas
    start : ndarray, shape (2, channel, H, W)
        Where the curvature of the edges is measured.
    """

    def __init__(
        self,
        misfit: MisfitInPlace,
        penalties: Penalties,
        weights: Weights,
        known: ClosedForm,
        canvas: Canvas,
        start: Images,
    ) -> None:
        self._misfit, self._weights = misfit, weights
        self._local = FusedPenalties(penalties, canvas, start.shape[1])
        natural = penalties.natural_image
        hessian = assumed_hessian(self._local, natural, weights, known, start)
        self._whitened = FusedPreconditioner(hessian, natural.mean, natural.basis, canvas.shape[1])
        self._layers = np.empty_like(start)
        self._gradient = np.empty_like(start)
        self.misfit = math.inf

    def coordinates(self, layers: Images) -> Vector:
        """Coordinates of canvas layers."""
        return self._whitened.coordinates(layers)

    def value_and_grad(self, z: Vector) -> tuple[float, Vector]:
        """Value (float64) and gradient (float32) at coordinates z."""
        values = self._evaluate(z)
        value = sum(self._weights.factor(name) * value for name, value in values.items())
        return value, self._whitened.gradient(self._gradient, z, self._weights.factor("natural_image"))

    def solution(self, z: Vector) -> tuple[Images, dict[str, Term]]:
        """Canvas layers (2, channel, H, W) at z, which the next call overwrites, and the terms.

        Each term has its raw value and its weight, also where it is switched off.
        """
        values = self._evaluate(z)
        return self._layers, {name: Term(value, self._weights.factor(name)) for name, value in values.items()}

    def _evaluate(self, z: Vector) -> dict[str, float]:
        """Raw values by name; the gradient by the layers, but for the spectral prior's, goes into the buffer."""
        energy = self._whitened.layers(z, self._layers)
        misfit = self._misfit.value_and_grad(self._layers, self._gradient, self._weights.factor("misfit"))
        self.misfit = misfit
        local = self._local.value_and_grad(self._layers, self._gradient, self._weights)
        return {"misfit": misfit, **local, "natural_image": energy}


def assumed_hessian(
    local: FusedPenalties, natural: NaturalImage, weights: Weights, known: ClosedForm, start: Images
) -> AssumedHessian:
    """The Hessian that the coordinates are whitened for, with the curvature of the edges at `start`."""
    return AssumedHessian(known.told, known.cross, natural.stiffness, local.curvature(start, weights))
