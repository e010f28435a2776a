"""How far the edges of the two layers fall together for a trial incidence: least at the true one.

The mean over a block of a picture shifted bilinearly is the picture's running mean, read bilinearly where the block
came from. So the running means are taken once for all shifts.

The pane is inverted linearly, all ghosts included. With R one interface's reflectance and z the shift by a ghost step,
``(1 - R^2 z) I = 1/2 [(R + R (1 - 2R) z) r + (1 - R)^2 t]`` for both polarizations; eliminating one layer leaves the
other, itself with a ghost, from at most three copies of the images. So for one ghost shift the gradients of those
copies are taken once, and every incidence is a sum of them.
"""

from __future__ import annotations

import copy
import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from polaropt.capture import PlateFrame
from polaropt.numerics import block_mean, grid_sums, left_out
from polaropt.optics import SceneParameters, in_place_reflectance, plate_at

Images = NDArray[np.float32]
Mask = NDArray[np.bool_]
Matrix = NDArray[np.float64]

Step = tuple[float, float]

SIZES = (2, 4, 8, 16, 32)
"""Sides of blocks in pixels. The noise in a gradient falls with the side: at 10 degrees, noise 0.005, the incidence of
least overlap is 12, 6 and 2 degrees off at 2, 4 and 8 pixels (192x192, 12 pairs)."""
_LEAST_BLOCKS = 8
"""Blocks per side that a scale needs. Set by hand."""
_LEAST_OF_CELLS, _LEAST_OF_FAINT, _FAINT_DEG = 4, 8, 30.0
"""Least sides of blocks of a mosaic's cells, and of panes at incidences below which they polarize little: on finer ones
what aliases passes for edges of the reflection. Of 200 mosaics of panes at 10 to 40 degrees (`studies.random_windows`,
even seeds from 9940000, mono and color) cells tell incidences 0.9 and 1.2 degrees off so, the median, and 1.6 and 1.8
by blocks as of photographs."""
MOSTLY_VALID = 0.75
"""Share of its pixels that must be valid for a block to count. Set by hand."""
_FINEST_MEANS = 4
"""Running means longer than so many samples are taken of halved pictures."""
MOST_NOISE = 0.2
"""Noise of a pixel of what is mirrored (white = 1) up to which its edges are seen, and tell windows apart: photographs
have about that contrast. On the random windows to fit on (`studies.random_windows`, even seeds), false windows had 0.23
and more, true ones 0.09 and less."""
_LEAST_DIFFERENCE = 1e-6
"""Of the two reflectances: that of an incidence of 0.13 degrees, below which nothing is told. Set by hand."""
_WHOLE = 1e-9
"""Samples by which a shift may miss a whole one for rounding."""


