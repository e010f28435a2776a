"""Gaps between panes that are likely, of all lengths and to all sides at once.

Images that a gap moves add waves to the spectra. To first order each wave changes the likelihood by itself. So one
gradient, taken where such images do not count, tells by a sum over frequencies what every gap gains.
"""

from __future__ import annotations

import math
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from polaropt.estimation.flat.ghosts import (
    DEGREES_OF_FREEDOM,
    FIRST_LEVEL,
    LEAST_FACTOR,
    CrossSpectra,
    spectral_shapes,
)
from polaropt.estimation.flat.windows.likelihood import DETAIL, Window, lags_of
from polaropt.numerics import hann_autocorrelation, local_minima

Values = NDArray[np.float64]
Floats = NDArray[np.float32]

# All set by hand.
_STEP_PX, _MOST_ACROSS_PX = 1.0, 10
"""Spacing of gaps, and how many steps to each side of the azimuth they may shift."""
_MOST_GAPS = 2
"""Images that have crossed more gaps are too dim to lead to a window."""
_ROUNDS = 12
"""In which the layers' spectra are fitted."""
_LEAST_DETERMINANT = np.float32(1e-6)
"""Of a covariance, as a share of the product of its diagonal: float32 tells no less."""
_LEAST_CURVATURE = np.float32(1e-30)
"""That is divided by: a pane that mirrors nothing has none."""


