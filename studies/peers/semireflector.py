"""Schechner, Shamir, Kiryati: invert the pane at every incidence, take the one that leaves the layers least alike.

"Polarization and statistical analysis of scenes containing a semireflector", JOSA A 17 (2000): the mutual information
of the layers over the mean of their entropies; before it, "Vision through semireflecting media", Optics Letters 24
(1999): their correlation. All bounces are summed in place, ghosts are not known to either.

The layers, the pane and the criteria follow the papers. Chosen here: 256 grey levels between black and white, values
beyond are clipped; trial incidences of 5 to 87 degrees; colours share one incidence, found on their mean.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from polaropt.capture import Capture
from polaropt.optics import change_basis, frame_matrix, in_place_reflectance

Images = NDArray[np.float32]
Criterion = Callable[[Images, Images], float]

INCIDENCES_DEG = tuple(np.arange(5.0, 87.5, 0.5).tolist())
_LEVELS = 256
_LEAST = 1e-12


def separate_by(criterion: Criterion, capture: Capture, azimuth_deg: float, refractive_index: float) -> Images:
    """Layers (2, channel, h, w) at the incidence where they are least alike.

    Parameters
    ----------
    criterion : callable
        From two images (h, w) to a number, smaller where they are less alike.
    capture : Capture
    azimuth_deg : float
        Of the plane of incidence: the papers find it by turning the filter, up to an ambiguity that they name.
    refractive_index : float
    """
    across = plane_images(capture, azimuth_deg)
    grey = across.mean(axis=1) if capture.color else across
    scores = [criterion(*invert(grey, incidence, refractive_index)) for incidence in INCIDENCES_DEG]
    return invert(across, INCIDENCES_DEG[int(np.nanargmin(scores))], refractive_index)


def plane_images(capture: Capture, azimuth_deg: float) -> Images:
    """Photographs with the filter along and across the plane of incidence, (2, [channel,] h, w)."""
    return np.asarray(change_basis(frame_matrix(azimuth_deg)[:2], capture.stokes), dtype=np.float32)


def invert(across: Images, incidence_deg: float, refractive_index: float) -> Images:
    """Transmission and reflection of photographs along and across the plane of incidence."""
    along_r, across_r = in_place_reflectance(incidence_deg, refractive_index, single_surface=False)
    mixing = np.array([[1 - along_r, along_r], [1 - across_r, across_r]]) / 2
    return np.asarray(change_basis(np.linalg.inv(mixing), across), dtype=np.float32)


def correlation(transmission: Images, reflection: Images) -> float:
    """Absolute correlation of two images."""
    first, second = (image.ravel().astype(np.float64) - image.mean(dtype=np.float64)
                     for image in (transmission, reflection))  # fmt: skip
    return float(abs(first @ second) / max(np.sqrt((first @ first) * (second @ second)), _LEAST))


def mutual_information(transmission: Images, reflection: Images) -> float:
    """Mutual information of two images over the mean of their entropies."""
    grey = [np.clip(image * _LEVELS, 0, _LEVELS - 1).astype(np.int64).ravel() for image in (transmission, reflection)]
    joint = np.bincount(grey[0] * _LEVELS + grey[1], minlength=_LEVELS**2).reshape(_LEVELS, _LEVELS) / grey[0].size
    of_both, of_first, of_second = (_entropy(part) for part in (joint, joint.sum(axis=1), joint.sum(axis=0)))
    mean = (of_first + of_second) / 2
    # Where one image is a single level nothing is known of it, and nothing is shared.
    return (of_first + of_second - of_both) / mean if min(of_first, of_second) > _LEAST else float("nan")


def _entropy(probability: NDArray[np.float64]) -> float:
    some = probability[probability > 0]
    return float(-(some * np.log(some)).sum())
