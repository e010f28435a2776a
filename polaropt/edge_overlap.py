"""How far the edges of the two layers fall together, for a trial incidence: least at the true one.

The pane is inverted linearly, all ghosts included. With R one interface's reflectance and z the shift by a ghost step,
``(1 - R^2 z) I = 1/2 [(R + R (1 - 2R) z) r + (1 - R)^2 t]`` for both polarizations; eliminating one layer leaves the
other, itself with a ghost, from at most three copies of the images. So for one ghost shift the gradients of those
copies are taken once, and every incidence is a sum of them.
"""

from __future__ import annotations

import copy
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from polaropt.fresnel import interface
from polaropt.plate_frame import Images, Mask, Matrix, PlateFrame, block_mean
from polaropt.scene import SceneParameters

SHRINK = 2.0
"""Gradients are shrunk by this many standard errors."""
SIZES = (2, 4, 8, 16, 32)
_LEAST_BLOCKS, _MOST_BLOCKS = 8, 160
"""Per side; a larger frame has enough of them at a coarser scale."""
_LEAST_SHIFT = 1.25
_MOSTLY = 0.75
_PSEUDO = 0.01
_NOISE_BEYOND = 0.0115
"""Mean square of what noise alone leaves of a gradient shrunk by two standard errors."""
_SEEN = 1.4


@dataclass(frozen=True)
class _Scale:
    """Gradients (copy, entry, direction, channel, h, w) of block means, and the noise's covariance between copies."""

    gradients: Images
    noise: Matrix
    weight: Images | None


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
        return self.reflection > _SEEN * _NOISE_BEYOND * self.n_gradients * self.n_blocks

    @property
    def value(self) -> float:
        """Normalized overlap, 0..1; 1 where nothing stands out of the noise."""
        pseudo = _PSEUDO * self.n_blocks
        return (self.both + pseudo) / (math.sqrt(self.reflection * self.transmission) + pseudo)


class EdgeOverlap:
    """Edge overlap of the layers of a capture, for one ghost shift, at any incidence.

    Parameters
    ----------
    frame : PlateFrame
    scene : SceneParameters
        Index and surfaces of the pane; incidence and azimuth are not used.
    ghost_shift : float
        Pixels along the frame's azimuth.
    scales : sequence of int
        Block sizes in pixels.
    """

    def __init__(
        self, frame: PlateFrame, scene: SceneParameters, ghost_shift: float, scales: Sequence[int] = SIZES
    ) -> None:
        self._scene = scene
        # Copies a pixel apart only differ by noise and a derivative; what is left of edges then says little.
        self._in_place = abs(ghost_shift) < _LEAST_SHIFT or scene.single_surface or scene.n_bounces == 0
        self._covariance = frame.covariance
        azimuth = math.radians(frame.azimuth_deg)
        step = (ghost_shift * math.cos(azimuth), -ghost_shift * math.sin(azimuth))
        copies, valid = _shifted_copies(frame, step, 1 if self._in_place else 3)
        self.scales = _usable_sizes(scales, min(frame.images.shape[-2:]))
        self._scales = [_scale(copies, valid, step, size) for size in self.scales]

    def at(self, incidence_deg: float) -> list[Overlap]:
        """Overlap at each scale."""
        factors = self._factors(incidence_deg)
        return [_overlap(scale, factors, self._covariance) for scale in self._scales]

    def joint(self, incidence_deg: float) -> float:
        """Geometric mean of the overlap over the scales, 0..1."""
        return math.exp(sum(math.log(part.value) for part in self.at(incidence_deg)) / len(self.scales))

    def at_best_scales(self, incidence_deg: float, n_scales: int = 3) -> EdgeOverlap:
        """The same on the finest scale at which the reflection's edges stand out of the noise, and coarser ones."""
        seen = [part.reflection_seen for part in self.at(incidence_deg)]
        first = seen.index(True) if True in seen else len(seen) - 1
        first = max(0, min(first, len(seen) - n_scales))
        chosen = copy.copy(self)
        chosen.scales = self.scales[first : first + n_scales]
        chosen._scales = self._scales[first : first + n_scales]
        return chosen

    def _factors(self, incidence_deg: float) -> Matrix:
        """Weights (layer, copy, entry) that leave one layer of two: [0] reflection, [1] transmission."""
        (r_p, r_s, _), (t_p, t_s, _) = interface(incidence_deg, self._scene.refractive_index)
        if self._scene.single_surface or self._scene.n_bounces == 0:
            if not self._scene.single_surface:
                t_p, t_s = t_p * t_p, t_s * t_s
            return np.array([[[t_s, -t_p]], [[-r_s, r_p]]])
        reflection = _times([t_s * t_s], r_p), -_times([t_p * t_p], r_s)
        transmission = -_times([r_s, r_s * (1 - 2 * r_s)], r_p), _times([r_p, r_p * (1 - 2 * r_p)], r_s)
        factors = np.stack([np.stack(reflection, axis=1), np.stack(transmission, axis=1)])
        return factors.sum(axis=1, keepdims=True) if self._in_place else factors


