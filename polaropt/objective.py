"""The objective: how badly two layers explain the photographs, and how unlike two natural scenes they are.

Every term is in units of the noise, so that no weight depends on brightness, exposure or the image's size.
"""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from polaropt.canvas import Canvas
from polaropt.capture import Capture
from polaropt.closed_form import ClosedForm
from polaropt.errors import InputError
from polaropt.forward import PSE
from polaropt.spectra import mean_power
from priors.base import CHROMA_WEIGHT, Regularizer
from priors.edge_independence import EdgeIndependence
from priors.gradient_sparsity import GradientSparsity, LayerSparsity
from priors.natural_image import NaturalImage
from priors.nonnegativity import Nonnegativity

Images = NDArray[np.float32]

# Found with ``python -m studies.paper_protocol``.
_SPARSITY = 7.0
_INDISTINCT = 0.02**2
_UNCERTAIN = 0.15
_LEAST_SPECTRAL = 0.4
# Share of the reflection's gradient energy that must be told before edges and signs may be divided between the layers.
_TOLD = 0.2
_INDEPENDENCE = 0.1
_ROBUST_SIGMAS = 3.0


@dataclass(frozen=True)
class Weights:
    """Factor on each term's weight: None is 1 (it follows from the noise), 0 switches the term off.

    Parameters
    ----------
    misfit : float or None
        The photographs against the simulated ones.
    edge_independence : float or None
        Edges that both layers share.
    gradient_sparsity : float or None
        Gradients of each layer.
    nonnegativity : float or None
        Negative light.
    natural_image : float or None
        Means and slow changes: the layers' expected spectra.
    """

    misfit: float | None = None
    edge_independence: float | None = None
    gradient_sparsity: float | None = None
    nonnegativity: float | None = None
    natural_image: float | None = None

    def __post_init__(self) -> None:
        for field in fields(self):
            factor = getattr(self, field.name)
            if factor is not None and not (np.isfinite(factor) and factor >= 0):
                raise InputError(f"weight {field.name} is {factor}; give a factor of 0 (off) or more")

    def factor(self, name: str) -> float:
        """The factor on a term's weight."""
        factor: float | None = getattr(self, name)
        return 1.0 if factor is None else float(factor)


@dataclass(frozen=True)
class Term:
    """A term of the objective: its raw value and the factor on it."""

    value: float
    weight: float


class Misfit:
    """Half the sum of squared residuals of the trusted photographs, in units of their noise.

    Parameters
    ----------
    capture : Capture
    pse : PSE
    canvas : Canvas
    noise : float
    robust : bool
        Pseudo-Huber instead of squares: residuals beyond 3 sigma count linearly.
    """

    def __init__(self, capture: Capture, pse: PSE, canvas: Canvas, noise: float, robust: bool = False) -> None:
        shape = (len(capture.angles_deg), -1, *capture.shape[-2:])
        self._photographs = canvas.pad_zeros(capture.intensities.reshape(shape))
        self._precision = canvas.pad_zeros(capture.valid.reshape(shape).astype(np.float32) / np.float32(noise))
        self._pse = pse
        self._robust = robust

    def value_and_grad(self, layers: Images) -> tuple[float, Images]:
        """Value and gradient at canvas layers (2, channel, H, W)."""
        residual = self._pse.forward(layers)
        residual -= self._photographs
        residual *= self._precision
        value, slope = _pseudo_huber(residual) if self._robust else _half_square(residual)
        slope *= self._precision
        gradient: Images = self._pse.adjoint(slope)
        return value, gradient


def _half_square(residual: Images) -> tuple[float, Images]:
    return 0.5 * float(np.vdot(residual, residual)), residual


def _pseudo_huber(residual: Images) -> tuple[float, Images]:
    root = np.sqrt(1 + np.square(residual / np.float32(_ROBUST_SIGMAS)))
    return _ROBUST_SIGMAS**2 * float((root - 1).sum(dtype=np.float64)), residual / root


class WithinFrame:
    """A penalty on the part of the canvas that the photographs show.

    Parameters
    ----------
    penalty : Regularizer
    canvas : Canvas
    """

    def __init__(self, penalty: Regularizer, canvas: Canvas) -> None:
        self._penalty, self._canvas = penalty, canvas

    def value_and_grad(self, layers: Images) -> tuple[float, Images]:
        """Value and gradient at canvas layers (2, channel, H, W)."""
        value, gradient = self._penalty.value_and_grad(self._canvas.crop(layers))
        return value, self._canvas.pad_zeros(gradient)


