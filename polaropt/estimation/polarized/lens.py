"""A flat pane before a lens, with polarized light behind it or in the mirrored scene.

In every block the light of two layers lies in the plane of the two Stokes vectors that they show; what lies off it is
noise, see `polarized_mixing`. Before a lens the pane turns this plane over the frame: so it alone tells pane, lens and
the polarization of both layers' light, and edges need not be asked. Ghosts are taken to lie in place.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import NDArray

from polaropt.capture import StokesImages
from polaropt.estimation.polarized.light import MOST_ANGLE_ERROR_DEG, MOST_DEGREE_ERROR
from polaropt.estimation.wide.blocks import COARSE_BLOCKS, SCATTERS, PolarizedBlocks
from polaropt.estimation.wide.pane import (
    AZIMUTH,
    FRONTAL,
    INCIDENCE,
    LONGEST,
    SHORTEST,
    STEEPEST,
    USUAL_VIEW,
    VIEW,
    normal_at,
)
from polaropt.optics import (
    SceneErrors,
    SceneParameters,
    dolp_aolp,
    in_place_weights,
    shown_stokes,
    stokes_vector,
    viewing_angles,
)

if TYPE_CHECKING:
    from scipy.optimize import OptimizeResult


Values = NDArray[np.float64]
Numbers = tuple[int, ...]

_BEHIND, _MIRRORED = (3, 4), (5, 6)
"""Of a point: after incidence and azimuth (rad) and half the longer side over the focal length, for each layer's light
degree times cosine and sine of twice the angle of its polarization, in the camera's frame."""
# Where the search begins: incidence and azimuth of the pane, angle and degree of one layer's polarization. By hand.
_INCIDENCES_DEG, _AZIMUTHS_DEG, _ANGLES_DEG = (35.0, 50.0, 65.0), tuple(range(0, 360, 30)), (0.0, 45.0, 90.0, 135.0)
_DEGREE = 0.4
# Azimuths, the best start of each, that are followed from there. Set by hand.
_N_STARTS = 8
# A usual step of each number of a point: radians, half a side per focal length, degrees of polarization. Set by hand.
_SCALE = np.array([0.2, 0.2, 0.1, 0.2, 0.2, 0.2, 0.2])
# Bounds of a point in the same units: azimuth free to turn, degree of polarization (each of its parts) at most 1.
_LOW = np.array([FRONTAL, -4 * math.pi, 0.5 / LONGEST, *4 * [-1.0]])
_HIGH = np.array([STEEPEST, 4 * math.pi, 0.5 / SHORTEST, *4 * [1.0]])
# Least cosine of the incidence in a block (89.94 degrees): a trial pane may be seen from behind there. Set by hand.
_GRAZING = 1e-3
# Evaluations of all derivatives, from each start and from the best ones. Set by hand.
_ROUGHLY, _CLOSELY = 25, 40
# Light off the plane, in standard deviations of the noise, from which on a block counts less while starts are compared
# (soft L1); and how far inside its bounds a fit begins, in a point's units. Both set by hand.
_OUTLYING, _INSIDE = 3.0, 1e-9
# Of derivatives by differences, beside 1 or a point's number: the root of what rounding leaves, as scipy takes it.
_DIFFERENCE = float(np.sqrt(np.finfo(np.float64).eps))
# Share of what one polarized layer leaves that two must explain. Set by hand.
_MUCH = 0.5
_WIDER = 1.25
"""Factor on standard errors. Measured on 56 scenes of photographs that no figure is taken of: ghosts beside their
place move the numbers, too."""


@dataclass(frozen=True)
class PolarizedPerspectiveFit:
    """Pane, lens and polarized light.

    Attributes
    ----------
    scene : SceneParameters
        Complete, its ghosts in place.
    errors : SceneErrors
    misfit : float
        Mean square of what the blocks' light has off the plane of what both layers show, in units of the noise: 1 where
        the model holds.
    n_parameters : int
        Numbers fitted.
    negative : float
        Share of the blocks where a layer would have clearly less than no light.
    """

    scene: SceneParameters
    errors: SceneErrors
    misfit: float
    n_parameters: int
    negative: float