@dataclass(frozen=True)
class BlockImages:
    """Running means in the plate's frame.

    Attributes
    ----------
    means : ndarray of float32, shape (2, channel, h, w)
        Means of I_par and I_perp over `length` samples each way, at every sample.
    shares : ndarray of float32, shape (channel, h, w), or None
        Share of valid pixels in each; None where all are.
    covariance : ndarray, shape (2, 2)
        Covariance of the noise in a pixel.
    length, spacing : int
        Samples in a block and pixels in a sample, along each side.
    sizes : tuple of int
        Sides of the blocks in pixels, from finest to coarsest, each twice the one before.
    azimuth_deg : float
    aliased : bool
        Whether they are of a mosaic's cells.
    """

    means: Images
    shares: Images | None
    covariance: Matrix
    length: int
    spacing: int
    sizes: tuple[int, ...]
    azimuth_deg: float
    aliased: bool = False

    @property
    def side(self) -> int:
        """Shorter side of the capture in pixels, but for an incomplete sample."""
        samples: int = min(self.means.shape[-2:]) + self.length - 1
        return self.spacing * samples

    def across(self) -> BlockImages:
        """The same for a pane whose plane of incidence lies across: its two polarizations are exchanged."""
        covariance = self.covariance[::-1, ::-1]
        return replace(self, means=self.means[::-1], covariance=covariance, azimuth_deg=self.azimuth_deg + 90)

    def noisier(self) -> tuple[BlockImages, ...]:
        """The same of captures with as much noise again, drawn once and mirrored two ways."""
        h, w = (side + self.length - 1 for side in self.means.shape[-2:])
        drawn = np.random.default_rng(0).standard_normal((2, self.means.shape[1] * h * w), dtype=np.float32)
        root = np.linalg.cholesky(self.covariance) / self.spacing
        noise = _running_mean((root.astype(np.float32) @ drawn).reshape(2, -1, h, w), self.length)
        parts = (noise, noise[..., ::-1], noise[..., ::-1, :])
        return tuple(replace(self, means=self.means + part, covariance=2 * self.covariance) for part in parts)

    def step(self, ghost_shift: float) -> Step:
        """A ghost shift in pixels to the right and down."""
        azimuth = math.radians(self.azimuth_deg)
        return ghost_shift * math.cos(azimuth), -ghost_shift * math.sin(azimuth)

    def copies(self, ghost_shift: float, n_copies: int) -> tuple[Images, Mask | None]:
        """Finest blocks of copies shifted by 0, 1, ... ghost shifts, where all exist, and which of them are known.

        Shapes (copy, 2, channel, rows, columns) and (channel, rows, columns), the latter None where all are known.
        """
        step = [distance / self.spacing for distance in self.step(ghost_shift)]
        places = [
            [_place(length, distance, k, n_copies - 1, self.length) for distance, length in self._axes(step)]
            for k in range(n_copies)
        ]
        images = np.stack([_read(self.means, place, self.length) for place in places])
        if self.shares is None:
            return images, None
        shares = np.min([_read(self.shares, place, self.length) for place in places], axis=0)
        return images, shares >= MOSTLY_VALID

    def _axes(self, step: list[float]) -> list[tuple[float, int]]:
        """Distance and number of samples along columns and along rows."""
        rows, columns = (side + self.length - 1 for side in self.means.shape[-2:])
        return [(step[1], rows), (step[0], columns)]


