"""Variance that the photographs leave to a pixel, from what is told per frequency and how busy the place is.

A layer is taken as a mixture of Gaussian ones: its spectrum is the fitted one times a scale that changes over the
frame, small where the layer is flat and large where it has edges. Given the scales and how exactly the place is
measured, the variance of a pixel is the sum over all frequencies of what a Wiener filter leaves open.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from polaropt.inversion.spectra import RESOLUTION, TURNS
from polaropt.numerics import Basis
from priors.base import CHROMA_WEIGHT

Power = NDArray[np.float32]
Images = NDArray[np.float32]

SCALES = np.geomspace(0.01, 30.0, 9)
"""Scales of the spectra, in units of the fitted one, that a table holds; between them it is interpolated. By hand."""
# Nine of ten photographs have less than so many times the power of another (measured on luminance, in any octave).
_SPREAD_OF_POWER = 4.0
DETAIL_PX = 2.0
"""Of the Gaussian whose rest of a layer is its detail: what is finer than about 5 px."""
DETAIL_CUT = 3
"""Widths of it beyond which it is nothing."""
# Power of detail that a black layer is divided by.
_LEAST_DETAIL = 1e-20


@dataclass(frozen=True)
class Knowledge:
    """What is known of two layers at a sample of the frequencies.

    Attributes
    ----------
    told : ndarray, shape (2, n) or (2, channel, n)
        What the photographs tell of each layer (inverse variance).
    cross : ndarray, shape (n,) or (channel, n)
        Squared modulus of what they tell of both together.
    prior : ndarray, shape (2, channel, n)
        Power before the photographs are seen, in the colour basis.
    share : ndarray, shape (n,)
        Of all frequencies, for which a sampled one stands.
    squared_frequency : ndarray, shape (n,)
    basis : ndarray, shape (channel, channel)
        The colour basis.
    turns : int
        Of expectation maximization, after which the spectra's fit stopped, or as good as which it is.
    """

    told: Power
    cross: Power
    prior: Power
    share: Power
    squared_frequency: Power
    basis: Basis
    turns: int = TURNS

    def uncertainty(self, precision: float = 1.0, scales: tuple[float, float] = (1.0, 1.0)) -> Power:
        """Power that remains open, (2, channel, n), where information and spectra are so many times the usual."""
        of_t, of_r = (self.information(i, precision, scales[i]) for i in (0, 1))
        return self.left_by(of_t, of_r, precision)

    def information(self, layer: int, precision: float, scale: float) -> Power:
        """Of one layer by itself, from the photographs and from its own spectrum, (channel, n)."""
        return np.asarray(np.float32(precision) * self.told[layer] + 1 / (np.float32(scale) * self.prior[layer]))

    def left_by(self, of_t: Power, of_r: Power, precision: float) -> Power:
        """`uncertainty` from the information of both layers."""
        product = of_t * of_r
        determinant = np.maximum(product - np.float32(precision) ** 2 * self.cross, RESOLUTION * product)
        return np.asarray(np.stack([of_r, of_t]) / determinant)

    def told_share(self) -> float:
        """Numbers that the photographs tell of both layers and all colours, per pixel."""
        return float(((1 - self.uncertainty() / self.prior) @ self.share).sum())

    def edges(self, power: Power) -> NDArray[np.float64]:
        """Gradient energy of spectra (2, channel, n), chroma weighted as the penalties do, (2,)."""
        per_color = power @ (self.share * self.squared_frequency)
        color_weights = np.full(per_color.shape[1], CHROMA_WEIGHT)
        color_weights[0] = 1.0
        return np.asarray(per_color @ color_weights, dtype=np.float64)

    def unknown_detail(self, reflection: Images) -> float:
        """Share of the reflection's detail (channel, h, w) that remains open, 0..1, see `unknown_share`."""
        return unknown_share(self.uncertainty()[1], self.squared_frequency, self.share, reflection)

    def told_detail(self) -> float:
        """Power of the reflection's detail that the photographs tell."""
        told = self.prior[1] - self.uncertainty()[1]
        return float((told * (self.share * detail_power(self.squared_frequency))).sum(dtype=np.float64))

    def variance(self) -> NDArray[np.float64]:
        """That the photographs leave to a pixel of each layer, mean over colours, (2,)."""
        return np.asarray((self.uncertainty() @ self.share).mean(axis=1), dtype=np.float64)

    def structure(self, distances: NDArray[np.float64]) -> NDArray[np.float64]:
        """Mean squared difference of two pixels so far apart, mean over colours, (2, distances)."""
        from scipy.special import j0

        apart = 2 * (1 - j0(np.sqrt(self.squared_frequency) * distances[:, None]))
        return np.asarray(self.prior.mean(axis=1) @ (apart * self.share).T)

    def told_by(self, precision: float | Power) -> Knowledge:
        """With photographs that tell so many times as much, at each frequency (n,) or at all."""
        told, cross = np.float32(precision) * self.told, np.float32(precision) ** 2 * self.cross
        return replace(self, told=told, cross=cross)

    def allowed(self) -> Knowledge:
        """With the power that a layer may have where the photographs do not tell it.

        One turn of the fit goes a share ``told^2`` of the way from the power that it starts with, which is that of the
        photographs, to the layer's own. What it has not gone leaves the spread of spectra between photographs.
        """
        told = 1 - self.uncertainty() / self.prior
        unfitted = (1 - told**2) ** self.turns
        return replace(self, prior=self.prior * (1 + np.float32(_SPREAD_OF_POWER - 1) * unfitted))


