"""Standard errors of what is estimated of a scene."""

from __future__ import annotations

import math

import numpy as np
import pytest

from polaropt import SceneParameters, estimate, separate, simulate
from polaropt.capture.capture import Capture
from polaropt.capture.polarization import plate_frame, stokes_images
from polaropt.estimation.flat.errors import errors_of_gains, spectral_incidence, weighted_incidence
from polaropt.estimation.flat.estimate import estimate_scene
from polaropt.estimation.flat.ghost_overlap import refined_incidence
from polaropt.estimation.flat.ghosts import cross_spectra
from polaropt.estimation.flat.overlap import block_images
from polaropt.numerics import turn_between
from polaropt.optics.plate import in_place_weights
from polaropt.optics.rivals import widened
from polaropt.optics.scene import SceneErrors
from polaropt.reporting.report import json_values, scene_report
from polaropt.reporting.words import error_of, pane_sentence
from studies.kit.frames import frame_of
from studies.parameter_errors import Row, compared, tables
from studies.random_windows.windows import window_of
from studies.scenes import random_scene
from tests.blends import blend

BLIND = SceneParameters(None, None, None)


@pytest.mark.parametrize("incidence_deg", [35.0, 55.0, 70.0])
def test_the_truth_lies_within_the_errors(incidence_deg: float) -> None:
    example = blend(incidence_deg, 160, ghost_shift=6.0)
    found = estimate_scene(example.capture, BLIND, noise=0.005)
    errors = found.errors
    assert abs(found.scene.incidence_deg - incidence_deg) < 3.5 * errors.incidence_deg
    assert abs(turn_between(found.scene.azimuth_deg, 25)) < 4 * errors.azimuth_deg
    assert abs(abs(found.scene.ghost_shift) - 6) < 3.5 * errors.ghost_shift
    assert errors.incidence_deg < 3
    assert errors.azimuth_deg < 0.3
    # Fainter ghosts leave another shift open.
    assert errors.ghost_shift < (1 if incidence_deg > 50 else 10)
    assert errors.focal_px is errors.bend_deg_per_px is None


@pytest.mark.parametrize(("incidence_deg", "noise"), [(10.0, 0.005), (15.0, 0.02), (20.0, 0.02)])
def test_noise_that_moves_a_small_incidence_is_in_its_error(incidence_deg: float, noise: float) -> None:
    found = estimate_scene(blend(incidence_deg, 160, ghost_shift=0.0, noise=noise).capture, BLIND, noise=noise)
    assert abs(found.scene.incidence_deg - incidence_deg) < 2.5 * found.errors.incidence_deg


def test_more_noise_is_as_large_as_the_capture_has() -> None:
    flat = Capture.of_planes(
        np.full((4, 96, 96), 0.4, dtype=np.float32) + 0.01 * np.random.default_rng(1).normal(size=(4, 96, 96))
    )
    blocks = block_images(plate_frame(stokes_images(flat, 0.01), 20.0), 160)
    for noisier in blocks.noisier():
        assert noisier.means.var(axis=(1, 2, 3)) == pytest.approx(2 * blocks.means.var(axis=(1, 2, 3)), rel=0.15)
        np.testing.assert_array_equal(noisier.covariance, 2 * blocks.covariance)


def test_of_two_incidences_the_surer_one_has_more_to_say() -> None:
    assert weighted_incidence((50.0, 1.0), (51.0, 1.0)) == pytest.approx((50.5, math.sqrt(0.5)))
    mean, error = weighted_incidence((50.0, 3.0), (51.0, 1.0))
    assert (mean, error) == pytest.approx((50.9, math.sqrt(0.9)))
    assert weighted_incidence((50.0, math.inf), (51.0, 1.0)) == pytest.approx((51.0, 1.0))


@pytest.mark.parametrize(("incidence_deg", "about_deg"), [(35.0, 39.0), (60.0, 55.0)])
def test_spectra_tell_the_incidence(incidence_deg: float, about_deg: float) -> None:
    stokes = stokes_images(blend(incidence_deg, 256, ghost_shift=6.0).capture, 0.005)
    scene = SceneParameters(about_deg, 25.0, 6.0)
    told = spectral_incidence(cross_spectra(plate_frame(stokes, 25.0)), scene)
    assert told is not None
    assert told[0] == pytest.approx(incidence_deg, abs=1.5)
    assert 0.3 < told[1] < 2


