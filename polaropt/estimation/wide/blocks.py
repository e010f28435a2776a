"""Polarized light of blocks of a frame: what is left across the plane of incidence, wherever that lies.

Unpolarized layers leave no light polarized at 45 degrees to the plane of incidence, in any pixel, so that this tells
how the plane turns over the frame.
"""

from __future__ import annotations

import copy
import math
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from polaropt.capture import StokesImages
from polaropt.estimation.flat.gradients import seen_blocks
from polaropt.numerics import spread_blocks
from polaropt.optics import FLAT, Bend, bent_normal, incidence_trace, pixel_grid, plane_normal, twice_the_azimuth

Values = NDArray[np.float64]

# Blocks along the longer side, at most: for errors and misfits, and where a search begins. Set by hand.
_BLOCKS = 48
COARSE_BLOCKS = 12
# Parts of the frame along each side that gradients are summed over for standard errors. Set by hand.
_GROUPS = 8
# Standard deviations of the noise beyond which something is no chance: 99.7 % of a normal distribution.
SCATTERS = 3.0
# Negative light, as a share of a layer's mean, that is not counted: the model is not that exact. Set by hand.
_FAINT = 0.05


class PolarizedBlocks:
    """Polarized light of blocks of a frame, in units of its noise.

    Parameters
    ----------
    stokes : StokesImages
    most : int
        Blocks along the longer side, at most.

    Attributes
    ----------
    n : int
        Number of blocks times colours.
    half_px : float
        Half the longer side of the frame.
    noise : float
        Standard deviation of the noise of a block's s1 and s2.
    aliases : float
        The same in units of what white noise would leave there; more than 1 of a mosaic's cells.
    """

    def __init__(self, stokes: StokesImages, most: int = _BLOCKS) -> None:
        height, width = stokes.images.shape[-2:]
        size = max(1, math.ceil(max(height, width) / most))
        self._source, self._size, self._frame = stokes, size, (height, width)
        means = stokes.means(size)[1:]
        self.aliases = stokes.block_noise(size)
        self.noise = self.aliases * math.sqrt(float(np.trace(stokes.covariance[1:, 1:])) / 2) / size
        # A clipped pixel is no polarized light.
        self._seen = seen = seen_blocks(stokes.shares(size).min(axis=0).ravel())
        self._s1, self._s2 = (means.astype(np.float64) / self.noise).reshape(2, means.shape[1], -1)[..., seen]
        rows, columns = means.shape[-2:]
        x, y = pixel_grid(rows, columns, ((width - size) / 2 / size, (height - size) / 2 / size))
        self._x, self._y = (size * grid.ravel()[seen] for grid in np.broadcast_arrays(x, y))
        self.n, self.half_px, self._trust = self._s1.size, max(height, width) / 2, 1.0

    def trusted(self, weights: Values) -> PolarizedBlocks:
        """The same with weights (m,) for the blocks' squares, up to 1; misfits are then weighted means."""
        other = copy.copy(self)
        other.__dict__.pop("moments", None)
        root = np.sqrt(weights)
        other._s1, other._s2 = self._s1 * root, self._s2 * root
        other._trust = self._trust * float(weights.mean())
        return other

    @cached_property
    def stokes(self) -> Values:
        """All Stokes components of the blocks as they were measured, in units of `noise`, (3, channel, m)."""
        means = self._source.means(self._size)
        return np.asarray(means.reshape(*means.shape[:2], -1)[..., self._seen].astype(np.float64) / self.noise)

    @property
    def covariance(self) -> Values:
        """Of the noise of `stokes`, (3, 3)."""
        return np.asarray(self._source.covariance * (self.aliases / (self._size * self.noise)) ** 2)

    def negative(self, weights: Values) -> float:
        """Share of the blocks where a layer has clearly less than no light.

        Parameters
        ----------
        weights : ndarray, shape (2, 3, m)
            What makes each block's layers, up to a factor, of its Stokes components.
        """
        light = np.einsum("lim,icm->lm", weights, self.stokes)
        noise = np.sqrt(self.stokes.shape[1] * np.einsum("lim,ij,ljm->lm", weights, self.covariance, weights))
        least = np.maximum(SCATTERS * noise, _FAINT * np.abs(light).mean(axis=1, keepdims=True))
        return float((light < -least).any(axis=0).mean())

    @property
    def brightness(self) -> Values:
        """Mean square of each block's polarized light over the colours, without what is noise, (m,)."""
        return np.asarray(np.maximum((np.square(self._s1) + np.square(self._s2)).mean(axis=0) - 2, 0))

    def squares(self, incidence_deg: float, azimuth_deg: float, focal_px: float) -> Values:
        """Mean square over the colours of what a flat pane leaves across in each block, (m,)."""
        across = self.across(incidence_deg, azimuth_deg, focal_px).reshape(self._s1.shape)
        return np.asarray(np.square(across).mean(axis=0))

    def across(self, incidence_deg: float, azimuth_deg: float, focal_px: float, bend: Bend = FLAT) -> Values:
        """Light polarized at 45 degrees to the plane of incidence, flat, in units of its noise."""
        normal = bent_normal(plane_normal(incidence_deg, azimuth_deg), bend, 1 / focal_px, self._x, self._y)
        cos, sin = twice_the_azimuth(*incidence_trace(normal, 1 / focal_px, self._x, self._y))
        return np.asarray(cos * self._s2 - sin * self._s1).ravel()

    def misfit(self, incidence_deg: float, azimuth_deg: float, focal_px: float, bend: Bend = FLAT) -> float:
        """Its mean square."""
        return float(np.mean(np.square(self.across(incidence_deg, azimuth_deg, focal_px, bend)))) / self._trust

    def constant_misfit(self, azimuth_deg: float) -> float:
        """The same for one azimuth all over the frame."""
        return float(np.mean(np.square(self._across_one(azimuth_deg)))) / self._trust

    def plane_misfit(self, shown: Values) -> float:
        """Mean square of what no two layers make that show some Stokes vectors (2, 3), in units of its noise."""
        off = np.cross(*shown)
        left = np.einsum("i,icm->cm", off, self.stokes)
        # All light together hardly aliases.
        noise = off / [self.aliases, 1.0, 1.0]
        return float(np.mean(np.square(left)) / (noise @ self.covariance @ noise))

    def squares_across(self, azimuth_deg: float) -> Values:
        """Mean square over the colours of what is polarized across one azimuth in each block, (m,)."""
        return np.asarray(np.square(self._across_one(azimuth_deg)).mean(axis=0))

    def _across_one(self, azimuth_deg: float) -> Values:
        double = 2 * math.radians(azimuth_deg)
        across: Values = math.cos(double) * self._s2 - math.sin(double) * self._s1
        return across

    def laid_out(self, values: NDArray[Any]) -> NDArray[Any]:
        """Values (m,) of the blocks where they lie, (rows, columns); zeros where nothing was seen."""
        rows, columns = (side // self._size for side in self._frame)
        grid = np.zeros(rows * columns, dtype=values.dtype)
        grid[self._seen] = values
        return grid.reshape(rows, columns)

    def in_pixels(self, grid: NDArray[Any]) -> NDArray[Any]:
        """What is laid out by blocks, of each pixel of the frame (h, w); beyond the last blocks as in them."""
        return spread_blocks(grid, self._size, self._frame)

    def least_constant_misfit(self) -> float:
        """The same for the azimuth that leaves least."""
        s11, s12, s22 = self.moments.sum(axis=1) / self.n
        return float((s11 + s22) / 2 - math.hypot((s11 - s22) / 2, s12)) / self._trust

    @property
    def at_px(self) -> Values:
        """Where the blocks lie, x to the right and y up from the middle in pixels, (2, m)."""
        return np.stack([self._x, self._y])

    @cached_property
    def places(self) -> Values:
        """Where the blocks lie, x to the right and y up from the middle in units of half the longer side, (2, m)."""
        places: Values = np.stack([self._x, self._y]) / self.half_px
        return places

    @cached_property
    def moments(self) -> Values:
        """Sums of s1 s1, s1 s2 and s2 s2 over the colours of each block, (3, m): all that a fit needs of them."""
        pairs = ((self._s1, self._s1), (self._s1, self._s2), (self._s2, self._s2))
        return np.stack([np.einsum("cm,cm->m", a, b) for a, b in pairs])

    def grouped(self, values: Values) -> Values:
        """Sums of values (m, ...) over neighbouring blocks: an 8x8 chessboard's squares, those that are seen."""
        column, row = np.minimum((self.places + 1) / 2 * _GROUPS, _GROUPS - 1).astype(int)
        _, group = np.unique(row * _GROUPS + column, return_inverse=True)
        sums: Values = np.zeros((group.max() + 1, *values.shape[1:]))
        np.add.at(sums, group, values)
        return sums
