"""Panes with polarized layers as a few numbers, and which of them show a given pair of Stokes vectors in place.

A point is (incidence, azimuth, ghost shift, and for each layer two numbers: degree times cosine and sine of twice the
angle of its light's polarization, counted from the plane of incidence). In place a capture tells four numbers, two
for each layer's Stokes vector: several panes with one polarized layer show the same, and ever so many with two.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from polaropt.optics import GhostSeries, SceneParameters, brewster_angle_deg, frame_matrix, plate_at

Point = NDArray[np.float64]
Values = NDArray[np.float64]

# Places of a point's numbers.
INCIDENCE, AZIMUTH, SHIFT = 0, 1, 2
OF_TRANSMISSION, OF_REFLECTION = slice(3, 5), slice(5, 7)
LOWEST_DEG, HIGHEST_DEG = 3.0, 87.0
"""Incidences among which a pane before polarized light is searched, inside those of unpolarized light: at 3 degrees
glass polarizes 3e-4 of what it passes and 4e-3 of what it mirrors, and slightly polarized light would do as well; at 87
it passes 15 %. Set by hand."""
HIGHEST_DEGREE = 1.0
"""Degree of fully polarized light. A search held at 0.97 exchanged a fully polarized screen with the reflection."""
MOST_DEGREE_ERROR, MOST_ANGLE_ERROR_DEG = 1.0, 90.0
"""Errors of the degree and of the angle of polarization (an axis) that leave them wholly open."""
_BEYOND = 2.0
"""Degrees of polarization up to this are taken for full polarization and errors of measurement. Set by hand."""
_MOST_OFF = 0.1
"""Degree of polarization by which a pane before unpolarized light may miss the one shown. Set by hand."""
_NEAR_DEG = 20.0
"""Difference of two incidences, on either side of Brewster's angle, that are taken for one between. Set by hand."""
_LEAST_GAIN = 1e-6
"""Share of light from which on it is divided by, where the pane passes or mirrors less. Set by hand."""
_GRID_DEG = np.arange(LOWEST_DEG, HIGHEST_DEG, 0.5)
"""Incidences between which the one that shows a degree of polarization is interpolated. Set by hand."""


@dataclass(frozen=True)
class Candidate:
    """A point and whose light may be polarized there, beside what is given."""

    point: Point
    transmission: bool
    reflection: bool


def free_numbers(candidate: Candidate, asked: SceneParameters) -> NDArray[np.intp]:
    """Which of a candidate's numbers are to be found; a shift only where there is one."""
    ghosts = asked.ghost_shift is None and candidate.point[SHIFT] != 0
    flags = [asked.incidence_deg is None, asked.azimuth_deg is None, ghosts]
    return np.flatnonzero(flags + 2 * [candidate.transmission] + 2 * [candidate.reflection])


@lru_cache(maxsize=64)
def pane_light(incidence_deg: float, scene: SceneParameters) -> Values:
    """Direct light, first ghost and ratio of ghosts of each layer and entry, (2, 3, 3); unpolarized light is 1.

    A search asks several times at each incidence; not to be written to.
    """
    light = np.array(plate_at(incidence_deg, scene).series).swapaxes(1, 2)
    light.flags.writeable = False
    return light


def in_place(light: Values) -> Values:
    """All ghosts of `pane_light` summed in place, (2, 3)."""
    return np.asarray(GhostSeries(light[..., 0], light[..., 1], light[..., 2]).in_place)


def entering_light(point: Point) -> Values:
    """(I_par, I_perp, s2') of both layers' light of intensity 1, the reflection's as the pane meets it, (2, 3)."""
    along, turned = point[[3, 5]], point[[4, 6]]
    return np.stack([(1 + along) / 2, (1 - along) / 2, turned * [1, -1]], axis=1)


