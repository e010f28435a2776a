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
from polaropt.estimation.polarized.kernels import FREEDOM
from polaropt.estimation.polarized.light import HIGHEST_DEGREE, in_place, pane_light
from polaropt.estimation.wide.blocks import LEAST_SEEN, WHOLE
from polaropt.numerics import Box, block_mean, local_minimum
from polaropt.optics import INCIDENCE_SEARCH_DEG, SceneParameters, frame_matrix

Images = NDArray[np.float32]
Values = NDArray[np.float64]

# Blocks along the longer side, at most, and side of a window in blocks. Set by hand.
_BLOCKS, _WINDOW = 64, 3
# Directions over half a turn, of which each pair is tried. Set by hand.
_DIRECTIONS = 36
# Least squared sine between two directions (0.6 degrees), which is divided by. Set by hand.
_LEAST_APART = 1e-4
# From the best pair: first step in radians, and evaluations at most. Set by hand.
_STEP, _EVALUATIONS = np.radians(2.0), 60
# Pairs that are each likelier than their neighbours, at most. Set by hand.
_PAIRS = 2
_INDEPENDENT = 0.025
"""Share of the gradients that tell for themselves. Measured on 32 random scenes in place: minus log likelihood of the
true directions is then 0.7 more than of the likeliest, where 1 is the mean for two numbers."""
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
        size = max(1, math.ceil(max(stokes.images.shape[-2:]) / _BLOCKS))
        self._unwhiten = np.linalg.cholesky(stokes.covariance * (stokes.block_noise(size) / size) ** 2)
        means = stokes.means(size).reshape(3, -1).astype(np.float64)
        white = np.linalg.solve(self._unwhiten, means)
        seen = _seen(stokes, size)
        known = white[:, seen.ravel()]
        self._scatter = known @ known.T / known.shape[1]
        scatter, axes = np.linalg.eigh(self._scatter)
        self._plane, self.misfit = axes[:, :0:-1], float(scatter[0])
        self._windows = Windows((self._plane.T @ white).reshape(2, *seen.shape).astype(np.float32), seen)

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
        width = max(width, _STEP)
        return middle - width, middle + width

    def _vector(self, angle: float) -> Values:
        """With intensity 1, and no more polarized than light can be."""
        vector = self._unwhiten @ self._plane @ [math.cos(angle), math.sin(angle)]
        vector = vector * np.sign(vector[0] or 1.0) / max(abs(float(vector[0])), 1e-12)
        degree = float(np.hypot(vector[1], vector[2]))
        vector[1:] *= min(1.0, HIGHEST_DEGREE / max(degree, 1e-12))
        return np.asarray(vector)