def fit_polarized_perspective(
    stokes: StokesImages, plain: SceneParameters, focal_px: float | None = None
) -> PolarizedPerspectiveFit:
    """Fit normal, focal length unless it is given, and the polarization of one layer's light or of both.

    Parameters
    ----------
    stokes : StokesImages
    plain : SceneParameters
        Index and surfaces of the pane; its geometry is not used.
    focal_px : float, optional
        Focal length, where it is known.
    """
    coarse, blocks = (
        _OffPlane(part, plain) for part in (PolarizedBlocks(stokes, COARSE_BLOCKS), PolarizedBlocks(stokes))
    )
    pane = (INCIDENCE, AZIMUTH) if focal_px is not None else (INCIDENCE, AZIMUTH, VIEW)
    view = USUAL_VIEW if focal_px is None else blocks.half_px / focal_px
    single = [_Search(coarse, pane + layer).ends(_grid(layer, view)) for layer in (_BEHIND, _MIRRORED)]
    both = _Search(coarse, pane + _BEHIND + _MIRRORED).ends([*single[0], *single[1]])
    starts = [points[0] for points in (*single, both)]
    searches = [_Search(blocks, pane + layers) for layers in (_BEHIND, _MIRRORED, _BEHIND + _MIRRORED)]
    found = [search.finely(start) for search, start in zip(searches, starts, strict=True)]
    best = _simplest(found)
    return PolarizedPerspectiveFit(
        _scene_at(best.point, plain, blocks.half_px),
        best.errors(blocks),
        best.misfit,
        len(best.free),
        blocks.negative(best.point),
    )


class _OffPlane:
    """What blocks have off the plane of what both layers show."""

    def __init__(self, blocks: PolarizedBlocks, plain: SceneParameters) -> None:
        self._blocks, self._pane = blocks, (plain.index, *plain.sheets)
        self.half_px, self.grouped = blocks.half_px, blocks.grouped

    def __call__(self, points: Values) -> Values:
        """In units of the noise, (..., channel, m), at points (..., number)."""
        across = np.cross(*self._shown(points), axis=0)
        spread = np.sqrt(np.einsum("i...m,ij,j...m->...m", across, self._blocks.covariance, across))
        return np.asarray(np.einsum("i...m,icm->...cm", across / spread, self._blocks.stokes))

    def negative(self, point: Values) -> float:
        """Share of the blocks where a layer has clearly less than no light."""
        shown = np.stack(self._shown(point), axis=-1).transpose(1, 0, 2)
        whitening = np.linalg.inv(np.linalg.cholesky(self._blocks.covariance))
        weights = np.asarray(np.linalg.pinv(whitening @ shown) @ whitening, dtype=np.float64)
        return self._blocks.negative(weights.transpose(1, 2, 0))

    def _shown(self, points: Values) -> tuple[Values, Values]:
        """Stokes vectors (3, ..., m) that a unit of each layer's light shows in each block."""
        numbers = np.moveaxis(points, -1, 0)[..., None]
        cosine, cos, sin = viewing_angles(normal_at(numbers), numbers[VIEW], *self._blocks.places)
        weights = in_place_weights(np.maximum(cosine, _GRAZING), *self._pane)
        lights = (_entering(numbers, light) for light in (_BEHIND, _MIRRORED))
        behind, mirrored = (
            shown_stokes(weight, light, cos, sin) for weight, light in zip(weights, lights, strict=True)
        )
        return behind, mirrored


@dataclass(frozen=True)
class _Minimum:
    """Where a search ended, what is off the plane there (channel, m) and its derivatives (channel, m, free)."""

    point: Values
    free: Numbers
    off: Values
    slopes: Values

    @property
    def misfit(self) -> float:
        return float(np.mean(np.square(self.off)))

    def errors(self, blocks: _OffPlane) -> SceneErrors:
        """Standard errors from the curvature, widened by what the gradient scatters between parts of the frame."""
        curvature = np.einsum("cmi,cmj->ij", self.slopes, self.slopes)
        parts = blocks.grouped(np.einsum("cm,cmi->mi", self.off, self.slopes))
        inverse = np.linalg.pinv(curvature, hermitian=True)
        covariance = np.zeros((_LOW.size, _LOW.size))
        covariance[np.ix_(self.free, self.free)] = _WIDER**2 * inverse @ (curvature + parts.T @ parts) @ inverse
        incidence, azimuth, view = np.sqrt(np.diag(covariance))[:3]
        return SceneErrors(
            incidence_deg=math.degrees(incidence),
            azimuth_deg=math.degrees(azimuth),
            focal_px=blocks.half_px / self.point[VIEW] ** 2 * view if VIEW in self.free else None,
            transmission_polarization=self._of_light(covariance, _BEHIND),
            reflection_polarization=self._of_light(covariance, _MIRRORED),
        )

    def _of_light(self, covariance: Values, light: Numbers) -> tuple[float, float] | None:
        """Errors of degree and angle of a layer's light; None where it is not polarized."""
        if not set(light) <= set(self.free):
            return None
        degree = float(np.hypot(*self.point[list(light)]))
        error = math.sqrt(float(np.trace(covariance[np.ix_(light, light)])) / 2)
        angle_deg = math.degrees(error / max(degree, 1e-9)) / 2
        return min(error, MOST_DEGREE_ERROR), min(angle_deg, MOST_ANGLE_ERROR_DEG)


