"""What the two layers show in a pixel's Stokes vector, and whether they look polarized.

Behind a flat pane every pixel is ``S = m_t t + m_r r`` with two constant vectors, however the layers' light is
polarized: the cloud of all pixels lies in a plane through the origin. Where in it the two vectors point is told by the
edges, whose strength varies over the frame in each layer for itself: in every small window the gradients are Gaussian
with the covariance ``P m_t m_t' + Q m_r m_r' + noise``, P and Q its own. The vectors are those of greatest likelihood.

References
----------
D. T. Pham, J.-F. Cardoso, Blind separation of instantaneous mixtures of nonstationary sources, IEEE TSP, 2001.

Light that arrives polarized along or across the plane of incidence leaves none at 45 degrees to it, and mimics a pane
at another incidence. But the directions in which edges say that the layers lie are then not those of any pane.
"""

from __future__ import annotations

import math
from itertools import product

import numpy as np
from numpy.typing import NDArray

from polaropt.capture import StokesImages
from polaropt.estimation.flat.gradients import MOST_BLOCKS, GradientWindows, seen_blocks
from polaropt.estimation.polarized.light import HIGHEST_DEGREE, in_place, pane_light
from polaropt.numerics import local_minimum
from polaropt.optics import INCIDENCE_SEARCH_DEG, SceneParameters, frame_matrix

Images = NDArray[np.float32]
Values = NDArray[np.float64]

# Least half width (rad) of the range of directions that light can have. Set by hand.
_LEAST_WIDTH = np.radians(2.0)
_FARTHEST, _SPREAD, _FIRST_REACH, _REACHES = 3.0, 9, 5e-4, 14
"""Minus log likelihood up to which directions count, how many are looked at on either axis; first reach (rad) from the
likeliest, and how often it is doubled at most. Set by hand."""


