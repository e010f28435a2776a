"""How well a pane and the polarization of its layers' light explain a capture: spectra and edges together.

In the Fourier domain all ghosts are phases, so that at each frequency the three Stokes components are two constant
vectors times the layers. Their likelihood (Whittle's, with smooth unknown spectra of the layers and Student's tails)
tells the plane of the vectors, the ghosts, and directions as far as the layers' colours and spectra differ. Edges of
the layers that this Wiener filter leaves tell the directions finely. Where the ghosts are known roughly, coarse light
alone tells them best: in every small window the gradients of two layers are Gaussian with variances of their own, and
uncorrelated only where the directions are right.

References
----------
D. T. Pham, J.-F. Cardoso, Blind separation of instantaneous mixtures of nonstationary sources, IEEE TSP, 2001.
"""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from polaropt.capture import StokesImages
from polaropt.estimation.flat.ghost_overlap import coarse_overlap, fading
from polaropt.estimation.flat.ghosts import HIGHEST_FREQUENCY
from polaropt.estimation.flat.search import OVERLAP_WEIGHT
from polaropt.estimation.polarized.light import (
    AZIMUTH,
    INCIDENCE,
    SHIFT,
    Point,
    in_place,
    shown_light,
    stokes_of_entries,
)
from polaropt.numerics import (
    NATURAL_POWER_LAW,
    block_mean,
    column_multiplicity,
    frequencies,
    middle_part,
    opponent_basis,
)
from polaropt.optics import SceneParameters

if TYPE_CHECKING:
    from polaropt.estimation.polarized.kernels import WhitenedSpectra

Images = NDArray[np.float32]
Values = NDArray[np.float64]
Levels = NDArray[np.float64]
"""How much of each shape of natural spectra each layer's light holds, (layer, channel, shape)."""

# Longest side of the middle of the frame that is looked at, in pixels, and side of the blocks that it is averaged over.
# Bounded time; set by hand.
_SIDE, _HALF = 384, 2
# Blocks at each side that the edge overlap leaves out, where the window fades. Set by hand.
_LEFT_OUT = 6
# Bands of frequency and orientations, smooth ones, in which each layer's spectrum has a level. Set by hand.
_BANDS, _ORIENTATIONS = 5, 3
# Bands and directions of the sectors that are left out in turn to see how far a gain scatters. Set by hand.
_SECTOR_BANDS, _SECTOR_DIRECTIONS = 5, 9
# Least frequency that is used, in cycles per frame: the window leaks those below. Set by hand.
_LOWEST_CYCLES = 1.5
# Steps of the fit of the layers' spectra. Set by hand.
_ROUNDS = 8
# Every third frequency is used, and every fourth of these for a glance: bounded time. Set by hand.
_SPARSE, _SPARSER = 3, 4
_COARSE = 1.5
"""Highest frequency of coarse light, all of which is used, in radians per averaged block: beyond, ghosts between two
pixels are blurred, by the sensor and by any model of them. Of 40 random scenes with ghosts, refined from the true pane,
the transmission came out as bright as it is within 1.2 % in 22 with 2.8, in 23 with 2.0, in 30 with 1.5 and in 24 with
1.2; by the overlap of edges in the place of what they tell of each other in 21 with 2.8 and in 27 with 1.5."""
# Costs of a point, as minus log likelihood per frequency and colour, all by trial: for the square of the logarithm of
# the layers' ratio of brightness; for each degree of incidence beyond 80; for polarized light in a layer at all and for
# the square of its degree, more behind the pane than in the mirrored scene, where skies and walls often are.
_BALANCE_COST = 0.002
_GRAZING_DEG, _GRAZING_COST = 80.0, 0.003
_PRESENCE_COST, _DEGREE_COST = np.array([0.004, 0.001]), np.array([0.01, 0.004])
# Frequencies up to this count in a point's misfit, in cycles per frame: those of coarse light. Set by hand.
_LOW_CYCLES = 24
# Least mean of a layer, as a share of the intensity, in the ratio of brightness. Set by hand.
_DARKEST = 0.02
# The same of what it shows, where the glass hardly mirrors. Set by hand.
_LEAST_SHARE = 0.005
# Least overlap of edges (1 where they coincide), and least factor of a level in one step of its fit. Both set by hand.
_LEAST_OVERLAP, _LEAST_FACTOR = 1e-3, 1e-3
_WINDOW, _QUIET, _MOST_ALIKE = 4, 0.1, 0.999
"""Side of a window of edges, in averaged blocks; share of the median window's that counts as noise; and most squared
correlation. Set by hand."""
_OF_EDGES = 1.0
"""Weight of what two layers' edges tell of each other, in minus log likelihood per gradient. By trial: with
twice as much 26 of the scenes of `_COARSE` for 30."""
_NOTHING = np.empty((0, 0, 0, 0), np.float32)


