"""The objective: how badly two layers explain the photographs, and how unlike two natural scenes they are.

Every term is in units of the noise, so that no weight depends on brightness, exposure or the image's size.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, fields, replace
from typing import Any

import numpy as np
from array_api_compat import array_namespace, is_torch_namespace
from numpy.typing import NDArray

from polaropt.capture import Capture, NoiseClasses
from polaropt.errors import InputError, check_numbers
from polaropt.inversion import Canvas, ClosedForm, FourierPreconditioner
from polaropt.numerics import Basis, each_plane
from polaropt.optics import PSE, VaryingPSE
from polaropt.solving.local_spectra import Expectation
from priors.base import CHROMA_WEIGHT, Regularizer
from priors.edge_independence import EdgeIndependence
from priors.gradient_sparsity import GradientSparsity, LayerSparsity
from priors.natural_image import NaturalImage, in_basis
from priors.nonnegativity import Nonnegativity
from solvers.entry_points import REGULARIZERS, loaded, plugged

Images = NDArray[np.float32]
Power = NDArray[np.float32]
Placing = Callable[[NDArray[Any]], Any]
"""Turns numpy arrays into those to work with, such as tensors on a device."""

# The next six were found with ``python -m studies.paper_protocol``.
# Strength of the gradients' sparsity, where the photographs tell a layer.
_SPARSITY = 7.0
# Gradient energies that count as none, in parts of the layer's mean one and of what the photographs leave open of it.
_INDISTINCT = 0.02**2
_UNCERTAIN = 0.15
# Share of its weight that the spectral prior keeps where the sparse one has all of its own.
_LEAST_SPECTRAL = 0.4
# Share of the reflection's gradient energy that must be known before edges and signs may be divided between the layers.
_KNOWN_ENOUGH = 0.2
# The first and the fourth of them for samples of a mosaic, which leave more open: by trial on four simulated mosaics,
# behind panes at 40 to 75 degrees, of other photographs than are judged.
_SPARSITY_OF_MOSAIC = 1.5
_SPECTRAL_OF_MOSAIC = 0.3
# Strength of the gradients' sparsity around layers that are expected in each place, of transmission and reflection, and
# what then counts as none: of 40 choices on five and on four pairs of training photographs behind panes at 10 to 85
# degrees, at noises of 0.25 to 4 %, one of the best for both layers, and of those the one that loses least on any;
# since fine windows tell what is expected, less suits the reflection, from the closed form and from a learned start.
# The transmission's edges are told even where the reflection's are not.
_SPARSITY_OF_EXPECTED = (9.0, 10.0)
_UNCERTAIN_OF_EXPECTED = 0.03
# The same of a mono mosaic's samples, of transmission and reflection, and how many times the weight of the layers that
# are expected counts: of 41 choices on nine simulated mosaics of training photographs behind panes at 40, 60 and 75
# degrees (noise 0.5 % and 2 %) the one that loses least on any; nine others gained as much. Stronger sparsity and less
# weight gain 0.1 dB behind a lens that blurs by 0.5 px, and lose 0.3 dB where it blurs by 0.8 px.
_OF_MONO_SAMPLES = ((3.0, 1.5), 0.5)
# For a colour mosaic's, whose colours share their edges: of three choices on eleven of them, five with 2 % noise, the
# one whose largest loss is least.
_OF_COLOR_SAMPLES = ((4.2, 2.1), 0.35)
# Strength of the edges' independence.
_INDEPENDENCE = 0.1
# Residual in standard deviations of the noise, beyond which a robust solve counts it linearly: set by hand.
ROBUST_SIGMAS = 3.0
MOST_WEIGHT = 1e6
"""Factor on a term's weight beyond which no other term counts, in single precision. Set by hand."""

_PENALTY = "penalty"
MakePenalty = Callable[[ClosedForm, float], Regularizer]


def penalty(make: MakePenalty) -> Any:
    """A term of the objective, as a field of `Weights`.

    Parameters
    ----------
    make : callable
        The penalty on the layers within the frame, from the closed form and the standard deviation of the noise. Its
        strength is such that the factor 1 suits the noise.
    """
    return field(default=None, metadata={_PENALTY: make})


