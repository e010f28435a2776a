"""Closed-form layers where the pane varies over the frame and has ghosts: Wiener filters of some places, blended.

Around a place the pane is that of the place: every frequency is a small mixture, as it is for a pane seen from far.
The layers' spectra are those under which the surroundings of all places are most likely.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from polaropt.canvas import Canvas
from polaropt.capture import Capture
from polaropt.closed_form import (
    ClosedForm,
    NormalEquations,
    described,
    filtered,
    initial_power,
    normal_equations,
    transformed,
)
from polaropt.color_basis import Basis, opponent_basis
from polaropt.plate_frame import least_squares_entries
from polaropt.spectra import FittedSpectra, FrequencyBands, Spectrum, fit_spectra
from polaropt.transfer import ghost_transfer, ghost_transfer_at
from polaropt.varying import VaryingPSE
from polaropt.varying_closed_form import inverted, weak_prior
from priors.natural_image import in_basis

Images = NDArray[np.float32]
Matrix = NDArray[np.float64]

# Places per side whose surroundings the spectra are fitted to, and between whose filters the layers are blended.
_N_FITTED, _N_FILTERS = 2, 4


@dataclass(frozen=True)
class _Place:
    """A pixel of the frame, and how much the pixels of the canvas belong to it, (H, W)."""

    row: int
    column: int
    weights: Images


def ghost_layers(capture: Capture, pse: VaryingPSE, canvas: Canvas, noise: float) -> ClosedForm:
    """Counterpart of `polaropt.closed_form.natural_image_layers`; parameters and result as there."""
    basis = opponent_basis(capture.intensities.shape[1] if capture.color else 1)
    stokes = in_basis(basis.astype(np.float32), least_squares_entries(capture, pse.analyzer), np)
    precision = pse.analyzer.T @ pse.analyzer / noise**2
    mixtures = pse.mixtures(canvas.height, canvas.width)
    _, in_place, _ = inverted(mixtures, precision, stokes, weak_prior(stokes))
    mean: Images = in_place.mean(axis=(-1, -2), keepdims=True)
    # What the means show is another thing in every pixel; the filters see the rest.
    rest = stokes - np.einsum("ilhw,lc->ichw", mixtures, mean[..., 0, 0])
    panes = _Panes(pse, precision, canvas)
    bands = FrequencyBands(*canvas.shape)
    fitted = _fitted(panes, rest, bands, initial_power(stokes[0] / 2))
    seen, layers = _blended(panes, rest, fitted.everywhere(bands), mean, basis)
    return replace(described(seen, fitted, bands, mean, basis), layers=layers)


class _Panes:
    """The pane as it is at places of the frame."""

    def __init__(self, pse: VaryingPSE, precision: Matrix, canvas: Canvas) -> None:
        frame = (canvas.height, canvas.width)
        self.canvas, self._precision = canvas, precision
        self._mixtures, self._displacements = pse.ghost_mixtures(*frame), pse.displacements(*frame)

    def seen(self, place: _Place, data: Spectrum) -> NormalEquations:
        """What spectra (3, channel, H, W // 2 + 1) tell of the layers if all the pane is as at a place."""
        transfer = ghost_transfer(self._taps(place), self._displacements, *self.canvas.shape)
        return normal_equations(transfer, self._precision, data)

    def seen_at(self, place: _Place, data: Spectrum, sample: NDArray[np.intp]) -> NormalEquations:
        """The same at a sample of the frequencies, flat indices: data (3, channel, n)."""
        transfer = ghost_transfer_at(self._taps(place), self._displacements, self.canvas.shape, sample)
        return normal_equations(transfer, self._precision, data)

    def _taps(self, place: _Place) -> Matrix:
        return self._mixtures[..., place.row, place.column].transpose(1, 2, 0).astype(np.float64)


def _places(canvas: Canvas, per_side: int) -> Iterator[_Place]:
    """Places evenly over the frame, with weights that fall linearly to the next ones and add up to 1."""
    rows, columns = (
        ((np.arange(per_side) + 0.5) * length / per_side).astype(int) for length in (canvas.height, canvas.width)
    )
    height, width = canvas.shape
    for i, j in np.ndindex(per_side, per_side):
        down = np.interp(np.arange(height), rows + canvas.top, np.eye(per_side)[i])
        across = np.interp(np.arange(width), columns + canvas.left, np.eye(per_side)[j])
        yield _Place(int(rows[i]), int(columns[j]), np.outer(down, across).astype(np.float32))


def _fitted(panes: _Panes, rest: Images, bands: FrequencyBands, power: NDArray[np.float64]) -> FittedSpectra:
    """Spectra fitted at the bands' sample, whose frequencies are looked at around one place each, in turns."""
    n = bands.sample.size
    information = np.empty((2, 2, n), dtype=np.complex64)
    right = np.empty((2, rest.shape[1], n), dtype=np.complex64)
    places = list(_places(panes.canvas, _N_FITTED))
    for i, place in enumerate(places):
        own = slice(i, None, len(places))
        window = panes.canvas.crop(place.weights)
        window = window / np.sqrt(np.square(window).mean())
        data = _spectra(rest * window, panes.canvas)
        sampled = data.reshape(*data.shape[:2], -1)[..., bands.sample[own]]
        seen = panes.seen_at(place, sampled, bands.sample[own])
        information[..., own] = [[seen.told[0], seen.cross], [seen.cross.conj(), seen.told[1]]]
        right[..., own] = seen.right
    return fit_spectra(information, right, bands, power)


def _blended(panes: _Panes, rest: Images, prior: Images, mean: Images, basis: Basis) -> tuple[NormalEquations, Images]:
    """What is told on average, and canvas layers: between places those of their filters, blended."""
    data = _spectra(rest, panes.canvas)
    layers = np.zeros((*prior.shape[:2], *panes.canvas.shape), dtype=np.float32)
    told, cross = np.zeros((2, *data.shape[-2:]), np.float32), np.zeros(data.shape[-2:], np.complex64)
    places = list(_places(panes.canvas, _N_FILTERS))
    for place in places:
        seen = panes.seen(place, data)
        told += seen.told / np.float32(len(places))
        cross += seen.cross / np.float32(len(places))
        layers += place.weights * filtered(seen, prior, mean, basis, panes.canvas)
    return NormalEquations(told, cross, np.empty(0, dtype=np.complex64)), layers


def _spectra(images: Images, canvas: Canvas) -> Spectrum:
    return transformed(images, np.zeros((*images.shape[:2], 1, 1), np.float32), canvas)