@dataclass(frozen=True)
class Pane:
    """What both layers show of their light at any frequency.

    Attributes
    ----------
    mixing : ndarray, shape (3, 3)
        From entries to whitened Stokes components.
    light : ndarray, shape (2, 3, 3)
        Direct light, first ghost and ratio of ghosts of each layer and entry.
    step : (float, float)
        Pixels to the right and up from one ghost to the next.
    """

    mixing: Values
    light: Values
    step: tuple[float, float] = (0.0, 0.0)


def ghost_step(point: Point, shift: float) -> tuple[float, float]:
    """Pixels to the right and up from one ghost of a point to the next, where they lie so far apart."""
    azimuth = math.radians(float(point[AZIMUTH]))
    return shift * math.cos(azimuth), shift * math.sin(azimuth)


class PolarizedLikelihood:
    """Scores of points (see `polarized_light`) given a capture's Stokes images.

    Parameters
    ----------
    stokes : StokesImages
    scene : SceneParameters
        Index and surfaces of the pane; its geometry is not used.
    coarse : bool
        Of coarse light alone, which knows best where a pane near the true one is, and takes accidents for ghosts.
    """

    def __init__(self, stokes: StokesImages, scene: SceneParameters, *, coarse: bool = False) -> None:
        from scipy.fft import rfft2

        self._coarse = coarse
        self._scene = scene
        self._whiten = np.linalg.inv(np.linalg.cholesky(stokes.covariance / _HALF**2))
        images = block_mean(stokes.images[..., *middle_part(stokes.images.shape, _SIDE)], _HALF)
        basis = opponent_basis(images.shape[1])
        images = np.einsum("ij,dc,jcyx->idyx", self._whiten, basis, images)
        self._shape: tuple[int, int] = images.shape[-2:]
        self._mean = images[:, 0].mean(axis=(-2, -1)).astype(np.float64)
        self._intensity = float(np.linalg.solve(self._whiten, self._mean)[0])
        images -= images.mean(axis=(-2, -1), keepdims=True)
        window = np.outer(*(fading(side) for side in self._shape))
        images *= window
        self._faded = float(np.mean(np.square(window)))
        spectra = rfft2(images.astype(np.float32), norm="ortho").reshape(*images.shape[:2], -1)
        rows, columns = frequencies(*self._shape)
        self._rows, self._columns = (part.ravel() for part in np.broadcast_arrays(rows, columns))
        self._seen, shapes = _whitened(
            spectra, self._rows, self._columns, self._shape, _COARSE if coarse else HIGHEST_FREQUENCY
        )
        self._all = _Part(self._seen, shapes, slice(None))
        sample = np.flatnonzero(self._seen.weight)[:: 1 if coarse else _SPARSE]
        self._some, self._few = (_Part(self._seen, shapes, sample[::every]) for every in (1, _SPARSER))
        bright = {name: getattr(self._seen, name)[..., :1, :].copy() for name in ("re", "im", "power")}
        self._bright = dataclasses.replace(self._all, seen=self._seen._replace(**bright))
        self._n_levels = (2, images.shape[1], len(shapes))
        self.n: float = self._some.weight * images.shape[1]
        """How many numbers the evidence is the mean of."""
        places = np.arctan2(self._rows, self._columns), np.hypot(self._rows, self._columns)
        self._sectors = [_Part(self._seen, shapes, sample[which]) for which in _sectors(*(p[sample] for p in places))]

    def pane(self, point: Point) -> Pane:
        """The pane at a point."""
        mixing = np.asarray(self._whiten @ stokes_of_entries(point))
        return Pane(mixing, shown_light(point, self._scene), ghost_step(point, float(point[SHIFT])))

    def flat(self, shown: Values) -> Pane:
        """A pane whose layers show Stokes vectors (2, 3), its ghosts in place."""
        light = np.zeros((2, 3, 3))
        light[..., 0] = shown
        return Pane(self._whiten, light)

    def levels(self, pane: Pane) -> Levels:
        """The layers' spectra fitted to a pane: evidence for others like it rests on them."""
        vectors, levels = self._vectors(pane, self._some.which), np.ones(self._n_levels)
        for _ in range(_ROUNDS):
            levels = self._some.fitted(vectors, levels)
        return levels

    def spectral(self, pane: Pane, levels: Levels) -> float:
        """Minus log likelihood per frequency and colour, with spectra that were fitted to a pane like it."""
        vectors = self._vectors(pane, self._some.which)
        # One step towards the spectra that suit this pane: fixed ones would hold it where they were fitted.
        return self._some.misfit(vectors, self._some.fitted(vectors, levels))[0]

    def glances(self, point: Point, shifts: Values, levels: Levels) -> list[float]:
        """The same roughly where a point's ghosts lie elsewhere: from few frequencies, with spectra fitted before."""
        pane = self.pane(point)
        moved = (dataclasses.replace(pane, step=ghost_step(point, float(shift))) for shift in shifts)
        return [self._few.misfit(self._vectors(one, self._few.which), levels)[0] for one in moved]

    def sectors(self, point: Point) -> Values:
        """What the frequencies of each direction and band add to the spectral part of a point's evidence, (sector,)."""
        pane = self.pane(point)
        levels = self._some.fitted(self._vectors(pane, self._some.which), self.levels(pane))
        sums = [part.misfit(self._vectors(pane, part.which), levels)[0] * part.weight for part in self._sectors]
        return np.array(sums) / self._some.weight

    def evidence(self, pane: Pane, levels: Levels) -> float:
        """`spectral` with what the layers' edges tell of each other; less is better."""
        layers = self._layers(pane, levels)
        if self._coarse:
            return self.spectral(pane, levels) + _OF_EDGES * _shared_edges(layers)
        return self.spectral(pane, levels) + OVERLAP_WEIGHT * math.log(max(_LEAST_OVERLAP, coarse_overlap(layers)))

    def doubt(self, point: Point) -> float:
        """What speaks against a point before anything is seen, to be added to the evidence.

        That is polarized light, the more the stronger it is, layers of very different brightness, a grazing view.
        """
        means = self.brightness(point)
        degrees = np.hypot(point[[3, 5]], point[[4, 6]])
        polarized = float(np.sum(_DEGREE_COST * np.square(degrees) + _PRESENCE_COST * (degrees > 0)))
        grazing = max(0.0, float(point[INCIDENCE]) - _GRAZING_DEG)
        return polarized + _BALANCE_COST * float(np.log(means[1] / means[0])) ** 2 + _GRAZING_COST * grazing

    @property
    def lit(self) -> bool:
        """Whether any light is seen: angles that are told wrongly may leave less than none."""
        return self._intensity > 0

    def brightness(self, point: Point) -> Values:
        """Mean of each layer there, (2,)."""
        pane = self.pane(point)
        return self._means(in_place(pane.light) @ pane.mixing.T, _DARKEST)

    def shares(self, shown: Values) -> Values:
        """Mean intensity of what each layer shows, (2,), where it shows Stokes vectors (2, 3) with s0 = 1."""
        return self._means(shown @ self._whiten.T, _LEAST_SHARE)

    def _means(self, vectors: Values, least: float) -> Values:
        """Means of layers that show whitened vectors (2, 3), at least a share of the intensity each."""
        means = np.linalg.lstsq(vectors.T, self._mean, rcond=None)[0]
        return np.asarray(np.maximum(means, least * self._intensity))

    def leftover(self, point: Point) -> tuple[float, int]:
        """Mean square, in units of the noise, of coarse light that no two layers make there; and how many it is of."""
        low = np.hypot(self._rows, self._columns) < 2 * np.pi * _LOW_CYCLES / max(self._shape)
        low = np.flatnonzero(low & (self._seen.weight > 0))
        vectors = self._vectors(self.pane(point), low).astype(np.float64)
        a, b = vectors[..., 0].swapaxes(0, 1) + 1j * vectors[..., 1].swapaxes(0, 1)
        across = np.cross(a, b)
        seen = self._seen.re[..., low] + 1j * self._seen.im[..., low]
        left = np.abs(np.einsum("ni,icn->cn", across, seen)) ** 2 / np.sum(np.abs(across) ** 2, axis=1)
        weight = np.broadcast_to(self._seen.weight[low], left.shape)
        return float(np.sum(weight * left) / np.sum(weight)) / self._faded, int(np.sum(weight))

    def _vectors(self, pane: Pane, which: NDArray[np.intp] | slice) -> Values:
        """Vectors of both layers at the frequencies, each of length 1 in place: (n, layer, component, re/im)."""
        from polaropt.estimation.polarized.kernels import pane_vectors

        light, shown = pane.light.copy(), in_place(pane.light) @ pane.mixing.T
        light[..., :2] /= np.linalg.norm(shown, axis=1)[:, None, None]
        x, y = (distance / _HALF for distance in pane.step)
        phase = x * self._columns[which] - y * self._rows[which]
        vectors = np.empty((phase.size, 2, 3, 2))
        pane_vectors(pane.mixing, light, np.cos(phase), np.sin(phase), vectors)
        return vectors

    def _layers(self, pane: Pane, levels: Levels) -> Images:
        """Brightness of the layers (2, h, w) that the Wiener filter leaves."""
        from scipy.fft import irfft2

        layers = self._bright.misfit(self._vectors(pane, slice(None)), levels[:, :1])[1]
        spectra = layers.view(np.complex64).reshape(self._shape[0], -1, 2)
        images = irfft2(np.moveaxis(spectra, -1, 0), s=self._shape, norm="ortho")
        edge = min(_LEFT_OUT, min(self._shape) // 8)
        return np.asarray(images[:, edge:-edge, edge:-edge] if edge else images)


def _shared_edges(layers: Images) -> float:
    """What edges of two layers (2, h, w) tell of each other: 0 where they are uncorrelated in every window.

    Twice the mutual information of two Gaussian variables, mean of all windows.
    """
    first, second = (_along_both(layer) for layer in layers)
    pairs = ((first, first), (second, second), (first, second))
    own, other, shared = (block_mean(a * b, _WINDOW).sum(axis=0).ravel() for a, b in pairs)
    own, other = (part + _QUIET * np.median(part) for part in (own, other))
    alike = np.square(shared) / np.maximum(own * other, 1e-30)
    return float(-np.mean(np.log1p(-np.minimum(alike, _MOST_ALIKE))))


def _along_both(image: Images) -> Images:
    """Gradients of an image to the right and down, (2, h - 1, w - 1)."""
    corner = image[:-1, :-1]
    return np.stack([image[:-1, 1:] - corner, image[1:, :-1] - corner])


@dataclass(frozen=True)
class _Part:
    """Some of the frequencies: what is seen there, and the shapes (shape, n) that make up the layers' powers."""

    seen: WhitenedSpectra
    shapes: Images
    which: NDArray[np.intp] | slice

    def __post_init__(self) -> None:
        from polaropt.estimation.polarized.kernels import WhitenedSpectra

        for name in ("seen", "shapes"):
            whole = getattr(self, name)
            parts = [np.ascontiguousarray(part[..., self.which]) for part in (whole if name == "seen" else (whole,))]
            object.__setattr__(self, name, WhitenedSpectra(*parts) if name == "seen" else parts[0])

    @property
    def weight(self) -> float:
        """How much these frequencies count together."""
        return float(self.seen.weight.sum())

    def fitted(self, vectors: Values, levels: Levels) -> Levels:
        """Levels one step closer to those of greatest likelihood."""
        from polaropt.estimation.polarized.kernels import explain

        slope = np.empty((2, *levels.shape[:2], self.seen.weight.size), np.float32)
        explain(self.seen, vectors, self._powers(levels), slope, np.empty((slope.shape[-1], 2, 2), np.float32))
        more, less = slope @ self.shapes.T
        return np.asarray(levels * np.maximum(more / np.maximum(less, 1e-30), _LEAST_FACTOR))

    def misfit(self, vectors: Values, levels: Levels) -> tuple[float, Images]:
        """Minus log likelihood per frequency and colour, and the estimate of the first channel (n, layer, re/im)."""
        from polaropt.estimation.polarized.kernels import explain

        layers = np.empty((self.seen.weight.size, 2, 2), np.float32)
        value = explain(self.seen, vectors, self._powers(levels), _NOTHING, layers)
        return float(value) / (self.weight * levels.shape[1]), layers

    def _powers(self, levels: Levels) -> Images:
        return np.asarray(levels.astype(np.float32) @ self.shapes)


def _sectors(direction: Values, radius: Values) -> list[NDArray[np.intp]]:
    """Indices of the frequencies of each of some directions and bands, about as many in each band."""
    if not radius.size:
        return []
    bands = np.digitize(radius, np.quantile(radius, np.linspace(0, 1, _SECTOR_BANDS + 1)[1:-1]))
    turns = np.floor(direction % np.pi / np.pi * _SECTOR_DIRECTIONS).astype(int) % _SECTOR_DIRECTIONS
    sector = bands * _SECTOR_DIRECTIONS + turns
    return [np.flatnonzero(sector == k) for k in np.unique(sector)]


def _whitened(
    spectra: NDArray[np.complex64], rows: Values, columns: Values, shape: tuple[int, int], highest: float
) -> tuple[WhitenedSpectra, Images]:
    """What is seen at all frequencies, and the shapes of natural spectra: a power law in bands and orientations."""
    from polaropt.estimation.polarized.kernels import WhitenedSpectra

    radius, lowest = np.hypot(rows, columns), 2 * np.pi / max(shape)
    weight = np.tile(column_multiplicity(shape[1]), shape[0]) * (
        (radius > _LOWEST_CYCLES * lowest) & (radius < highest)
    )
    radius = np.maximum(radius, lowest)
    position = np.log(radius / lowest) / math.log(math.sqrt(2) * math.pi / lowest) * (_BANDS - 1)
    bands = np.maximum(0, 1 - np.abs(position - np.arange(_BANDS)[:, None]))
    turn = 2 * (np.arctan2(rows, columns) - np.pi / _ORIENTATIONS * np.arange(_ORIENTATIONS)[:, None])
    shapes = (bands[:, None] * (1 + np.cos(turn)) * radius**-NATURAL_POWER_LAW).reshape(-1, radius.size)
    re, im = spectra.real.astype(np.float64), spectra.imag.astype(np.float64)
    power = np.einsum("icn,icn->cn", re, re) + np.einsum("icn,icn->cn", im, im)
    return WhitenedSpectra(re, im, power, weight), shapes.astype(np.float32)