@dataclass(frozen=True)
class Weights:
    """Factor on each term's weight: None is 1 (it follows from the noise), 0 switches the term off.

    The fields are the terms: the first five are in compiled passes, others say by `penalty` how they are made.

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
    plugged : tuple of (str, float)
        Names and factors of regularizers that other packages plug in (entry points ``polaropt.regularizers``). One that
        is not named is off.

    Examples
    --------
    Without the edges' independence, and twice the usual sparsity of gradients:

    >>> from polaropt import Weights
    >>> weights = Weights(edge_independence=0, gradient_sparsity=2)
    >>> weights.factor("edge_independence"), weights.factor("gradient_sparsity"), weights.factor("misfit")
    (0.0, 2.0, 1.0)
    """

    misfit: float | None = None
    edge_independence: float | None = None
    gradient_sparsity: float | None = None
    nonnegativity: float | None = None
    natural_image: float | None = None
    plugged: tuple[tuple[str, float], ...] = ()

    def __post_init__(self) -> None:
        names = [*term_names(), *(name for name, _ in self.plugged)]
        for name, factor in [*((name, getattr(self, name)) for name in term_names()), *self.plugged]:
            check_numbers([(f"weight {name}", factor)])
            if names.count(name) > 1:
                raise InputError(f"the weight {name} is in `plugged` and has a factor already; give one")
            if factor is not None and not 0 <= factor <= MOST_WEIGHT:
                raise InputError(f"weight {name} is {factor}; give a factor of 0 (off) to {MOST_WEIGHT:g}")

    def factor(self, name: str) -> float:
        """The factor on a term's weight."""
        factor: float | None = dict(self.plugged)[name] if name not in term_names() else getattr(self, name)
        return 1.0 if factor is None else float(factor)


def term_names() -> tuple[str, ...]:
    """Terms of the objective that are this package's own."""
    return tuple(term.name for term in fields(Weights) if term.name != "plugged")


def plugged_names() -> tuple[str, ...]:
    """Terms that other packages plug in."""
    return tuple(plugged(REGULARIZERS, term_names()))


def check_plugged(weights: Weights) -> None:
    """InputError where a term is of another package and there is none of this name, or it cannot be imported."""
    for name, _ in weights.plugged:
        if name not in plugged_names():
            raise InputError(f"there is no term {name!r}; no package that is installed plugs it in")
        if loaded(REGULARIZERS, name) is None:
            raise InputError(f"the term {name!r} is of another package and cannot be imported; mend or remove it")