class Windows:
    """Second moments of the gradients of two coordinates in small windows.

    Parameters
    ----------
    coordinates : ndarray of float32, shape (2, channel, h, w)
        Block means with noise of unit variance.
    seen : ndarray of bool, shape (channel, h, w)
    """

    def __init__(self, coordinates: Images, seen: NDArray[np.bool_]) -> None:
        corner = coordinates[..., :-1, :-1]
        x, y = np.stack([coordinates[..., 1:, :-1] - corner, coordinates[..., :-1, 1:] - corner], axis=1)
        known = (seen[..., :-1, :-1] & seen[..., 1:, :-1] & seen[..., :-1, 1:]).all(axis=0)
        # A gradient's noise has twice the variance of a pixel's.
        products = [0.5 * known * np.mean(a * b, axis=(0, 1)) for a, b in ((x, x), (x, y), (y, y))]
        pooled = block_mean(np.stack([*products, known]).astype(np.float32), _WINDOW).reshape(4, -1)
        pooled = pooled[:, pooled[3] > 0].astype(np.float64)
        self._moments: Values = pooled[:3] / pooled[3]
        self._count: Values = 2 * len(seen) * _WINDOW**2 * pooled[3]
        # Where hardly anything is seen no window tells anything: all directions cost the same.
        self._total = float(self._count.sum()) or 1.0
        (xx, xy, yy) = self._moments @ self._count / self._total
        self._spread = np.linalg.cholesky(np.array([[xx, xy], [xy, yy]])) if pooled.size else np.eye(2)

    @property
    def certainty(self) -> float:
        """Minus log likelihood, of gradients that tell for themselves, for 1 of the cost."""
        return _INDEPENDENT * float(self._count.sum())

    def cost(self, first: float, second: float | Values) -> Values:
        """Minus log likelihood per gradient of two directions (rad), for one or several of the second."""
        second = np.atleast_1d(second)[:, None]
        xx, xy, yy = self._moments
        cos, sin = math.cos(first), math.sin(first)
        b_cos, b_sin = np.cos(second), np.sin(second)
        apart = np.maximum(np.sin(second - first) ** 2, _LEAST_APART)
        # What is left across one layer's direction is the other's, and noise.
        p = np.maximum(b_sin**2 * xx - 2 * b_sin * b_cos * xy + b_cos**2 * yy - 1, 0) / apart
        q = np.maximum(sin**2 * xx - 2 * sin * cos * xy + cos**2 * yy - 1, 0) / apart
        c_xx, c_yy = p * cos**2 + q * b_cos**2 + 1, p * sin**2 + q * b_sin**2 + 1
        c_xy = p * cos * sin + q * b_cos * b_sin
        det = c_xx * c_yy - c_xy**2
        distance = self._count * (c_yy * xx - 2 * c_xy * xy + c_xx * yy) / det
        value = self._count * np.log(det) + (FREEDOM + 2 * self._count) * np.log(FREEDOM + distance)
        return np.asarray(value.sum(axis=1) / self._total)

    def directions(self, possible: tuple[float, float]) -> list[tuple[float, float]]:
        """Angles (rad) of the likeliest pairs of directions, the best first, each likelier than its neighbours.

        They are looked for where the cloud of gradients is round: uncorrelated layers are at right angles there.

        Parameters
        ----------
        possible : (float, float)
            First and last (rad) of those that light can have.
        """
        first, last = self._rounded(np.array(possible))
        last = first + (last - first) % (2 * np.pi)
        round_angles = np.linspace(first, last, _DIRECTIONS)
        angle = self._unrounded(round_angles)
        costs = np.full((_DIRECTIONS + 2, _DIRECTIONS + 2), np.inf)
        for i in range(1, _DIRECTIONS):
            costs[i + 1, 1 : i + 1] = self.cost(float(angle[i]), angle[:i])

        def cost(x: Values) -> float:
            return float(self.cost(*self._unrounded(x))[0])

        inner = costs[1:-1, 1:-1]
        around = [
            costs[1 + i : _DIRECTIONS + 1 + i, 1 + j : _DIRECTIONS + 1 + j] for i, j in product((-1, 0, 1), repeat=2)
        ]
        valleys = np.argwhere((inner <= np.min(around, axis=0)) & np.isfinite(inner))
        valleys = valleys[np.argsort(inner[tuple(valleys.T)])][:_PAIRS]
        ends = np.full(2, first), np.full(2, last)
        found = [Box(round_angles[valley], np.full(2, _STEP), *ends).minimum(cost, _EVALUATIONS) for valley in valleys]
        found.sort(key=cost)
        return [(float(one), float(other)) for one, other in map(self._unrounded, found)]

    def _rounded(self, angle: Values) -> Values:
        """Angles in coordinates in which the cloud is round."""
        x, y = np.linalg.solve(self._spread, np.stack([np.cos(angle), np.sin(angle)]))
        return np.asarray(np.arctan2(y, x))

    def _unrounded(self, angle: Values) -> Values:
        """Angles of directions from those in coordinates in which the cloud is round."""
        x, y = self._spread @ np.stack([np.cos(angle), np.sin(angle)])
        return np.asarray(np.arctan2(y, x))


def _seen(stokes: StokesImages, size: int) -> NDArray[np.bool_]:
    """Blocks (channel, h, w) without clipped pixels; all where these are too few."""
    whole = stokes.shares(size) > WHOLE
    return whole if whole.mean() > LEAST_SEEN else np.ones_like(whole)


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
