"""How exactly each pixel is measured, in units of a pixel in the middle of the frame with all its photographs.

Clipped photographs tell nothing; near the frame's edge ghosts bring light from beyond it, which nothing else shows.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from polaropt.capture import Capture, NoiseClasses
from polaropt.inversion import Knowledge
from polaropt.optics import PSE, Displacements, VaryingPSE
from polaropt.solving import kinds_of_pixels

Images = NDArray[np.float32]
Matrix = NDArray[np.float64]

LEAST = 1e-3
"""Precision of a pixel that no photograph shows: its neighbours tell the slow changes."""
# Width of the Gaussian that spreads the precision to neighbours, in pixels: set by hand.
_BLUR_PX = 1.0
# Precision below which a pixel counts as not seen: set by hand.
_UNSEEN = 0.1
# Distances at which the structure function is made, between which is interpolated.
_DISTANCES = 17


def local_precision(
    capture: Capture, pse: PSE | VaryingPSE, noise: float, known: Knowledge, classes: NoiseClasses | None = None
) -> Images | None:
    """Precision of every pixel of the frame, (h, w), at least `LEAST`; None where all are alike."""
    mixing = pse.mixing[:, : pse.taps.shape[2]] if isinstance(pse, PSE) else pse.analyzer
    clipped = _of_clipping(capture, mixing)
    variance = noise**2 * np.diag(np.linalg.inv(mixing.T @ mixing))
    beyond = _of_unseen_light(_ghosts(pse, capture.shape[-2:]), variance, known, clipped)
    of_noise = None if classes is None else np.square(noise / classes.images()).mean(axis=0)
    parts = [part for part in (clipped, beyond, of_noise) if part is not None]
    if not parts:
        return None
    return np.asarray(np.maximum(np.prod(parts, axis=0), LEAST), dtype=np.float32)


def _of_clipping(capture: Capture, mixing: Matrix) -> Images | None:
    """What the trusted photographs tell of a pixel's entries against all of them, mean over colours."""
    from scipy.ndimage import gaussian_filter

    if capture.valid.all():
        return None
    shape = (len(capture.angles_deg), -1, *capture.shape[-2:])
    patterns, kinds = kinds_of_pixels(capture.valid.reshape(shape))
    of_kind = np.array([_volume(mixing * trusted[:, None]) for trusted in patterns]) / _volume(mixing)
    precision: Images = of_kind.astype(np.float32)[kinds].mean(axis=0) if kinds.size else np.ones(shape[2:], np.float32)
    return np.asarray(gaussian_filter(precision, _BLUR_PX, mode="nearest"), dtype=np.float32)


def _volume(mixing: Matrix) -> float:
    """Geometric mean of the eigenvalues of the information on the entries."""
    return float(max(np.linalg.det(mixing.T @ mixing), 0.0) ** (1 / mixing.shape[1]))


@dataclass(frozen=True)
class _Ghosts:
    """What each image of a layer adds to the entries, (entry, 2, ghosts + 1, h, w), and its displacement."""

    weights: NDArray[Any]
    displacements: Displacements


def _ghosts(pse: PSE | VaryingPSE, shape: tuple[int, ...]) -> _Ghosts:
    height, width = shape
    if isinstance(pse, VaryingPSE):
        return _Ghosts(pse.ghost_mixtures(height, width), pse.displacements(height, width))
    taps = pse.taps.transpose(2, 0, 1)[..., None, None]
    return _Ghosts(np.broadcast_to(taps, (*taps.shape[:3], height, width)), pse.displacements)


def _of_unseen_light(
    ghosts: _Ghosts, variance: NDArray[np.float64], known: Knowledge, clipped: Images | None
) -> Images | None:
    """Ghosts of what no photograph shows are known as far as it is like its surroundings; the rest is noise."""
    amplitude = np.zeros((2, len(variance), *ghosts.weights.shape[-2:]), dtype=np.float32)
    unseen = None if clipped is None else _distance_to_seen(clipped)
    for k, displacement in enumerate(ghosts.displacements[: ghosts.weights.shape[2]]):
        distance = _source_distance(amplitude.shape[-2:], displacement, unseen)
        where = np.nonzero(distance)
        if k > 0 and where[0].size:
            grid = np.linspace(0, float(distance.max()), _DISTANCES)
            for i, structure in enumerate(np.sqrt(known.structure(grid))):
                apart = np.interp(distance[where], grid, structure)
                amplitude[i, :, where[0], where[1]] += (np.abs(ghosts.weights[:, i, k, where[0], where[1]]) * apart).T
    if not amplitude.any():
        return None
    usual = variance.astype(np.float32)[:, None, None]
    unknown = np.square(amplitude).sum(axis=0)
    return np.asarray(np.prod(usual / (usual + unknown), axis=0) ** (1 / len(usual)), dtype=np.float32)


def _distance_to_seen(clipped: Images) -> Images | None:
    """How far each pixel is from one that its own photographs tell; None where all are such."""
    from scipy.ndimage import distance_transform_edt

    unseen = clipped < _UNSEEN
    return np.asarray(distance_transform_edt(unseen), dtype=np.float32) if unseen.any() else None


def _source_distance(shape: tuple[int, ...], displacement: tuple[float, float], unseen: Images | None) -> Images:
    """How far the source of a displaced image is from what the photographs show, for every pixel, (h, w)."""
    from scipy.ndimage import shift

    columns, rows = (_beyond(*side) for side in zip((shape[1], shape[0]), displacement, strict=True))
    beyond = np.hypot(rows[:, None], columns).astype(np.float32)
    if unseen is None:
        return beyond
    return np.asarray(beyond + shift(unseen, displacement[::-1], order=1, mode="nearest"), dtype=np.float32)


def _beyond(length: int, shift: float) -> NDArray[np.float64]:
    """How far from the frame each pixel of a side sees, shifted so, (length,)."""
    seen = np.arange(length) - shift
    return np.asarray(np.maximum(np.maximum(-seen, seen - (length - 1)), 0.0))