def shown_light(point: Point, scene: SceneParameters) -> Values:
    """`pane_light` of the light that arrives at a point, (2, 3, 3)."""
    light = pane_light(float(point[INCIDENCE]), scene).copy()
    light[..., :2] *= entering_light(point)[..., None]
    return light


def first_images(light: Values, n: int) -> Values:
    """Direct light and ghosts of `pane_light`, the first n images of each layer and entry, (2, 3, n)."""
    ghosts = light[..., 1, None] * light[..., 2, None] ** np.arange(n - 1)
    return np.concatenate([light[..., :1], ghosts], axis=-1)


def stokes_of_entries(point: Point) -> Values:
    """From a point's entries to Stokes components in the camera's frame, (3, 3)."""
    return np.asarray(np.linalg.inv(frame_matrix(float(point[AZIMUTH]))))


def scene_at(point: Point, asked: SceneParameters) -> SceneParameters:
    """The complete scene at a point; what was asked for says the rest."""
    azimuth = float(point[AZIMUTH]) % 180
    sense = 1 if round((float(point[AZIMUTH]) - azimuth) / 180) % 2 == 0 else -1

    def polarization(part: slice) -> tuple[float, float]:
        degree = min(math.hypot(*point[part]), HIGHEST_DEGREE)
        return degree, (azimuth + math.degrees(math.atan2(*point[part][::-1])) / 2) % 180 if degree else 0.0

    return asked.replace(
        incidence_deg=float(point[INCIDENCE]),
        azimuth_deg=azimuth,
        ghost_shift=sense * float(point[SHIFT]),
        transmission_polarization=polarization(OF_TRANSMISSION),
        reflection_polarization=polarization(OF_REFLECTION),
    )


def candidates(vectors: Values, asked: SceneParameters) -> list[Candidate]:
    """Panes in place, one layer's light unpolarized, that show two Stokes vectors.

    Parameters
    ----------
    vectors : ndarray, shape (2, 3)
        Which of them is the transmission's is not said.
    asked : SceneParameters
        Index and surfaces of the pane; incidence, azimuth and ghost shift where they are known.
    """
    found = []
    for behind, mirrored in (vectors, vectors[::-1]):
        for plain, vector in ((1, mirrored), (0, behind)):
            for incidence, azimuth in _unpolarized(vector, plain, asked):
                place = Place(incidence, azimuth, asked.ghost_shift or 0.0)
                point = point_showing(place, np.stack([behind, mirrored]), asked)
                point[(OF_TRANSMISSION, OF_REFLECTION)[plain]] = 0
                if math.hypot(*point[3:]) <= _BEYOND:
                    found.append(Candidate(bounded(point), plain == 1, plain == 0))
    return found


def with_one_polarized(point: Point, part: slice) -> Candidate:
    """The pane at a point with polarized light in one layer, one of `OF_TRANSMISSION` and `OF_REFLECTION`, alone."""
    point, behind = point.copy(), part == OF_TRANSMISSION
    point[OF_REFLECTION if behind else OF_TRANSMISSION] = 0
    return Candidate(point, behind, not behind)


def bounded(point: Point) -> Point:
    """With no light more polarized than it can be."""
    point = point.copy()
    for part in (OF_TRANSMISSION, OF_REFLECTION):
        point[part] *= min(1.0, HIGHEST_DEGREE / max(math.hypot(*point[part]), 1e-9))
    return point


