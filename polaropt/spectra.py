"""Power spectra of two mixed layers, fitted by expectation maximization, and the layers that follow from them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Spectrum = NDArray[np.complex64]
Power = NDArray[np.float32]

_N_BANDS = 8
_POWER_LAW = 2.4
_TURNS_POWER_LAW = 3
_TURNS_BANDS = 9
# Share of all frequencies that a band must hold before it moves freely.
_BAND_INERTIA = 2e-4


class FrequencyBands:
    """Radial bands, evenly spaced in the logarithm of frequency, with linear weights between neighbours."""

    def __init__(self, height: int, width: int) -> None:
        rows = 2 * np.pi * np.fft.fftfreq(height)[:, None]
        columns = 2 * np.pi * np.fft.rfftfreq(width)[None, :]
        # The finite frequency at zero stands for all that is slower than the frame.
        squared = 4 - 2 * np.cos(rows) - 2 * np.cos(columns) + (2 * np.pi / max(height, width)) ** 2
        self.squared_frequency: Power = squared.astype(np.float32)
        share = column_multiplicity(width) / (height * width)
        self.multiplicity: Power = np.broadcast_to(share, squared.shape).astype(np.float32)
        position = np.log(squared)
        position = (position - position.min()) / np.ptp(position) * (_N_BANDS - 1)
        self._lower = np.minimum(position.astype(np.intp), _N_BANDS - 2)
        self._share = (position - self._lower).astype(np.float32)
        self._size = self._sums(self.multiplicity)

    def smoothed_ratio(self, ratio: Power) -> Power:
        """Band means of a ratio near 1, interpolated over all frequencies."""
        means = (self._sums(ratio * self.multiplicity) + _BAND_INERTIA) / (self._size + _BAND_INERTIA)
        logs = np.log(means).astype(np.float32)
        smooth: Power = np.exp(logs[self._lower] * (1 - self._share) + logs[self._lower + 1] * self._share)
        return smooth

    def _sums(self, values: Power) -> NDArray[np.float64]:
        lower = np.bincount(self._lower.ravel(), (values * (1 - self._share)).ravel(), _N_BANDS)
        upper = np.bincount(self._lower.ravel() + 1, (values * self._share).ravel(), _N_BANDS)
        return np.asarray(lower + upper, dtype=np.float64)


def posterior(information: Spectrum, right: Spectrum, prior: Power) -> tuple[Spectrum, Power]:
    """Wiener solution and its variance per frequency.

    Parameters
    ----------
    information : ndarray, shape (2, 2, H, W // 2 + 1)
        Normal matrix of the two layers, in units of the noise.
    right : ndarray, shape (2, channel, H, W // 2 + 1)
        Right-hand side.
    prior : ndarray, shape (2, channel, H, W // 2 + 1)
        Power of each layer.

    Returns
    -------
    coefficients : ndarray, shape (2, channel, H, W // 2 + 1)
    uncertainty : ndarray, same shape
        Variance that remains.
    """
    h_t = information[0, 0].real + 1 / prior[0]
    h_r = information[1, 1].real + 1 / prior[1]
    cross = information[0, 1]
    determinant = h_t * h_r - np.abs(cross) ** 2
    uncertainty = np.stack([h_r, h_t]) / determinant
    coefficients = np.empty_like(right)
    coefficients[0] = uncertainty[0] * right[0] - cross / determinant * right[1]
    coefficients[1] = uncertainty[1] * right[1] - cross.conj() / determinant * right[0]
    return coefficients, uncertainty


def fit_spectra(
    information: Spectrum, right: Spectrum, bands: FrequencyBands, gradient_power: NDArray[np.float64]
) -> Power:
    """Spectra under which the photographs are most likely: first a power law, then its value in each band.

    Parameters
    ----------
    information, right : ndarray
        As for `posterior`.
    bands : FrequencyBands
    gradient_power : ndarray, shape (channel,)
        Mean squared gradient per colour to start from.

    Returns
    -------
    ndarray of float32, shape (2, channel, H, W // 2 + 1)
    """
    law = bands.squared_frequency ** (_POWER_LAW / 2)
    power = np.stack([gradient_power, gradient_power])
    prior: Power = (power[..., None, None] / law).astype(np.float32)
    for _ in range(_TURNS_POWER_LAW):
        expected = _expected_power(information, right, prior)
        power = (expected * (law * bands.multiplicity)).sum(axis=(-1, -2), dtype=np.float64)
        prior = (power[..., None, None] / law).astype(np.float32)
    for _ in range(_TURNS_BANDS):
        ratio = _expected_power(information, right, prior) / prior
        for layer in range(2):
            for channel in range(prior.shape[1]):
                prior[layer, channel] *= bands.smoothed_ratio(ratio[layer, channel])
    return prior


def _expected_power(information: Spectrum, right: Spectrum, prior: Power) -> Power:
    coefficients, uncertainty = posterior(information, right, prior)
    return np.square(coefficients.real) + np.square(coefficients.imag) + uncertainty


def mean_power(power: Power, gain: NDArray[np.float64], width: int) -> NDArray[np.float64]:
    """Mean square over the pixels of images whose power per frequency is `power`, filtered by `gain` (a power).

    Parameters
    ----------
    power : ndarray, shape (..., H, W // 2 + 1)
    gain : ndarray, shape (H, W // 2 + 1)
    width : int
        W, which the half spectrum does not tell.

    Returns
    -------
    ndarray, shape (...)
    """
    weights = gain * column_multiplicity(width) / (power.shape[-2] * width)
    return np.asarray((power * weights).sum(axis=(-1, -2), dtype=np.float64))


def column_multiplicity(width: int) -> NDArray[np.float64]:
    """How often a column of the half spectrum stands for itself and its conjugate."""
    twice = np.full(width // 2 + 1, 2.0)
    twice[0] = 1
    if width % 2 == 0:
        twice[-1] = 1
    return twice