@dataclass(frozen=True)
class _Search:
    """The search for some of a point's numbers, the others of which stay."""

    off: _OffPlane
    free: Numbers

    def ends(self, starts: Sequence[Values]) -> list[Values]:
        """Minima near the best starts of some azimuths, best first; a few blocks do not decide."""
        costs = np.square(self.off(np.array(starts))).mean(axis=(1, 2))
        likely: dict[float, Values] = {}
        for i in np.argsort(costs):
            likely.setdefault(round(float(starts[i][AZIMUTH]), 1), starts[i])
        ends = [self._minimum(start, "soft_l1", _ROUGHLY) for start in list(likely.values())[:_N_STARTS]]
        return [self._moved(starts[0], end.x) for end in sorted(ends, key=lambda end: float(end.cost))]

    def finely(self, start: Values) -> _Minimum:
        """The minimum of the sum of squares near a start."""
        end = self._minimum(start, "linear", _CLOSELY)
        point = self._moved(start, end.x)
        shape = self.off(point).shape
        return _Minimum(point, self.free, end.fun.reshape(shape), end.jac.reshape(*shape, end.x.size))

    def _minimum(self, start: Values, loss: Literal["linear", "soft_l1"], most: int) -> OptimizeResult:
        from scipy.optimize import least_squares

        chosen = list(self.free)
        low, high = _LOW[chosen], _HIGH[chosen]

        def slopes(x: Values) -> Values:
            # All at once: blocks are few, and each evaluation costs many calls of numpy.
            step = _DIFFERENCE * np.where(x < 0, -1, 1) * np.maximum(1, np.abs(x))
            step = np.where((x + step < low) | (x + step > high), -step, step)
            there = np.concatenate([x[None], x + np.diag(step)])
            here, *moved = self.off(self._moved(start, there)).reshape(len(there), -1)
            return np.stack([(one - here) / taken for one, taken in zip(moved, (x + step) - x, strict=True)], axis=1)

        return least_squares(
            lambda x: self.off(self._moved(start, x)).ravel(),
            np.clip(start[chosen], low + _INSIDE, high - _INSIDE),
            slopes,
            bounds=(low, high),
            x_scale=_SCALE[chosen],
            loss=loss,
            f_scale=_OUTLYING,
            max_nfev=most,
        )

    def _moved(self, start: Values, x: Values) -> Values:
        """Points (..., number) with other free numbers (..., free)."""
        points = np.broadcast_to(start, (*x.shape[:-1], start.size)).copy()
        points[..., list(self.free)] = x
        return points


def _simplest(found: Sequence[_Minimum]) -> _Minimum:
    """The better one with a single polarized layer, unless two explain much of what it leaves, and more than chance."""
    single, both = min(found[:-1], key=lambda minimum: minimum.misfit), found[-1]
    enough = max(_MUCH * (single.misfit - 1), SCATTERS * math.sqrt(2 / single.off.size))
    return both if single.misfit - both.misfit > enough else single


def _entering(numbers: Values, light: Numbers) -> Values:
    """Stokes vector (3, ...) of a layer's light of intensity 1, in the camera's frame, at points (number, ...)."""
    s1, s2 = numbers[list(light)]
    return np.stack([np.ones_like(s1), s1, s2])


def _grid(layer: Numbers, view: float) -> list[Values]:
    """Panes that lean any way, and light of one layer that is polarized any way."""
    points = []
    for incidence, azimuth, angle in itertools.product(_INCIDENCES_DEG, _AZIMUTHS_DEG, _ANGLES_DEG):
        point = np.array([math.radians(incidence), math.radians(azimuth), view, *4 * [0.0]])
        point[list(layer)] = stokes_vector(_DEGREE, angle)[1:]
        points.append(point)
    return points


def _scene_at(point: Values, plain: SceneParameters, half_px: float) -> SceneParameters:
    """The scene at a point; index and surfaces are those of another."""

    def polarization(light: Numbers) -> tuple[float, float]:
        degree, angle_deg = dolp_aolp(_entering(point, light))
        return float(degree), float(angle_deg)

    return plain.replace(
        incidence_deg=math.degrees(point[INCIDENCE]),
        azimuth_deg=math.degrees(point[AZIMUTH]) % 360,
        focal_px=half_px / float(point[VIEW]),
        transmission_polarization=polarization(_BEHIND),
        reflection_polarization=polarization(_MIRRORED),
    )
