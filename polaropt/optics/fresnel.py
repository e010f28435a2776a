"""Fresnel's formulas for one interface, as the three diagonal Mueller entries in the plate's frame.

Frame: x' lies in the plane of incidence. In the basis (I_par, I_perp, s2') reflection and transmission are diagonal;
the entries are (R_p, R_s, r_p r_s) and (T_p, T_s, sqrt(T_p T_s)). From inside the glass they are the same.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

Entries = tuple[float, float, float]
Cosines = NDArray[np.float64]


class Interface(NamedTuple):
    """Diagonal Mueller entries (par, perp, s2') of one dielectric interface."""

    reflection: Entries
    transmission: Entries


def amplitudes(incidence_deg: float, refractive_index: float) -> tuple[float, float]:
    """Amplitude reflection coefficients of an interface from air into a medium.

    Parameters
    ----------
    incidence_deg : float
        Angle of incidence in degrees, 0 <= incidence_deg < 90.
    refractive_index : float
        Index of the medium relative to air, >= 1.

    Returns
    -------
    r_p, r_s : float
        Parallel and perpendicular coefficients, in the sign convention in which ``r_p r_s < 0`` below
        Brewster's angle.

    References
    ----------
    E. Collett, Field Guide to Polarization, SPIE, 2005.
    """
    return _amplitudes(*_cosines(incidence_deg, refractive_index), refractive_index)


def refraction_angle(incidence_deg: float, refractive_index: float) -> float:
    """Angle of the refracted ray in radians, by Snell's law."""
    _, inside = _cosines(incidence_deg, refractive_index)
    return math.atan2(math.sin(math.radians(incidence_deg)), inside)


def interface(incidence_deg: float, refractive_index: float) -> Interface:
    """Reflection and transmission entries of one interface (arguments as for `amplitudes`)."""
    outside, inside = _cosines(incidence_deg, refractive_index)
    r_p, r_s = _amplitudes(outside, inside, refractive_index)
    transmittance_p, transmittance_s = _transmittances(outside, inside, refractive_index)
    return Interface(
        (r_p * r_p, r_s * r_s, r_p * r_s),
        (transmittance_p, transmittance_s, math.sqrt(transmittance_p * transmittance_s)),
    )


def interface_images(cosine: Cosines, refractive_index: float) -> tuple[Cosines, Cosines]:
    """Reflection and transmission entries (3, ...) of one interface for an array of cosines of the incidence."""
    inside = np.sqrt((refractive_index - 1) * (refractive_index + 1) + cosine * cosine)
    r_p, r_s = _amplitudes(cosine, inside, refractive_index)
    t_p, t_s = _transmittances(cosine, inside, refractive_index)
    return np.stack([r_p * r_p, r_s * r_s, r_p * r_s]), np.stack([t_p, t_s, np.sqrt(t_p * t_s)])


def _cosines(incidence_deg: float, refractive_index: float) -> tuple[float, float]:
    """``cos(theta)`` and ``n cos(theta_t)``, the latter without the sine, which says little at grazing incidence."""
    outside = math.cos(math.radians(incidence_deg))
    return outside, math.sqrt((refractive_index - 1) * (refractive_index + 1) + outside * outside)


def _amplitudes(outside: Any, inside: Any, refractive_index: float) -> tuple[Any, Any]:
    square = refractive_index**2
    return (square * outside - inside) / (square * outside + inside), (outside - inside) / (outside + inside)


def _transmittances(outside: Any, inside: Any, refractive_index: float) -> tuple[Any, Any]:
    """1 - R, in the form that keeps its precision at grazing incidence."""
    square = refractive_index**2
    return (
        4 * square * outside * inside / (square * outside + inside) ** 2,
        4 * outside * inside / (outside + inside) ** 2,
    )


def brewster_angle_deg(refractive_index: float) -> float:
    """Incidence at which the parallel reflection vanishes, in degrees."""
    return math.degrees(math.atan(refractive_index))
