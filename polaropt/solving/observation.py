"""What the networks of `priors` are shown of a capture."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np
from array_api_compat import array_namespace, device
from numpy.typing import NDArray

from polaropt.capture import ANGLES_DEG, Capture, least_squares_entries
from polaropt.optics import (
    PSE,
    SceneParameters,
    VaryingPSE,
    analyzer_matrix,
    change_basis,
    frame_matrix,
    in_place_weights,
)
from polaropt.solving.problem import Problem

if TYPE_CHECKING:
    from priors.observation import Observation


# Incidences of the panes that the paper's form chooses from, first and last: set by hand; the networks shipped were
# trained with these.
_CANDIDATES_DEG = (8.0, 88.0)
# What is told of a layer where nothing is, in parts of a photograph's share: keeps what divides by it finite.
LEAST_TOLD = 1e-3
Images = NDArray[np.float32]
Matrix = NDArray[np.float64]


def plain_observation(capture: Capture, noise: float, refractive_index: float = 1.5) -> Observation:
    """The photographs alone, as they would be at 0, 45, 90 and 135 degrees: for the paper's form.

    Parameters
    ----------
    capture : Capture
        Any three or more angles.
    noise : float
        Standard deviation of one photograph's noise (white = 1).
    refractive_index : float
        Of the pane.
    """
    from priors.observation import N_CANDIDATES, of_arrays

    to_views = analyzer_matrix(ANGLES_DEG)
    stokes = least_squares_entries(capture, analyzer_matrix(capture.angles_deg))
    views = np.tensordot(to_views.astype(np.float32), stokes, axes=1)
    return of_arrays(
        views=views,
        view_errors=view_errors(to_views, capture, noise),
        trusted=_trusted(capture),
        shares=transmitted_shares(refractive_index, N_CANDIDATES),
    )


def transmitted_shares(refractive_index: float, n: int) -> Matrix:
    """Shares of the light along and across the plane of incidence that panes transmit, from frontal to grazing.

    Parameters
    ----------
    refractive_index : float
    n : int
        Panes.

    Returns
    -------
    ndarray, shape (n, 2)
    """
    cosines = np.cos(np.radians(np.linspace(*_CANDIDATES_DEG, n)))
    transmitted, _ = in_place_weights(cosines[None], refractive_index, single_surface=False)
    return np.asarray(transmitted[:2, 0].T)


def conditioned_observation(problem: Problem) -> Observation:
    """The views along and across the plane of incidence, and the layers known best before: for the conditioned form."""
    from priors.observation import of_arrays

    capture, pse, layers = problem.capture, problem.pse, problem.best_known()
    told = told_in_place(problem.observed, pse)
    average = told.mean(axis=(1, 2, 3), keepdims=True)
    # What noise does to the slope of the misfit, where as much is told as on average.
    usual = np.sqrt(average) / np.float32(problem.noise)
    stokes = least_squares_entries(capture, analyzer_matrix(capture.angles_deg))
    _, azimuth_deg, shift = problem.scene.values()
    azimuth = math.radians(azimuth_deg)
    return of_arrays(
        views=plate_views(stokes, pse),
        view_errors=view_errors(frame_matrix(0.0)[:2], capture, problem.noise),
        trusted=_trusted(capture),
        layers=problem.canvas.crop(layers),
        errors=layer_errors(problem.known.variance),
        mixing=mixing_in_place(pse, *capture.shape[-2:]),
        step=np.array([shift * math.cos(azimuth), -shift * math.sin(azimuth)]),
        unexplained=-problem.canvas.crop(problem.slope_of_misfit(layers)) / usual,
        told=told / average,
    )


def plate_views(stokes: Any, pse: PSE | VaryingPSE) -> Any:
    """Stokes images (3, channel, h, w) as seen along and across the plane of incidence, (2, channel, h, w)."""
    xp = array_namespace(stokes)
    if isinstance(pse, PSE):
        return change_basis(frame_matrix(pse.scene.values()[1])[:2], stokes)
    cos, sin = (xp.asarray(part, device=device(stokes)) for part in _directions(pse, *stokes.shape[-2:]))
    along = cos * stokes[1, ...] + sin * stokes[2, ...]
    return xp.stack([stokes[0, ...] + along, stokes[0, ...] - along]) / 2


def told_in_place(observed: Capture, pse: PSE | VaryingPSE) -> Images:
    """Squares of what each layer adds to the photographs of a pixel, summed over those measured, (2, channel, h, w).

    Double images count where they come from, the mixing is that of the frame's middle.
    """
    squares = np.square(_shares(pse, *observed.shape[-2:])).astype(np.float32)
    valid = observed.valid.reshape(len(squares), -1, *observed.shape[-2:])
    least = np.float32(LEAST_TOLD) * squares.mean()
    return np.asarray(np.tensordot(squares.T, valid.astype(np.float32), axes=1) + least)


def mixing_in_place(pse: PSE | VaryingPSE, height: int, width: int) -> Matrix:
    """Share of each layer in the views along and across the plane of incidence, at the middle, (2, 2)."""
    if isinstance(pse, PSE):
        return np.ascontiguousarray(pse.taps.sum(axis=1).T[:2])
    row, column = height // 2, width // 2
    mixture = pse.mixtures(height, width)[:, :, row, column]
    cos, sin = (float(direction[row, column]) for direction in _directions(pse, height, width))
    along = cos * mixture[1] + sin * mixture[2]
    return np.stack([mixture[0] + along, mixture[0] - along]).astype(np.float64) / 2


def _shares(pse: PSE | VaryingPSE, height: int, width: int) -> Matrix:
    """What layers of intensity 1 add to each photograph at the middle of the frame, (k, 2)."""
    if isinstance(pse, PSE):
        mixture = pse.taps.sum(axis=1).T
        return np.asarray(pse.mixing[:, : len(mixture)] @ mixture)
    return np.asarray(pse.analyzer @ pse.mixtures(height, width)[:, :, height // 2, width // 2])


def _directions(pse: VaryingPSE, height: int, width: int) -> tuple[Images, Images]:
    """Cosine and sine of twice the azimuth at each pixel: the direction in which a pane polarizes what it transmits."""
    scene: SceneParameters = pse.scene.replace(transmission_polarization=(0.0, 0.0))
    plain = VaryingPSE(scene, pse.angles_deg, pse.center(height, width))
    _, s1, s2 = plain.mixtures(height, width)[:, 0]
    length = np.maximum(np.hypot(s1, s2), np.float32(1e-12))
    return s1 / length, s2 / length


def view_errors(to_views: Matrix, capture: Capture, noise: float) -> NDArray[np.float32]:
    """Standard deviation of the noise of views that are linear in the Stokes vector, (view,)."""
    weights = to_views @ np.linalg.pinv(analyzer_matrix(capture.angles_deg))
    errors = noise * np.sqrt(np.square(weights).sum(axis=1))
    return np.asarray(errors, dtype=np.float32)


def layer_errors(variance: Any) -> Any:
    """Standard errors (..., 3) in the networks' colour basis, of the layers' variance in colours (..., channel).

    Luminance, and the same for both differences of colours; numpy arrays or tensors.
    """
    xp, is_grey = array_namespace(variance), variance.shape[-1] == 1
    # Grey is shown as three equal channels, whose luminance is larger by the root of three.
    luminance = variance[..., :1] * (3 if is_grey else 1)
    chroma = xp.zeros_like(luminance) if is_grey else xp.mean(variance[..., 1:], axis=-1, keepdims=True)
    return xp.sqrt(xp.concat([luminance, chroma, chroma], axis=-1))


def _trusted(capture: Capture) -> Images:
    """Share of the photographs that are not clipped, (1, 1, h, w)."""
    share = capture.valid.reshape(-1, *capture.shape[-2:]).mean(axis=0, dtype=np.float32)
    return np.asarray(share, dtype=np.float32)[None, None]
