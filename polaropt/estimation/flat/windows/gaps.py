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
)
from polaropt.estimation.flat.windows.likelihood import DETAIL, Window, lags_of
from polaropt.numerics import hann_autocorrelation, local_minima

Values = NDArray[np.float64]
Floats = NDArray[np.float32]
Waves = NDArray[np.complex64]

# All set by hand.
_STEP_PX, _MOST_ACROSS_PX = 1.0, 10
"""Spacing of gaps, and how many steps to each side of the azimuth they may shift."""
_MOST_GAPS = 2
"""Images that have crossed more gaps are too dim to lead to a window."""
_ROUNDS = 12
"""In which the layers' spectra are fitted."""
_LEAST_DETERMINANT = np.float32(1e-6)
"""Of a covariance, as a share of the product of its diagonal: float32 tells no less."""


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
        table = np.zeros((2 * self._n + 1, 2 * _MOST_ACROSS_PX + 1))
        for (along, across), common, (even, odd) in zip(self._waves, self._common, self._gradient(window), strict=True):
            table += common.reshape(table.shape) * (along @ ((even + 1j * odd)[:, None] * across)).real
        minima = np.flatnonzero(local_minima(table) & local_minima(table.T).T)
        best = minima[np.argsort(table.ravel()[minima])][:most]
        return [(float(along), float(across)) for along, across in self._gaps[best]]

    @cached_property
    def _sides(self) -> tuple[Values, Values]:
        """Along, and across."""
        along, across = (_STEP_PX * np.arange(-n, n + 1.0) for n in (self._n, _MOST_ACROSS_PX))
        return along, across

    @cached_property
    def _gaps(self) -> Values:
        """Along and across, (gap, 2)."""
        return np.stack(np.meshgrid(*self._sides, indexing="ij"), axis=-1).reshape(-1, 2)

    @cached_property
    def _waves(self) -> list[tuple[Waves, Waves]]:
        """What 1, 2, ... gaps do to each frequency, turned back: (along, frequency) and (frequency, across)."""
        along, across = self._sides
        once = np.outer(along, self._spectra.along), np.outer(self._spectra.across_azimuth, across)
        waves = [[np.exp(-1j * k * turn).astype(np.complex64) for turn in once] for k in range(1, _MOST_GAPS + 1)]
        return [(first, second) for first, second in waves]

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
        return self._spectra.shapes(*DETAIL)

    @cached_property
    def _data(self) -> Floats:
        seen = self._spectra
        return np.stack([seen.par, seen.perp, seen.cross.real, seen.cross.imag]).astype(np.float32)

    def _gradient(self, window: Window) -> list[tuple[Floats, Floats]]:
        """What cosines and sines of 1, 2, ... gaps change the misfit by, each (frequency,)."""
        orders, weights = lags_of(window, self._index)
        azimuth = math.radians(self._spectra.azimuth_deg)
        pane = window.pane_shift * orders[:, 0]
        common = [hann_autocorrelation(pane * f(azimuth) / self._spectra.tile) for f in (math.cos, math.sin)]
        phase = (pane[:, None] * self._spectra.along).astype(np.float32)
        cosine, sine = np.cos(phase), np.sin(phase)
        still = orders[:, 1] == 0
        damped = weights[:, still] * np.prod(common, axis=0).astype(np.float32)[still, None]
        powers, toward = self._fitted(np.stack([_response(w, cosine[still], sine[still]) for w in damped]))
        multiplicity = self._spectra.multiplicity
        shares = powers * multiplicity / multiplicity.sum()
        found = []
        for n in range(1, _MOST_GAPS + 1):
            moved = np.abs(orders[:, 1]) == n
            sign = np.sign(orders[moved, 1]).astype(np.float32)[:, None]
            # Of both layers, by lag and frequency.
            par, perp, both, turned = np.moveaxis(weights[:, moved], -1, 0)[..., None]
            of_cosine = (shares[:, None] * (perp * toward[0] + par * toward[1] - 2 * both * toward[2])).sum(axis=0)
            of_sine = 2 * (shares[:, None] * (turned * toward[3])).sum(axis=0)
            even = (of_cosine * cosine[moved] + of_sine * sine[moved]).sum(axis=0)
            odd = (sign * (of_sine * cosine[moved] - of_cosine * sine[moved])).sum(axis=0)
            found.append((even, odd))
        return found

    def _fitted(self, layers: Floats) -> tuple[Floats, Floats]:
        """Powers of both layers (2, frequency), and the misfit's derivative by the covariance that they make.

        Its product with a change of the covariance, see `_dot`, is the change of the misfit.
        """
        from polaropt.estimation.flat.windows.kernels import fitted_misfits

        (par, cross), (_, perp) = self._spectra.covariance
        noise = np.array([[par], [perp], [cross], [0.0]], np.float32)
        data, shapes, freedom = self._data, self._shapes, DEGREES_OF_FREEDOM
        # As the kernel has them: reflection first.
        first = layers[::-1]
        squares = [np.maximum(_dot(of, of), 2 * _LEAST_DETERMINANT * of[0] * of[1]) for of in first]
        of_rest = [_dot(of, other) for other in (noise, data) for of in first]
        products = np.empty((1, 9, shapes.shape[1]), np.float32)
        for i, product in enumerate(
            (*squares, np.maximum(_dot(*first), 0), *of_rest, _dot(noise, noise), _dot(noise, data))
        ):
            products[0, i] = product
        levels = np.full((1, 2, len(shapes)), FIRST_LEVEL, np.float32)
        settings = (freedom, np.float32(LEAST_FACTOR), _ROUNDS)
        fitted_misfits(products, shapes, self._spectra.multiplicity, *settings, levels, np.empty(1), 0, 1)
        # A pane that mirrors nothing tells no level.
        powers = np.nan_to_num(levels[0, ::-1]) @ shapes
        model = (powers[:, None] * layers).sum(axis=0) + noise
        product = model[0] * model[1]
        determinant = np.maximum(product - model[2] ** 2 - model[3] ** 2, _LEAST_DETERMINANT * product)
        distance = _dot(model, data) / determinant
        surprise = (freedom + 2) / (freedom + distance)
        return powers, (model * (1 - surprise * distance) + surprise * data) / determinant


def _response(weights: Floats, cosine: Floats, sine: Floats) -> Floats:
    """Outer product of a layer's transfer functions, as (par, perp, real, imaginary), (4, frequency)."""
    return np.stack([*(weights[:, k] @ cosine for k in range(3)), -(weights[:, 3] @ sine)])


def _dot(one: Floats, other: Floats) -> Floats:
    """Trace of the adjugate of one Hermitian matrix times another, at each frequency."""
    product: Floats = one[0] * other[1] + one[1] * other[0] - 2 * (one[2] * other[2] + one[3] * other[3])
    return product
