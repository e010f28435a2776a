"""What a capture tells of its pane: small simulated captures of photographs that ship with scikit-image."""

from __future__ import annotations

import math

import numpy as np
import pytest
from skimage import data

from polaropt import SeparationWarning, separate
from polaropt.capture.capture import Capture
from polaropt.estimation.flat.estimate import SceneEstimate, estimate_scene
from polaropt.estimation.flat.search import Trial, _Judged
from polaropt.optics.scene import SceneParameters, ghost_step
from studies.camera import take
from studies.photographs import shipped_pairs
from studies.scenes import protocol
from tests.blends import Blend, blend

SIZE = 160


def assert_same_scene(
    found: SceneEstimate, true: SceneParameters, incidence: float = 1.5, azimuth: float = 0.7, shift: float = 0.5
) -> None:
    """Azimuth + 180 with the opposite shift is the same scene."""
    turn = found.scene.azimuth_deg - true.azimuth_deg
    assert abs(found.scene.incidence_deg - true.incidence_deg) < incidence
    assert abs((turn + 90) % 180 - 90) < azimuth
    sense = 1 if math.cos(math.radians(turn)) > 0 else -1
    assert abs(sense * found.scene.ghost_shift - true.ghost_shift) < shift


@pytest.fixture(scope="module")
def capture() -> Blend:
    return blend(60, SIZE, ghost_shift=-6.4, azimuth_deg=140)


def test_all_is_found_blind(capture: Blend) -> None:
    found = estimate_scene(capture.capture)
    assert found.scene.complete
    assert_same_scene(found, capture.scene)
    assert found.polarized
    assert found.axis_margin > 0
    assert found.overlap.shape == found.incidence_grid_deg.shape
    assert found.shift_misfit.min() == 0


def test_trials_whose_edges_leave_other_parts_out_are_compared_by_the_errors_of_each() -> None:
    parts = np.array([1.0, 2.0, 3.0, 4.0])
    one, other = (_Judged(Trial(50.0, 0.0, 0.0), 0.0, score, (parts, parts[:n])) for score, n in ((0.0, 4), (-1.0, 2)))
    assert 0 < one.chance_beside(other) < 0.5 < other.chance_beside(one) < 1


@pytest.mark.parametrize(("incidence_deg", "ghost_shift"), [(40, 4.1), (75, -5.0)])
def test_both_sides_of_brewster_and_both_senses(incidence_deg: float, ghost_shift: float) -> None:
    true = blend(incidence_deg, SIZE, ghost_shift=ghost_shift, azimuth_deg=75)
    assert_same_scene(estimate_scene(true.capture), true.scene, incidence=2, shift=0.6)


def test_ghosts_far_off_that_explain_hardly_more_are_none() -> None:
    pair = shipped_pairs(128, 64)[0]
    found = estimate_scene(take(protocol(20.0), pair).capture).scene
    assert found.incidence_deg == pytest.approx(20, abs=1)
    assert abs(found.values()[2]) < 3


def test_near_normal_incidence_still_tells_the_axis() -> None:
    true = blend(15, SIZE, ghost_shift=0.6)
    found = estimate_scene(true.capture)
    assert_same_scene(found, true.scene, incidence=5, azimuth=2, shift=1.0)
    assert found.errors.azimuth_deg < 2


def test_monochrome_and_three_angles() -> None:
    true = blend(60, SIZE, color=False, angles_deg=(0.0, 60.0, 120.0), noise=0.002)
    assert_same_scene(estimate_scene(true.capture), true.scene, incidence=3, shift=0.6)


def test_given_fields_stay(capture: Blend) -> None:
    given = SceneParameters(incidence_deg=55.0, azimuth_deg=None, ghost_shift=None, refractive_index=1.52, n_bounces=3)
    found = estimate_scene(capture.capture, given).scene
    assert (found.incidence_deg, found.refractive_index, found.n_bounces) == (55.0, 1.52, 3)
    given = SceneParameters(incidence_deg=None, azimuth_deg=139.0, ghost_shift=0.0)
    found = estimate_scene(capture.capture, given).scene
    assert (found.azimuth_deg, found.ghost_shift) == (139.0, 0.0)


def test_a_complete_scene_is_returned(capture: Blend) -> None:
    assert estimate_scene(capture.capture, capture.scene).scene == capture.scene


@pytest.mark.parametrize("kind", ["paper", "plate"])
def test_thickness_ties_the_shift_to_the_incidence(kind: str) -> None:
    step = ghost_step(65, 1.5, 8, kind)
    true = blend(65, SIZE, ghost_shift=-step)
    found = estimate_scene(true.capture, thickness_px=8, thickness_kind=kind)
    assert abs(found.scene.ghost_shift) == pytest.approx(ghost_step(found.scene.incidence_deg, 1.5, 8, kind), abs=1e-9)
    assert_same_scene(found, true.scene)


def test_a_single_surface_has_no_ghosts() -> None:
    true = blend(50, SIZE, ghost_shift=0.0, azimuth_deg=90, refractive_index=1.33, single_surface=True)
    given = SceneParameters(None, None, None, refractive_index=1.33, single_surface=True)
    found = estimate_scene(true.capture, given)
    assert found.scene.ghost_shift == 0
    assert_same_scene(found, true.scene, incidence=2)


def test_masked_pixels_do_not_count(capture: Blend) -> None:
    intensities = capture.capture.intensities.copy()
    valid = np.ones(intensities.shape, bool)
    valid[..., 30:60, 40:90] = False
    valid[0, :, 100:104, 20:24] = False
    intensities[~valid] = 1
    found = estimate_scene(Capture.of_planes(intensities, capture.capture.angles_deg, valid))
    assert_same_scene(found, capture.scene, incidence=2.5)


def test_no_polarization_is_said_and_harmless() -> None:
    photograph = data.camera()[100 : 100 + SIZE, 200 : 200 + SIZE] / 510
    noise = 0.005 * np.random.default_rng(0).standard_normal((4, SIZE, SIZE))
    found = estimate_scene(Capture(photograph + noise))
    assert not found.polarized
    assert all(np.isfinite(value) for value in found.scene.values())
    assert np.isfinite(found.overlap).all()
    assert np.isfinite(found.shift_misfit).all()


def test_even_the_smallest_capture_gives_something_finite() -> None:
    tiny = blend(60, 16, ghost_shift=1.0)
    assert all(np.isfinite(value) for value in estimate_scene(tiny.capture).scene.values())


def test_constant_layers_give_something_finite() -> None:
    flat = np.broadcast_to(np.array([0.3, 0.35, 0.4, 0.35])[:, None, None], (4, 40, 40)).copy()
    flat[:, 0, 0] += 0.01
    assert all(np.isfinite(value) for value in estimate_scene(Capture(flat)).scene.values())


@pytest.mark.parametrize("told", [6.0, -6.0, 3.0, 12.0, 1000.0])
def test_photographs_speak_against_another_ghost_shift_than_theirs(told):
    example = blend(60, 160, ghost_shift=6.0)
    result = separate(example.capture, SceneParameters(None, None, told), model="ghosts")
    assert (SeparationWarning.SHIFT_DOUBTFUL in result.diagnostics.warnings) == (abs(told) != 6)
    assert result.scene.ghost_shift == told
