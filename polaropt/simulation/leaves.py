"""Generated images with the statistics of natural ones: leaves of all sizes that hide each other."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Image = NDArray[np.float32]
Mask = NDArray[np.bool_]

# Where nothing else is said numbers of this module are set by hand, to look like photographs.
_SMALLEST_PX, _LARGEST_SHARE = (2.0, 9.0), 0.4
"""Radius of the smallest leaves of a picture, between these; of the largest, as a share of its side."""
_MOST_LEAVES = 4000
_FINER = 2
"""Pictures are drawn larger by this factor and averaged, so that edges are as smooth as a lens makes them."""


@dataclass(frozen=True)
class _Palette:
    """Colours that a picture is made of: a few hues, each with its spread."""

    colors: Image

    @classmethod
    def drawn(cls, random: np.random.Generator) -> _Palette:
        """Mostly muted colours, some saturated, as in photographs."""
        n = int(random.integers(3, 7))
        value = random.beta(1.2, 1.6, (n, 1))
        saturation = random.beta(1.0, 2.5, (n, 1))
        hue = random.random((n, 3))
        hue = (hue - hue.min(1, keepdims=True)) / (np.ptp(hue, axis=1, keepdims=True) + 1e-6)
        return cls((value * (1 - saturation * (1 - hue))).astype(np.float32))

    def one(self, random: np.random.Generator) -> Image:
        """A colour near one of the palette's, (3,)."""
        color = self.colors[random.integers(len(self.colors))]
        varied = color * np.exp(random.normal(0, 0.35)) * np.exp(random.normal(0, 0.06, 3))
        return np.asarray(np.clip(varied, 0, 1), dtype=np.float32)


def dead_leaves(size: int, seed: int) -> Image:
    """A square image of leaves.

    Parameters
    ----------
    size : int
        Side in pixels.
    seed : int

    Returns
    -------
    ndarray of float32, shape (size, size, 3)
        In [0, 1], as an encoded photograph's values.

    References
    ----------
    A. B. Lee, D. Mumford, J. Huang, Occlusion models for natural images, IJCV 41, 2001 (radii whose density falls with
    the third power). R. Achddou, Y. Gousseau, S. Ladjal, Synthetic images as a regularity prior for image restoration
    neural networks, SSVM 2021.
    """
    random = np.random.default_rng([2001, seed])
    side = _FINER * size
    palette, texture = _Palette.drawn(random), _textures(side, random)
    image = np.empty((side, side, 3), dtype=np.float32)
    image[...] = palette.one(random)
    _paint(image, np.ones((side, side), dtype=bool), (slice(None), slice(None)), texture, random)
    for radius in _radii(size, random)[::-1]:
        _leaf(image, radius * _FINER, palette, texture, random)
    small = image.reshape(size, _FINER, size, _FINER, 3).mean(axis=(1, 3))
    return np.asarray(np.clip(small, 0, 1), dtype=np.float32)


def _radii(size: int, random: np.random.Generator) -> NDArray[np.float64]:
    """Radii in pixels, smallest first, whose density falls with the third power: as many as cover the image twice."""
    low, high = random.uniform(*_SMALLEST_PX) ** (-2), (_LARGEST_SHARE * size) ** (-2)
    radii = (low + random.random(_MOST_LEAVES) * (high - low)) ** (-0.5)
    # The rare large leaves first in a random order would hide all small ones: the order is partly by size.
    order = np.argsort(radii * random.lognormal(0, 0.8, radii.size))
    return np.asarray(radii[order][-int(min(_MOST_LEAVES, 3 * size)) :])


def _textures(side: int, random: np.random.Generator) -> Image:
    """Two fields of noise (2, side, side) whose spectra fall differently, of standard deviation 1."""
    rows, columns = np.fft.fftfreq(side)[:, None], np.fft.rfftfreq(side)[None]
    fields = []
    for power in random.uniform(0.6, 1.6, 2):
        stretch = np.exp(random.normal(0, 0.7))
        frequency = np.sqrt((rows * stretch) ** 2 + (columns / stretch) ** 2) + 2 / side
        spectrum = np.fft.rfft2(random.standard_normal((side, side))) / frequency**power
        field = np.fft.irfft2(spectrum, s=(side, side))
        fields.append((field - field.mean()) / field.std())
    return np.asarray(np.stack(fields), dtype=np.float32)


def _leaf(image: Image, radius: float, palette: _Palette, texture: Image, random: np.random.Generator) -> None:
    """One leaf somewhere: a disc, an ellipse or a rectangle, turned."""
    side = image.shape[0]
    center = random.uniform(0, side, 2)
    box = tuple(slice(max(0, int(c - radius)), min(side, int(c + radius) + 1)) for c in center)
    y, x = np.mgrid[box[0], box[1]].astype(np.float32)
    turn, flatness = random.uniform(0, np.pi), random.uniform(0.2, 1.0)
    along = (x - center[1]) * np.cos(turn) + (y - center[0]) * np.sin(turn)
    across = ((y - center[0]) * np.cos(turn) - (x - center[1]) * np.sin(turn)) / flatness
    if random.random() < 0.35:
        inside = np.maximum(np.abs(along), np.abs(across)) < radius / 2**0.5
    else:
        inside = along * along + across * across < radius * radius
    image[box][inside] = palette.one(random)
    _paint(image, inside, box, texture, random)


def _paint(image: Image, inside: Mask, box: tuple[slice, ...], texture: Image, random: np.random.Generator) -> None:
    """Shading across a leaf, and on some leaves texture."""
    part = image[box]
    height, width = inside.shape
    slope = random.normal(0, 0.25, 2)
    rows, columns = np.linspace(-0.5, 0.5, height)[:, None], np.linspace(-0.5, 0.5, width)[None]
    light = 1 + slope[0] * rows + slope[1] * columns
    if random.random() < 0.6:
        light = light + random.exponential(0.12) * texture[random.integers(2)][box]
    part[inside] *= np.maximum(light, 0).astype(np.float32)[inside][:, None]
