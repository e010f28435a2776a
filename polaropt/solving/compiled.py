"""The objective in compiled passes: value and gradient in whitened coordinates, equal to the readable form.

The photographs of a pixel enter through their normal equations alone: with G the information on its entries, the misfit
is ``|G^(1/2) entries - data|^2 / 2`` plus a constant. Which photographs are trusted decides G, so that the few kinds of
pixels there are share a table.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from polaropt.capture import Capture, NoiseClasses
from polaropt.inversion import AssumedHessian, Canvas, ClosedForm, FusedPreconditioner
from polaropt.optics import PSE, Displacements, VaryingPSE
from polaropt.solving.kernels.misfit import (
    Ghosts,
    residuals,
    spread,
    varying_ghost_residuals,
    varying_ghost_spread,
    varying_residuals,
)
from polaropt.solving.kernels.penalties import Frame, add_gradient, add_negativity, energies, independence, sparsity
from polaropt.solving.objective import Misfit, Penalties, Term, Weights, WithinFrame
from priors.base import CHROMA_WEIGHT
from priors.natural_image import NaturalImage
from solvers.kernels import in_blocks

Images = NDArray[np.float32]

# Rows that a thread takes at a time: as short a wait at the end as is worth a call; set by hand.
_ROWS = 32


class FusedPenalties:
    """Edge independence, gradient sparsity and nonnegativity of the layers within the frame, and other penalties.

    These three have passes of their own; others are evaluated as they are.

    Parameters
    ----------
    penalties : Penalties
    canvas : Canvas
    colors : int
    """

    def __init__(self, penalties: Penalties, canvas: Canvas, colors: int) -> None:
        sparse = penalties.gradient_sparsity
        self._others = {name: WithinFrame(other, canvas) for name, other in penalties.others.items()}
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
        for name, other in self._others.items():
            values[name], part = other.value_and_grad(layers)
            gradient += np.float32(weights.factor(name)) * part
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


# Singular values below this share of the largest are rounding.
_SINGULAR = 1e-9
# A displacement this near to whole pixels is one, in pixels: rounding of an angle's sine.
_SNAP = 1e-9


@dataclass(frozen=True)
class Information:
    """What the photographs tell of a pixel's entries, for each kind of pixel."""

    root: Images
    """G^(1/2), symmetric, (kind, entry, entry)."""
    to_data: Images
    """From the photographs to G^(-1/2) times the normal equations' right-hand side, (kind, entry, k)."""
    to_rest: list[NDArray[np.float64]]
    """From the photographs to what no entries explain, in units of the noise: one matrix (rest, k) a kind."""


class WhitenedPhotographs:
    """Photographs reduced to the residuals' data, and what whitens entries to compare with them.

    Parameters
    ----------
    capture : Capture
    mixing : ndarray, shape (k, entry)
        Photographs from entries.
    noise : float or NoiseClasses
    """

    def __init__(self, capture: Capture, mixing: NDArray[np.float64], noise: float | NoiseClasses) -> None:
        shape = (len(capture.angles_deg), -1, *capture.shape[-2:])
        patterns, self.kinds = kinds_of_pixels(capture.valid.reshape(shape))
        if isinstance(noise, NoiseClasses):
            patterns, sigmas, self.kinds = _kinds_of_noise(patterns, self.kinds, noise)
        else:
            sigmas = np.full(len(patterns), noise)
        information = _information(mixing, sigmas, patterns)
        self.roots = information.root
        self.data, self.constant = _reduced(capture.intensities.reshape(shape), self.kinds, information)
        self.slopes = np.empty_like(self.data)

    @property
    def height(self) -> int:
        """Rows of the frame."""
        return int(self.data.shape[2])


