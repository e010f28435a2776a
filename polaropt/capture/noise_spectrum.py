"""Noise whose neighbours are alike, as of photographs that were demosaicked, resized or smoothed, and how to undo it.

What estimates a scene takes noise to be white. Where it is not, slow changes are noisier than a pixel's noise says and
fine detail is less so: double images are missed, and the incidence comes out too steep. White it becomes by adding to
each pixel what it stands out of its neighbours by, and what that stands out by, and so on. This commutes with a flat
pane: the layers of what comes out are those of the photographs after the same.

How noise falls with frequency is told by what more than three photographs say twice. A frequency is named by how much
of it stands out of its four neighbours, ``1 - (cos x + cos y) / 2``: 0 for what is constant, 2 for a chessboard.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from polaropt.capture.capture import Capture
from polaropt.capture.pair_gain import gain_remover, redundancy_residual
from polaropt.numerics import ROUNDED, column_multiplicity, frequencies, hann_tile, quantization_step, strips
from solvers.kernels import in_blocks

Floats = NDArray[np.float64]
Images = NDArray[np.float32]

_TILE = 32
"""Side in pixels of the tiles whose spectra are looked at; set by hand."""
_FEWEST_TILES, _MOST_TILES = 9, 400
"""Tiles that tell a spectrum, and so many that more tell nothing else; set by hand."""
_EDGES = np.concatenate([[0.015], np.linspace(0.1, 2.0, 13)])
"""Of classes of frequencies. Slower changes than the first one's are those of gains and angles that are not as told."""
_MOST_POWERS, _LOOKED_AT = 5, 21
"""Of what stands out, the zeroth too, that are summed, and frequencies at which the sum is looked at; set by hand."""
_LEAST_SHARE = 1 / 6
"""Of the strongest noise, that any frequency is taken to have at least: fine detail is not raised more than that."""
_CORRELATED = 1.25
"""By how much noise of half the highest frequency is weaker than that of slow changes, from which on it is not white.
White noise comes within 0.03 of 1."""
_OF_SLOW, _OF_COMMON = 0.3, 0.75
"""Powers of both in the noise that layers are solved for; the larger counts. By trial on 10 simulated captures of
training photographs, in five kinds of noise: the transmission gains 0.3 to 0.7 dB by it, the reflection 0.5 to 1.6."""
_COMMON = 1.1
"""From which on colours have noise in common: at a correlation of 0.1 it is that."""


@dataclass(frozen=True)
class NoiseSpectrum:
    """How strong the noise of photographs is at each frequency, in units of what white noise has.

    Attributes
    ----------
    frequency : ndarray, shape (class,)
        Share that stands out, 0 to 2, rising.
    level : ndarray, shape (class,)
    common : float
        Noise of what colours have in common, in units of what it is where each has its own: up to the root of 3.
    """

    frequency: Floats
    level: Floats
    common: float = 1.0

    @property
    def slow(self) -> float:
        """That of what changes slowly, as of means over blocks: they are so much noisier than if it were white."""
        return 1.0 if self.white else float(self.level[0])

    @property
    def of_layers(self) -> float:
        """Noise that layers are best solved for as if it were white, in units of a pixel's."""
        return float(max(1.0, self.slow**_OF_SLOW, self.common**_OF_COMMON))

    def at(self, frequency: NDArray[np.floating[Any]]) -> Floats:
        """Level at any frequencies."""
        return np.asarray(np.interp(frequency, self.frequency, self.level))

    @property
    def white(self) -> bool:
        """Whether it is as strong at all frequencies, or nearly so."""
        return bool(self._weights.sum() < _CORRELATED * self._weights[0])

    def whitened(self, capture: Capture) -> Capture:
        """Photographs with such noise, made white, but for slow changes, which stay as they are; white ones themselves.

        Pixels that cannot be trusted spread as far as it sees.
        """
        from scipy.ndimage import binary_erosion

        if self.white:
            return capture
        weights = (self._weights / self._weights[0]).astype(np.float32)
        photographs = capture.intensities.reshape(-1, *capture.shape[-2:])
        made = np.empty_like(photographs)
        parts = list(strips(capture.shape[-2], photographs.shape[-1]))

        def some(start: int, stop: int) -> None:
            for plane, part in [divmod(i, len(parts)) for i in range(start, stop)]:
                rows = _with_rim(photographs[plane], parts[part], len(weights) - 1)
                made[plane, parts[part]] = _summed(rows, weights)

        in_blocks(some, len(photographs) * len(parts), 1)
        valid = None
        if capture.n_valid < capture.mask.size:
            planes = capture.valid.reshape(photographs.shape)
            kept = [binary_erosion(plane, iterations=len(weights) - 1, border_value=1) for plane in planes]
            valid = np.reshape(kept, capture.intensities.shape)
        return capture.replace(intensities=made.reshape(capture.intensities.shape), valid=valid)

    @cached_property
    def _weights(self) -> Floats:
        """Of the powers of what stands out, zeroth first, that add up to white noise and turn the sign of nothing."""
        level = np.maximum(self.level, _LEAST_SHARE * self.level.max())
        for n in range(_MOST_POWERS, 1, -1):
            rows = level[:, None] * self.frequency[:, None] ** np.arange(n)
            weights = np.linalg.lstsq(rows, np.ones(len(level)), rcond=None)[0]
            if (np.linspace(0, 2, _LOOKED_AT)[:, None] ** np.arange(n) @ weights).min() > 0:
                return np.asarray(weights)
        return np.ones(1)


