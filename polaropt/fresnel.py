"""Fresnel's formulas for one interface, as the three diagonal Mueller entries in the plate's frame.

Frame: x' lies in the plane of incidence. In the basis (I_par, I_perp, s2') reflection and transmission are diagonal;
the entries are (R_p, R_s, r_p r_s) and (T_p, T_s, sqrt(T_p T_s)). From inside the glass they are the same.
"""

from __future__ import annotations

import math
from typing import NamedTuple

Entries = tuple[float, float, float]


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
    cos_i = math.cos(math.radians(incidence_deg))
    cos_t = math.cos(refraction_angle(incidence_deg, refractive_index))
    n = refractive_index
    return (n * cos_i - cos_t) / (n * cos_i + cos_t), (cos_i - n * cos_t) / (cos_i + n * cos_t)


def refraction_angle(incidence_deg: float, refractive_index: float) -> float:
    """Angle of the refracted ray in radians, by Snell's law."""
    return math.asin(math.sin(math.radians(incidence_deg)) / refractive_index)


def interface(incidence_deg: float, refractive_index: float) -> Interface:
    """Reflection and transmission entries of one interface (arguments as for `amplitudes`)."""
    r_p, r_s = amplitudes(incidence_deg, refractive_index)
    reflectance_p, reflectance_s = r_p * r_p, r_s * r_s
    transmittance_p, transmittance_s = 1 - reflectance_p, 1 - reflectance_s
    return Interface(
        (reflectance_p, reflectance_s, r_p * r_s),
        (transmittance_p, transmittance_s, math.sqrt(transmittance_p * transmittance_s)),
    )


def brewster_angle_deg(refractive_index: float) -> float:
    """Incidence at which the parallel reflection vanishes, in degrees."""
    return math.degrees(math.atan(refractive_index))
