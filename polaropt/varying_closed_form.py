"""Closed-form layers where the pane varies over the frame: each pixel inverted, then a Wiener filter for the rest.

The inverted layers' noise differs from pixel to pixel; the filter takes its mean. It is a start, not an answer.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from polaropt.canvas import Canvas
from polaropt.capture import Capture
from polaropt.closed_form import (
    ClosedForm,
    NormalEquations,
    closed_form_of,
    initial_power,
    transformed,
)
from polaropt.color_basis import opponent_basis
from polaropt.plate_frame import least_squares_entries
from polaropt.varying import VaryingPSE
from priors.natural_image import in_basis

Images = NDArray[np.float32]

# Standard deviation of a layer's pixel before anything is measured, in units of the mean intensity.
_SPREAD = 0.5
# Information that keeps a pixel without any from dividing by zero.
_LEAST = 1e-6


def varying_layers(capture: Capture, pse: VaryingPSE, canvas: Canvas, noise: float) -> ClosedForm:
    """Counterpart of `polaropt.closed_form.natural_image_layers`; parameters and result as there."""
    basis = opponent_basis(capture.intensities.shape[1] if capture.color else 1)
    stokes = in_basis(basis.astype(np.float32), least_squares_entries(capture, pse.analyzer), np)
    precision = pse.analyzer.T @ pse.analyzer / noise**2
    mixtures = pse.mixtures(canvas.height, canvas.width)
    told, layers, covariance = inverted(mixtures, precision, stokes, weak_prior(stokes))
    level = layers.mean(axis=(-1, -2), keepdims=True)
    information = np.linalg.inv(covariance)
    right = np.tensordot(information.astype(np.float32), transformed(layers, level, canvas), axes=1)
    known = closed_form_of(_everywhere(information, right), initial_power(stokes[0] / 2), level, basis, canvas)
    # What is told on average, not what is left open on average, makes the coordinates round.
    mean = _everywhere(told.mean(axis=(-1, -2), dtype=np.float64), right)
    return replace(known, told=mean.told, cross=mean.cross)


def weak_prior(stokes: Images) -> float:
    """Inverse variance of a pixel of a layer before anything is measured, from Stokes images in the colour basis."""
    intensity = max(1e-6, float(np.sqrt(np.square(stokes[0].mean(axis=(-1, -2))).sum())))
    return 1 / (_SPREAD * intensity) ** 2


def varying_pixel_layers(capture: Capture, pse: VaryingPSE) -> Images:
    """Counterpart of `polaropt.closed_form.per_pixel_layers`: layers (2, [channel,] h, w)."""
    stokes = least_squares_entries(capture, pse.analyzer)
    precision = pse.analyzer.T @ pse.analyzer
    _, layers, _ = inverted(pse.mixtures(*capture.shape[-2:]), precision, stokes, _LEAST)
    return layers if capture.color else layers[:, 0]


def _everywhere(information: NDArray[Any], right: NDArray[Any]) -> NormalEquations:
    """The same information (2, 2) at every frequency."""
    flat = np.ones(right.shape[-2:], dtype=np.float32)
    told = np.stack([np.float32(information[i, i]) * flat for i in (0, 1)])
    return NormalEquations(told, (information[0, 1] * flat).astype(np.complex64), right)


def inverted(
    mixtures: Images, precision: NDArray[np.float64], stokes: Images, stiffness: float
) -> tuple[Images, Images, NDArray[np.float64]]:
    """Each pixel's layers from its own photographs.

    Parameters
    ----------
    mixtures : ndarray, shape (3, 2, h, w)
        Stokes images of layers of intensity 1.
    precision : ndarray, shape (3, 3)
        Inverse covariance of a pixel's Stokes vector.
    stokes : ndarray, shape (3, channel, h, w)
    stiffness : float
        Weak prior at zero, an inverse variance.

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
    t, r, k = told[0, 0] + np.float32(stiffness), told[1, 1] + np.float32(stiffness), told[0, 1]
    determinant = t * r - k * k
    right = np.einsum("ilhw,ichw->lchw", weights, stokes)
    layers = np.stack([r * right[0] - k * right[1], t * right[1] - k * right[0]]) / determinant
    entries = [float((part / determinant).mean(dtype=np.float64)) for part in (r, -k, -k, t)]
    return told, layers, np.array(entries).reshape(2, 2)
