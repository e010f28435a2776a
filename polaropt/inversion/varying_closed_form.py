"""Closed-form layers where the pane varies over the frame: pixel by pixel, or by filters of some places, blended.

The inverted layers' noise differs from pixel to pixel; the filter takes its mean. It is a start, not an answer.

Around a place the pane is that of the place: every frequency is a small mixture, as it is for a pane seen from far.
The layers' spectra are those under which the surroundings of all places are most likely.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from polaropt.capture import Capture, least_squares_entries
from polaropt.inversion.canvas import Canvas
from polaropt.inversion.closed_form import (
    LEAST_INTENSITY,
    ClosedForm,
    NormalEquations,
    fitted_closed_form,
    half_spectra,
    initial_power,
    knowledge_of,
    means_of,
    normal_equations,
    wiener_layers,
)
from polaropt.inversion.spectra import RESOLUTION, FittedSpectra, FrequencyBands, Spectrum, fit_spectra, moments_of
from polaropt.inversion.transfer import ghost_transfer, ghost_transfer_at
from polaropt.numerics import Basis, opponent_basis
from polaropt.optics import VaryingPSE
from priors.natural_image import in_basis

Images = NDArray[np.float32]
Matrix = NDArray[np.float64]

# Standard deviation of a layer's pixel before anything is measured, in units of the mean intensity. Set by hand.
_PIXEL_SPREAD = 0.5
# Information (inverse variance, for noise of 1) that keeps a pixel without any from dividing by zero.
_LEAST_INFORMATION = 1e-6


def varying_layers(capture: Capture, pse: VaryingPSE, canvas: Canvas, noise: float) -> ClosedForm:
    """Counterpart of `polaropt.inversion.closed_form.natural_image_layers`; parameters and result as there."""
    basis = opponent_basis(capture.intensities.shape[1] if capture.color else 1)
    stokes = in_basis(basis.astype(np.float32), least_squares_entries(capture, pse.analyzer), np)
    precision = pse.analyzer.T @ pse.analyzer / noise**2
    mixtures = pse.mixtures(canvas.height, canvas.width)
    mean = _frame_means(mixtures, precision, stokes, basis)
    rest = _without(mean, mixtures, stokes)
    told, layers, covariance = pixel_layers(mixtures, precision, rest, weak_prior(stokes, mean))
    level = layers.mean(axis=(-1, -2), keepdims=True)
    information = np.linalg.inv(covariance)
    right = np.tensordot(information.astype(np.float32), half_spectra(layers, level, canvas), axes=1)
    power = initial_power(stokes[0] / 2)
    known = fitted_closed_form(_everywhere(information, right), power, mean + level, basis, canvas)
    # What is told on average, not what is left open on average, makes the coordinates round.
    typical = _everywhere(told.mean(axis=(-1, -2), dtype=np.float64), right)
    return replace(known, told=typical.told, cross=typical.cross)


def weak_prior(stokes: Images, mean: Images) -> Matrix:
    """Inverse variances (2,) of a pixel of each layer around its mean before anything is measured.

    Parameters
    ----------
    stokes : ndarray, shape (3, channel, h, w)
        Stokes images in the colour basis.
    mean : ndarray, shape (2, channel, 1, 1)
        Of the layers. Glass shows little of what it mirrors: that may be far brighter than all that is seen.
    """
    intensity = max(LEAST_INTENSITY, float(np.linalg.norm(stokes[0].mean(axis=(-1, -2)))))
    levels = np.linalg.norm(mean.reshape(2, -1), axis=1)
    return np.asarray((_PIXEL_SPREAD * np.maximum(levels, intensity)) ** -2.0)


def _frame_means(mixtures: Images, precision: Matrix, stokes: Images, basis: Basis) -> Images:
    """Means of the layers (2, channel, 1, 1) that explain all pixels best."""
    weights = np.tensordot(precision.astype(np.float32), mixtures, axes=1)
    normal = np.einsum("ilhw,imhw->lm", mixtures, weights, dtype=np.float64)
    right = np.einsum("ilhw,ichw->lc", weights, stokes, dtype=np.float64)
    return means_of(stokes[0].mean(axis=(-1, -2)), normal, right, basis)


def _without(mean: Images, mixtures: Images, stokes: Images) -> Images:
    """Stokes images less what the layers' means show, which is another thing in every pixel."""
    return np.asarray(stokes - np.einsum("ilhw,lc->ichw", mixtures, mean[..., 0, 0]))


def varying_pixel_layers(capture: Capture, pse: VaryingPSE) -> Images:
    """Counterpart of `polaropt.inversion.closed_form.per_pixel_layers`: layers (2, [channel,] h, w)."""
    stokes = least_squares_entries(capture, pse.analyzer)
    precision = pse.analyzer.T @ pse.analyzer
    stiffness = np.full(2, _LEAST_INFORMATION)
    _, layers, _ = pixel_layers(pse.mixtures(*capture.shape[-2:]), precision, stokes, stiffness)
    return layers if capture.color else layers[:, 0]


def _everywhere(information: NDArray[Any], right: NDArray[Any]) -> NormalEquations:
    """The same information (2, 2) at every frequency."""
    flat = np.ones(right.shape[-2:], dtype=np.float32)
    told = np.stack([np.float32(information[i, i]) * flat for i in (0, 1)])
    return NormalEquations(told, (information[0, 1] * flat).astype(np.complex64), right)


