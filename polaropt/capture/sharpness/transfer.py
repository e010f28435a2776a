"""Transfer functions of photographs: what each shows of the scene's frequencies, against the sharpest of them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from polaropt.optics import analyzer_matrix

Floats = NDArray[np.floating[Any]]
Spectrum = NDArray[np.complexfloating[Any, Any]]


def pane_matrix(angles_deg: Sequence[float], azimuth_deg: float) -> Floats:
    """Photographs of the light and of what of it is polarized along an azimuth, (k, 2): all that a pane shows.

    Parameters
    ----------
    angles_deg : sequence of k floats
    azimuth_deg : float
    """
    matrix, double = analyzer_matrix(angles_deg), np.radians(2 * azimuth_deg)
    return np.stack([matrix[:, 0], matrix[:, 1] * np.cos(double) + matrix[:, 2] * np.sin(double)], axis=1)


@dataclass(frozen=True)
class Transfer:
    """Where each photograph shows the scene, and how much less sharply than the sharpest.

    Attributes
    ----------
    shifts_px : ndarray, shape (k, 2)
        How far down and to the right of the first photograph each shows the scene.
    blurs_px2 : ndarray, shape (k, 2, 2)
        Covariance, rows before columns, of the Gaussian by which each is less sharp; that of the sharpest is 0.
    azimuth_deg : float or None
        Direction along which, or across which, all light of a flat pane is polarized; needed where one is less sharp.
    """

    shifts_px: Floats
    blurs_px2: Floats
    azimuth_deg: float | None = None

    @property
    def blurs_px(self) -> tuple[float, ...]:
        """Standard deviation of each Gaussian, root mean square over its directions."""
        return tuple(math.sqrt(max(float(np.trace(blur)), 0.0) / 2) for blur in self.blurs_px2)

    @property
    def blurred(self) -> bool:
        """Whether any photograph is less sharp than another."""
        return bool(self.blurs_px2.any())

    def at(self, rows: Floats, columns: Floats) -> Spectrum:
        """Transfer functions (k, ...) at frequencies in periods per pixel."""
        exponents = [
            -2 * np.pi**2 * (blur[0, 0] * rows**2 + 2 * blur[0, 1] * rows * columns + blur[1, 1] * columns**2)
            - 2j * np.pi * (shift[0] * rows + shift[1] * columns)
            for shift, blur in zip(self.shifts_px, self.blurs_px2, strict=True)
        ]
        return np.asarray(np.exp(np.stack(exponents)))
