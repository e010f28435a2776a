"""A pane before a pinhole camera: incidence and azimuth at every pixel.

For the pixel ray v (unit, x right, y up, z to the scene) and the pane's normal n with n_z > 0: ``cos theta = |n . v|``,
and the trace of the plane of incidence is n minus its part along v, projected on the image.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

Plane = NDArray[np.float64]


def plane_normal(incidence_deg: float, azimuth_deg: float) -> tuple[float, float, float]:
    """Normal of the pane from incidence and azimuth at the middle of the frame."""
    tilt, azimuth = math.radians(incidence_deg), math.radians(azimuth_deg)
    return math.sin(tilt) * math.cos(azimuth), math.sin(tilt) * math.sin(azimuth), math.cos(tilt)


def pixel_grid(height: int, width: int, center: tuple[float, float]) -> tuple[Plane, Plane]:
    """Coordinates of pixels from the principal point: x to the right (1, width), y up (height, 1).

    Parameters
    ----------
    height, width : int
    center : (float, float)
        Column and row of the principal point.
    """
    columns, rows = np.arange(width, dtype=np.float64), np.arange(height, dtype=np.float64)
    return columns[None, :] - center[0], center[1] - rows[:, None]


def viewing_angles(normal: Any, focal_px: Any, x: Any, y: Any) -> tuple[Any, Any, Any]:
    """Cosine of the incidence, and cosine and sine of twice the azimuth, for pixels x to the right and y up.

    Plain arithmetic: numbers, arrays and symbols alike.

    Parameters
    ----------
    normal : (n_x, n_y, n_z)
    focal_px : scalar
    x, y : scalar or array
        From the principal point, in pixels.
    """
    n_x, n_y, n_z = normal
    squared = x * x + y * y + focal_px * focal_px
    along = n_x * x + n_y * y + n_z * focal_px
    w_x, w_y = n_x - along * x / squared, n_y - along * y / squared
    # Never quite 0: where the pane is seen frontally there is no plane of incidence.
    energy = w_x * w_x + w_y * w_y + 1e-12
    cosine = (along * along / squared) ** 0.5
    return cosine, (w_x * w_x - w_y * w_y) / energy, 2 * w_x * w_y / energy