def correlated_noise(capture: Capture, noise: float) -> NoiseSpectrum | None:
    """The noise of photographs of which neighbours or colours have some in common; None of others, and of a mosaic's.

    Parameters
    ----------
    capture : Capture
    noise : float
        `noise_level` of the capture. Rounding errors, which are alike as long as the light is, are no such noise.
    """
    if capture.of_mosaic or noise < ROUNDED * quantization_step(capture.intensities):
        return None
    spectrum = noise_spectrum(capture)
    return None if spectrum is None or (spectrum.white and spectrum.common < _COMMON) else spectrum


def noise_spectrum(capture: Capture) -> NoiseSpectrum | None:
    """How the noise of photographs falls with frequency, by the median over tiles.

    None where three photographs do not tell it, or too few tiles can be trusted throughout.
    """
    tiles = _tiles(capture)
    if len(tiles) < _FEWEST_TILES:
        return None
    spectra = _spectra(tiles)
    frequency, shares, powers = _powers(spectra)
    total = powers @ shares
    noisy = total > 0
    if np.count_nonzero(noisy) < _FEWEST_TILES:
        return None
    relative = np.median(powers[noisy] / total[noisy, None], axis=0)
    lost = lost_by_jpeg(capture) ** 2 / float(np.median(total[noisy]))
    at, level = _down_to_zero(frequency, np.sqrt((relative + lost) / (1 + lost)))
    return NoiseSpectrum(at, level, _in_common(spectra, lost))


def _spectra(tiles: Images) -> NDArray[np.complexfloating[Any, Any]]:
    """Of tiles under a window."""
    from scipy.fft import rfft2

    return np.asarray(rfft2((tiles - tiles.mean(axis=(-2, -1), keepdims=True)) * hann_tile(_TILE, _TILE)))


def _standing_out() -> Floats:
    """How much of each frequency of a tile's spectrum stands out."""
    rows, columns = frequencies(_TILE, _TILE)
    return np.asarray(1 - (np.cos(rows) + np.cos(columns)) / 2)


def _powers(spectra: NDArray[Any]) -> tuple[Floats, Floats, Floats]:
    """Frequency of each class, its share of all, and the power of each tile in it, (tile, [channel,] class)."""
    power, standing_out = np.abs(spectra) ** 2, _standing_out()
    count = np.broadcast_to(column_multiplicity(_TILE), standing_out.shape)
    members = [(standing_out >= low) & (standing_out <= high) for low, high in pairwise(_EDGES)]
    shares = np.array([count[member].sum() for member in members]) / _TILE**2
    powers = np.stack([power[..., member].mean(axis=-1) for member in members], axis=-1)
    return np.array([standing_out[member].mean() for member in members]), shares, powers