def pixel_layers(
    mixtures: Images, precision: Matrix, stokes: Images, stiffness: Matrix
) -> tuple[Images, Images, Matrix]:
    """Each pixel's layers from its own photographs.

    Parameters
    ----------
    mixtures : ndarray, shape (3, 2, h, w)
        Stokes images of layers of intensity 1.
    precision : ndarray, shape (3, 3)
        Inverse covariance of a pixel's Stokes vector.
    stokes : ndarray, shape (3, channel, h, w)
    stiffness : ndarray, shape (2,)
        Weak prior of each layer at zero, an inverse variance.

    Returns
    -------
    told : ndarray, shape (2, 2, h, w)
        Information on the two layers.
    layers : ndarray of float32, shape (2, channel, h, w)
    covariance : ndarray, shape (2, 2)
        Of the layers' noise, mean over the pixels.
    """
    weights = np.tensordot(precision.astype(np.float32), mixtures, axes=1)
    told = np.einsum("ilhw,imhw->lmhw", mixtures, weights)
    t, r, k = told[0, 0] + np.float32(stiffness[0]), told[1, 1] + np.float32(stiffness[1]), told[0, 1]
    determinant = np.maximum(t * r - k * k, RESOLUTION * t * r)
    right = np.einsum("ilhw,ichw->lchw", weights, stokes)
    layers = np.stack([r * right[0] - k * right[1], t * right[1] - k * right[0]]) / determinant
    entries = [float((part / determinant).mean(dtype=np.float64)) for part in (r, -k, -k, t)]
    return told, layers, np.array(entries).reshape(2, 2)


# Places per side whose surroundings the spectra are fitted to, and between whose filters the layers are blended. By
# trial: the start that they give is 1.3 / 2.5 dB (T / R) from the solve.
_N_FITTED, _N_FILTERS = 2, 4


@dataclass(frozen=True)
class _Place:
    """A pixel of the frame, and how much the pixels of the canvas belong to it, (H, W)."""

    row: int
    column: int
    weights: Images


def ghost_layers(capture: Capture, pse: VaryingPSE, canvas: Canvas, noise: float) -> ClosedForm:
    """Counterpart of `polaropt.inversion.closed_form.natural_image_layers`; parameters and result as there."""
    basis = opponent_basis(capture.intensities.shape[1] if capture.color else 1)
    stokes = in_basis(basis.astype(np.float32), least_squares_entries(capture, pse.analyzer), np)
    precision = pse.analyzer.T @ pse.analyzer / noise**2
    mixtures = pse.mixtures(canvas.height, canvas.width)
    mean = _frame_means(mixtures, precision, stokes, basis)
    _, in_place, _ = pixel_layers(mixtures, precision, _without(mean, mixtures, stokes), weak_prior(stokes, mean))
    # Pixels that tell more weigh more in what explains them best, but not in a mean.
    mean = mean + in_place.mean(axis=(-1, -2), keepdims=True)
    # The filters see the rest.
    rest = _without(mean, mixtures, stokes)
    panes = _Panes(pse, precision, canvas)
    bands = FrequencyBands(*canvas.shape)
    fitted = _fitted(panes, rest, bands, initial_power(stokes[0] / 2))
    equations, layers = _blended(panes, rest, fitted.everywhere(bands), mean, basis)
    return replace(knowledge_of(equations, fitted, bands, mean, basis), layers=layers)


class _Panes:
    """The pane as it is at places of the frame."""

    def __init__(self, pse: VaryingPSE, precision: Matrix, canvas: Canvas) -> None:
        frame = (canvas.height, canvas.width)
        self.canvas, self._precision = canvas, precision
        self._mixtures, self._displacements = pse.ghost_mixtures(*frame), pse.displacements(*frame)

    def equations(self, place: _Place, data: Spectrum) -> NormalEquations:
        """What spectra (3, channel, H, W // 2 + 1) tell of the layers if all the pane is as at a place."""
        transfer = ghost_transfer(self._taps(place), self._displacements, *self.canvas.shape)
        return normal_equations(transfer, self._precision, data)

    def equations_at(self, place: _Place, data: Spectrum, sample: NDArray[np.intp]) -> NormalEquations:
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
        equations = panes.equations_at(place, sampled, bands.sample[own])
        information[..., own] = [[equations.told[0], equations.cross], [equations.cross.conj(), equations.told[1]]]
        right[..., own] = equations.right
    return fit_spectra(moments_of(information, right), bands, power)


def _blended(panes: _Panes, rest: Images, prior: Images, mean: Images, basis: Basis) -> tuple[NormalEquations, Images]:
    """What is told on average, and canvas layers: between places those of their filters, blended."""
    data = _spectra(rest, panes.canvas)
    layers = np.zeros((*prior.shape[:2], *panes.canvas.shape), dtype=np.float32)
    told, cross = np.zeros((2, *data.shape[-2:]), np.float32), np.zeros(data.shape[-2:], np.complex64)
    places = list(_places(panes.canvas, _N_FILTERS))
    for place in places:
        equations = panes.equations(place, data)
        told += equations.told / np.float32(len(places))
        cross += equations.cross / np.float32(len(places))
        layers += place.weights * wiener_layers(equations, prior, mean, basis, panes.canvas)
    return NormalEquations(told, cross, np.empty(0, dtype=np.complex64)), layers


def _spectra(images: Images, canvas: Canvas) -> Spectrum:
    return half_spectra(images, np.zeros((*images.shape[:2], 1, 1), np.float32), canvas)