class Mixture:
    """The plane of a capture's Stokes vectors, and how likely two directions in it are those of its layers.

    Parameters
    ----------
    stokes : StokesImages

    Attributes
    ----------
    misfit : float
        Mean square of block means off the plane, in units of the noise: 1 where the layers' light, and the pane, are
        the same all over the frame and its ghosts in place.
    """

    def __init__(self, stokes: StokesImages) -> None:
        size = max(1, math.ceil(max(stokes.images.shape[-2:]) / MOST_BLOCKS))
        self._unwhiten = np.linalg.cholesky(stokes.covariance * (stokes.block_noise(size) / size) ** 2)
        means = stokes.means(size).reshape(3, -1).astype(np.float64)
        white = np.linalg.solve(self._unwhiten, means)
        seen = seen_blocks(stokes.shares(size))
        known = white[:, seen.ravel()]
        self._scatter = known @ known.T / known.shape[1]
        scatter, axes = np.linalg.eigh(self._scatter)
        self._plane, self.misfit = axes[:, :0:-1], float(scatter[0])
        self._windows = GradientWindows((self._plane.T @ white).reshape(2, *seen.shape).astype(np.float32), seen)

    def vectors(self) -> Values:
        """The likeliest Stokes vectors (2, 3), s0 = 1."""
        return self.likely_vectors()[0]

    def likely_vectors(self) -> list[Values]:
        """The likeliest Stokes vectors, and others that are likelier than all like them: ghosts disturb edges."""
        pairs = self._windows.directions(self._possible())
        return [np.stack([self._vector(angle) for angle in pair]) for pair in pairs]

    def spread(self) -> tuple[Values, Values]:
        """Pairs of Stokes vectors (n, 2, 3) about the likeliest, and the chance of each (n,), 1 together."""
        possible = self._possible()
        middle = sum(possible) / 2 - math.pi / 2
        # A direction's sign says nothing.
        best = [middle + (angle - middle) % math.pi for angle in self._windows.directions(possible)[0]]
        best = [float(np.clip(angle, *possible)) for angle in best]
        least = float(self._windows.cost(*best)[0])
        axes = []
        for i in (0, 1):
            low, high = (self._reach(best, i, sign, possible, least) for sign in (-1.0, 1.0))
            axes.append(np.linspace(low, high, _SPREAD))
        costs = np.array([self._windows.cost(float(angle), axes[1]) for angle in axes[0]])
        chances = np.exp(-self._windows.certainty * (costs - costs.min())).ravel()
        pairs = [np.stack([self._vector(float(angle)) for angle in pair]) for pair in product(*axes)]
        return np.stack(pairs), chances / chances.sum()

    def _reach(self, best: list[float], which: int, sign: float, possible: tuple[float, float], least: float) -> float:
        """The angle farthest from the best one to one side that light can have and edges do not speak against."""
        reach = _FIRST_REACH
        certainty = self._windows.certainty
        for _ in range(_REACHES):
            pair = list(best)
            pair[which] += sign * reach
            if not possible[0] <= pair[which] <= possible[1]:
                break
            if certainty * (float(self._windows.cost(*pair)[0]) - least) > _FARTHEST:
                break
            reach *= 2
        return float(np.clip(best[which] + sign * reach, *possible))

    def cost(self, vectors: Values) -> float:
        """Minus twice the log likelihood per gradient of two Stokes vectors (2, 3): in their plane, and that it is."""
        first, second = np.linalg.solve(self._unwhiten, vectors.T).T
        across = np.cross(first, second)
        off = float(across @ self._scatter @ across / max(float(across @ across), 1e-30))
        x, y = self._plane.T @ np.stack([first, second], axis=1)
        angles = np.arctan2(y, x)
        return float(self._windows.cost(float(angles[0]), float(angles[1]))[0]) + 0.5 * (off - self.misfit)

    def _possible(self) -> tuple[float, float]:
        """First and last (rad) of the directions in the plane that light can have.

        There ``s0^2 - s1^2 - s2^2``, a quadratic form of the direction, is not negative.
        """
        axes = self._unwhiten @ self._plane
        form = axes.T @ np.diag([HIGHEST_DEGREE**2, -1.0, -1.0]) @ axes
        mean, along, across = (form[0, 0] + form[1, 1]) / 2, (form[0, 0] - form[1, 1]) / 2, form[0, 1]
        swing = max(math.hypot(along, across), 1e-30)
        middle, width = math.atan2(across, along) / 2, math.acos(min(1.0, max(-1.0, -mean / swing))) / 2
        width = max(width, _LEAST_WIDTH)
        return middle - width, middle + width

    def _vector(self, angle: float) -> Values:
        """With intensity 1, and no more polarized than light can be."""
        vector = self._unwhiten @ self._plane @ [math.cos(angle), math.sin(angle)]
        vector = vector * np.sign(vector[0] or 1.0) / max(abs(float(vector[0])), 1e-12)
        degree = float(np.hypot(vector[1], vector[2]))
        vector[1:] *= min(1.0, HIGHEST_DEGREE / max(degree, 1e-12))
        return np.asarray(vector)


_INCIDENCES_DEG = tuple(float(x) for x in range(4, 89, 3))
"""Incidences of which the likeliest begins the search for the nearest pane. Set by hand."""
_BOUNDS_DEG = (INCIDENCE_SEARCH_DEG[0], 89.0)
"""Where it ends. Polarized layers are compared with any pane at all before unpolarized light, and must not gain by a
bound: so it lies beyond what is searched for a pane. Set by hand."""
_STEP_DEG, _TOLERANCE_DEG = 1.5, 0.2
"""First step and accuracy of that search. Set by hand."""
_LEAST_GAIN = 0.012
"""What polarized layers must gain in minus log likelihood per gradient. By trial."""
_GAIN_OF_GHOSTS, _STRONG_GHOSTS_DEG = 0.13, 65.0
"""What strong ghosts, which are not in place, gain in the same unit, and the incidence where they are strong. By
trial."""
OBLIQUE_DEG = 30.0
"""Closer to normal incidence hardly anything tells the layers' directions apart. Set by hand."""


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
    return cost - mixture.cost(mixture.vectors()) if incidence > OBLIQUE_DEG else 0.0


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
