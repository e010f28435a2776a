"""Where each photograph of a camera that is held by hand shows both layers.

A camera that moves between the photographs sees what is behind the glass and what the glass mirrors from another place.
They lie at different distances, so that each layer moves by itself. At every frequency four photographs then hold two
unknown numbers, one of each layer, and what no two numbers explain tells how both have moved.
"""

from __future__ import annotations

import math
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from polaropt.capture.matching.least_squares import Curve, levenberg_marquardt
from polaropt.capture.matching.spectra import DetailSpectra
from polaropt.capture.matching.transfer import LayerShifts, unmixing

Floats = NDArray[np.floating[Any]]
Spectrum = NDArray[np.complexfloating[Any, Any]]

_MOST_FREQUENCIES = 1500
"""Frequencies that are looked at, those with most detail; set by hand, for the time it takes."""
_FINEST = (0.06, 0.12, 0.3)
"""Frequencies in periods per pixel up to which a fit looks, one after the other: the first are turned by half a period
where a layer has moved by eight pixels. Set by hand."""
_FEWEST = 150
"""Frequencies that a fit looks at, at least, the coarsest first; set by hand."""
_USUAL, _SPREAD = (0.15, -0.7), (0.15, 0.25)
"""Degrees of polarization of what passes and of what is mirrored by glass, and their standard deviations, of 30 to 75
degrees; what nothing tells stays there."""
_SPREAD_RAD, _SPREAD_PX = 0.1, 1.0
"""The same of twice the azimuth, as it is known before, and of a layer's shifts: which a photograph that shows hardly
any of it leaves open. Set by hand."""
_LEAST_POLARIZED, _MOST_POLARIZED = np.array([0.0, -0.99]), np.array([0.99, -0.1])
"""Degrees of polarization that are looked for: what passes is polarized along the plane of incidence, and what is
mirrored across it, by a tenth at least from 20 degrees on. Layers that are polarized alike would explain anything."""
_LONGEST_PX, _LONGEST = 1.0, 0.2
"""Longest steps of shifts and of the other numbers; set by hand."""
_MOST_STEPS, _ENDS = 15, 1e-4
"""Steps of a fit, and the share of the misfit that the last one gains; set by hand."""
_MOST_SLACK = 1e4
"""Damping at which a fit ends; set by hand."""


