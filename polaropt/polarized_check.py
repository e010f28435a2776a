"""Whether a capture's layers look polarized, told by its edges: cheap enough to be asked of every capture.

Light that arrives polarized along or across the plane of incidence leaves none at 45 degrees to it, and mimics a pane
at another incidence. But the directions in which edges say that the layers lie are then not those of any pane.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from polaropt.parabola import local_minimum
from polaropt.plate_frame import StokesImages
from polaropt.polarized_light import in_place, pane_light
from polaropt.polarized_mixing import Mixture
from polaropt.scene import SceneParameters
from polaropt.stokes import frame_matrix

Values = NDArray[np.float64]

_INCIDENCES_DEG = tuple(float(x) for x in range(4, 89, 3))
_BOUNDS_DEG, _STEP_DEG, _TOLERANCE_DEG = (0.5, 89.0), 1.5, 0.2
_LEAST_GAIN = 0.012
"""What polarized layers must gain in minus log likelihood per gradient."""
_GAIN_OF_GHOSTS, _STRONG_GHOSTS_DEG = 0.13, 65.0
"""What strong ghosts, which are not in place, gain."""
_OBLIQUE_DEG = 30.0
"""Closer to normal incidence hardly anything tells the layers' directions apart."""


def polarization_gain(stokes: StokesImages, scene: SceneParameters) -> float:
    """How much likelier, per gradient, the likeliest layers are than those of any pane before unpolarized light.

    Parameters
    ----------
    stokes : StokesImages
    scene : SceneParameters
        Its azimuth, or that across, is the pane's; index and surfaces are used.

    Returns
    -------
    float
        0 where the view is too steep to tell.
    """
    mixture, azimuth = Mixture(stokes), scene.values()[1]
    cost, incidence = min(_nearest_pane(mixture, azimuth + turn, scene) for turn in (0, 90))
    return cost - mixture.cost(mixture.vectors()) if incidence > _OBLIQUE_DEG else 0.0


def _nearest_pane(mixture: Mixture, azimuth_deg: float, scene: SceneParameters) -> tuple[float, float]:
    """Least cost of a pane before unpolarized light, and its incidence."""

    def cost(incidence_deg: float) -> float:
        return mixture.cost(_shown(incidence_deg, azimuth_deg, scene))

    start = min(_INCIDENCES_DEG, key=cost)
    nearest = local_minimum(cost, start, _BOUNDS_DEG, _STEP_DEG, _TOLERANCE_DEG)
    return cost(nearest), nearest


def looks_polarized(stokes: StokesImages, scene: SceneParameters) -> bool:
    """Whether the layers' light looks polarized, even where the plain pane leaves none at 45 degrees to its plane.

    Parameters
    ----------
    stokes : StokesImages
    scene : SceneParameters
        The plain pane that explains the capture best.
    """
    gain = polarization_gain(stokes, scene)
    strong = scene.has_ghosts and scene.values()[0] > _STRONG_GHOSTS_DEG
    return gain > (_GAIN_OF_GHOSTS if strong else _LEAST_GAIN)


def _shown(incidence_deg: float, azimuth_deg: float, scene: SceneParameters) -> Values:
    """Stokes vectors (2, 3) that unpolarized layers show in place."""
    entries = in_place(pane_light(incidence_deg, scene)) * [0.5, 0.5, 0.0]
    return np.asarray(entries @ np.linalg.inv(frame_matrix(azimuth_deg)).T)
