"""Transfer functions of photographs: what each shows of the frequencies of the scene, or of both layers."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from polaropt.optics import analyzer_matrix

Floats = NDArray[np.floating[Any]]
Spectrum = NDArray[np.complexfloating[Any, Any]]

_FIRMNESS = 1e-8
"""Share of both layers' power by which those are kept small that photographs do not tell apart; set by hand."""


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
class LayerShifts:
    """Where each photograph shows both layers, each of which moves by itself, and how these are polarized.

    Attributes
    ----------
    shifts_px : ndarray, shape (2, k, 2)
        How far down and to the right of the first photograph each shows a layer.
    azimuth_deg : float
        Direction along which, or across which, the light of both is polarized.
    polarized : ndarray, shape (2,)
        Degree of polarization of each, negative where it is polarized across the azimuth.
    """

    shifts_px: Floats
    azimuth_deg: float
    polarized: Floats

    def seen_by(self, azimuth_deg: float) -> LayerShifts:
        """The same, first the layer that is polarized along the plane of incidence: what is behind the pane."""
        along = math.cos(2 * math.radians(azimuth_deg - self.azimuth_deg)) * (self.polarized[0] - self.polarized[1]) > 0
        return self if along else LayerShifts(self.shifts_px[::-1], self.azimuth_deg, self.polarized[::-1])

    def in_place(self, angles_deg: Sequence[float]) -> Floats:
        """What photographs show of both layers where these lie in place, (k, 2)."""
        return np.asarray(2 * pane_matrix(angles_deg, self.azimuth_deg) @ np.stack([np.ones(2), self.polarized]))

    def turns(self, rows: Floats, columns: Floats) -> Spectrum:
        """What shifts do to both layers at frequencies in periods per pixel, (..., k, 2)."""
        down, across = np.moveaxis(self.shifts_px, -1, 0).swapaxes(1, 2)
        return np.asarray(np.exp(-2j * np.pi * (down * rows[..., None, None] + across * columns[..., None, None])))

    def at(self, rows: Floats, columns: Floats, angles_deg: Sequence[float]) -> Spectrum:
        """What photographs show of both layers at frequencies in periods per pixel, (..., k, 2)."""
        return np.asarray(self.in_place(angles_deg) * self.turns(rows, columns))


def unmixing(mixing: Spectrum) -> Spectrum:
    """What finds both layers in photographs by least squares, (..., 2, k), of what these show of them, (..., k, 2).

    Layers that are hardly told apart stay small.
    """
    adjoint = mixing.conj().swapaxes(-1, -2)
    powers = adjoint @ mixing
    power = np.trace(powers, axis1=-2, axis2=-1).real / 2
    inverse = np.linalg.inv(powers + _FIRMNESS * power[..., None, None] * np.eye(2))
    return np.asarray(inverse @ adjoint)


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
    layers : LayerShifts or None
        Where each shows both layers, if these have moved by themselves; shifts are then those of the first.
    """

    shifts_px: Floats
    blurs_px2: Floats
    azimuth_deg: float | None = None
    layers: LayerShifts | None = None

    @classmethod
    def of_shifts(cls, shifts_px: Floats) -> Transfer:
        """That of photographs which are equally sharp."""
        return cls(shifts_px, np.zeros((len(shifts_px), 2, 2)))

    @classmethod
    def of_layers(cls, layers: LayerShifts) -> Transfer:
        """That of photographs which are equally sharp, and show both layers in places of their own."""
        return replace(cls.of_shifts(layers.shifts_px[0]), layers=layers)

    @property
    def blurs_px(self) -> tuple[float, ...]:
        """Standard deviation of each Gaussian, root mean square over its directions."""
        return tuple(math.sqrt(max(float(np.trace(blur)), 0.0) / 2) for blur in self.blurs_px2)

    @property
    def blurred(self) -> bool:
        """Whether any photograph is less sharp than another."""
        return bool(self.blurs_px2.any())

    @property
    def moves(self) -> bool:
        """Whether any photograph shows anything in another place than the first."""
        return bool(self.shifts_px.any()) or self.layers is not None

    @property
    def mixes(self) -> bool:
        """Whether each photograph is made of all to undo it."""
        return self.blurred or self.layers is not None

    @property
    def reach_px(self) -> int:
        """Distance over which undoing it brings in what lies beside."""
        widest = 2 * max(self.blurs_px)
        if self.layers is not None:
            widest += float(np.abs(self.layers.shifts_px).max())
        return 1 + math.ceil(widest)

    def at(self, rows: Floats, columns: Floats) -> Spectrum:
        """Transfer functions (k, ...) at frequencies in periods per pixel."""
        exponents = [
            -2 * np.pi**2 * (blur[0, 0] * rows**2 + 2 * blur[0, 1] * rows * columns + blur[1, 1] * columns**2)
            - 2j * np.pi * (shift[0] * rows + shift[1] * columns)
            for shift, blur in zip(self.shifts_px, self.blurs_px2, strict=True)
        ]
        return np.asarray(np.exp(np.stack(exponents)))