def _usable_sizes(sizes: Sequence[int], side: int) -> tuple[int, ...]:
    """Block sizes that leave enough blocks, and not needlessly many."""
    enough = [size for size in sizes if side // size >= _LEAST_BLOCKS] or [1]
    few = [size for size in enough if side // size <= _MOST_BLOCKS]
    return tuple(few or enough[-1:])


def _times(polynomial: Sequence[float], reflectance: float) -> Matrix:
    """Coefficients of ``polynomial (1 - R^2 z)`` in z, three of them."""
    product = np.convolve(polynomial, [1, -reflectance * reflectance])
    return np.pad(product, (0, 3 - product.size))


def _shifted_copies(frame: PlateFrame, step: tuple[float, float], n_copies: int) -> tuple[Images, Mask | None]:
    """Copies (copy, entry, channel, h, w) shifted by 0, 1, 2 ghost steps, cut to where all of them exist."""
    everywhere = bool(frame.valid.all())
    images = [_shifted_inside(frame.images, step, k, n_copies - 1) for k in range(n_copies)]
    if everywhere:
        return np.stack(images), None
    valid = frame.valid.astype(np.float32)
    masks = [_shifted_inside(valid, step, k, n_copies - 1) for k in range(n_copies)]
    return np.stack(images), np.min(masks, axis=0) > 1 - 1e-3


def _shifted_inside(images: Images, step: tuple[float, float], times: int, most: int) -> Images:
    height, width = images.shape[-2:]
    for axis, length, distance in ((-1, width, step[0]), (-2, height, step[1])):
        images = _shift_cut(images, axis, length, distance * times, math.ceil(abs(distance) * most) * np.sign(distance))
    return images


def _shift_cut(images: Images, axis: int, length: int, distance: float, margin: float) -> Images:
    """Bilinear shift along one axis, cut by `margin` samples on the side where samples would be missing."""
    first, last = (int(margin), length) if margin >= 0 else (0, length + int(margin))
    whole = math.floor(distance + 1e-9)
    fraction = max(distance - whole, 0.0)

    def part(offset: int) -> Images:
        index = np.clip(np.arange(first - offset, last - offset), 0, length - 1)
        return np.take(images, index, axis=axis)

    if fraction < 1e-9:
        return part(whole)
    return np.asarray((1 - fraction) * part(whole) + fraction * part(whole + 1), np.float32)


def _scale(copies: Images, valid: Mask | None, step: tuple[float, float], size: int) -> _Scale:
    blocks = block_mean(copies, size)
    if valid is None:
        return _Scale(_gradients(blocks), _noise_factors(len(copies), step, size), None)
    share = block_mean(valid.astype(np.float32), size)
    means = block_mean((copies * valid).astype(np.float32), size) / np.maximum(share, 1e-3)
    good = share >= _MOSTLY
    usable = good[..., :-1, :-1] & good[..., :-1, 1:] & good[..., 1:, :-1]
    gradients = _gradients(means.astype(np.float32))
    return _Scale(gradients, _noise_factors(len(copies), step, size), usable.astype(np.float32))


def _gradients(blocks: Images) -> Images:
    gradients: Images = np.stack([np.diff(blocks, axis=-1)[..., :-1, :], np.diff(blocks, axis=-2)[..., :, :-1]], axis=2)
    return gradients


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


def _overlap(scale: _Scale, factors: Matrix, covariance: Matrix) -> Overlap:
    n_copies, n_entries = scale.gradients.shape[:2]
    mixing = factors.reshape(2, n_copies * n_entries).astype(np.float32)
    flat = scale.gradients.reshape(n_copies * n_entries, -1)
    # Not BLAS: its threads cost more than so small a product.
    gradients = np.einsum("la,an->ln", mixing, flat).reshape(2, *scale.gradients.shape[2:])
    variance = np.einsum("lae,dab,lbf,ef->ld", factors, scale.noise, factors, covariance)
    error = np.sqrt(np.maximum(variance, 1e-30))
    np.abs(gradients, out=gradients)
    gradients /= error[:, :, None, None, None].astype(np.float32)
    gradients -= SHRINK
    beyond = np.maximum(gradients, 0, out=gradients)
    # All directions and colours of a block together: an edge need not show in all of them.
    strength = np.sqrt(np.einsum("ldcyx,ldcyx->lyx", beyond, beyond))
    weight = 1.0 if scale.weight is None else scale.weight.min(axis=0)
    reflection, transmission = strength
    return Overlap(
        float(np.sum(reflection * transmission * weight, dtype=np.float64)),
        float(np.sum(reflection**2 * weight, dtype=np.float64)),
        float(np.sum(transmission**2 * weight, dtype=np.float64)),
        reflection.size if scale.weight is None else int(np.sum(weight)),
        beyond.shape[1] * beyond.shape[2],
    )