def block_images(frame: PlateFrame, most_blocks: int, most_sizes: int = len(SIZES)) -> BlockImages:
    """Running means for the finest of the usual block sizes that leave no more than `most_blocks` a side."""
    sizes = _usable_sizes(min(frame.images.shape[-2:]), most_blocks, aliased=frame.aliased)[:most_sizes]
    spacing = max(1, sizes[0] // _FINEST_MEANS)
    length = sizes[0] // spacing
    means = _running_mean(frame.means(spacing), length)
    shares = None
    if not frame.valid.all():
        shares = _running_mean(frame.shares(spacing), length)
    return BlockImages(means, shares, frame.covariance, length, spacing, sizes, frame.azimuth_deg, frame.aliased)


def _usable_sizes(side: int, most_blocks: int, *, aliased: bool) -> tuple[int, ...]:
    """Block sizes that leave enough blocks, and not needlessly many."""
    enough = [size for size in SIZES if side // size >= _LEAST_BLOCKS] or [1]
    few = [size for size in enough if side // size <= most_blocks and (size >= _LEAST_OF_CELLS or not aliased)]
    return tuple(few or enough[-1:])


def _running_mean(images: Images, length: int) -> Images:
    """Means over the square that begins at each sample; `length` is a power of two."""
    reach = 1
    while reach < length:
        images = images[..., :-reach, :] + images[..., reach:, :]
        images = images[..., :-reach] + images[..., reach:]
        reach *= 2
    images = images * np.float32(1 / length**2) if length > 1 else images
    return images


def _place(length: int, distance: float, times: int, most: int, block: int) -> tuple[int, int, float]:
    """Where along one axis a copy's blocks begin: first sample, number of blocks, share of the sample before it."""
    margin = math.ceil(abs(distance) * most - _WHOLE)
    first = margin if distance > 0 else 0
    whole = math.floor(distance * times + _WHOLE)
    fraction = max(distance * times - whole, 0.0)
    return first - whole, max(0, length - margin) // block, fraction if fraction > _WHOLE else 0.0


def _read(means: Images, place: list[tuple[int, int, float]], block: int) -> Images:
    """Every `block`-th running mean from a place on, bilinearly."""
    (top, n_rows, down), (left, n_columns, right) = place

    def part(y: int, x: int) -> Images:
        return means[..., y : y + block * n_rows : block, x : x + block * n_columns : block]

    def row(y: int) -> Images:
        if right == 0:
            return part(y, left)
        return np.float32(1 - right) * part(y, left) + np.float32(right) * part(y, left - 1)

    if down == 0:
        return row(top)
    return np.float32(1 - down) * row(top) + np.float32(down) * row(top - 1)


SHRINK = 2.0
"""Gradients are shrunk by this many standard errors; not shrunk they leave the incidence up to twice as far off."""
_LEAST_SHIFT_PX = 1.25
"""Ghosts closer than this count as in place. By trial."""
FAINT_OVERLAP = 0.01
"""Squared gradient per block, in units of its noise, that is added to both sides of the normalized overlap: nothing
overlaps where nothing stands out. By trial: without it a scene that makes all gradients faint looks perfect."""
NOISE_BEYOND = 0.0115
"""Mean square of what noise alone leaves of a gradient that is shrunk: 2 ((1 + s^2) Q(s) - s phi(s)), s = SHRINK."""
_ABOVE_NOISE = 1.4
"""Times the noise's own that gradients must have for edges to stand out. By trial."""
PARTS = 4
"""Parts per side of the frame that are left out in turn for standard errors. Set by hand."""
_N_SCALES = 3
"""Scales that the overlap is the mean of, from the finest that tells something. By trial."""
_LEAST_VARIANCE = 1e-30
"""Of a gradient that nothing is left of."""


@dataclass(frozen=True)
class _Scale:
    """Side of its blocks, gradients (direction, copy and entry, channel, block), noise (direction, copies), weights."""

    size: int
    gradients: Images
    noise: Matrix
    weight: Images | None
    shape: tuple[int, int]


@dataclass(frozen=True)
class Overlap:
    """Sums over one scale: |grad r||grad t|, |grad r|^2, |grad t|^2 beyond the noise, in units of it."""

    both: float
    reflection: float
    transmission: float
    n_blocks: int
    n_gradients: int

    @property
    def reflection_seen(self) -> bool:
        """Whether the reflection's edges stand out of the noise at this scale."""
        return self.reflection > _ABOVE_NOISE * NOISE_BEYOND * self.n_gradients * self.n_blocks

    @property
    def value(self) -> float:
        """Normalized overlap, 0..1; 1 where nothing stands out of the noise."""
        return float(_normalized(self.both, self.reflection, self.transmission, self.n_blocks))


class EdgeOverlap:
    """Edge overlap of the layers of a capture, for one ghost shift, at any incidence.

    Parameters
    ----------
    blocks : BlockImages
    scene : SceneParameters
        Index and surfaces of the pane; incidence and azimuth are not used.
    ghost_shift : float
        Pixels along the blocks' azimuth.
    """

    def __init__(self, blocks: BlockImages, scene: SceneParameters, ghost_shift: float) -> None:
        self._scene = scene
        # Copies a pixel apart only differ by noise and a derivative; what is left of edges then says little.
        self._in_place = abs(ghost_shift) < _LEAST_SHIFT_PX or scene.single_surface or scene.n_bounces == 0
        self._covariance, self._aliased = blocks.covariance, blocks.aliased
        copies, valid = blocks.copies(ghost_shift, 1 if self._in_place else 3)
        share = None if valid is None else valid.astype(np.float32)
        step = blocks.step(ghost_shift)
        self._scales = []
        for size in blocks.sizes:
            if min(copies.shape[-2:]) < 2:
                break
            self._scales.append(_scale(copies, share, step, size))
            copies, share = block_mean(copies, 2), None if share is None else block_mean(share, 2)

    def at(self, incidence_deg: float) -> list[Overlap]:
        """Overlap at each scale."""
        factors = self._factors(incidence_deg)
        return [_overlap(scale, factors, self._covariance) for scale in self._scales]

    def joint(self, incidence_deg: float) -> float:
        """Geometric mean of the overlap over the scales, 0..1."""
        return math.exp(sum(math.log(part.value) for part in self.at(incidence_deg)) / max(1, len(self._scales)))

    def left_out(self, incidence_deg: float) -> Matrix:
        """The joint overlap without each part of the frame, (part,); of a single part where no scale tells anything."""
        if not self._scales:
            return np.ones(1)
        factors = self._factors(incidence_deg)
        rows, columns = (min(sides) for sides in zip(*(scale.shape for scale in self._scales), strict=True))
        groups = min(PARTS, rows), min(PARTS, columns)
        sums = [_parts(scale, factors, self._covariance, groups) for scale in self._scales]
        logs = [np.log(_normalized(*left_out(part))) for part in sums]
        return np.asarray(np.exp(np.mean(logs, axis=0)))

    def at_best_scales(self, incidence_deg: float) -> EdgeOverlap:
        """The same on the finest scale at which the reflection's edges stand out of the noise, and coarser ones."""
        seen = [part.reflection_seen for part in self.at(incidence_deg)]
        first = seen.index(True) if True in seen else len(seen) - 1
        first = max(0, min(first, len(seen) - _N_SCALES))
        if self._aliased and incidence_deg < _FAINT_DEG:
            n_finer = sum(scale.size < _LEAST_OF_FAINT for scale in self._scales)
            first = max(first, min(n_finer, len(seen) - 1))
        chosen = copy.copy(self)
        chosen._scales = self._scales[first : first + _N_SCALES]
        return chosen

    def _factors(self, incidence_deg: float) -> Matrix:
        """Weights (layer, copy, entry) that leave one layer of two: [0] reflection, [1] transmission."""
        cleared = plate_at(incidence_deg, self._scene).cleared()
        layers = zip((cleared.transmission, cleared.reflection), (1, -1), strict=True)
        # Eliminating one layer multiplies by the other's factor, and by the denominator.
        factors = np.array([_elimination(layer, cleared.ratio, sign) for layer, sign in layers])
        return factors.sum(axis=1, keepdims=True) if self._in_place else factors


def _elimination(layer: tuple[Matrix, Matrix], ratio: Matrix, sign: int) -> Matrix:
    """Coefficients (1, z and z^2; par and perp) of what takes a layer ``c_0 + c_1 z`` out of the photographs.

    Each is multiplied by what the other shows of the layer, and by its own denominator ``1 - ratio z``.
    """
    swapped, signs = [part[::-1] for part in layer], np.array([sign, -sign])
    a, b = (signs * part for part in swapped)
    return np.stack([a, b - a * ratio, -b * ratio])


def _scale(copies: Images, share: Images | None, step: Step, size: int) -> _Scale:
    """Gradients of block means (copy, entry, channel, h, w), and where all three blocks they need are known."""
    n_copies, n_entries, n_channels, height, width = copies.shape
    gradients = np.empty((2, n_copies, n_entries, n_channels, height - 1, width - 1), np.float32)
    corner = copies[..., :-1, :-1]
    np.subtract(copies[..., :-1, 1:], corner, out=gradients[0])
    np.subtract(copies[..., 1:, :-1], corner, out=gradients[1])
    weight = None
    if share is not None:
        good = share.min(axis=0) >= MOSTLY_VALID
        weight = (good[:-1, :-1] & good[:-1, 1:] & good[1:, :-1]).astype(np.float32).ravel()
    flat = gradients.reshape(2, n_copies * n_entries, n_channels, -1)
    return _Scale(size, flat, _noise_factors(n_copies, step, size), weight, (height - 1, width - 1))


def _noise_factors(n_copies: int, step: tuple[float, float], size: int) -> Matrix:
    """Covariance (direction, copy, copy) of block-mean gradients between copies, for unit white noise in the pixels."""
    lag = np.subtract.outer(np.arange(n_copies), np.arange(n_copies)) / size
    x, y = lag * step[0], lag * step[1]

    def along(distance: Matrix) -> Matrix:
        return 2 * _triangle(distance) - _triangle(distance - 1) - _triangle(distance + 1)

    return np.stack([along(x) * _triangle(y), along(y) * _triangle(x)]) / size**2


def _triangle(distance: Matrix) -> Matrix:
    triangle: Matrix = np.maximum(0, 1 - np.abs(distance))
    return triangle


def _normalized(both: Any, reflection: Any, transmission: Any, n_blocks: Any) -> Any:
    pseudo = FAINT_OVERLAP * np.maximum(n_blocks, 1)
    return (both + pseudo) / (np.sqrt(reflection * transmission) + pseudo)


def _overlap(scale: _Scale, factors: Matrix, covariance: Matrix) -> Overlap:
    """Sums over a scale."""
    reflection, transmission = _energies(scale, factors, covariance)
    n_channels, n_blocks = scale.gradients.shape[2:]
    return Overlap(
        float(np.sum(np.sqrt(reflection * transmission), dtype=np.float64)),
        float(np.sum(reflection, dtype=np.float64)),
        float(np.sum(transmission, dtype=np.float64)),
        n_blocks if scale.weight is None else int(np.sum(scale.weight)),
        2 * n_channels,
    )


def _parts(scale: _Scale, factors: Matrix, covariance: Matrix, groups: tuple[int, int]) -> Matrix:
    """The same sums and the number of blocks over each part of the frame, (4, part)."""
    reflection, transmission = _energies(scale, factors, covariance)
    weight = np.ones_like(reflection) if scale.weight is None else scale.weight
    maps = np.stack([np.sqrt(reflection * transmission), reflection, transmission, weight])
    return grid_sums(maps.reshape(4, *scale.shape), groups)


def _energies(scale: _Scale, factors: Matrix, covariance: Matrix) -> tuple[Images, Images]:
    """Squared gradients of reflection and transmission beyond the noise, in units of it, of each block."""
    _, n_sources, n_channels, n_blocks = scale.gradients.shape
    variance = np.einsum("lae,dab,lbf,ef->dl", factors, scale.noise, factors, covariance)
    error = np.sqrt(np.maximum(variance, _LEAST_VARIANCE))
    mixing = (factors.reshape(1, 2, n_sources) / error[:, :, None]).astype(np.float32)
    beyond = np.matmul(mixing, scale.gradients.reshape(2, n_sources, -1))
    np.abs(beyond, out=beyond)
    beyond -= np.float32(SHRINK)
    np.maximum(beyond, 0, out=beyond)
    # All directions and colours of a block together: an edge need not show in all of them.
    beyond = beyond.reshape(2, 2, n_channels, n_blocks)
    energy = np.einsum("dlcn,dlcn->ln", beyond, beyond)
    if scale.weight is not None:
        energy *= scale.weight
    return energy[0], energy[1]


def noise_of_mirrored(frame: PlateFrame, scene: SceneParameters) -> float:
    """Standard deviation of the noise of a pixel of what a flat pane mirrors, infinite where it polarizes nothing.

    Parameters
    ----------
    frame : PlateFrame
        At the azimuth of the scene.
    scene : SceneParameters
        Complete.
    """
    par, perp = in_place_reflectance(scene.values()[0], scene.index, *scene.sheets)
    if perp - par < _LEAST_DIFFERENCE:
        return math.inf
    weights = 2 * np.array([perp - 1, 1 - par]) / (perp - par)
    return math.sqrt(weights @ frame.covariance @ weights)
