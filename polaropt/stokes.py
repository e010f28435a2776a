"""Stokes vectors, polarizers and the rotation between the camera's and the plate's frame.

Angles count counter-clockwise from the image's x axis (to the right; y is up).
``I(phi) = (s0 + s1 cos 2phi + s2 sin 2phi) / 2``, so unpolarized light of intensity s0 gives s0/2 behind a polarizer.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

Matrix = NDArray[np.float64]


def analyzer_matrix(angles_deg: Sequence[float]) -> Matrix:
    """Rows that turn a Stokes vector into the intensities behind linear polarizers, shape (k, 3)."""
    double = 2 * np.radians(np.asarray(angles_deg, dtype=np.float64))
    return 0.5 * np.stack([np.ones_like(double), np.cos(double), np.sin(double)], axis=1)


def frame_matrix(azimuth_deg: float) -> Matrix:
    """Camera Stokes vector to (I_par, I_perp, s2') in the frame of a plate at `azimuth_deg`, shape (3, 3)."""
    double = 2 * np.radians(azimuth_deg)
    cos, sin = np.cos(double), np.sin(double)
    return np.array([[0.5, 0.5 * cos, 0.5 * sin], [0.5, -0.5 * cos, -0.5 * sin], [0.0, -sin, cos]])


def stokes_vector(dolp: float, aolp_deg: float) -> NDArray[np.float64]:
    """Stokes vector of light of intensity 1 with a degree and an angle of linear polarization."""
    double = 2 * np.radians(aolp_deg)
    return np.array([1.0, dolp * np.cos(double), dolp * np.sin(double)])


def stokes_from_intensities(intensities: Any, angles_deg: Sequence[float]) -> Any:
    """Least-squares Stokes images from k >= 3 polarizer photographs.

    Parameters
    ----------
    intensities : ndarray, shape (k, ...)
        Linear photographs.
    angles_deg : sequence of k floats
        Polarizer angles in degrees.

    Returns
    -------
    ndarray, shape (3, ...)
        s0, s1, s2 in the camera's frame, in the dtype of the input.
    """
    inverse = np.linalg.pinv(analyzer_matrix(angles_deg)).astype(intensities.dtype)
    return np.tensordot(inverse, intensities, axes=1)


def dolp_aolp(stokes: Any) -> tuple[Any, Any]:
    """Degree (0..1) and angle (degrees, 0..180) of linear polarization of Stokes images (3, ...)."""
    polarized = np.hypot(stokes[1], stokes[2])
    dolp = np.clip(polarized / np.maximum(stokes[0], np.finfo(stokes.dtype).tiny), 0, 1)
    return dolp, np.degrees(np.arctan2(stokes[2], stokes[1])) / 2 % 180
