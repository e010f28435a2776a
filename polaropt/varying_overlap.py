"""Edge overlap of the layers where incidence and azimuth vary over the frame, all bounces in place.

Each block of pixels is inverted linearly with its own incidence and azimuth; gradients are shrunk by their standard
errors, as in `polaropt.edge_overlap`. The overlap is normalized in each part of the frame: a trial pane that makes one
part's layers brighter must not make it count for more. With one normalization for all the incidence is 1.4 degrees too
high before a lens of 45 degrees of view.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from polaropt.edge_overlap import SHRINK
from polaropt.jackknife import grid_sums
from polaropt.perspective import Pane, pixel_grid
from polaropt.plate_frame import Images, StokesImages, block_mean
from polaropt.scene import SceneParameters
from polaropt.varying import in_place_weights

Values = NDArray[np.float64]

_FINEST, _MOST_BLOCKS, _SCALES, _LEAST_BLOCKS = 2, 128, 3, 8
_MOSTLY = 0.75
_PSEUDO = 0.01
_LEAST_COSINE = 0.02
_PARTS = 4


@dataclass(frozen=True)
class _Scale:
    """Block means (3, channel, h, w), where gradients count (h - 1, w - 1), and the blocks' places in pixels."""

    means: Images
    weight: Images
    x: Values
    y: Values
    size: int


class VaryingOverlap:
    """Edge overlap of a capture's layers for any pane that varies over the frame.

    Parameters
    ----------
    stokes : StokesImages
    scene : SceneParameters
        Index and surfaces of the pane; its geometry is not used.
    """

    def __init__(self, stokes: StokesImages, scene: SceneParameters) -> None:
        self._covariance, self._scene = stokes.covariance, scene
        side = max(stokes.images.shape[-2:])
        size = max(_FINEST, 2 ** math.ceil(math.log2(side / _MOST_BLOCKS)))
        self._scales = []
        for _ in range(_SCALES):
            if min(stokes.images.shape[-2:]) // size < _LEAST_BLOCKS:
                break
            self._scales.append(_scale(stokes, size))
            size *= 2

    def log(self, pane: Pane) -> Values:
        """Log overlap of each part of the frame (part,), mean over the scales; 0 where nothing is told."""
        return np.asarray(np.mean([self._log_overlap(scale, pane) for scale in self._scales], axis=0))

    @property
    def usable(self) -> bool:
        """Whether the frame is large enough."""
        return bool(self._scales)

    def _log_overlap(self, scale: _Scale, pane: Pane) -> Values:
        cosine, cos, sin = pane.angles(scale.x, scale.y)
        scene = self._scene
        weights = in_place_weights(np.maximum(cosine, _LEAST_COSINE), scene.refractive_index, scene.single_surface)
        energies = [
            _beyond_noise(scale, factor, (cos, sin), self._covariance)
            for factor in _factors(weights[1][0], weights[1][1])
        ]
        transmission, reflection = (scale.weight * energy for energy in energies)
        maps = np.stack([np.sqrt(reflection * transmission), reflection, transmission, scale.weight])
        both, reflections, transmissions, n_blocks = grid_sums(maps, _PARTS)
        pseudo = _PSEUDO * np.maximum(n_blocks, 1)
        return np.asarray(np.log((both + pseudo) / (np.sqrt(reflections * transmissions) + pseudo)))


def _scale(stokes: StokesImages, size: int) -> _Scale:
    height, width = stokes.images.shape[-2:]
    means = block_mean(stokes.images, size)
    good = block_mean(stokes.valid.astype(np.float32), size).min(axis=0) >= _MOSTLY
    weight = good[:-1, :-1] & good[:-1, 1:] & good[1:, :-1]
    rows, columns = means.shape[-2:]
    x, y = pixel_grid(rows, columns, ((width - size) / 2 / size, (height - size) / 2 / size))
    return _Scale(means, weight.astype(np.float32), size * x, size * y, size)


def _factors(par: Values, perp: Values) -> tuple[Values, Values]:
    """What s1' adds to s0 to make transmission and reflection, from the pane's two reflectances."""
    # Next to normal incidence nothing is told; the noise then drowns all.
    difference = np.minimum(par - perp, -1e-9)
    return -(par + perp) / difference, (2 - par - perp) / difference


def _beyond_noise(scale: _Scale, factor: Values, turn: tuple[Values, Values], covariance: Values) -> Values:
    """Squared gradients of one layer in units of their noise, shrunk by it, over colours and directions."""
    f = factor.astype(np.float32)
    with_s1, with_s2 = f * turn[0].astype(np.float32), f * turn[1].astype(np.float32)
    layer = scale.means[0] + with_s1 * scale.means[1] + with_s2 * scale.means[2]
    mixing = np.stack([np.ones_like(f), with_s1, with_s2])
    variance = np.einsum("ihw,ij,jhw->hw", mixing, covariance.astype(np.float32), mixing) * (2 / scale.size**2)
    error = np.sqrt(variance[:-1, :-1])
    energy = np.zeros(error.shape, np.float64)
    corner = layer[:, :-1, :-1]
    for moved in (layer[:, :-1, 1:], layer[:, 1:, :-1]):
        beyond = np.maximum(np.abs(moved - corner) / error - np.float32(SHRINK), 0)
        energy += np.einsum("chw,chw->hw", beyond, beyond)
    return energy