class ParallaxFit:
    """What no two layers explain of photographs, as a function of where these show them.

    A fit's numbers are the shifts (2, k - 1, 2) of both layers against the first photograph, the azimuth in radians,
    twice, and the degree of polarization of both layers.

    Parameters
    ----------
    detail : DetailSpectra
        Of more than three photographs.
    azimuth_deg : float
        Direction along which, or across which, the pane polarizes.
    """

    def __init__(self, detail: DetailSpectra, azimuth_deg: float) -> None:
        self._detail, self._azimuth = detail, np.radians(2 * azimuth_deg)
        self._radius = np.hypot(detail.rows, detail.columns)
        self._strength = np.square(np.abs(detail.values)).sum(axis=(0, 1)) * self._radius**2

    def besides_two(self) -> float:
        """Mean square of what no two pictures in place explain, however photographs mix them, in units of the noise.

        Behind a flat pane that is all but noise of photographs that agree: polarized light, gains and angles that are
        not what they should be only mix both layers otherwise.
        """
        photographs = np.moveaxis(self._detail.values[..., self._chosen(_FINEST[-1])], 1, 0)
        powers = (photographs @ photographs.conj().swapaxes(-1, -2)).real / photographs.shape[-1]
        return float(np.linalg.eigvalsh(powers)[:, :-2].mean())

    def found(self) -> tuple[LayerShifts, float]:
        """The shifts of both layers that explain most.

        Returns
        -------
        layers : LayerShifts
        left : float
            Mean square of what these leave, in units of the noise.
        """
        in_place = np.zeros(4 * (len(self._detail.angles_deg) - 1))
        usual = np.concatenate([in_place, [self._azimuth, *_USUAL]])
        # Whether the plane of incidence lies along or across shows only where layers move much, or is left open.
        across = usual.copy()
        across[-3] += np.pi
        numbers, left = min((self._found(start) for start in (usual, across)), key=lambda found: found[1])
        return self._layers(numbers), left

    def _found(self, usual: Floats) -> tuple[Floats, float]:
        """Numbers that explain most, of those near the usual ones, and what they leave."""
        numbers, left = usual, math.inf
        free = np.full(usual.size - 2, np.inf)
        bounds = np.append(-free, _LEAST_POLARIZED), np.append(free, _MOST_POLARIZED)
        longest = np.append(np.full(usual.size - 3, _LONGEST_PX), np.full(3, _LONGEST))
        for finest in _FINEST:
            curve = partial(self._curve, usual=usual, chosen=self._chosen(finest))
            numbers, left = levenberg_marquardt(
                curve, numbers, longest, most_steps=_MOST_STEPS, ends=_ENDS, most_slack=_MOST_SLACK, bounds=bounds
            )
        return numbers, left

    def _layers(self, numbers: Floats) -> LayerShifts:
        shifts = np.zeros((2, len(self._detail.angles_deg), 2))
        shifts[:, 1:] = numbers[:-3].reshape(2, -1, 2)
        return LayerShifts(shifts, float(np.degrees(numbers[-3]) / 2), numbers[-2:])

    def _chosen(self, finest: float) -> NDArray[np.intp]:
        """Frequencies up to one, those with most detail."""
        chosen = np.flatnonzero(self._radius <= finest)
        if chosen.size < _FEWEST:
            chosen = np.argsort(self._radius)[:_FEWEST]
        return chosen[np.argsort(self._strength[chosen])[-_MOST_FREQUENCIES:]]

    def _curve(self, numbers: Floats, usual: Floats, chosen: NDArray[np.intp]) -> Curve:
        """What is left at some frequencies, and how far off the usual the numbers are, as a function of them."""
        detail = self._detail
        angles, layers = detail.angles_deg, self._layers(numbers)
        rows, columns = detail.rows[chosen], detail.columns[chosen]
        frequencies = np.stack([rows, columns])
        values = np.moveaxis(detail.values[..., chosen], -1, 0)
        mixing = layers.at(rows, columns, angles)
        unmixed = unmixing(mixing)
        found = unmixed @ values
        left = values - mixing @ found
        shown = mixing[..., None] * found[:, None]
        # The last three numbers change what all photographs show: (frequency, photograph, number, channel).
        double = 2 * np.radians(np.asarray(angles) - layers.azimuth_deg)[:, None]
        of_weights = shown / layers.in_place(angles)[..., None]
        of_azimuth = ((np.sin(double) * layers.polarized)[..., None] * of_weights).sum(axis=2, keepdims=True)
        slopes = np.concatenate([of_azimuth, np.cos(double)[..., None] * of_weights], axis=2)
        unexplained = np.eye(len(angles)) - mixing @ unmixed
        apart = (unexplained @ slopes.reshape(*mixing.shape[:2], -1)).reshape(slopes.shape)
        beside = np.concatenate([left[:, :, None], apart], axis=2)
        # A shift turns what one photograph shows of one layer, by an imaginary slope: (frequency, layer, photograph).
        moved = shown[:, 1:].swapaxes(1, 2)
        turned = -2 * np.pi * (shown[:, 1:].conj() @ beside[:, 1:].swapaxes(-1, -2)).imag
        turned = np.tensordot(turned, frequencies, axes=(0, 1)).transpose(2, 1, 0, 3).reshape(4, -1)
        slopes, beside = (np.moveaxis(each, 2, 0).reshape(each.shape[2], -1) for each in (slopes, beside))
        of_all = (beside @ slopes.conj().T).real
        curvature = np.block([[_of_shifts(moved, unexplained, frequencies), turned[1:].T], [turned[1:], of_all[1:]]])
        gain = np.concatenate([turned[0], of_all[0]])
        size = (len(angles) - 2) * values[:, 0].size
        spread = np.concatenate([np.full(numbers.size - 3, _SPREAD_PX), [_SPREAD_RAD, *_SPREAD]])
        firmness, off = 1 / (2 * size * spread**2), numbers - usual
        misfit = np.square(np.abs(left)).sum() / size + firmness @ off**2
        return float(misfit), firmness * off - gain / size, curvature / size + np.diag(firmness)


def _of_shifts(moved: Spectrum, unexplained: Spectrum, frequencies: Floats) -> Floats:
    """Gauss-Newton matrix of the shifts of both layers in all photographs but the first.

    Parameters
    ----------
    moved : ndarray, shape (n, 2, k - 1, channel)
        What these show of each layer.
    unexplained : ndarray, shape (n, k, k)
        What takes away from photographs what two layers explain.
    frequencies : ndarray, shape (2, n)
    """
    count, flat = len(moved), moved.reshape(len(moved), -1, moved.shape[-1])
    shared = (flat.conj() @ flat.swapaxes(1, 2)).reshape(count, *2 * moved.shape[1:3])
    products = (shared * unexplained[:, None, 1:, None, 1:]).real.reshape(count, -1)
    squares = (2 * np.pi) ** 2 * (frequencies[:, None] * frequencies).reshape(4, count)
    n_moved = flat.shape[1]
    matrix = (squares @ products).reshape(2, 2, n_moved, n_moved)
    return np.asarray(matrix.transpose(2, 0, 3, 1).reshape(2 * n_moved, 2 * n_moved))
