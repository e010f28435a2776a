"""Layers whose light arrives polarized: the plane of the cloud, panes that show it, the blind fit and its claims."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from polaropt.capture.capture import Capture
from polaropt.capture.noise import noise_level
from polaropt.capture.pair_gain import closure_share
from polaropt.capture.polarization import StokesImages, stokes_images
from polaropt.estimation.ladder import find_scene
from polaropt.estimation.polarized.alike import panes_alike
from polaropt.estimation.polarized.kernels import pane_vectors
from polaropt.estimation.polarized.light import (
    Candidate,
    Place,
    candidates,
    entering_light,
    in_place,
    pane_light,
    point_showing,
    scene_at,
    shown_by,
)
from polaropt.estimation.polarized.likelihood import PolarizedLikelihood
from polaropt.estimation.polarized.mixing import Mixture, looks_polarized
from polaropt.estimation.polarized.search import Search
from polaropt.judging.warnings import SeparationWarning
from polaropt.numerics.minima import Box
from polaropt.optics.plate import plate_at
from polaropt.optics.rivals import widened
from polaropt.optics.scene import SceneErrors, SceneParameters
from polaropt.reporting.report import json_values
from polaropt.reporting.words import pane_sentence
from polaropt.separation import Separation, separate
from polaropt.simulation.metrics import psnr_db
from polaropt.simulation.simulator import simulate
from studies.camera import take
from studies.photographs import shipped_pairs
from studies.scenes import SCENES, protocol
from tests.blends import Blend, blend
from tests.points import point_of

BLIND = SceneParameters(None, None, None)
SCREEN = {"transmission_polarization": (0.6, 140.0)}
SKY = {"reflection_polarization": (0.3, 70.0)}
KINDS = {"screen": SCREEN, "sky": SKY, "both": SCREEN | SKY}

degrees = st.floats(0.05, 0.9)
angles = st.floats(0, 180)


def stokes_of(capture: Capture) -> StokesImages:
    return stokes_images(capture, max(1e-4, noise_level(capture)))


def lively_layers(seed: int, size: int = 128) -> list[np.ndarray]:
    """Two grey layers of noise whose strength changes from square to square, in each for itself."""
    random = np.random.default_rng(seed)
    layers = []
    for _ in range(2):
        strength = np.kron(0.002 * np.exp(1.5 * random.standard_normal((8, 8))), np.ones((size // 8, size // 8)))
        layers.append(np.clip(0.4 + strength * random.standard_normal((size, size)), 0.0, 1.0))
    return layers


def apart(found: np.ndarray, true: np.ndarray) -> float:
    """Largest distance of two pairs of Stokes vectors, whichever is first."""
    return min(float(np.abs(found - true).max()), float(np.abs(found[::-1] - true).max()))


@pytest.mark.parametrize("polarization", [{}, SCREEN, SKY, SCREEN | SKY], ids=["none", "screen", "sky", "both"])
def test_the_cloud_of_stokes_vectors_lies_in_a_plane(polarization: dict[str, object]) -> None:
    capture = blend(ghost_shift=0.0, **polarization).capture
    assert Mixture(stokes_of(capture)).misfit == pytest.approx(1, abs=0.15)


@given(angles, degrees, angles, st.floats(0.05, 0.5), st.integers(0, 100))
@settings(max_examples=12, deadline=None)
def test_edges_tell_both_stokes_vectors_in_the_plane(
    azimuth: float, screen: float, behind: float, sky: float, seed: int
) -> None:
    scene = SceneParameters(70.0, azimuth, 0.0, transmission_polarization=(screen, behind))
    scene = scene.replace(reflection_polarization=(sky, 30.0))
    capture = simulate(*lively_layers(seed), scene, noise=1e-4)
    true = shown_by(point_of(scene), scene)
    if np.linalg.norm(true[0] - true[1]) > 0.2:
        assert apart(Mixture(stokes_of(capture)).vectors(), true) < 0.03


@given(st.floats(15, 85), angles, degrees, angles, degrees, angles)
def test_a_point_is_told_by_what_it_shows(
    incidence: float, azimuth: float, screen: float, behind: float, sky: float, mirrored: float
) -> None:
    scene = SceneParameters(incidence, azimuth, 0.0, transmission_polarization=(screen, behind))
    point = point_of(scene.replace(reflection_polarization=(sky, mirrored)))
    place = Place(incidence, azimuth, 0.0)
    if abs(incidence - 56.3) > 2:
        np.testing.assert_allclose(point_showing(place, shown_by(point, scene), scene), point, atol=1e-9)


@given(st.floats(15, 85), angles, degrees, angles, st.booleans())
def test_a_single_polarized_layer_leaves_the_true_pane_among_the_candidates(
    incidence: float, azimuth: float, degree: float, angle: float, screen: bool
) -> None:
    light = {"transmission_polarization" if screen else "reflection_polarization": (degree, angle)}
    true = point_of(SceneParameters(incidence, azimuth, 0.0).replace(**light))
    # Near Brewster's angle the reflection shows the same on both sides of it, whatever its light.
    if abs(incidence - 56.3) > 11:
        found = candidates(shown_by(true, BLIND), BLIND)
        off = [np.abs((candidate.point - true + [0, 90, *5 * [0]]) % [360, 180, *5 * [9]]) for candidate in found]
        distances = [
            max(min(part[0], 360 - part[0]) / 100, abs(part[1] - 90) / 100, *_signed(part[3:])) for part in off
        ]
        assert min(distances) < 0.02


def _signed(values: np.ndarray) -> list[float]:
    return [float(min(value, 9 - value)) for value in values]


def test_a_scene_is_its_point() -> None:
    scene = SceneParameters(50.0, 20.0, -3.0, transmission_polarization=(0.6, 140.0))
    back = scene_at(point_of(scene), BLIND)
    assert back.values() == pytest.approx(scene.values())
    assert back.transmission_polarization == pytest.approx((0.6, 140.0))


@pytest.mark.parametrize("change", [(0, 4.0), (1, 4.0), (2, 2.0), (3, 0.1), (4, 0.1)], ids=str)
def test_the_true_pane_is_the_likeliest(change: tuple[int, float]) -> None:
    made = blend(size=128, **SCREEN)
    likelihood = PolarizedLikelihood(stokes_of(made.capture), made.scene)
    true = point_of(made.scene)

    def evidence(point: np.ndarray) -> float:
        pane = likelihood.pane(point)
        return likelihood.evidence(pane, likelihood.levels(pane))

    for sign in (-1, 1):
        other = true.copy()
        other[change[0]] += sign * change[1]
        assert evidence(other) > evidence(true)


def test_behind_the_true_pane_no_coarse_light_is_left_over() -> None:
    made = blend(size=128, **SCREEN, **SKY)
    likelihood = PolarizedLikelihood(stokes_of(made.capture), made.scene)
    misfit, n = likelihood.leftover(point_of(made.scene))
    assert n > 1000
    assert misfit == pytest.approx(1, abs=0.15)


@lru_cache
def separated(kind: str, ghost_shift: float) -> tuple[Blend, Separation]:
    made = blend(size=128, ghost_shift=ghost_shift, **KINDS[kind])
    return made, separate(made.capture, BLIND if ghost_shift else BLIND.replace(ghost_shift=0.0))


@pytest.mark.parametrize(("kind", "ghost_shift"), [("screen", 0.0), ("sky", 6.3), ("both", 6.3)])
def test_separation_beats_the_trivial_ones_before_polarized_light(kind: str, ghost_shift: float) -> None:
    made, result = separated(kind, ghost_shift)
    s0, s1, s2 = made.capture.stokes
    trivial = max(psnr_db(image, made.layers[0], 16) for image in (s0, s0 - np.hypot(s1, s2)))
    # In place a pane on the other side of Brewster's angle shows the same: that is said.
    told = ghost_shift or SeparationWarning.POLARIZATION_DOUBTFUL not in result.diagnostics.warnings
    assert psnr_db(result.layers[0], made.layers[0], 16) > trivial + (6 if told else 3)


@pytest.mark.parametrize(("incidence_deg", "ghost_shift"), [(15.0, 6.3), (40.0, 0.0), (60.0, 6.3), (80.0, 0.0)])
def test_no_polarized_light_is_claimed_where_there_is_none(incidence_deg: float, ghost_shift: float) -> None:
    made = blend(incidence_deg, size=128, ghost_shift=ghost_shift)
    found = find_scene(made.capture, BLIND, noise_level(made.capture))
    assert not found.scene.polarized


@pytest.mark.parametrize("across", [0.0, 90.0])
def test_edges_see_light_polarized_along_or_across_the_plane_of_incidence(across: float) -> None:
    made = blend(size=160, ghost_shift=0.0, transmission_polarization=(0.6, 25.0 + across))
    assert looks_polarized(stokes_of(made.capture), made.scene)
    assert not looks_polarized(stokes_of(blend(size=160, ghost_shift=0.0).capture), made.scene)


def test_what_is_told_of_the_pane_stays() -> None:
    made = blend(size=128, **SCREEN)
    asked = SceneParameters(60.0, 25.0, None)
    found = find_scene(made.capture, asked, noise_level(made.capture), "polarized")
    assert found.scene.values()[:2] == (60.0, 25.0)
    assert found.scene.transmission_polarization == pytest.approx((0.6, 140.0), abs=3)


@pytest.mark.parametrize("noise", [0.005, 0.01])
def test_frontal_glass_needs_no_polarized_light(noise: float) -> None:
    # A slight polarization of what is behind oblique glass shows nearly the same.
    capture = take(protocol(10.0, noise=noise), shipped_pairs(128, 64)[2]).capture
    found = find_scene(capture, BLIND, noise_level(capture)).scene
    assert not found.polarized
    assert found.values()[0] < 20


def test_a_wrong_azimuth_is_not_explained_by_polarized_light() -> None:
    sample = take(protocol(60.0), shipped_pairs(128, 64)[1])
    capture, told = sample.capture, sample.scene.values()[1] + 10
    found = find_scene(capture, SceneParameters(None, told, None), noise_level(capture))
    assert not found.scene.polarized
    assert found.unexplained > 4


@pytest.mark.parametrize("kind", ["sky", "both"])
def test_the_true_numbers_lie_within_a_few_standard_errors(kind: str) -> None:
    _, found = separated(kind, 6.3)
    incidence, azimuth, shift = found.scene.values()
    assert abs(incidence - 60.0) < 3 * (found.errors.incidence_deg or 0)
    assert abs(azimuth - 25.0) < 3 * (found.errors.azimuth_deg or 0)
    assert abs(shift - 6.3) < 3 * (found.errors.ghost_shift or 0)
    if found.errors.transmission_polarization is not None and "transmission_polarization" in KINDS[kind]:
        degree, angle = found.scene.transmission_polarization
        assert abs(degree - 0.6) < 3 * found.errors.transmission_polarization[0]
        assert abs(angle - 140.0) < 3 * found.errors.transmission_polarization[1]


def test_an_untold_side_of_the_ghosts_widens_their_error(monkeypatch: pytest.MonkeyPatch) -> None:
    capture = blend(size=128, ghost_shift=6.3, **SCREEN).capture
    asked = BLIND.replace(incidence_deg=60.0, azimuth_deg=25.0)
    told = find_scene(capture, asked, noise_level(capture), "polarized")
    monkeypatch.setattr("polaropt.estimation.polarized.search._SURE_OF_LIGHT", math.inf)
    doubted = find_scene(capture, asked, noise_level(capture), "polarized")
    assert told.errors.ghost_shift is not None
    assert told.errors.ghost_shift < 1
    assert doubted.errors.ghost_shift == pytest.approx(abs(doubted.scene.values()[2]))


def test_newton_steps_go_along_a_narrow_valley() -> None:
    def valley(x: np.ndarray) -> float:
        return float(1e3 * (x[0] - 0.9 * x[1]) ** 2 + (x[1] - 3) ** 2)

    far = np.full(2, 10.0)
    box = Box(np.zeros(2), np.full(2, 0.1), -far, far)
    step = box.newton(valley)
    np.testing.assert_allclose(step.point, [2.7, 3.0], rtol=1e-6)
    assert step.value == pytest.approx(0, abs=1e-6)
    again = dataclasses.replace(box, start=np.array([5.0, -5.0])).newton(valley, step.curvature)
    np.testing.assert_allclose(again.point, [2.7, 3.0], rtol=1e-6)
    nothing = np.empty(0)
    assert Box(nothing, nothing, nothing, nothing).newton(lambda x: 1.0).value == 1.0


def test_the_sentence_tells_the_polarization_of_both_layers() -> None:
    scene = {**json_values(SceneParameters(**SCREEN)), "rung": "polarized"}
    errors = {**json_values(SceneErrors()), "transmission_polarization": [0.02, 1.5]}
    sentence = pane_sentence({"scene": scene, "estimated": ["transmission_polarization"], "errors": errors})
    assert "light from behind polarized 0.60 +- 0.02 at 140.0 +- 1.5 deg (estimated)" in sentence
    assert "mirrored" not in sentence


def test_fully_polarized_light_behind_the_glass_is_found_as_such() -> None:
    made = blend(size=128, ghost_shift=6.3, transmission_polarization=(1.0, 140.0))
    asked = BLIND.replace(ghost_shift=6.3)
    scene = find_scene(made.capture, asked, noise_level(made.capture)).scene
    assert scene.transmission_polarization == pytest.approx((1.0, 140.0), abs=2)


def test_a_wide_lens_is_not_looked_at_for_polarized_light() -> None:
    # What it leaves lies off the plane of any two Stokes vectors.
    made = blend(size=128, azimuth_deg=25.0, focal_px=160.0)
    found = find_scene(made.capture, BLIND, noise_level(made.capture))
    assert [tried.rung for tried in found.tried][1:] == ["perspective"]


def test_ghosts_beside_the_likelier_accident_are_found() -> None:
    # Accidents of these spectra make two polarized layers likelier, and a pane on the other side of Brewster's angle.
    capture = take(SCENES["screen behind, degree: 0.2"], shipped_pairs(128, 64)[1]).capture
    scene = find_scene(capture, BLIND, noise_level(capture)).scene
    assert 0.0 in (scene.transmission_polarization[0], scene.reflection_polarization[0])
    assert scene.values()[0] == pytest.approx(60, abs=6)


def test_coarse_light_tells_a_screen_where_fine_light_is_wrong() -> None:
    """Fine light takes it for polarized light in both layers before a pane at 37 degrees."""
    capture = take(SCENES["screen behind, degree: 0.4"], shipped_pairs(256, 128)[1]).capture
    scene = find_scene(capture, BLIND, noise_level(capture)).scene
    assert scene.reflection_polarization[0] == 0
    assert scene.transmission_polarization[0] == pytest.approx(0.4, abs=0.05)
    assert scene.values()[0] == pytest.approx(60, abs=4)


def test_a_sky_is_not_taken_for_a_weak_screen_that_is_hardly_likelier() -> None:
    # A screen polarized to a few per cent, at an incidence 3 to 6 degrees off, makes these spectra a little likelier.
    pair = shipped_pairs(128, 64)[3]
    scene = SceneParameters(60.0, 100.0, 8.165, reflection_polarization=(0.3, 160.0))
    larger = simulate(pair.transmission, pair.reflection, scene, noise=0.005, bits=12, seed=3)
    capture = Capture.of_planes(pair.cropped(larger.intensities), larger.angles_deg)
    found = find_scene(capture, BLIND, noise_level(capture)).scene
    assert found.transmission_polarization[0] == 0 < found.reflection_polarization[0]
    assert found.values()[0] == pytest.approx(60, abs=1)


def test_parts_of_the_spectra_add_up_to_their_likelihood() -> None:
    made = blend(size=96, ghost_shift=6.3, **SCREEN)
    likelihood = PolarizedLikelihood(stokes_of(made.capture), BLIND)
    point = point_of(made.scene)
    pane = likelihood.pane(point)
    spectral = likelihood.spectral(pane, likelihood.levels(pane))
    assert likelihood.sectors(point).sum() == pytest.approx(spectral, rel=1e-5)


@pytest.mark.parametrize(("number", "step"), [(0, 0.5), (1, 0.2), (2, 0.05)])
def test_the_likelihood_is_smooth_enough_for_its_curvature(number: int, step: float) -> None:
    made = blend(size=96, ghost_shift=6.3, **SCREEN)
    likelihood = PolarizedLikelihood(stokes_of(made.capture), BLIND)
    point = point_of(made.scene)
    levels = likelihood.levels(likelihood.pane(point))

    def curvature(step: float) -> float:
        move = step * np.eye(point.size)[number]
        before, here, after = (likelihood.spectral(likelihood.pane(point + k * move), levels) for k in (-1, 0, 1))
        return (before - 2 * here + after) / step**2

    # What is left of bright spectra is the small difference of large sums.
    assert curvature(step) == pytest.approx(curvature(2 * step), rel=0.3)
    assert curvature(step) == pytest.approx(curvature(step / 2), rel=0.3)


class _Watched(PolarizedLikelihood):
    """Keeps the spectra that glances at panes rest on."""

    glances_seen: list[np.ndarray]

    def glances(self, point, shifts, levels):
        self.glances_seen.append(levels.copy())
        return super().glances(point, shifts, levels)


def test_all_shifts_and_directions_of_ghosts_are_glanced_at_with_the_same_spectra() -> None:
    made = blend(size=96, ghost_shift=6.3, **SCREEN)
    likelihood = _Watched(stokes_of(made.capture), BLIND)
    likelihood.glances_seen = []
    point = point_of(made.scene.replace(ghost_shift=0.0))
    Search(likelihood, Mixture(stokes_of(made.capture)), BLIND).rough([Candidate(point, True, False)])
    # Those along the azimuth come first, others after a few panes were fitted.
    assert len(likelihood.glances_seen) > 5
    for levels in likelihood.glances_seen:
        np.testing.assert_array_equal(levels, likelihood.glances_seen[0])


@pytest.mark.parametrize("changes", [{}, {"n_bounces": 0}, {"single_surface": True}])
def test_the_kernel_sums_ghosts_as_the_plate_does(changes):
    scene = SceneParameters(72.0, 0.0, 4.0, **changes)
    phase = np.linspace(0, 6, 9)
    vectors = np.empty((phase.size, 2, 3, 2), np.float32)
    pane_vectors(np.eye(3), pane_light(72.0, scene), np.cos(phase), np.sin(phase), vectors)
    series = plate_at(72.0, scene).at(np.exp(-1j * phase[:, None]))
    expected = np.stack([np.broadcast_to(layer, (phase.size, 3)) for layer in series], axis=1)
    np.testing.assert_allclose(vectors[..., 0] + 1j * vectors[..., 1], expected, atol=1e-6)


def with_gains(capture: Capture, gains: tuple[float, ...]) -> Capture:
    return capture.replace(intensities=capture.intensities * np.float32(gains)[:, None, None, None])


def test_gains_that_differ_are_not_taken_for_polarized_light() -> None:
    # They tilt the plane of the Stokes vectors as polarized light does, but pairs no longer add up.
    capture = with_gains(blend(size=128, ghost_shift=0.0).capture, (1.013, 0.994, 0.986, 0.997))
    found = find_scene(capture, BLIND, noise_level(capture))
    assert found.unexplained > 1.5
    assert not found.scene.polarized


def test_photographs_tell_by_how_much_they_do_not_add_up() -> None:
    capture = blend(size=128, ghost_shift=0.0, **SCREEN).capture
    assert closure_share(capture.intensities, capture.angles_deg, capture.valid) == 0
    off = with_gains(capture, (1.02, 1.0, 1.02, 1.0))
    # Of four photographs that are half the light each it is a half.
    share = closure_share(off.intensities, off.angles_deg, off.valid)
    assert share == pytest.approx(0.01, rel=0.1)
    three = [0, 1, 2]
    assert closure_share(off.intensities[three], [off.angles_deg[i] for i in three], off.valid[three]) == 0


@pytest.mark.parametrize("number", range(3))
def test_directions_of_strongly_polarized_layers_are_the_likeliest_that_light_can_have(number: int) -> None:
    # Beyond full polarization others may be likelier; moved back from there they are far from the likeliest.
    scene = SceneParameters(52.0, 15.0, 0.0, transmission_polarization=(0.95, 160.0))
    capture = simulate(*lively_layers(number), scene, noise=3e-3)
    mixture = Mixture(stokes_of(capture))
    vectors = mixture.vectors()
    assert (np.hypot(vectors[:, 1], vectors[:, 2]) <= 1 + 1e-6).all()
    assert mixture.cost(vectors) < mixture.cost(shown_by(point_of(scene), scene)) + 1e-3


def test_ghosts_are_not_close_where_none_explain_more_the_closer_they_are() -> None:
    made = blend(size=96, ghost_shift=0.0, **SCREEN)
    likelihood = PolarizedLikelihood(stokes_of(made.capture), BLIND)
    search = Search(likelihood, Mixture(stokes_of(made.capture)), BLIND)
    rough = search.rough([Candidate(point_of(made.scene), True, False)])
    assert all(found.candidate.point[2] == 0 for found in rough)


def test_panes_that_show_the_same_are_told() -> None:
    made = blend(60.0, size=96, ghost_shift=0.0, **SCREEN)
    stokes = stokes_of(made.capture)
    likelihood, true = PolarizedLikelihood(stokes, BLIND), point_of(made.scene)
    alike = panes_alike(Mixture(stokes), likelihood, BLIND)
    assert alike is not None
    assert 0.5 < sum(rival.chance for rival in alike.rivals) <= 1 + 1e-9
    assert 0 < alike.chance <= 1
    shown = shown_by(true, BLIND)
    assert min(apart(shown_by(point_of(rival.scene), BLIND), shown) for rival in alike.rivals) < 0.1
    wider = widened(SceneErrors(5.0, 4.0), made.scene, alike.rivals)
    assert wider.incidence_deg is not None
    assert wider.incidence_deg > 5


@dataclass(frozen=True)
class _Shown:
    """Two Stokes vectors that are exactly known, and the mean intensity of each: mixture and likelihood at once."""

    vectors: np.ndarray
    means: np.ndarray

    def spread(self):
        return self.vectors[None], np.ones(1)

    def shares(self, vectors):
        return self.means


def test_the_chance_of_a_pane_is_how_often_it_is_the_true_one() -> None:
    random = np.random.default_rng(7)
    stated, right = [], []
    for number in range(90):
        kind = number % 3
        numbers = [0.0, 0.0, 0.0, 0.0]
        for layer in (0, 1):
            if kind in (layer, 2):
                degree, angle = random.uniform(0, 1), random.uniform(0, 2 * np.pi)
                numbers[2 * layer : 2 * layer + 2] = degree * np.cos(angle), degree * np.sin(angle)
        point = np.array([random.uniform(4, 86), random.uniform(0, 180), 0.0, *numbers])
        shares = (in_place(pane_light(float(point[0]), BLIND)) * entering_light(point))[:, :2].sum(axis=1)
        brightness = np.exp([0.0, random.normal()])
        seen = _Shown(shown_by(point, BLIND), shares * brightness)
        alike = panes_alike(seen, seen, BLIND)
        assert alike is not None
        found = alike.candidate.point
        passed = (in_place(pane_light(float(found[0]), BLIND)) * entering_light(found))[0, :2].sum()
        stated.append(alike.chance)
        same = apart(shown_by(found, BLIND)[:1], seen.vectors[:1]) < 1e-2
        right.append(same and abs(shares[0] / passed - 1) < 0.01)
    # The sum of so many chances scatters by 4 at most.
    assert abs(sum(stated) - sum(right)) < 12
    assert sum(right) > 30


def test_it_is_said_that_panes_before_polarized_light_look_alike() -> None:
    _, result = separated("screen", 0.0)
    assert result.scene.polarized
    assert SeparationWarning.POLARIZATION_DOUBTFUL in result.diagnostics.warnings