def plugged_penalties(weights: Weights, known: ClosedForm, noise: float) -> dict[str, Regularizer]:
    """Penalties of other packages that are switched on.

    Raises
    ------
    InputError
        There is none of this name, or it cannot be imported.
    """
    check_plugged(weights)
    return {name: loaded(REGULARIZERS, name)(known, noise) for name, factor in weights.plugged if factor}


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
    pse : PSE or VaryingPSE
        For images of the canvas's size.
    canvas : Canvas
    noise : float or NoiseClasses
        Standard deviation of a photograph's noise, the same everywhere or by classes of pixels.
    robust : bool
        Pseudo-Huber instead of squares: residuals beyond 3 sigma count linearly.
    place : callable, optional
        Turns numpy arrays into those to work with, such as tensors on a device.
    """

    def __init__(
        self,
        capture: Capture,
        pse: PSE | VaryingPSE,
        canvas: Canvas,
        noise: float | NoiseClasses,
        robust: bool = False,
        place: Placing = np.asarray,
    ) -> None:
        shape = (len(capture.angles_deg), -1, *capture.shape[-2:])
        self._photographs = place(canvas.pad_zeros(capture.intensities.reshape(shape)))
        sigma = noise.images() if isinstance(noise, NoiseClasses) else np.float32(noise)
        self._precision = place(canvas.pad_zeros(capture.valid.reshape(shape).astype(np.float32) / sigma))
        self._pse = pse
        self._robust = robust

    def value_and_grad(self, layers: Any) -> tuple[float, Any]:
        """Value and gradient at canvas layers (2, channel, H, W), arrays or tensors."""
        residual = (self._pse.forward(layers) - self._photographs) * self._precision
        value, slope = _pseudo_huber(residual) if self._robust else _half_square(residual)
        return value, self._pse.adjoint(slope * self._precision)


def _half_square(residual: Any) -> tuple[float, Any]:
    xp = array_namespace(residual)
    return 0.5 * float(xp.sum(residual**2, dtype=xp.float64)), residual


def _pseudo_huber(residual: Any) -> tuple[float, Any]:
    xp = array_namespace(residual)
    root = xp.sqrt(1 + (residual / ROBUST_SIGMAS) ** 2)
    return ROBUST_SIGMAS**2 * float(xp.sum(root - 1, dtype=xp.float64)), residual / root


class WithinFrame:
    """A penalty on the part of the canvas that the photographs show.

    Parameters
    ----------
    penalty : Regularizer
    canvas : Canvas
    """

    def __init__(self, penalty: Regularizer, canvas: Canvas) -> None:
        self._penalty, self._canvas = penalty, canvas

    def value_and_grad(self, layers: Any) -> tuple[float, Any]:
        """Value and gradient at canvas layers (2, channel, H, W), arrays or tensors."""
        value, within = self._penalty.value_and_grad(self._canvas.crop(layers))
        gradient = array_namespace(layers).zeros_like(layers)
        self._canvas.crop(gradient)[...] = within
        return value, gradient


class Objective:
    """Weighted sum of named terms, in its readable form.

    `polaropt.solving.compiled` has the same value and gradient in compiled passes.

    Parameters
    ----------
    terms : dict of str to Regularizer
    weights : Weights
    """

    def __init__(self, terms: dict[str, Regularizer], weights: Weights) -> None:
        self._terms = {name: (weights.factor(name), term) for name, term in terms.items()}
        self.misfit = math.inf
        """Raw misfit at the last evaluation."""

    def value_and_grad(self, layers: Any) -> tuple[float, Any]:
        """Value (float64) and gradient (float32) at canvas layers (2, channel, H, W), arrays or tensors."""
        total, gradient = 0.0, array_namespace(layers).zeros_like(layers)
        for name, (weight, term) in self._terms.items():
            if weight:
                value, part = term.value_and_grad(layers)
                self.misfit = value if name == "misfit" else self.misfit
                total += weight * value
                gradient += weight * part
        return total, gradient

    def terms(self, layers: Any) -> dict[str, Term]:
        """Raw value and weight of every term, also of those switched off."""
        return {name: Term(term.value_and_grad(layers)[0], weight) for name, (weight, term) in self._terms.items()}


@dataclass(frozen=True)
class Penalties:
    """The priors of the default objective; their names are those of `Weights`, also in `others`."""

    edge_independence: EdgeIndependence
    gradient_sparsity: GradientSparsity
    nonnegativity: Nonnegativity
    natural_image: NaturalImage
    others: Mapping[str, Regularizer] = field(default_factory=dict)
    """Those without a compiled pass, for the layers within the frame."""

    def placed(self, place: Placing) -> Penalties:
        """With arrays that `place` has turned into those to work with."""
        natural = self.natural_image
        parts = (place(natural.stiffness), place(natural.mean), place(natural.basis.astype(np.float32)))
        return replace(self, natural_image=NaturalImage(*parts))


@dataclass(frozen=True)
class LayerPenalties:
    """The priors that judge the layers within the frame, and how much the spectral one counts beside them.

    Attributes
    ----------
    edge_independence : EdgeIndependence
    gradient_sparsity : GradientSparsity
    nonnegativity : Nonnegativity
    spectral : ndarray of float32, shape (2,)
        Weight of the spectral prior of each layer, where nothing is expected of the layers in each place.
    confidence : float
        Weight of the prior around what is expected in each place.
    """

    edge_independence: EdgeIndependence
    gradient_sparsity: GradientSparsity
    nonnegativity: Nonnegativity
    spectral: NDArray[np.float32]
    confidence: float


def layer_penalties(known: ClosedForm, noise: float, *, mosaic: bool, expects: bool) -> LayerPenalties:
    """The priors within the frame that the fitted spectra imply.

    Where the photographs hardly tell a layer's gradients, the sparse prior gives way to the Gaussian one: the most
    probable point of a sparse prior is no good estimate there.

    Parameters
    ----------
    known : ClosedForm
        Of it the energies of edges, the variance and the basis.
    noise : float
    mosaic : bool
        Whether the layers are solved for from samples of a mosaic.
    expects : bool
        Whether layers are expected in each place.
    """
    scale, unknown = _gradient_energy(known.edges), _gradient_energy(known.unknown_edges)
    open_share = unknown_shares(known)
    known_enough = min(1.0, float(1 - open_share[1]) / _KNOWN_ENOUGH) ** 2
    # The transmission's edges are told even where the reflection's detail is open.
    of_each = np.array([1.0, known_enough]) * (1 - open_share)
    confidence, uncertain = 1.0, _UNCERTAIN
    if mosaic:
        around, confidence = _OF_MONO_SAMPLES if len(known.basis) == 1 else _OF_COLOR_SAMPLES
        strength = (np.array(around) if expects else _SPARSITY_OF_MOSAIC) * of_each
        spectral = np.full(2, _SPECTRAL_OF_MOSAIC, np.float32)
    else:
        if expects:
            strength, uncertain = np.array(_SPARSITY_OF_EXPECTED) * of_each, _UNCERTAIN_OF_EXPECTED
        else:
            strength = _SPARSITY * known_enough * (1 - open_share)
        spectral = np.maximum(open_share, 1 - known_enough * (1 - _LEAST_SPECTRAL)).astype(np.float32)
    floor = _INDISTINCT * scale + uncertain * unknown
    layers = [
        LayerSparsity(float(own), float(size), float(least))
        for own, size, least in zip(strength, scale, floor, strict=True)
    ]
    typical = scale + unknown
    variance = noise**2 + known.variance.mean(axis=1)
    return LayerPenalties(
        edge_independence=EdgeIndependence(_INDEPENDENCE * known_enough, (float(typical[0]), float(typical[1]))),
        gradient_sparsity=GradientSparsity((layers[0], layers[1])),
        nonnegativity=Nonnegativity((known_enough / float(variance[0]), known_enough / float(variance[1]))),
        spectral=spectral,
        confidence=confidence,
    )


def default_penalties(
    known: ClosedForm,
    noise: float,
    mosaic: bool = False,
    expected: Expectation | None = None,
    slope: Images | None = None,
) -> Penalties:
    """The priors that the fitted spectra imply; those within the frame are of `layer_penalties`.

    Parameters
    ----------
    known : ClosedForm
    noise : float
    mosaic : bool
        Whether the layers are solved for from samples of a mosaic.
    expected : Expectation, optional
        What the layers are expected to be in each place. Default: of their means and spectra alone.
    slope : ndarray, shape (2, channel, H, W), optional
        Gradient of the photographs' misfit at these layers. With it the misfit and the prior around them are least at
        these layers themselves, and the photographs, of which they know already, do not count twice. Default: they do.
    """
    within = layer_penalties(known, noise, mosaic=mosaic, expects=expected is not None)
    if expected is None:
        natural = NaturalImage(within.spectral[:, None, None, None] / known.prior, known.mean, known.basis)
    else:
        stiffness = np.float32(within.confidence) / expected.variance
        mean = expected.layers if slope is None else _least_at(expected.layers, stiffness, slope, known.basis)
        natural = NaturalImage(stiffness, mean, known.basis)
    return Penalties(
        edge_independence=within.edge_independence,
        gradient_sparsity=within.gradient_sparsity,
        nonnegativity=within.nonnegativity,
        natural_image=natural,
        others=own_penalties(known, noise),
    )


def own_penalties(known: ClosedForm, noise: float) -> dict[str, Regularizer]:
    """Penalties of this package that have no compiled pass, by name."""
    return {term.name: term.metadata[_PENALTY](known, noise) for term in fields(Weights) if _PENALTY in term.metadata}


def _least_at(layers: Images, stiffness: Power, slope: Images, basis: Basis) -> Images:
    """Mean of a spectral prior that is, together with something of this slope at layers in the basis, least there."""
    from scipy.fft import irfft2, rfft2

    mean = in_basis(basis.astype(np.float32), slope, np)

    def plane(where: tuple[int, int]) -> None:
        spectrum = rfft2(mean[where], norm="ortho") / stiffness[where]
        mean[where] = irfft2(spectrum, mean.shape[-2:], norm="ortho")

    each_plane(plane, mean.shape)
    mean += layers
    return np.asarray(mean)


def build_objective(misfit: Misfit, penalties: Penalties, canvas: Canvas, weights: Weights) -> Objective:
    """The objective in its readable form.

    Edges and signs are judged within the frame; the margins, which only ghosts tell of, follow from the spectra.
    """
    terms: dict[str, Regularizer] = {
        "misfit": misfit,
        "edge_independence": WithinFrame(penalties.edge_independence, canvas),
        "gradient_sparsity": WithinFrame(penalties.gradient_sparsity, canvas),
        "nonnegativity": WithinFrame(penalties.nonnegativity, canvas),
        "natural_image": penalties.natural_image,
        **{name: WithinFrame(other, canvas) for name, other in penalties.others.items()},
    }
    return Objective(terms, weights)


def unknown_shares(known: ClosedForm) -> NDArray[np.float64]:
    """Share of each layer's gradient energy that the photographs leave open, (2,), 0..1."""
    return np.minimum(_gradient_energy(known.unknown_edges) / _gradient_energy(known.edges), 1.0)


