"""Stokes vectors, polarizers and the rotation between the camera's and the plate's frame.

Angles count counter-clockwise from the image's x axis (to the right; y is up).
``I(phi) = (s0 + s1 cos 2phi + s2 sin 2phi) / 2``, so unpolarized light of intensity s0 gives s0/2 behind a polarizer.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from array_api_compat import array_namespace, is_torch_namespace
from numpy.typing import NDArray

from polaropt.errors import InputError

Matrix = NDArray[np.float64]

# Singular value below which polarizer angles count as the same: they are less than about 1e-4 degrees apart.
_SAME_ANGLE = 1e-6


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
    intensities : numpy array or torch tensor, shape (k, ...)
        Linear photographs.
    angles_deg : sequence of k floats
        Polarizer angles in degrees.

    Returns
    -------
    array, shape (3, ...)
        s0, s1, s2 in the camera's frame, in the dtype of the input (float32 for whole numbers).

    Raises
    ------
    InputError
        Fewer than three angles that differ modulo 180 degrees.
    """
    analyzer = analyzer_matrix(angles_deg)
    if np.linalg.matrix_rank(analyzer, tol=_SAME_ANGLE) < 3:
        raise InputError("fewer than 3 different polarizer angles; three are needed to know the polarization")
    return change_basis(np.asarray(np.linalg.pinv(analyzer), dtype=np.float64), intensities)


def dolp_aolp(stokes: Any) -> tuple[Any, Any]:
    """Degree (0..1) and angle (degrees, 0 <= angle < 180) of linear polarization of Stokes images (3, ...)."""
    xp = array_namespace(stokes)
    stokes = as_floating(stokes, xp)
    s0, s1, s2 = stokes[0, ...], stokes[1, ...], stokes[2, ...]
    polarized = xp.hypot(s1, s2)
    # Noise can leave more polarized light than light.
    light = xp.where(s0 > polarized, s0, polarized)
    dolp = polarized / xp.where(light > 0, light, xp.ones_like(light))
    half_turn = xp.atan2(s2, s1) * (90 / np.pi) % 180
    # The remainder of a tiny negative angle rounds to 180 itself.
    return dolp, xp.where(half_turn < 180, half_turn, xp.zeros_like(half_turn))


def change_basis(matrix: Matrix, images: Any) -> Any:
    """Product of a matrix with the first axis of numpy or torch images (n, ...), in their dtype."""
    xp = array_namespace(images)
    images = as_floating(images, xp)
    device = images.device if is_torch_namespace(xp) else None
    factors = xp.asarray(np.ascontiguousarray(matrix), dtype=images.dtype, device=device)
    flat = xp.reshape(images, (images.shape[0], -1))
    return xp.reshape(factors @ flat, (matrix.shape[0], *images.shape[1:]))


def as_floating(x: Any, xp: Any) -> Any:
    """Whole numbers as float32; others as they are."""
    return x if xp.isdtype(x.dtype, ("real floating", "complex floating")) else xp.astype(x, xp.float32)
