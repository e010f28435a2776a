"""Block means of a capture in the plate's frame at any ghost shift, without shifting the pictures.

The mean over a block of a picture shifted bilinearly is the picture's running mean, read bilinearly where the block
came from. So the running means are taken once for all shifts.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from polaropt.plate_frame import Images, Mask, Matrix, PlateFrame, block_mean

Step = tuple[float, float]

SIZES = (2, 4, 8, 16, 32)
_LEAST_BLOCKS = 8
_MOSTLY = 0.75
_READ = 4
"""Running means longer than so many samples are taken of halved pictures."""


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
    """

    means: Images
    shares: Images | None
    covariance: Matrix
    length: int
    spacing: int
    sizes: tuple[int, ...]
    azimuth_deg: float

    @property
    def side(self) -> int:
        """Shorter side of the capture in pixels, but for an incomplete sample."""
        samples: int = min(self.means.shape[-2:]) + self.length - 1
        return self.spacing * samples

    def across(self) -> BlockImages:
        """The same for a pane whose plane of incidence lies across: its two polarizations are exchanged."""
        return BlockImages(
            self.means[::-1],
            self.shares,
            self.covariance[::-1, ::-1],
            self.length,
            self.spacing,
            self.sizes,
            self.azimuth_deg + 90,
        )

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
        return images, shares >= _MOSTLY

    def _axes(self, step: list[float]) -> list[tuple[float, int]]:
        """Distance and number of samples along columns and along rows."""
        rows, columns = (side + self.length - 1 for side in self.means.shape[-2:])
        return [(step[1], rows), (step[0], columns)]


def block_images(frame: PlateFrame, most_blocks: int, most_sizes: int = len(SIZES)) -> BlockImages:
    """Running means for the finest of the usual block sizes that leave no more than `most_blocks` a side."""
    sizes = _usable_sizes(min(frame.images.shape[-2:]), most_blocks)[:most_sizes]
    spacing = max(1, sizes[0] // _READ)
    length = sizes[0] // spacing
    means = _running_mean(block_mean(frame.images, spacing), length)
    shares = None
    if not frame.valid.all():
        shares = _running_mean(block_mean(frame.valid.astype(np.float32), spacing), length)
    return BlockImages(means, shares, frame.covariance, length, spacing, sizes, frame.azimuth_deg)


def _usable_sizes(side: int, most_blocks: int) -> tuple[int, ...]:
    """Block sizes that leave enough blocks, and not needlessly many."""
    enough = [size for size in SIZES if side // size >= _LEAST_BLOCKS] or [1]
    few = [size for size in enough if side // size <= most_blocks]
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
    margin = math.ceil(abs(distance) * most - 1e-9)
    first = margin if distance > 0 else 0
    whole = math.floor(distance * times + 1e-9)
    fraction = max(distance * times - whole, 0.0)
    return first - whole, max(0, length - margin) // block, fraction if fraction > 1e-9 else 0.0


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