def _gradient_energy(per_color: NDArray[np.float64]) -> NDArray[np.float64]:
    """Gradient energy of each layer, chroma weighted as the penalties do, (2,)."""
    color_weights = np.full(per_color.shape[1], CHROMA_WEIGHT)
    color_weights[0] = 1.0
    energy: NDArray[np.float64] = per_color @ color_weights
    return energy


class WhitenedObjective:
    """The counterpart of `polaropt.solving.compiled.FusedObjective` that is meant to be read, and that runs on a GPU.

    Parameters
    ----------
    objective : Objective
    preconditioner : FourierPreconditioner
    place : callable, optional
        Turns numpy arrays into those that the two were made with, such as tensors on a device.
    """

    def __init__(
        self, objective: Objective, preconditioner: FourierPreconditioner, place: Placing = np.asarray
    ) -> None:
        self._objective, self._whitened, self._place = objective, preconditioner, place

    @property
    def misfit(self) -> float:
        """Raw misfit at the last evaluation; infinite before the first."""
        return self._objective.misfit

    def coordinates(self, layers: Images) -> Any:
        """Coordinates of canvas layers, on the device."""
        return self._whitened.coordinates(self._place(layers))

    def value_and_grad(self, z: Any) -> tuple[float, Any]:
        """Value (float64) and gradient (float32) at coordinates z."""
        value, gradient = self._objective.value_and_grad(self._whitened.layers(z))
        return value, self._whitened.gradient(gradient)

    def solution(self, z: Any) -> tuple[Images, dict[str, Term]]:
        """Canvas layers (2, channel, H, W) at z as a numpy array, and the terms."""
        layers = self._whitened.layers(self._place(z) if isinstance(z, np.ndarray) else z)
        there = is_torch_namespace(array_namespace(layers))
        return np.asarray(layers.cpu() if there else layers), self._objective.terms(layers)


def on_device(device: str) -> Placing:
    """What turns numpy arrays into tensors on a device.

    Parameters
    ----------
    device : str
        As torch names it: "cpu", "cuda", "cuda:1".
    """
    import torch

    def place(array: NDArray[Any]) -> Any:
        return torch.from_numpy(np.ascontiguousarray(array)).to(device)

    return place
