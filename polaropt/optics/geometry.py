"""A pane before a pinhole camera: incidence and azimuth at every pixel.

For the pixel ray v (unit, x right, y up, z to the scene) and the pane's normal n with n_z > 0: ``cos theta = |n . v|``,
and the trace of the plane of incidence is n minus its part along v, projected on the image.

A bent pane is a surface whose inverse depth is quadratic in the pixels: ``1 / Z ~ n_z + (n_x x + n_y y + q / 2) / f``
with ``q = b_xx x^2 + 2 b_xy x y + b_yy y^2``. Its gradient makes the normals ``n + (b_xx x + b_xy y, b_xy x + b_yy y,
-q / (2 f))``: their part across the line of sight changes linearly over the frame.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from polaropt.optics.scene import SceneParameters

Plane = NDArray[np.float64]
Bend = tuple[Any, ...]

FLAT: Bend = (0.0, 0.0, 0.0)
# Squared sine of an incidence of 6e-5 degrees, within which the azimuth fades to nothing. Set by hand.
_NEVER_ZERO = 1e-12


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


def bent_normal(normal: Any, bend: Bend, vergence: Any, x: Any, y: Any) -> tuple[Any, Any, Any]:
    """Normal of a bent pane, of any length, for pixels x to the right and y up; linear in normal and bend together.

    Plain arithmetic: numbers and arrays, real and complex.

    Parameters
    ----------
    normal : (n_x, n_y, n_z)
        At the middle.
    bend : (b_xx, b_xy, b_yy)
        Change of the normal per pixel, in radians.
    vergence : scalar
        One over the focal length in pixels; 0 for a pane that is seen from far.
    x, y : scalar or array
        From the principal point, in pixels.
    """
    b_xx, b_xy, b_yy = bend
    turn_x, turn_y = b_xx * x + b_xy * y, b_xy * x + b_yy * y
    return normal[0] + turn_x, normal[1] + turn_y, normal[2] - (turn_x * x + turn_y * y) * (vergence / 2)


def largest_turn(bend: Bend) -> float:
    """How much a bent pane's normal turns over a pixel, in the direction in which it turns most; units of the bend."""
    b_xx, b_xy, b_yy = bend
    return float(np.abs(np.linalg.eigvalsh([[b_xx, b_xy], [b_xy, b_yy]])).max())


@dataclass(frozen=True)
class Pane:
    """Normal at the middle, bend in radians per pixel, and vergence, one over the focal length in pixels."""

    normal: tuple[float, float, float]
    bend: Bend
    vergence: float

    def angles(self, x: Plane, y: Plane) -> tuple[Plane, Plane, Plane]:
        """As `viewing_angles`."""
        return viewing_angles(bent_normal(self.normal, self.bend, self.vergence, x, y), self.vergence, x, y)


def scene_pane(scene: SceneParameters) -> Pane:
    """The pane of a complete scene, flat or bent, near or far."""
    incidence_deg, azimuth_deg, _ = scene.values()
    bend = tuple(math.radians(part) for part in scene.bend_deg_per_px)
    vergence = 0.0 if scene.focal_px is None else 1 / scene.focal_px
    return Pane(plane_normal(incidence_deg, azimuth_deg), bend, vergence)


def scene_angles(scene: SceneParameters, x: Plane, y: Plane) -> tuple[Plane, Plane, Plane]:
    """What `viewing_angles` gives for a complete scene."""
    return scene_pane(scene).angles(x, y)


def incidence_trace(normal: Any, vergence: Any, x: Any, y: Any) -> tuple[Any, Any]:
    """Trace of the plane of incidence on the image, (x, y) of the length that the normal has across the line of sight.

    Linear in the normal; parameters as for `viewing_angles`.
    """
    n_x, n_y, n_z = normal
    x, y = x * vergence, y * vergence
    squared = x * x + y * y + 1
    along = n_x * x + n_y * y + n_z
    return n_x - along * x / squared, n_y - along * y / squared


def twice_the_azimuth(w_x: Any, w_y: Any) -> tuple[Any, Any]:
    """Cosine and sine of twice the azimuth of a trace, as `incidence_trace` gives it; numbers real and complex."""
    # Where the pane is seen frontally there is no plane of incidence.
    energy = w_x * w_x + w_y * w_y + _NEVER_ZERO
    return (w_x * w_x - w_y * w_y) / energy, 2 * w_x * w_y / energy


def viewing_angles(normal: Any, vergence: Any, x: Any, y: Any) -> tuple[Any, Any, Any]:
    """Cosine of the incidence, and cosine and sine of twice the azimuth, for pixels x to the right and y up.

    Plain arithmetic: numbers and arrays, real and complex.

    Parameters
    ----------
    normal : (n_x, n_y, n_z)
        Of any length.
    vergence : scalar
        One over the focal length in pixels; 0 for a pane that is seen from far.
    x, y : scalar or array
        From the principal point, in pixels.
    """
    n_x, n_y, n_z = normal
    double = twice_the_azimuth(*incidence_trace(normal, vergence, x, y))
    x, y = x * vergence, y * vergence
    squared = x * x + y * y + 1
    along = n_x * x + n_y * y + n_z
    cosine = along / (squared * (n_x * n_x + n_y * n_y + n_z * n_z)) ** 0.5
    return (cosine * cosine) ** 0.5, *double