def unknown_share(left: Power, squared_frequency: Power, share: Power, reflection: Images) -> float:
    """Share of the reflection's detail, what is finer than about 5 px, that remains open, 0..1.

    What remains open, beside what was found: a spectrum fitted to photographs that hardly tell the reflection may
    hold much that it has not. The root of the rest is how the detail found correlates with the true one.

    Parameters
    ----------
    left : ndarray, shape (channel, ...)
        Power that remains open, in the colour basis.
    squared_frequency, share : ndarray
        Of each frequency, and of all frequencies for which it stands.
    reflection : ndarray of float32, shape (channel, h, w)
        What was found.
    """
    open_power = float((left * (share * detail_power(squared_frequency))).sum(dtype=np.float64))
    return open_part(open_power, _detail(reflection))


def detail_power(squared_frequency: Power) -> Power:
    """Share of a frequency's power that is detail."""
    finer = 1 - np.exp(-squared_frequency * np.float32(DETAIL_PX**2 / 2))
    return np.asarray(finer**2, dtype=np.float32)


def open_part(left: float, found: float) -> float:
    """Share of a layer's detail that remains open, from the power that is left open and that was found."""
    return left / max(left + found, _LEAST_DETAIL)


def _detail(layer: Images) -> float:
    """Mean square of the detail of a layer (channel, h, w), summed over colours."""
    from scipy.ndimage import gaussian_filter

    fine = layer - gaussian_filter(layer, (0, DETAIL_PX, DETAIL_PX), truncate=DETAIL_CUT)
    return float(np.square(fine, out=fine).mean(axis=(-1, -2), dtype=np.float64).sum())


# Of so many neighbours by frequency one stands for all in a table, from so many frequencies on. Set by hand.
_NEIGHBOURS, _MANY = 4, 4096


def thinned(known: Knowledge) -> Knowledge:
    """What is known at fewer frequencies, evenly chosen, which stand for those around them."""
    if known.share.size < _MANY:
        return known
    order = np.argsort(known.squared_frequency, kind="stable")
    starts = np.arange(0, order.size, _NEIGHBOURS)
    # In turns, so that none of the frequencies' directions is preferred.
    chosen = order[np.minimum(starts + np.arange(starts.size) % _NEIGHBOURS, order.size - 1)]
    return replace(
        known,
        told=known.told[..., chosen],
        cross=known.cross[..., chosen],
        prior=known.prior[..., chosen],
        share=np.add.reduceat(known.share[order], starts),
        squared_frequency=known.squared_frequency[chosen],
    )


def variance_table(known: Knowledge, precisions: NDArray[np.float64]) -> Power:
    """Standard errors and untold detail over precision and the two layers' scales.

    Returns
    -------
    ndarray of float32, shape (precisions, scales, scales, 2 channel + 1)
        Standard error of each layer and channel of a pixel, then the share of the reflection's detail (gradient
        energy) that is not told.
    """
    known = thinned(known)
    colors = known.prior.shape[1]
    values = np.empty((len(precisions), len(SCALES), len(SCALES), 2 * colors + 1), dtype=np.float32)
    usual = known.edges(known.prior)[1]
    of_channels = known.basis.T**2
    for i, precision in enumerate(map(float, precisions)):
        of_t, of_r = ([known.information(layer, precision, float(scale)) for scale in SCALES] for layer in (0, 1))
        for j, k in np.ndindex(len(SCALES), len(SCALES)):
            remaining = known.left_by(of_t[j], of_r[k], precision)
            values[i, j, k, :-1] = np.sqrt((remaining @ known.share) @ of_channels.T).ravel()
            values[i, j, k, -1] = known.edges(remaining)[1] / (float(SCALES[k]) * usual)
    return values
