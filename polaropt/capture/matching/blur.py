"""Which photographs are less sharp than the others, and by how much.

Four photographs of unpolarized scenes through a flat pane are mixtures of two pictures: at every frequency two
combinations of them are nothing but noise, ``I0 + I90 - I45 - I135`` and the light polarized across the plane of
incidence. A photograph that is less sharp leaves detail in both. What the third difference tells, of light along the
plane, is the scene's own: many blurs explain the same, and that of the fewest photographs is taken.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from polaropt.capture.matching.least_squares import Curve, levenberg_marquardt
from polaropt.capture.matching.spectra import DetailSpectra
from polaropt.capture.matching.transfer import pane_matrix

Floats = NDArray[np.floating[Any]]

_GAIN = 0.15
"""Share of the misfit that a photograph's blur must explain to be believed: noise explains less than 0.5 %, and where
more noise is left than is known, blurs of two photographs at once 5 %. By trial."""
_MOST_STEPS, _LONGEST_PX2, _ENDS = 12, 0.5, 1e-3
"""Steps of a fit, the longest step, and the share of the misfit that the last one gains; set by hand."""
_MOST_SLACK = 1e3
"""Damping at which a fit ends; set by hand."""
_MOST_EXPONENT = 4.0
"""Of what a blur takes or gives: frequencies of which so much is gone tell nothing."""


class BlurFit:
    """The two combinations of photographs that a flat pane leaves empty, as functions of their blurs.

    Parameters
    ----------
    detail : DetailSpectra
        With shifts taken out.
    azimuth_deg : float
        Direction along which, or across which, the pane polarizes.
    """

    def __init__(self, detail: DetailSpectra, azimuth_deg: float) -> None:
        self._empty = np.linalg.svd(pane_matrix(detail.angles_deg, azimuth_deg))[0][:, 2:].T
        self._values = np.ascontiguousarray(detail.values)
        rows, columns = detail.rows, detail.columns
        self._slopes = -2 * np.pi**2 * np.stack([rows**2, 2 * rows * columns, columns**2])
        self._products = self._slopes[:, None] * self._slopes

    def found(self) -> tuple[Floats, float]:
        """Blurs of the fewest photographs that explain the detail.

        Returns
        -------
        blurs : ndarray, shape (k, 3)
            Covariances in squared pixels: of rows, of rows and columns, of columns.
        left : float
            Mean square of what is left with them, in units of the noise.
        """
        count = len(self._values)
        blurs: Floats = np.zeros((count, 3))
        blurred: list[int] = []
        misfit = self._least_squares(blurs)[0]
        while len(blurred) < count - 1:
            tried = [(*self._fitted(blurs, [*blurred, k]), k) for k in range(count) if k not in blurred]
            able = [(left, k, fitted) for fitted, left, k in tried if fitted[k, 0] + fitted[k, 2] > 0]
            if not able:
                break
            left, k, fitted = min(able, key=lambda one: one[:2])
            if left > misfit * (1 - _GAIN):
                break
            blurs, misfit = fitted, left
            blurred.append(k)
        return blurs, misfit

    def _least_squares(self, blurs: Floats) -> Curve:
        """What is left in both combinations, as a function of all blurs (3k) in one row."""
        count = len(blurs)
        exponents = np.clip(blurs @ self._slopes, -_MOST_EXPONENT, _MOST_EXPONENT)
        sharper = np.exp(-exponents)
        gradient, matrix, total = np.zeros((count, 3)), np.zeros((count, count, 3, 3)), 0.0
        for weights in self._empty:
            amplified = weights[:, None] * sharper
            scale = 1 / np.sqrt(np.square(amplified).sum(axis=0))
            # In units of its noise: a blur must gain nothing by making noise less.
            share = amplified * scale
            parts = share[:, None] * self._values
            left = parts.sum(axis=0)
            # What a photograph's blurs change goes with these, whatever their direction.
            moves = _parts(np.square(share)[:, None] * left - parts)
            left = _parts(left)
            gradient += np.einsum("kcn,cn->kn", moves, left) @ self._slopes.T
            matrix += np.tensordot(np.einsum("kcn,lcn->kln", moves, moves), self._products, axes=(2, 2))
            total += float(np.square(left).sum())
        values = self._values[0].size * len(self._empty)
        every = matrix.swapaxes(1, 2).reshape(3 * count, 3 * count)
        return total / values, gradient.ravel() / values, every / values

    def _fitted(self, start: Floats, blurred: Sequence[int]) -> tuple[Floats, float]:
        """Blurs of some photographs, those of the others as at the start, and what is left with them."""
        free = np.concatenate([np.arange(3 * k, 3 * k + 3) for k in blurred])

        def among(numbers: Floats) -> Floats:
            every = start.ravel().copy()
            every[free] = numbers
            return every.reshape(start.shape)

        def curve(numbers: Floats) -> Curve:
            misfit, gradient, matrix = self._least_squares(among(numbers))
            return misfit, gradient[free], matrix[np.ix_(free, free)]

        numbers, left = levenberg_marquardt(
            curve, start.ravel()[free], _LONGEST_PX2, most_steps=_MOST_STEPS, ends=_ENDS, most_slack=_MOST_SLACK
        )
        return among(numbers), left


def _parts(numbers: NDArray[np.complexfloating[Any, Any]]) -> Floats:
    """Real and imaginary parts of complex numbers (..., channel, n), one below the other."""
    return np.concatenate([numbers.real, numbers.imag], axis=-2)


def covariances(blurs: Floats) -> Floats:
    """Covariances (k, 2, 2) of blurs (k, 3), none of them negative in any direction."""
    matrices = np.stack([blurs[:, :2], blurs[:, 1:]], axis=1)
    spread, directions = np.linalg.eigh(matrices)
    return np.asarray((directions * np.maximum(spread, 0)[:, None]) @ directions.swapaxes(1, 2))