class FusedMisfit:
    """Half the sum of squared residuals of the trusted photographs, in units of their noise.

    The same as `polaropt.solving.objective.Misfit`, from one plane per entry and colour instead of one per photograph.

    Parameters
    ----------
    capture : Capture
    pse : PSE
    canvas : Canvas
    noise : float or NoiseClasses
        Standard deviation of a photograph's noise, the same everywhere or by classes of pixels.
    """

    def __init__(self, capture: Capture, pse: PSE, canvas: Canvas, noise: float | NoiseClasses) -> None:
        self._photographs = WhitenedPhotographs(capture, pse.mixing[:, : pse.taps.shape[2]], noise)
        self._ghosts = ghosts_at(*pse.distinct_images(*canvas.shape))
        self._corner = (canvas.top, canvas.left)

    def value_and_grad(self, layers: Images, gradient: Images, weight: float = 1.0) -> float:
        """Value at canvas layers (2, channel, H, W); `gradient` is overwritten by weight times the gradient."""
        whitened, ghosts, factor = self._photographs, self._ghosts, np.float32(weight)
        top, left = self._corner

        def rows(start: int, stop: int) -> float:
            parts = (whitened.roots, whitened.kinds, whitened.data, factor, whitened.slopes)
            return float(residuals(layers, top, left, ghosts, *parts, start, stop))

        def planes(start: int, stop: int) -> None:
            spread(whitened.slopes, top, left, ghosts, gradient, start, stop)

        value = sum(in_blocks(rows, whitened.height, _ROWS)) + whitened.constant
        in_blocks(planes, 2 * layers.shape[1], 1)
        return value


def ghosts_at(displacements: Displacements, taps: NDArray[np.float64]) -> Ghosts:
    """Images at these places as whole and fractional shifts, with weights (2, ghost, entry)."""
    distance = np.array(displacements)
    whole = np.floor(distance + _SNAP)
    fraction = np.where(np.abs(distance - whole) < _SNAP, 0, distance - whole)
    shown = np.ascontiguousarray(np.any(taps != 0, axis=2))
    # Laid out by rows wherever they come from: each other layout is a kernel to compile.
    return Ghosts(
        np.ascontiguousarray(taps, dtype=np.float32), whole.astype(np.int64), fraction.astype(np.float32), shown
    )


def kinds_of_pixels(valid: NDArray[np.bool_]) -> tuple[NDArray[np.bool_], NDArray[np.uint16]]:
    """Which photographs are trusted, (kind, k), and the kind of each pixel, (channel, h, w), empty where all are 0."""
    k = len(valid)
    if valid.all():
        return np.ones((1, k), dtype=bool), np.zeros((0, 0, 0), dtype=np.uint16)
    packed = np.zeros(valid.shape[1:], dtype=np.int64)
    for j in range(k):
        packed |= valid[j].astype(np.int64) << j
    codes, kinds = np.unique(packed, return_inverse=True)
    patterns = (codes[:, None] >> np.arange(k)) & 1 == 1
    return patterns, kinds.reshape(valid.shape[1:]).astype(np.uint16)