def test_spectra_tell_the_incidence_where_both_layers_have_their_edges_in_the_same_places() -> None:
    scene = SceneParameters(55.0, 30.0, 4.0)
    patches = np.random.default_rng(0).uniform(0.1, 0.9, (2, 16, 16))
    first, second = np.kron(patches, np.ones((1, 16, 16))).astype(np.float32)
    stokes = stokes_images(simulate(first, second, scene, noise=0.005), 0.005)
    told = spectral_incidence(cross_spectra(plate_frame(stokes, 30.0)), scene.replace(incidence_deg=48.0))
    assert told is not None
    assert told[0] == pytest.approx(55, abs=2)


@pytest.mark.parametrize(("number", "least_doubt_deg"), [(512, -1.0), (192, 3.0)])
def test_of_two_minima_far_from_each_other_the_likelier_one_is_taken(number: int, least_doubt_deg: float) -> None:
    window = window_of(number, 192)
    capture = window.sample(None, 192).capture
    asked = BLIND.replace(refractive_index=window.index_told)
    found = estimate_scene(capture, asked)
    assert found.scene.incidence_deg == pytest.approx(window.scene.incidence_deg, abs=0.5)
    # The other one lies 40 degrees off, where the search no longer ends, and 14 degrees.
    reached = widened(SceneErrors(0.0), found.scene, found.rivals).incidence_deg
    assert least_doubt_deg < reached < 10


def test_a_frame_of_one_tile_tells_no_incidence() -> None:
    flat = np.random.default_rng(0).uniform(0.4, 0.6, (4, 24, 24)).astype(np.float32)
    spectra = cross_spectra(plate_frame(stokes_images(Capture.of_planes(flat), 0.005), 30.0))
    assert spectral_incidence(spectra, SceneParameters(55.0, 30.0, 4.0)) is None


def test_of_two_incidences_that_contradict_neither_is_sure() -> None:
    _, error = weighted_incidence((50.0, 1.0), (58.0, 1.0))
    assert error == pytest.approx(4)


def test_what_is_given_has_no_error() -> None:
    example = blend(60, 96)
    asked = SceneParameters(60.0, 25.0, None)
    errors = estimate_scene(example.capture, asked, noise=0.005).errors
    assert errors.incidence_deg is errors.azimuth_deg is None
    assert errors.ghost_shift > 0
    assert separate(example.capture, example.scene).errors == SceneErrors()


def test_a_shift_that_the_thickness_tells_is_as_uncertain_as_the_incidence() -> None:
    errors = estimate_scene(blend(60, 160).capture, BLIND, noise=0.005, thickness_px=6.0).errors
    rate = 2 * 6 * math.radians(1)
    assert 0 < errors.ghost_shift < 2 * rate * errors.incidence_deg


def test_noise_widens_the_azimuth_in_proportion() -> None:
    errors = [
        estimate_scene(blend(55, 128, noise=noise).capture, BLIND, noise=noise).errors.azimuth_deg
        for noise in (0.004, 0.016)
    ]
    assert errors[1] == pytest.approx(4 * errors[0], rel=0.5)


def test_an_unpolarized_capture_has_no_errors_to_tell() -> None:
    assert estimate_scene(blend(0, 64).capture, BLIND, noise=0.005).errors == SceneErrors()


def test_a_refined_incidence_has_an_error() -> None:
    example = blend(70, 160, ghost_shift=6.0)
    frame = plate_frame(stokes_images(example.capture, 0.005), 25.0)
    found, error = refined_incidence(frame, example.scene.replace(incidence_deg=69.0))
    assert 0 < error < 2
    assert abs(found - 70) < max(4 * error, 0.5)


@pytest.mark.parametrize(
    ("error", "text"),
    [(0.034, "+- 0.03 "), (0.41, "+- 0.41 "), (3.26, "+- 3.3 "), (41.0, "+- 41 "), (None, ""), (math.inf, "")],
)
def test_an_error_is_said_with_two_digits(error: float | None, text: str) -> None:
    assert error_of(error) == text


def test_the_sentence_tells_values_with_their_errors() -> None:
    scene = SceneParameters(61.2, 25.0, 0.0, focal_px=500.0, bend_deg_per_px=(0.02, 0.0, 0.0))
    report = scene_report(scene, BLIND) | {"errors": json_values(SceneErrors(0.4, 0.03, focal_px=12.0))}
    sentence = pane_sentence(report)
    assert "incidence 61.20 +- 0.40 deg (estimated)" in sentence
    assert "focal length 500 +- 12 px (estimated)" in sentence
    assert "bent by 2.0 deg in 100 px (estimated, error not known)" in sentence


