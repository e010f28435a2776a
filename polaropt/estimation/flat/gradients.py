"""Which directions the layers take in what is seen, as the gradients in small windows tell, and the incidence by them.

The strength of edges varies over the frame in each layer for itself. So of two coordinates of what is seen in a pixel
the gradients in a small window have the covariance ``P a a' + Q b b' + noise``, P and Q of each window its own, and the
layers' directions a and b are those of greatest likelihood. Where the noise leaves the mirrored scene to be seen they
tell the incidence of a flat pane twice as exactly as the least overlap of edges does.

References
----------
D. T. Pham, J.-F. Cardoso, Blind separation of instantaneous mixtures of nonstationary sources, IEEE TSP, 2001.
"""

from __future__ import annotations

import math
from functools import partial
from itertools import product

import numpy as np
from numpy.typing import NDArray

from polaropt.capture import PlateFrame
from polaropt.estimation.flat.ghost_overlap import HALF, SIDE, images_with_ghosts_in_place, without_borders
from polaropt.estimation.flat.overlap import MOST_NOISE, noise_of_mirrored
from polaropt.numerics import Box, block_mean, block_shares, local_minimum, middle_part
from polaropt.optics import INCIDENCE_LIMITS_DEG, INCIDENCE_SEARCH_DEG, SceneParameters, in_place_weights

Images = NDArray[np.float32]
Values = NDArray[np.float64]

MOST_BLOCKS = 64
"""Blocks along the longer side whose gradients are looked at, at most. Set by hand."""
FREEDOM = 4.0
"""Degrees of freedom of Student's likelihood: what the model does not fit must not decide. Set by hand."""
# Share of a block's pixels that are not clipped from which on it is whole: all, but for rounding.
_WHOLE = 0.999
# Share of the blocks below which those with clipped pixels must do, too. Set by hand.
_LEAST_SEEN = 0.05
WINDOW = 3
"""Side of a window in blocks. Set by hand."""
LEAST_SHOWN = 10.0
"""Power of a window's gradients, both coordinates together and beyond the noise, in units of a gradient's noise, from
which on it tells a pane's incidence. Where one layer has none, two directions fit the other's and the noise the better
the farther apart they are. Of 18 panes before half a sky (training photographs) all lie within 1.8 degrees where
without it one was off by 2.8, and no wrong index gains more than 3.1 (10.9); before 50 pairs of these photographs the
incidence is off by 0.15 to 0.20 degrees, root mean square (0.22). 6 and 15 do as well."""
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
_NO_LINE = 1e-9
"""Share of the product of two variances that is left where gradients do not all lie in one direction; set by hand."""


class GradientWindows:
    """Second moments of the gradients of two coordinates in small windows.

    In every window the gradients of two layers are Gaussian with variances of their own, and independent.

    Parameters
    ----------
    coordinates : ndarray of float32, shape (2, channel, h, w)
        Block means with noise of unit variance.
    seen : ndarray of bool, shape (channel, h, w)
    least_shown : float
        Power of a window's gradients, both coordinates together and beyond the noise, in units of a gradient's, from
        which on it tells something. Default: all do.
    """

    def __init__(self, coordinates: Images, seen: NDArray[np.bool_], least_shown: float = -math.inf) -> None:
        x, y, known = gradients_of(coordinates, seen)
        # A gradient's noise has twice the variance of a pixel's.
        products = [0.5 * known * np.mean(a * b, axis=(0, 1)) for a, b in ((x, x), (x, y), (y, y))]
        pooled = block_mean(np.stack([*products, known]).astype(np.float32), WINDOW).reshape(4, -1)
        pooled = pooled[:, pooled[3] > 0].astype(np.float64)
        self._moments: Values = pooled[:3] / pooled[3]
        shown = self._moments[0] + self._moments[2] - 2
        self._count: Values = 2 * len(seen) * WINDOW**2 * pooled[3] * (shown > least_shown)
        # Where hardly anything is seen no window tells anything: all directions cost the same.
        self._total = float(self._count.sum()) or 1.0
        (xx, xy, yy) = self._moments @ self._count / self._total
        # As of a single gradient, or of none.
        degenerate = not xx * yy - xy**2 > _NO_LINE * xx * yy
        self._spread = np.eye(2) if degenerate else np.linalg.cholesky(np.array([[xx, xy], [xy, yy]]))

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


def seen_blocks(shares: Images) -> NDArray[np.bool_]:
    """Blocks without clipped pixels, from the shares of those that are not; all where these are too few."""
    whole = np.asarray(shares > _WHOLE)
    return whole if whole.mean() > _LEAST_SEEN else np.ones_like(whole)


_STEP_DEG, _TOLERANCE_DEG, _FARTHEST_DEG = 0.5, 0.02, 8.0
"""First step, accuracy and reach of the search for the incidence. Set by hand."""
_BESIDE_DEG = 0.3
"""Beside the incidence found: where the likelihood is looked at for its standard error. Set by hand."""
_LEAST_ERROR_DEG = 0.05
"""Standard error that the curvature does not tell, set by hand: with it 90 % of 110 scenes at 40 to 84 degrees,
of photographs that no figure is taken of, lie within two errors."""
_ROUNDS, _AT_REST_DEG = 3, 0.05
"""In which ghosts are brought into place as they are at the last incidence, and the change that ends them. By hand."""


