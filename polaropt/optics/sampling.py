"""What a sensor with a mosaic of filters samples: one polarizer angle, and one colour, in each pixel."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from polaropt.optics.engine import PSE, VaryingPSE

Indices = NDArray[np.intp]
Pattern = tuple[tuple[int, ...], ...]

# Share of the strongest alternation that others have at least: filters a few degrees off make weak ones. Set by hand.
_ALTERNATES = 0.1


@dataclass(frozen=True)
class Sampling:
    """A mosaic's pattern, which repeats over the sensor.

    Attributes
    ----------
    photographs : tuple of tuples of int
        Which of the photographs (one an angle) each pixel of the pattern belongs to, row by row.
    channels : tuple of tuples of int
        Its colour, 0 in a mono mosaic; as many rows and columns.
    """

    photographs: Pattern
    channels: Pattern

    @property
    def period(self) -> int:
        """Side of the pattern in pixels: 2 mono, 4 colour."""
        return len(self.photographs)

    @property
    def n_channels(self) -> int:
        """Colours that are sampled."""
        return 1 + max(max(row) for row in self.channels)

    @cached_property
    def places(self) -> tuple[tuple[int, int, int, int], ...]:
        """Photograph, channel, row and column of each pixel of the pattern."""
        return tuple(
            (self.photographs[row][column], self.channels[row][column], row, column)
            for row in range(self.period)
            for column in range(self.period)
        )

    def alternations(self, angles_deg: Sequence[float]) -> tuple[tuple[float, float], ...]:
        """By which polarized light is sampled alternately, down and across, in periods per pixel.

        In a cell whose orthogonal pairs lie across from each other along its diagonals, that is by rows and by columns.

        Parameters
        ----------
        angles_deg : sequence of float
            Of the photographs' polarizers.
        """
        light = np.exp(2j * np.radians(np.asarray(angles_deg)[np.array(self.photographs)]))
        strength = np.abs(np.fft.fft2(light))
        strength[0, 0] = 0
        rows, columns = np.nonzero(strength > _ALTERNATES * strength.max())
        return tuple((row / self.period, column / self.period) for row, column in zip(rows, columns, strict=True))

    def weights(self, mixing: NDArray[np.float64], basis: NDArray[np.float64]) -> NDArray[np.float64]:
        """What each pixel of the pattern tells of images in a basis of colours, (color, entry, period * period).

        Parameters
        ----------
        mixing : ndarray, shape (k, entry)
            Photographs from images.
        basis : ndarray, shape (color, channel)
        """
        photographs, channels = np.ravel(self.photographs), np.ravel(self.channels)
        return np.asarray(mixing[photographs].T * basis[:, None, channels])

    def moved(self, rows: int, columns: int) -> Sampling:
        """The pattern of a frame that begins so many rows down and columns to the right (negative: up and left)."""
        turned = (-rows % self.period, -columns % self.period)
        photographs, channels = (
            tuple(map(tuple, np.roll(pattern, turned, (0, 1)).tolist()))
            for pattern in (self.photographs, self.channels)
        )
        return Sampling(photographs, channels)

    def laid_out(self, values: NDArray[Any], shape: tuple[int, ...]) -> NDArray[np.float32]:
        """Values (k, channel), or (k, channel, h / period, w / period), where they are sampled in a frame (h, w)."""
        laid = np.empty(shape, np.float32)
        for photograph, channel, row, column in self.places:
            laid[row :: self.period, column :: self.period] = values[photograph, channel]
        return laid

    def sample(self, images: NDArray[Any]) -> NDArray[Any]:
        """Raw samples (h, w) of photographs (k, channel, h, w)."""
        raw = np.empty(images.shape[-2:], dtype=images.dtype)
        for photograph, channel, row, column in self.places:
            here = (slice(row, None, self.period), slice(column, None, self.period))
            raw[here] = images[(photograph, channel, *here)]
        return raw

    def spread(self, raw: NDArray[Any], n_photographs: int) -> NDArray[Any]:
        """Transpose of `sample`: photographs (k, channel, h, w) with zeros (False) where nothing was sampled."""
        images = np.zeros((n_photographs, self.n_channels, *raw.shape), dtype=raw.dtype)
        for photograph, channel, row, column in self.places:
            here = (slice(row, None, self.period), slice(column, None, self.period))
            images[(photograph, channel, *here)] = raw[here]
        return images


class SampledPSE:
    """An engine behind a mosaic: raw samples of two layers, and the transpose.

    Parameters
    ----------
    engine : PSE or VaryingPSE
    sampling : Sampling
    """

    def __init__(self, engine: PSE | VaryingPSE, sampling: Sampling) -> None:
        self.engine, self.sampling = engine, sampling

    def forward(self, layers: NDArray[Any]) -> NDArray[Any]:
        """Raw samples (h, w) of layers (2, channel, h, w)."""
        return self.sampling.sample(np.asarray(self.engine.forward(layers)))

    def adjoint(self, raw: NDArray[Any]) -> NDArray[Any]:
        """Transpose of `forward`: raw samples (h, w) to layers (2, channel, h, w)."""
        return np.asarray(self.engine.adjoint(self.sampling.spread(raw, len(self.engine.angles_deg))))