class GapMap:
    """What gaps gain at one azimuth.

    Parameters
    ----------
    spectra : CrossSpectra
    refractive_index : float
    most_shift : float
        Longest gap along the azimuth, in pixels.
    """

    def __init__(self, spectra: CrossSpectra, refractive_index: float, most_shift: float) -> None:
        self._spectra, self._index, self._n = spectra, refractive_index, math.floor(most_shift / _STEP_PX)

    def likely(self, window: Window, most: int) -> list[tuple[float, float]]:
        """The likeliest gaps of a window whose own does not count: pixels along the azimuth, and clockwise from it."""
        gains = np.zeros(len(self._gaps))
        for (cosine, sine), common, (even, odd) in zip(self._waves, self._common, self._gradient(window), strict=True):
            gains += common * (cosine @ even + sine @ odd)
        table = gains.reshape(2 * self._n + 1, -1)
        minima = np.flatnonzero(local_minima(table) & local_minima(table.T).T)
        best = minima[np.argsort(gains[minima])][:most]
        return [(float(along), float(across)) for along, across in self._gaps[best]]

    @cached_property
    def _gaps(self) -> Values:
        """Along and across, (gap, 2)."""
        sides = np.arange(-self._n, self._n + 1), np.arange(-_MOST_ACROSS_PX, _MOST_ACROSS_PX + 1)
        return np.asarray(_STEP_PX * np.stack(np.meshgrid(*sides, indexing="ij"), axis=-1).reshape(-1, 2))

    @cached_property
    def _waves(self) -> list[tuple[Floats, Floats]]:
        """Cosine and sine of what 1, 2, ... of each gap turn each frequency by, (gap, frequency)."""
        once = (self._gaps @ np.stack([self._spectra.along, self._spectra.across_azimuth])).astype(np.float32)
        return [(np.cos(k * once), np.sin(k * once)) for k in range(1, _MOST_GAPS + 1)]

    @cached_property
    def _common(self) -> list[Values]:
        """Share of its light that a tile's window has in common with itself as many gaps off, (gap,)."""
        azimuth = math.radians(self._spectra.azimuth_deg)
        directions = (math.cos(azimuth), math.sin(azimuth)), (math.sin(azimuth), -math.cos(azimuth))
        sides = [self._gaps @ np.array(direction) / self._spectra.tile for direction in directions]
        return [
            np.asarray(np.prod([hann_autocorrelation(k * side) for side in sides], axis=0))
            for k in range(1, _MOST_GAPS + 1)
        ]

    @cached_property
    def _shapes(self) -> Floats:
        return np.asarray(spectral_shapes(self._spectra.along, self._spectra.across_azimuth, *DETAIL))

    @cached_property
    def _data(self) -> Floats:
        seen = self._spectra
        return np.stack([seen.par, seen.perp, seen.cross.real, seen.cross.imag]).astype(np.float32)

    def _gradient(self, window: Window) -> list[tuple[Floats, Floats]]:
        """What cosines and sines of 1, 2, ... gaps change the misfit by, each (frequency,)."""
        (orders, _), weights = lags_of(window, self._index)
        azimuth = math.radians(self._spectra.azimuth_deg)
        pane = window.pane_shift * orders[:, 0]
        common = [hann_autocorrelation(pane * f(azimuth) / self._spectra.tile) for f in (math.cos, math.sin)]
        phase = (pane[:, None] * self._spectra.along).astype(np.float32)
        cosine, sine = np.cos(phase), np.sin(phase)
        still = orders[:, 1] == 0
        damped = weights[:, still] * np.prod(common, axis=0).astype(np.float32)[still, None]
        powers, toward = self._fitted(np.stack([_response(w, cosine[still], sine[still]) for w in damped]))
        multiplicity = self._spectra.multiplicity
        even, odd = np.zeros((2, _MOST_GAPS, multiplicity.size), np.float32)
        for power, w in zip(powers * multiplicity / multiplicity.sum(), weights, strict=True):
            for k in np.flatnonzero(~still & (np.abs(orders[:, 1]) <= _MOST_GAPS)):
                n, sign = abs(int(orders[k, 1])) - 1, np.float32(np.sign(orders[k, 1]))
                of_cosine = power * (toward[0] * w[k, 1] + toward[1] * w[k, 0] - 2 * toward[2] * w[k, 2])
                of_sine = 2 * power * toward[3] * w[k, 3]
                even[n] += of_cosine * cosine[k] + of_sine * sine[k]
                odd[n] += sign * (of_sine * cosine[k] - of_cosine * sine[k])
        return list(zip(even, odd, strict=True))

    def _fitted(self, layers: Floats) -> tuple[Floats, Floats]:
        """Powers of both layers (2, frequency), and the misfit's derivative by the covariance that they make.

        Its product with a change of the covariance, see `_dot`, is the change of the misfit.
        """
        (par, cross), (_, perp) = self._spectra.covariance
        noise = np.array([[par], [perp], [cross], [0.0]], np.float32)
        levels = np.full((2, len(self._shapes)), FIRST_LEVEL, np.float32)
        weighted, freedom = self._spectra.multiplicity * self._shapes, DEGREES_OF_FREEDOM
        for last in (False,) * _ROUNDS + (True,):
            powers = levels @ self._shapes
            model = (powers[:, None] * layers).sum(axis=0) + noise
            product = model[0] * model[1]
            determinant = np.maximum(product - model[2] ** 2 - model[3] ** 2, _LEAST_DETERMINANT * product)
            distance = _dot(model, self._data) / determinant
            surprise = (freedom + 2) / (freedom + distance)
            if last:
                break
            for level, layer in zip(levels, layers, strict=True):
                near = _dot(layer, model)
                gain = weighted @ ((distance * near - _dot(layer, self._data)) * surprise / determinant)
                curvature = np.maximum(weighted @ (near / determinant), _LEAST_CURVATURE)
                level *= np.maximum(gain / curvature, LEAST_FACTOR)
        return powers, (model * (1 - surprise * distance) + surprise * self._data) / determinant


def _response(weights: Floats, cosine: Floats, sine: Floats) -> Floats:
    """Outer product of a layer's transfer functions, as (par, perp, real, imaginary), (4, frequency)."""
    return np.stack([*(weights[:, k] @ cosine for k in range(3)), -(weights[:, 3] @ sine)])


def _dot(one: Floats, other: Floats) -> Floats:
    """Trace of the adjugate of one Hermitian matrix times another, at each frequency."""
    product: Floats = one[0] * other[1] + one[1] * other[0] - 2 * (one[2] * other[2] + one[3] * other[3])
    return product