def _in_common(spectra: NDArray[Any], lost: float) -> float:
    """Noise of what colours have in common, in units of what it is where each has its own.

    Of slow changes, in which what else photographs do not add up by is common to colours, nothing is asked.
    """
    if spectra.ndim == 3:
        return 1.0
    fine = spectra[..., _standing_out() > _EDGES[2]]
    together = np.einsum("tcf,tdf->tcd", fine, fine.conj()).real
    power = np.sqrt(np.einsum("tcc->tc", together))
    noisy = power.min(axis=-1) > 0
    if not noisy.any():
        return 1.0
    alike = np.median((together / (power[:, None] * power[:, :, None]))[noisy], axis=0)
    # What JPEG has taken away is each colour's own.
    return math.sqrt((float(np.linalg.eigvalsh(alike)[-1]) + lost) / (1 + lost))


_LOST_BY_JPEG = 0.7
"""Error of a JPEG in units of what rounding its coefficients may leave at most: 0.6 to 1.3 at quality 92, 0.3 to 0.8 at
75 on three photographs."""


def lost_by_jpeg(capture: Capture) -> float:
    """Standard deviation of what JPEG has rounded away, white; the same in all photographs, they do not tell it."""
    jpeg = None if capture.origin is None else capture.origin.jpeg
    return 0.0 if jpeg is None else _LOST_BY_JPEG * jpeg.step


def _down_to_zero(frequency: Floats, level: Floats) -> tuple[Floats, Floats]:
    """The same with constant light, and slowest changes that are not noisier than the next two classes lead to expect.

    What else photographs do not add up by makes them look so.
    """
    rise = max(0.0, math.log(level[1] / level[2]) / (frequency[2] - frequency[1]))
    first = min(max(level[0], level[1]), level[1] * math.exp(rise * (frequency[1] - frequency[0])))
    still = first * math.exp(rise * frequency[0])
    return np.append([0.0], frequency), np.concatenate([[still, first], level[1:]])


def _tiles(capture: Capture) -> NDArray[Any]:
    """What photographs do not add up by, in tiles (n, [channel,] side, side) that can be trusted throughout."""
    if len(capture.angles_deg) == 3:
        return np.empty(0)
    rows, columns = ([slice(at, at + _TILE) for at in range(0, side - _TILE + 1, _TILE)] for side in capture.shape[-2:])
    parts = [(..., down, right) for down in rows for right in columns]
    whole = [part for part in parts[:: 1 + len(parts) // _MOST_TILES] if np.asarray(capture.mask[part]).all()]
    if not whole:
        return np.empty(0)
    photographs = np.stack([capture.intensities[part] for part in whole], axis=1)
    without_gain = gain_remover(capture.intensities, capture.angles_deg, capture.mask)
    if without_gain is not None:
        photographs = without_gain(photographs)
    return np.concatenate(redundancy_residual(photographs, capture.angles_deg))


def _with_rim(plane: Images, rows: slice, rim: int) -> Images:
    """Rows of a picture with some around them; beyond the frame it goes on as at its edge."""
    top, bottom = max(0, rows.start - rim), min(plane.shape[0], rows.stop + rim)
    beyond = (rim - rows.start + top, rim - bottom + rows.stop)
    return np.pad(plane[top:bottom], (beyond, (rim, rim)), mode="edge")


def _summed(power: Images, weights: Images) -> Images:
    """Sum of so many powers of what stands out, of a picture without the rim that they need."""
    rim = len(weights) - 1
    made = np.zeros([side - 2 * rim for side in power.shape], np.float32)
    for left, weight in zip(range(rim, -1, -1), weights, strict=True):
        made += weight * power[left : power.shape[0] - left, left : power.shape[1] - left]
        if left:
            beside = power[:-2, 1:-1] + power[2:, 1:-1] + power[1:-1, :-2] + power[1:-1, 2:]
            power = power[1:-1, 1:-1] - np.float32(0.25) * beside
    return made
