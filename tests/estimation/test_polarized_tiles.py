"""How likely single tiles of three Stokes components are before polarized light, and which ghosts they tell."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache, partial

import numpy as np
import pytest

from polaropt import Capture, SceneParameters
from polaropt.capture import noise_level, stokes_images
from polaropt.estimation import find_scene
from polaropt.estimation.polarized.cross_relation import CrossRelation
from polaropt.estimation.polarized.errors import incidence_reach
from polaropt.estimation.polarized.ghost_choice import (
    _beyond_brewster,
    ghosts_told,
    likeliest_near,
    likely_starts,
    settled,
)
from polaropt.estimation.polarized.kernels import pane_vectors
from polaropt.estimation.polarized.light import (
    HIGHEST_DEG,
    LOWEST_DEG,
    SHIFT,
    Candidate,
    Place,
    bounded,
    candidates,
    degrees_mirrored,
    entering_light,
    free_numbers,
    in_place,
    pane_light,
    point_showing,
    shown_by,
)
from polaropt.estimation.polarized.mixing import Mixture
from polaropt.estimation.polarized.tile_kernels import stokes_tile_misfits
from polaropt.estimation.polarized.tiles import StokesTiles
from polaropt.numerics import turn_between
from polaropt.optics import brewster_angle_deg, frame_matrix
from polaropt.simulation import Camera, photograph_pair
from studies.photographs import pairs_of

BLIND = SceneParameters(None, None, None)
NOISE = 0.005
SHOWN = SceneParameters(60.0, 25.0, 6.3, transmission_polarization=(0.5, 140.0))
TRUE = Candidate(np.array([60.0, 25.0, 6.3, -0.32139, -0.38302, 0.0, 0.0]), True, False)
"""The same: twice 140 - 25 degrees."""


@cache
def capture_of(scene: SceneParameters) -> Capture:
    photographs = pairs_of(None, 192)[0]
    layers = photographs.transmission, photographs.reflection
    return photograph_pair(*layers, scene, Camera(noise=NOISE), margin=photographs.margin)


@cache
def tiles_of(scene: SceneParameters) -> StokesTiles:
    return StokesTiles(stokes_images(capture_of(scene), NOISE), BLIND)


def moved(candidate: Candidate, **numbers: float) -> Candidate:
    point = candidate.point.copy()
    for name, value in numbers.items():
        point[("incidence", "azimuth", "shift").index(name)] = value
    return replace(candidate, point=point)


def matrix(numbers: np.ndarray) -> np.ndarray:
    """The Hermitian matrix of nine numbers."""
    d0, d1, d2, r01, i01, r02, i02, r12, i12 = numbers
    upper = np.array([[0, r01 + 1j * i01, r02 + 1j * i02], [0, 0, r12 + 1j * i12], [0, 0, 0]])
    return np.diag([d0, d1, d2]) + upper + upper.conj().T


def nine(hermitian: np.ndarray) -> list[float]:
    """The nine numbers of a Hermitian matrix."""
    beside = [hermitian[i, j] for i, j in ((0, 1), (0, 2), (1, 2))]
    return [*np.diag(hermitian).real, *(part for number in beside for part in (number.real, number.imag))]


@pytest.mark.parametrize("rank", [1, 2, 3])
def test_the_kernel_says_what_the_matrices_say(rank: int) -> None:
    random, n, freedom = np.random.default_rng(rank), 11, 16.0
    factors = random.standard_normal((2, n, 3, rank)) + 1j * random.standard_normal((2, n, 3, rank))
    response = np.array([[nine(x @ x.conj().T) for x in layer] for layer in factors])
    seen = 3 * (random.standard_normal((n, 3)) + 1j * random.standard_normal((n, 3)))
    data = np.array([[*(abs(s) ** 2), *(2 * x for k in ((0, 1), (0, 2), (1, 2)) for x in parts(s, *k))] for s in seen])
    weights, natural, powers, out = (
        np.arange(2, n + 2) // 6 + 1.0,
        np.linspace(1, 2, n),
        np.array([[[0.7]], [[2.0]]]),
        np.empty(1),
    )
    arguments = (
        response.swapaxes(1, 2).copy(),
        data.T[..., None].copy(),
        weights,
        natural,
        np.array([0, n]),
        freedom,
        0.02,
    )
    stokes_tile_misfits(*arguments, 0, powers, out, 0, 1)
    expected = 0.0
    for f in range(n):
        covariance = np.eye(3) + natural[f] * (0.7 * matrix(response[1, f]) + 2.0 * matrix(response[0, f]))
        distance = (seen[f].conj() @ np.linalg.solve(covariance, seen[f])).real
        volume = np.linalg.slogdet(covariance)[1]
        expected += weights[f] * (volume + (freedom + 3) * np.log(freedom + distance))
    assert out[0] == pytest.approx(expected, rel=1e-9)
    # Fitted powers are likelier, and hardly change any more once they have been fitted.
    misfits = []
    for rounds in (1, 30, 200):
        again = powers.copy()
        stokes_tile_misfits(*arguments, rounds, again, out, 0, 1)
        misfits.append(out[0])
    assert misfits[0] < expected
    assert misfits[2] <= misfits[1] < misfits[0]


def parts(seen: np.ndarray, i: int, j: int) -> tuple[float, float]:
    cross = seen[i].conj() * seen[j]
    return cross.real, -cross.imag


def test_what_a_pane_shows_is_its_series_of_ghosts() -> None:
    # By whole pixels, which need no interpolation.
    tiles, shift = tiles_of(SHOWN), 1.0
    point = np.array([55.0, 90.0, shift, 0.3, -0.2, 0.1, 0.4])
    response = tiles._response(point)
    light = pane_light(55.0, BLIND).copy()
    light[..., :2] *= entering_light(point)[..., None]
    mixing = tiles._whiten @ np.linalg.inv(frame_matrix(90.0))
    shown = in_place(light) @ mixing.T
    light[..., :2] /= np.linalg.norm(shown, axis=1)[:, None, None]
    phase = -shift * tiles._rows
    vectors = np.empty((phase.size, 2, 3, 2))
    pane_vectors(mixing, light, np.cos(phase), np.sin(phase), vectors)
    for layer in range(2):
        series = vectors[:, layer, :, 0] + 1j * vectors[:, layer, :, 1]
        expected = np.einsum("ni,nj->nij", series, series.conj())
        found = np.array([matrix(numbers) for numbers in response[layer].T])
        # Ghosts so close leave the tile hardly at all, and behind the seventh image there is next to nothing.
        np.testing.assert_allclose(found, expected, atol=0.01 * np.abs(expected).max())


@pytest.mark.parametrize("changes", [{"shift": 0.0}, {"shift": -6.3}, {"shift": 9.0}, {"azimuth": 45.0}], ids=str)
def test_true_ghosts_are_surely_likelier(changes: dict[str, float]) -> None:
    tiles, other = tiles_of(SHOWN), moved(TRUE, **changes)
    free = np.setdiff1d(free_numbers(other, BLIND), [1, 2])
    true, false = tiles.nearest(TRUE, free), tiles.nearest(other, free)
    assert true.surer_than(false) > 2
    assert true.gain_over(false) > 50
    assert false.surer_than(true) == -true.surer_than(false)


def test_the_likeliest_shift_is_the_true_one() -> None:
    tiles, shifts = tiles_of(SHOWN).luminance(), np.arange(-20.0, 21.0)
    assert 3 * len(tiles) == len(tiles_of(SHOWN))
    assert shifts[np.argmin(tiles.of_shifts(TRUE.point, shifts))] == 6
    nearest = tiles_of(SHOWN).nearest(moved(TRUE, shift=6.0), free_numbers(TRUE, BLIND)).candidate.point
    assert np.all(np.abs(nearest[:3] - TRUE.point[:3]) < [2.5, 1.5, 0.1])


def test_what_is_told_stays() -> None:
    tiles = tiles_of(SHOWN)
    free = free_numbers(TRUE, SceneParameters(60.0, 25.0, 6.3))
    assert free.tolist() == [3, 4]
    assert tiles.nearest(TRUE, free).candidate.point[:3].tolist() == TRUE.point[:3].tolist()
    assert tiles.nearest(TRUE, np.arange(0)).misfits == pytest.approx(tiles.fitted(TRUE).misfits)


def test_ghosts_are_told_where_no_other_search_found_any() -> None:
    in_place_ = moved(TRUE, shift=0.0)
    fits = ghosts_told(tiles_of(SHOWN), BLIND, [in_place_], [])
    assert fits[0].candidate.point[SHIFT] == pytest.approx(6.3, abs=0.2)
    assert [fit.misfit for fit in fits] == sorted(fit.misfit for fit in fits)
    starts = likely_starts([moved(TRUE, shift=12.0)], fits)
    assert all(start.point[SHIFT] == pytest.approx(6.3, abs=0.2) for start in starts)
    assert likely_starts([TRUE], fits) == [TRUE]


def test_no_ghosts_are_told_where_there_are_none() -> None:
    scene = replace(SHOWN, ghost_shift=0.0)
    assert ghosts_told(tiles_of(scene), BLIND, [moved(TRUE, shift=0.0)], [TRUE]) == []


@pytest.mark.parametrize("incidence", [8.0, 30.0, 57.0, 80.0])
def test_a_pane_beyond_brewsters_angle_is_one(incidence: float) -> None:
    steep = moved(TRUE, incidence=incidence)
    across = _beyond_brewster(steep, BLIND)
    assert LOWEST_DEG <= across.point[0] <= HIGHEST_DEG
    assert (across.point[0] > brewster_angle_deg(1.5)) == (incidence < brewster_angle_deg(1.5))
    assert np.hypot(*across.point[3:5]) <= 1 + 1e-9
    assert across.point[5:].tolist() == [0, 0]
    assert np.isfinite(tiles_of(SHOWN).fitted(across).misfit)


class Unsure:
    """Coarse light that finds every point as likely."""

    def evidence(self, point: np.ndarray) -> float:
        return 0.0

    def finished(self, candidate: Candidate) -> Unsure:
        self.candidate = candidate
        return self

    def near(self, point: np.ndarray) -> Callable[[np.ndarray], float]:
        return self.evidence


def test_a_pane_that_tiles_refuse_is_left() -> None:
    tiles = tiles_of(SHOWN)
    fits = ghosts_told(tiles, BLIND, [moved(TRUE, shift=0.0)], [])
    assert settled(tiles, BLIND, fits, TRUE, Unsure()) is TRUE
    wrong = moved(TRUE, shift=-6.3)
    assert settled(tiles, BLIND, fits, wrong, Unsure()).point[SHIFT] == pytest.approx(6.3, abs=0.2)


def test_close_ghosts_before_polarized_light_are_found() -> None:
    capture = capture_of(replace(SHOWN, incidence_deg=70.0, ghost_shift=-1.5))
    found = find_scene(capture, BLIND, noise_level(capture), "polarized").scene
    assert abs(found.values()[2]) == pytest.approx(1.5, abs=0.4)
    assert found.values()[0] == pytest.approx(70, abs=3)


class Sure(Unsure):
    """Coarse light that is sure of an incidence."""

    def evidence(self, point: np.ndarray) -> float:
        return 1e4 * float(point[0] - 63.0) ** 2


class Relation(CrossRelation):
    """A cross relation that is sure of an incidence, or finds every point as likely."""

    def __init__(self, sureness: float = 0.0) -> None:
        self.sureness = sureness

    def misfit(self, point: np.ndarray) -> float:
        return self.sureness * float(point[0] - 63.0) ** 2


def test_tiles_move_a_pane_to_where_its_ghosts_lie() -> None:
    beside = moved(TRUE, incidence=66.0, shift=5.9)
    point = likeliest_near(tiles_of(SHOWN), BLIND, beside, Unsure(), Relation()).point
    assert abs(point[0] - 60.0) < 2.5
    assert abs(point[SHIFT] - 6.3) < 0.1


def test_coarse_light_and_the_cross_relation_have_their_say() -> None:
    both = replace(moved(TRUE, incidence=61.0), reflection=True)
    likeliest = partial(likeliest_near, tiles_of(SHOWN), BLIND, both)
    assert likeliest(Sure(), Relation()).point[0] == pytest.approx(63.0, abs=0.2)
    assert likeliest(Unsure(), Relation(1e3)).point[0] == pytest.approx(63.0, abs=0.2)
    assert likeliest(Unsure(), Relation()).point[0] < 62.0


def test_a_step_along_what_is_shown_follows_a_narrow_valley() -> None:
    # Another incidence and azimuth, with the light that shows the same in place.
    both = replace(TRUE, reflection=True)
    shown = shown_by(TRUE.point, BLIND)
    start = replace(both, point=bounded(point_showing(Place(50.0, 15.0, 6.3), shown, BLIND)))
    tiles = tiles_of(SHOWN)
    assert tiles.nearest(start, free_numbers(start, BLIND), 8).misfit < tiles.fitted(both).misfit + 5


def test_ghosts_of_two_polarized_layers_are_found_in_any_direction() -> None:
    scene = replace(SHOWN, azimuth_deg=146.0, reflection_polarization=(0.8, 20.0))
    vectors = Mixture(stokes_images(capture_of(scene), NOISE)).likely_vectors()
    in_place_ = [pane for pair in vectors for pane in candidates(pair, BLIND)]
    fits = ghosts_told(tiles_of(scene), BLIND, in_place_, [], vectors)
    place = fits[0].candidate.point[1:3]
    assert abs(turn_between(float(place[0]), 146.0)) < 3
    assert abs(abs(place[1]) - 6.3) < 0.3


def test_close_to_brewster_s_angle_a_mirrored_scene_hardly_tells_the_incidence() -> None:
    brewster = brewster_angle_deg(BLIND.index)
    reaches = [incidence_reach(brewster + off, BLIND) for off in (0.0, 8.0, 20.0)]
    assert 2.5 < reaches[0] < 5
    assert reaches[0] > 2 * reaches[1] > 2 * reaches[2]
    # Whoever lies that far off shows light that is polarized by 2 % less.
    incidences, degrees = degrees_mirrored(BLIND)
    at = np.interp([brewster, brewster + reaches[0]], incidences, degrees)
    assert at[0] - at[1] == pytest.approx(0.02, abs=0.006)