def _kinds_of_noise(
    patterns: NDArray[np.bool_], kinds: NDArray[np.uint16], noise: NoiseClasses
) -> tuple[NDArray[np.bool_], NDArray[np.float64], NDArray[np.uint16]]:
    """Kinds divided by their noise: patterns (kind, k), standard deviations (kind,) and kinds (channel, h, w)."""
    n = len(noise.sigmas)
    codes = noise.classes + (n * kinds.astype(np.int64) if kinds.size else 0)
    present, divided = np.unique(codes, return_inverse=True)
    return patterns[present // n], noise.sigmas[present % n], divided.reshape(codes.shape).astype(np.uint16)


def _information(mixing: NDArray[np.float64], sigmas: NDArray[np.float64], patterns: NDArray[np.bool_]) -> Information:
    roots, to_data, to_rest = [], [], []
    for trusted, noise in zip(patterns, sigmas, strict=True):
        known = mixing * trusted[:, None] / noise
        left, singular, right = np.linalg.svd(known, full_matrices=True)
        regular = singular > _SINGULAR * max(singular[0], 1e-300)
        n = int(regular.sum())
        roots.append(right.T @ np.diag(singular) @ right)
        to_data.append(right[:n].T @ left[:, :n].T * trusted / noise)
        to_rest.append(left[:, n:].T * trusted / noise)
    return Information(np.array(roots, dtype=np.float32), np.array(to_data, dtype=np.float32), to_rest)


def _reduced(photographs: Images, kinds: NDArray[np.uint16], information: Information) -> tuple[Images, float]:
    """Data (entry, channel, h, w) of photographs, and half the squares that they leave over."""
    k, colors, height, width = photographs.shape
    data = np.empty((information.root.shape[1], colors, height, width), dtype=np.float32)
    rest = 0.0
    for c in range(colors):
        pixels = photographs[:, c].reshape(k, -1)
        of_kind = kinds[c].ravel() if kinds.size else None
        for kind, to_rest in enumerate(information.to_rest):
            chosen = slice(None) if of_kind is None else np.flatnonzero(of_kind == kind)
            values = pixels[:, chosen]
            data[:, c].reshape(len(data), -1)[:, chosen] = information.to_data[kind] @ values
            left_over = to_rest.astype(np.float32) @ values
            rest += 0.5 * float(np.vecdot(left_over, left_over).sum(dtype=np.float64))
    return data, rest


class FusedVaryingMisfit:
    """The misfit where incidence and azimuth vary over the frame, all bounces in place: one pass there and back.

    Parameters
    ----------
    capture : Capture
    pse : VaryingPSE
        Made for the frame.
    canvas : Canvas
    noise : float or NoiseClasses
    """

    def __init__(self, capture: Capture, pse: VaryingPSE, canvas: Canvas, noise: float | NoiseClasses) -> None:
        self._photographs = WhitenedPhotographs(capture, pse.analyzer, noise)
        self._mixtures = pse.mixtures(canvas.height, canvas.width)
        self._corner = (canvas.top, canvas.left)

    def value_and_grad(self, layers: Images, gradient: Images, weight: float = 1.0) -> float:
        """Value at canvas layers (2, channel, H, W); `gradient` is overwritten by weight times the gradient."""
        whitened, factor = self._photographs, np.float32(weight)
        top, left = self._corner
        gradient[...] = 0

        def rows(start: int, stop: int) -> float:
            parts = (self._mixtures, whitened.roots, whitened.kinds, whitened.data, factor, whitened.slopes)
            return float(varying_residuals(layers, top, left, *parts, gradient, start, stop))

        return sum(in_blocks(rows, whitened.height, _ROWS)) + whitened.constant


class FusedGhostMisfit:
    """The same with ghosts beside each other; parameters as of `FusedVaryingMisfit`."""

    def __init__(self, capture: Capture, pse: VaryingPSE, canvas: Canvas, noise: float | NoiseClasses) -> None:
        self._photographs = WhitenedPhotographs(capture, pse.analyzer, noise)
        frame = (canvas.height, canvas.width)
        self._mixtures = pse.ghost_mixtures(*frame)
        shown = np.abs(self._mixtures).max(axis=(0, 3, 4))[..., None].astype(np.float64)
        self._ghosts = ghosts_at(pse.displacements(*frame), shown)
        self._corner = (canvas.top, canvas.left)

    def value_and_grad(self, layers: Images, gradient: Images, weight: float = 1.0) -> float:
        """Value at canvas layers (2, channel, H, W); `gradient` is overwritten by weight times the gradient."""
        whitened, ghosts, mixtures, factor = self._photographs, self._ghosts, self._mixtures, np.float32(weight)
        top, left = self._corner

        def rows(start: int, stop: int) -> float:
            parts = (whitened.roots, whitened.kinds, whitened.data, factor, whitened.slopes)
            return float(varying_ghost_residuals(layers, top, left, ghosts, mixtures, *parts, start, stop))

        def planes(start: int, stop: int) -> None:
            varying_ghost_spread(whitened.slopes, top, left, ghosts, mixtures, gradient, start, stop)

        value = sum(in_blocks(rows, whitened.height, _ROWS)) + whitened.constant
        in_blocks(planes, 2 * layers.shape[1], 1)
        return value


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
        # Where the layers at hand are: of the point that a solver ends at nothing is computed twice.
        self._last: tuple[Vector, dict[str, float]] | None = None

    def coordinates(self, layers: Images) -> Vector:
        """Coordinates of canvas layers."""
        return self._whitened.coordinates(layers)

    def value_and_grad(self, z: Vector) -> tuple[float, Vector]:
        """Value (float64) and gradient (float32) at coordinates z."""
        values = self._evaluate(z)
        self._last = (z, values)
        value = sum(self._weights.factor(name) * value for name, value in values.items())
        return value, self._whitened.gradient(self._gradient, z, self._weights.factor("natural_image"))

    def solution(self, z: Vector) -> tuple[Images, dict[str, Term]]:
        """Canvas layers (2, channel, H, W) at z, which the next call overwrites, and the terms.

        Each term has its raw value and its weight, also where it is switched off. A vector that was evaluated last
        must not have been written to since.
        """
        values = self._last[1] if self._last is not None and self._last[0] is z else self._evaluate(z)
        self._last = None
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
