"""Power spectra of two mixed layers, fitted by expectation maximization, and the layers that follow from them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Protocol

import numpy as np
from array_api_compat import array_namespace
from numpy.typing import NDArray

from polaropt.numerics import NATURAL_POWER_LAW, column_multiplicity, natural_frequencies

Spectrum = NDArray[np.complex64]
Power = NDArray[np.float32]

N_BANDS = 8
# Turns of expectation maximization: first the power law's level alone, then every band. By trial; `variance` knows how
# far they lead.
TURNS_POWER_LAW = 3
TURNS_BANDS = 9
TURNS = TURNS_POWER_LAW + TURNS_BANDS
RESOLUTION = np.float32(2.0**-22)
"""Share of a product that single precision tells from 0 in the difference of it and another: two roundings of 2^-23. A
pane that shows both layers alike leaves a determinant below, which is then rounding, and may be negative."""
# Share of all frequencies that a band must hold before it moves freely. Set by hand.
BAND_INERTIA = 2e-4
# Entries of a table over the logarithm of frequency: a step is less than 0.3 %.
_TABLE = 4096
# Frequencies that the fit looks at: all the low ones, of which there are few, and a sample of the others. No figure of
# a study changed between a larger sample and this one.
_SAMPLED = 6144


class FrequencyBands:
    """Radial bands of a half spectrum, evenly spaced in the logarithm of frequency, linear between neighbours.

    Parameters
    ----------
    height, width : int
        Of the images.

    Attributes
    ----------
    sample : ndarray of int, shape (n,)
        Flat indices of the frequencies that stand for all: the slow ones and some others.
    share : ndarray of float32, shape (n,)
        Of all frequencies of the whole spectrum, for which a sampled one stands.
    squared_frequency : ndarray of float32, shape (n,)
        Of the sample.
    """

    def __init__(self, height: int, width: int) -> None:
        self._squared: Power = natural_frequencies(height, width).astype(np.float32)
        self.sample, counts = _sampled(self._squared, column_multiplicity(width))
        self.share: Power = (counts / (height * width)).astype(np.float32)
        self.squared_frequency: Power = self._squared.ravel()[self.sample]
        self._span = np.log([float(self._squared.min()), float(self._squared.max())])
        position = self._position(self.squared_frequency)
        self._lower = np.minimum(position.astype(np.intp), N_BANDS - 2)
        self._fraction = (position - self._lower).astype(np.float32)
        self._size = self._sums(self.share)

    def smoothed_logarithm(self, ratio: Power) -> NDArray[np.float64]:
        """Logarithm of each band's mean of a ratio near 1 over the sample, (bands,)."""
        means = (self._sums(ratio * self.share) + BAND_INERTIA) / (self._size + BAND_INERTIA)
        return np.asarray(np.log(means))

    def at_sample(self, logarithms: NDArray[np.float64]) -> Power:
        """Exponential of the bands' logarithms, interpolated to the sample."""
        logs = logarithms.astype(np.float32)
        smooth: Power = np.exp(logs[self._lower] * (1 - self._fraction) + logs[self._lower + 1] * self._fraction)
        return smooth

    def power_law(self, power: float, logarithms: NDArray[np.float64]) -> Power:
        """Power of every frequency, (height, width // 2 + 1): a power law times the bands' correction of it."""
        return np.asarray(self.table(power, logarithms)[self.entry])

    def table(self, power: float, logarithms: NDArray[np.float64]) -> Power:
        """What `power_law` takes by `entry`."""
        logs = np.linspace(float(self._span[0]), float(self._span[1]), _TABLE)
        correction = np.interp(np.linspace(0, N_BANDS - 1, _TABLE), np.arange(N_BANDS), logarithms)
        return np.asarray(np.exp(correction + np.log(power) - NATURAL_POWER_LAW / 2 * logs), dtype=np.float32)

    @cached_property
    def tables(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """The logarithm of a `table` of power 1 without correction (n,), and each band's weight in it (n, bands)."""
        of_bands = [np.interp(np.linspace(0, N_BANDS - 1, _TABLE), np.arange(N_BANDS), row) for row in np.eye(N_BANDS)]
        return -NATURAL_POWER_LAW / 2 * np.linspace(float(self._span[0]), float(self._span[1]), _TABLE), np.stack(
            of_bands, axis=1
        )

    @cached_property
    def weights(self) -> Power:
        """Of each sampled frequency in each band, (bands, n): those of `at_sample` and `smoothed_logarithm`."""
        weights = np.zeros((N_BANDS, self._lower.size), dtype=np.float32)
        places = np.arange(self._lower.size)
        weights[self._lower, places], weights[self._lower + 1, places] = 1 - self._fraction, self._fraction
        return weights

    @cached_property
    def entry(self) -> NDArray[np.int16]:
        """Where in a table over the logarithm of frequency each frequency is."""
        logs = np.log(self._squared)
        logs -= np.float32(self._span[0])
        logs *= np.float32((_TABLE - 1) / np.ptp(self._span))
        return np.clip(np.rint(logs), 0, _TABLE - 1).astype(np.int16)

    def _position(self, squared: Power) -> NDArray[np.float64]:
        position = (np.log(squared.astype(np.float64)) - self._span[0]) / np.ptp(self._span)
        return np.asarray(np.clip(position, 0, 1) * (N_BANDS - 1))

    def _sums(self, values: Power) -> NDArray[np.float64]:
        lower = np.bincount(self._lower, values * (1 - self._fraction), N_BANDS)
        upper = np.bincount(self._lower + 1, values * self._fraction, N_BANDS)
        return np.asarray(lower + upper, dtype=np.float64)


def _sampled(squared: Power, multiplicity: NDArray[np.float64]) -> tuple[NDArray[np.intp], NDArray[np.float64]]:
    """Flat indices of a sample of the half spectrum, and for how many frequencies of the whole one each stands.

    Columns stand for themselves and, by `multiplicity` (columns,), for their conjugates.
    """
    flat, n_slow = squared.ravel(), _SAMPLED // 4
    if flat.size <= _SAMPLED:
        return np.arange(flat.size), np.tile(multiplicity, len(squared))
    # By values and places alone: the order in which a partition leaves frequencies depends on the processor.
    limit = np.partition(flat, n_slow)[n_slow]
    slow, rest = np.flatnonzero(flat < limit), np.flatnonzero(flat >= limit)
    drawn = rest[np.random.default_rng(0).integers(rest.size, size=_SAMPLED - slow.size)]
    sample = np.concatenate([slow, drawn])
    counts = multiplicity[sample % multiplicity.size]
    # Those drawn stand for all the rest, however many of them stand for two.
    of_rest = multiplicity.sum() * len(squared) - counts[: slow.size].sum()
    counts[slow.size :] *= of_rest / counts[slow.size :].sum()
    return sample, counts


def posterior(information: Spectrum, right: Spectrum, prior: Power) -> tuple[Spectrum, Power]:
    """Wiener solution and its variance per frequency.

    Parameters
    ----------
    information : ndarray, shape (2, 2, ...)
        Normal matrix of the two layers at each frequency, in units of the noise.
    right : ndarray, shape (2, channel, ...)
        Right-hand side.
    prior : ndarray, shape (2, channel, ...)
        Power of each layer.

    Returns
    -------
    coefficients : ndarray, shape (2, channel, ...)
    uncertainty : ndarray, same shape
        Variance that remains.
    """
    return two_layers((information[0, 0].real, information[1, 1].real), information[0, 1], right, prior)


def two_layers(of_each: Any, cross: Any, right: Any, prior: Any) -> tuple[Any, Any]:
    """`posterior` of arrays or tensors, from the diagonal of the information (2, ...) and its upper entry."""
    xp = array_namespace(prior)
    uncertainty, determinant = left_open(of_each, cross, (1 / prior[0], 1 / prior[1]))
    off = cross / determinant
    t, r = right[0], right[1]
    return xp.stack([uncertainty[0, ...] * t - off * r, uncertainty[1, ...] * r - xp.conj(off) * t]), uncertainty


class Bands(Protocol):
    """Frequencies that stand for all, and a correction of the power law from few logarithms, see `FrequencyBands`."""

    sample: NDArray[np.intp]
    share: Power
    squared_frequency: Power

    def power_law(self, power: float, logarithms: NDArray[np.float64]) -> Power:
        """Power of every frequency, (height, width // 2 + 1)."""


def left_open(of_each: Any, cross: Any, stiffness: Any) -> tuple[Any, Any]:
    """Variance (2, ...) that remains under a prior's stiffness (2, ...), and the determinant of what is known.

    Parameters
    ----------
    of_each : arrays or tensors, shape (2, ...)
        What the photographs tell of each layer.
    cross : array or tensor, shape (...)
        And of both together.
    stiffness : arrays or tensors, shape (2, ...)
        Inverse of the power before the photographs are seen.
    """
    h_t, h_r = (of_each[i] + stiffness[i] for i in (0, 1))
    product = h_t * h_r
    xp = array_namespace(product)
    determinant = xp.maximum(product - xp.abs(cross) ** 2, float(RESOLUTION) * product)
    return xp.stack([h_r / determinant, h_t / determinant]), determinant


@dataclass(frozen=True)
class FittedSpectra:
    """Spectra of the layers that explain the photographs.

    Attributes
    ----------
    power : ndarray, shape (2, channel)
        Of the power law.
    logarithms : ndarray, shape (2, channel, bands)
        Of each band's correction, or each node's.
    prior, uncertainty : ndarray of float32, shape (2, channel, n)
        Power before and after the photographs are seen, at the sampled frequencies.
    """

    power: NDArray[np.float64]
    logarithms: NDArray[np.float64]
    prior: Power
    uncertainty: Power

    def everywhere(self, bands: Bands) -> Power:
        """Power of every frequency before the photographs are seen, (2, channel, H, W // 2 + 1)."""
        return np.stack(
            [
                np.stack([bands.power_law(float(p), log) for p, log in zip(powers, logs, strict=True)])
                for powers, logs in zip(self.power, self.logarithms, strict=True)
            ]
        )


Moments = Callable[[Power], tuple[Power, Power]]
"""From the power of each layer, (2, channel, n), to the power expected once the photographs are seen, and that part of
it that remains open."""


def fit_spectra(moments: Moments, bands: FrequencyBands, gradient_power: NDArray[np.float64]) -> FittedSpectra:
    """Spectra under which the photographs are most likely: first a power law, then its correction in each band.

    Parameters
    ----------
    moments : callable
        At the sample of `bands`.
    bands : FrequencyBands
    gradient_power : ndarray, shape (channel,)
        Mean squared gradient per colour to start from.
    """
    law = bands.squared_frequency ** (NATURAL_POWER_LAW / 2)
    power = np.stack([gradient_power, gradient_power])
    logarithms = np.zeros((*power.shape, N_BANDS))
    prior: Power = (power[..., None] / law).astype(np.float32)
    for _ in range(TURNS_POWER_LAW):
        power = (moments(prior)[0] * (law * bands.share)).sum(axis=-1, dtype=np.float64)
        prior = (power[..., None] / law).astype(np.float32)
    for _ in range(TURNS_BANDS):
        ratio = moments(prior)[0] / prior
        for where in np.ndindex(power.shape):
            step = bands.smoothed_logarithm(ratio[where])
            logarithms[where] += step
            prior[where] *= bands.at_sample(step)
    return FittedSpectra(power, logarithms, prior, moments(prior)[1])


def moments_of(information: Spectrum, right: Spectrum) -> Moments:
    """Moments of layers that mix frequency by frequency; parameters as of `posterior`, at a sample (..., n)."""

    def moments(prior: Power) -> tuple[Power, Power]:
        coefficients, uncertainty = posterior(information, right, prior)
        return np.square(coefficients.real) + np.square(coefficients.imag) + uncertainty, uncertainty

    return moments