def test_two_names_of_the_same_pane_are_both_right() -> None:
    scene = SceneParameters(50.0, 10.0, 6.0)
    found = blend(50, 160, azimuth_deg=190.0, ghost_shift=-6.0)
    result = _found(found)
    numbers = {name: (true, value) for name, true, value, _ in compared(scene, result.scene, result.errors)}
    assert numbers["azimuth_deg"][1] == pytest.approx(10, abs=0.5)
    assert numbers["ghost_shift"][1] == pytest.approx(numbers["ghost_shift"][0], abs=1)


def _found(example):
    from polaropt.estimation.ladder import find_scene

    return find_scene(example.capture, BLIND, 0.005)


def test_the_study_counts_what_lies_within_two_errors() -> None:
    rows = [
        Row("ghosts", 0, i, 50.0, "incidence_deg", 50.0, 50.0 + away, 1.0) for i, away in enumerate((0, 1, -1.9, 3))
    ]
    assert "| ghosts | incidence_deg | 4 | 75 % |" in tables(frame_of(Row, rows))
    scene = random_scene("curved", 192, np.random.default_rng(0))
    assert scene.rung == "curved"
    assert max(map(abs, scene.bend_deg_per_px)) * 96 <= 8


@pytest.mark.parametrize("incidence_deg", [40.0, 65.0, 80.0])
def test_gains_move_incidence_and_azimuth_of_light_that_passes_a_pane_by_their_errors(incidence_deg: float) -> None:
    scene, spread, angles = SceneParameters(incidence_deg, 20.0, 0.0), 0.004, np.radians([0.0, 45.0, 90.0, 135.0])

    def share(deg: np.ndarray) -> np.ndarray:
        """What a pane polarizes of unpolarized light that passes it."""
        (par, perp, _), _ = in_place_weights(np.cos(np.radians(deg)), scene.index, *scene.sheets)
        return (par - perp) / (par + perp)

    polarized = float(share(np.array([incidence_deg]))[0])
    light = 0.5 * (1 + polarized * np.cos(2 * (angles - math.radians(20))))
    taken = light * np.random.default_rng(0).normal(1, spread, (2000, 4))
    s0 = taken.sum(axis=1) / 2
    s1, s2 = ((taken[:, i] - taken[:, i + 2]) / s0 for i in range(2))
    azimuth = np.degrees(np.arctan2(s2, s1) / 2) - 20
    grid = np.linspace(1, 89, 2000)
    incidence = np.interp(np.hypot(s1, s2), share(grid), grid) - incidence_deg
    stated = errors_of_gains(spread / 2, polarized, scene)
    # Light that a pane polarizes is a little brighter at one angle than at the next.
    assert stated == pytest.approx((incidence.std(), azimuth.std()), rel=0.15)


def test_photographs_that_add_up_tell_of_no_gains() -> None:
    assert errors_of_gains(0.0, 0.1, SceneParameters(60.0, 0.0, 0.0)) == (0.0, 0.0)


def test_nothing_but_gains_leaves_the_pane_unknown() -> None:
    incidence, azimuth = errors_of_gains(1.0, 0.0, SceneParameters(60.0, 0.0, 0.0))
    assert incidence <= 90
    assert azimuth == pytest.approx(45)


def test_errors_of_a_pane_reach_as_far_as_wrong_gains_lead() -> None:
    example = blend(60, 128, ghost_shift=0.0)
    gains = np.float32((1.01, 0.996, 0.992, 0.988))[:, None, None, None]
    asked = BLIND.replace(ghost_shift=0.0)
    uneven = example.capture.replace(intensities=example.capture.intensities * gains)
    wrong = estimate(uneven, asked, match_photographs=False)
    away = abs(turn_between(wrong.scene.azimuth_deg, 25))
    right = estimate(example.capture, asked)
    assert right.errors.azimuth_deg < 0.3 < away < 2 * wrong.errors.azimuth_deg
    assert abs(wrong.scene.incidence_deg - 60) < 2 * wrong.errors.incidence_deg


def test_a_bent_pane_from_afar_is_as_well_the_one_that_leans_the_other_way() -> None:
    scene = SceneParameters(56.0, 302.0, 3.0, bend_deg_per_px=(0.04, 0.03, -0.05))
    other = SceneParameters(56.0, 122.0, -3.0, bend_deg_per_px=(-0.04, -0.03, 0.05))
    errors = SceneErrors(1.0, 1.0, 1.0, bend_deg_per_px=(0.01, 0.01, 0.01))
    assert all(true == value for _, true, value, _ in compared(scene, other, errors))
    # A lens tells which way it leans.
    numbers = compared(scene.replace(focal_px=200.0), other.replace(focal_px=200.0), errors)
    assert [true - value for name, true, value, _ in numbers if name == "bend_deg_per_px"] == [0.08, 0.06, -0.1]