class Objective:
    """Weighted sum of named terms.

    Parameters
    ----------
    terms : dict of str to Regularizer
    weights : Weights
    """

    def __init__(self, terms: dict[str, Regularizer], weights: Weights) -> None:
        self._terms = {name: (weights.factor(name), term) for name, term in terms.items()}

    def value_and_grad(self, layers: Images) -> tuple[float, Images]:
        """Value (float64) and gradient (float32) at canvas layers (2, channel, H, W)."""
        total, gradient = 0.0, np.zeros_like(layers)
        for weight, term in self._terms.values():
            if weight:
                value, part = term.value_and_grad(layers)
                total += weight * value
                gradient += part if weight == 1 else np.float32(weight) * part
        return total, gradient

    def terms(self, layers: Images) -> dict[str, Term]:
        """Raw value and weight of every term, also of those switched off."""
        return {name: Term(term.value_and_grad(layers)[0], weight) for name, (weight, term) in self._terms.items()}


def build_objective(misfit: Misfit, known: ClosedForm, canvas: Canvas, noise: float, weights: Weights) -> Objective:
    """The default objective: `misfit` with the priors that the fitted spectra imply.

    Edges and signs are judged within the frame; the margins, which only ghosts tell of, follow from the spectra.

    Where the photographs hardly tell a layer's gradients, the sparse prior gives way to the Gaussian one: the most
    probable point of a sparse prior is no good estimate there.
    """
    scale, unknown = _gradient_energy(known, known.prior), _gradient_energy(known, known.uncertainty)
    open_share = unknown_shares(known)
    floor = _INDISTINCT * scale + _UNCERTAIN * unknown
    told = min(1.0, float(1 - open_share[1]) / _TOLD) ** 2
    sparsity = [
        LayerSparsity(_SPARSITY * told * float(1 - share), float(size), float(least))
        for share, size, least in zip(open_share, scale, floor, strict=True)
    ]
    spectral = np.maximum(open_share, 1 - told * (1 - _LEAST_SPECTRAL))
    typical = scale + unknown
    variance = noise**2 + _pixel_variance(known)
    independence = EdgeIndependence(_INDEPENDENCE * told, (float(typical[0]), float(typical[1])))
    nonnegativity = Nonnegativity((told / float(variance[0]), told / float(variance[1])))
    terms: dict[str, Regularizer] = {
        "misfit": misfit,
        "edge_independence": WithinFrame(independence, canvas),
        "gradient_sparsity": WithinFrame(GradientSparsity((sparsity[0], sparsity[1])), canvas),
        "nonnegativity": WithinFrame(nonnegativity, canvas),
        "natural_image": NaturalImage((float(spectral[0]), float(spectral[1])), known.prior, known.mean, known.basis),
    }
    return Objective(terms, weights)


def unknown_shares(known: ClosedForm) -> NDArray[np.float64]:
    """Share of each layer's gradient energy that the photographs leave open, (2,), 0..1."""
    share = _gradient_energy(known, known.uncertainty) / _gradient_energy(known, known.prior)
    return np.minimum(share, 1.0)


def _pixel_variance(known: ClosedForm) -> NDArray[np.float64]:
    """Variance that the photographs leave to a pixel of each layer, mean over colours, (2,)."""
    everything = np.ones(known.uncertainty.shape[-2:])
    variance: NDArray[np.float64] = mean_power(known.uncertainty, everything, known.layers.shape[-1]).mean(axis=1)
    return variance


def _gradient_energy(known: ClosedForm, power: NDArray[np.float32]) -> NDArray[np.float64]:
    """Expected gradient energy of each layer, chroma weighted as the penalties do, (2,)."""
    height, width = known.layers.shape[-2:]
    rows = 2 * np.pi * np.fft.fftfreq(height)[:, None]
    columns = 2 * np.pi * np.fft.rfftfreq(width)[None, :]
    per_color = mean_power(power, 4 - 2 * np.cos(rows) - 2 * np.cos(columns), width)
    color_weights = np.full(per_color.shape[1], CHROMA_WEIGHT)
    color_weights[0] = 1.0
    energy: NDArray[np.float64] = per_color @ color_weights
    return energy