def whitened_means(frame: PlateFrame, scene: SceneParameters) -> tuple[Values, Images, NDArray[np.bool_]]:
    """Block means of what is seen along and across the plane of incidence, as coordinates with noise of unit variance.

    Parameters
    ----------
    frame : PlateFrame
        At the azimuth of the scene.
    scene : SceneParameters
        Complete. Its ghosts are brought into place.

    Returns
    -------
    whitening : ndarray, shape (2, 2)
        Makes coordinates of what is seen.
    means : ndarray of float32, shape (2, channel, h, w)
    seen : ndarray of bool, shape (channel, h, w)
    """
    part = (..., *middle_part(frame.images.shape, SIDE))
    # Of a frame with ghosts the images are half as large.
    half = HALF if scene.has_ghosts else 1
    images = images_with_ghosts_in_place(frame, scene) if scene.has_ghosts else np.asarray(frame.images[part])
    shares = without_borders(block_shares(frame.valid[part], HALF)) if scene.has_ghosts else frame.valid[part]
    size = max(1, math.ceil(max(images.shape[-2:]) / MOST_BLOCKS))
    whitening = np.linalg.inv(np.linalg.cholesky(frame.covariance)) * (size * half)
    means = np.einsum("ij,jchw->ichw", whitening, block_mean(images, size)).astype(np.float32)
    return whitening, means, seen_blocks(block_mean(shares.astype(np.float32), size))


def gradients_of(coordinates: Images, seen: NDArray[np.bool_]) -> tuple[Images, Images, NDArray[np.bool_]]:
    """Gradients (2, channel, h - 1, w - 1), down and along the rows, of either coordinate, and where all are seen."""
    corner = coordinates[..., :-1, :-1]
    x, y = np.stack([coordinates[..., 1:, :-1] - corner, coordinates[..., :-1, 1:] - corner], axis=1)
    return x, y, np.asarray((seen[..., :-1, :-1] & seen[..., 1:, :-1] & seen[..., :-1, 1:]).all(axis=0))


class PaneGradients:
    """How likely incidences of a flat pane are, given the gradients of what is seen in small windows.

    Parameters
    ----------
    frame : PlateFrame
        At the azimuth of the scene.
    scene : SceneParameters
        Complete. Its ghosts are brought into place as they would be before it.
    """

    def __init__(self, frame: PlateFrame, scene: SceneParameters) -> None:
        self._whitening, means, seen = whitened_means(frame, scene)
        self._windows, self._scene = GradientWindows(means, seen, LEAST_SHOWN), scene

    def cost(self, incidence_deg: float, refractive_index: float | None = None) -> float:
        """Minus log likelihood of an incidence and an index, of gradients that tell for themselves; less a constant."""
        scene = self._scene
        cosine, index = np.array([math.cos(math.radians(incidence_deg))]), refractive_index or scene.index
        entries = [layer[:2, 0] for layer in in_place_weights(cosine, index, *scene.sheets)]
        x, y = self._whitening @ np.stack(entries, axis=1)
        first, second = np.arctan2(y, x)
        return self._windows.certainty * float(self._windows.cost(float(first), float(second))[0])

    def nearest(self, incidence_deg: float, refractive_index: float | None = None) -> float:
        """The likeliest incidence near one, in degrees."""
        low, high = INCIDENCE_SEARCH_DEG
        bounds = (max(low, incidence_deg - _FARTHEST_DEG), min(high, incidence_deg + _FARTHEST_DEG))
        cost = partial(self.cost, refractive_index=refractive_index)
        return local_minimum(cost, incidence_deg, bounds, _STEP_DEG, _TOLERANCE_DEG)

    def likeliest(self, incidence_deg: float) -> tuple[float, float]:
        """The same with its standard error, infinite where nothing tells it; degrees."""
        best = self.nearest(incidence_deg)
        step = min(_BESIDE_DEG, (INCIDENCE_LIMITS_DEG[1] - best) / 2)
        before, here, after = (self.cost(best + move) for move in (-step, 0.0, step))
        curvature = (before + after - 2 * here) / step**2
        return best, 1 / math.sqrt(curvature) if curvature > 0 else math.inf


def incidence_by_gradients(frame: PlateFrame, scene: SceneParameters) -> tuple[float, float] | None:
    """The incidence near that of a complete scene that gradients tell, and its standard error, both in degrees.

    None where noise drowns what is mirrored.

    Parameters
    ----------
    frame : PlateFrame
        At the azimuth of the scene.
    scene : SceneParameters
        Of a flat pane, or of several, that is seen from far, before unpolarized light.
    """
    if noise_of_mirrored(frame, scene) > MOST_NOISE:
        return None
    for _ in range(_ROUNDS if scene.has_ghosts else 1):
        before = scene.values()[0]
        incidence, error = PaneGradients(frame, scene).likeliest(before)
        scene = scene.replace(incidence_deg=incidence)
        if abs(incidence - before) < _AT_REST_DEG:
            break
    return None if error == math.inf else (incidence, math.hypot(error, _LEAST_ERROR_DEG))