def _unpolarized(vector: Values, layer: int, asked: SceneParameters) -> list[tuple[float, float]]:
    """Incidences and azimuths at which unpolarized light of a layer shows a Stokes vector."""
    # The pane passes light polarized in the plane of incidence, and mirrors light polarized across.
    azimuth = math.degrees(math.atan2(vector[2], vector[1])) / 2 + 90 * layer
    azimuth = azimuth if asked.azimuth_deg is None else asked.azimuth_deg
    if asked.incidence_deg is not None:
        return [(asked.incidence_deg, azimuth)]
    off = _degrees(layer, asked) - math.hypot(vector[1], vector[2])
    brewster = brewster_angle_deg(asked.index) if layer == 1 else HIGHEST_DEG
    below = brewster >= _GRID_DEG
    sides = [part for part in (below, ~below) if part.any()]
    incidences = [x for side in sides if (x := _root(_GRID_DEG[side], off[side])) is not None]
    if len(incidences) == 2 and incidences[1] - incidences[0] < _NEAR_DEG:
        # In place nothing tells the two apart: between them the error is half as large.
        incidences = [sum(incidences) / 2]
    return [(incidence, azimuth) for incidence in incidences]


def degrees_mirrored(asked: SceneParameters) -> tuple[Values, Values]:
    """Incidences (n,), in degrees, and the degree of polarization that unpolarized light has once it is mirrored."""
    return _GRID_DEG, _degrees(1, asked)


@lru_cache(maxsize=8)
def _degrees(layer: int, asked: SceneParameters) -> Values:
    """Degree of polarization that a layer's unpolarized light shows at the incidences of the grid.

    Asked of every candidate; not to be written to.
    """
    gains = np.array([in_place(pane_light(float(x), asked))[layer, :2] for x in _GRID_DEG])
    degrees = np.asarray(np.abs(gains[:, 0] - gains[:, 1]) / gains.sum(axis=1))
    degrees.flags.writeable = False
    return degrees


def _root(x: Values, values: Values) -> float | None:
    """Where monotonic values are 0, or nearest to it; None where they stay far from it."""
    nearest = int(np.argmin(np.abs(values)))
    if abs(values[nearest]) > _MOST_OFF:
        return None
    rising = values if values[-1] > values[0] else -values
    return float(np.interp(0.0, rising, x))


@dataclass(frozen=True)
class Place:
    """Incidence and azimuth in degrees, ghost shift in pixels."""

    incidence_deg: float
    azimuth_deg: float
    ghost_shift: float


def point_showing(place: Place, shown: Values, scene: SceneParameters) -> Point:
    """The point whose layers show Stokes vectors (2, 3) in place."""
    gains = in_place(pane_light(place.incidence_deg, scene))
    numbers = []
    for gain, vector, sign in zip(gains, shown, (1, -1), strict=True):
        gain = np.where(np.abs(gain) < _LEAST_GAIN, _LEAST_GAIN, gain)
        par, perp, turned = frame_matrix(place.azimuth_deg) @ vector / gain
        numbers += [(par - perp) / (par + perp), sign * turned / (par + perp)]
    return np.array([place.incidence_deg, place.azimuth_deg, place.ghost_shift, *numbers])


def shown_by(point: Point, scene: SceneParameters) -> Values:
    """Stokes vectors (2, 3) with s0 = 1 that the layers show in place, in the camera's frame."""
    entries = in_place(pane_light(float(point[INCIDENCE]), scene)) * entering_light(point)
    shown = entries @ stokes_of_entries(point).T
    return np.asarray(shown / shown[:, :1])


def coordinates_of(point: Point, scene: SceneParameters) -> Values:
    """Pane, and what each layer shows in place, (s1, s2) where s0 = 1: what is told best, each for itself, (7,)."""
    return np.concatenate([point[:3], shown_by(point, scene)[:, 1:].ravel()])


def point_of(coordinates: Values, candidate: Candidate, scene: SceneParameters) -> Point:
    """The point of some coordinates, where the light of a candidate's unpolarized layers stays as it is."""
    shown = np.ones((2, 3))
    shown[:, 1:] = coordinates[3:].reshape(2, 2)
    point = point_showing(Place(*map(float, coordinates[:3])), shown, scene)
    for part, polarized in ((OF_TRANSMISSION, candidate.transmission), (OF_REFLECTION, candidate.reflection)):
        if not polarized:
            point[part] = candidate.point[part]
    return bounded(point)
