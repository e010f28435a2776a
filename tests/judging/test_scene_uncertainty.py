"""What a scene's own errors add to the layers': enough to cover one that is off by so much, nothing if it is known."""

from __future__ import annotations

import numpy as np
import pytest

import polaropt.solving.solution
from polaropt import separate
from polaropt.capture.noise import measured_noise
from polaropt.judging.loss import _chance, scene_loss
from polaropt.judging.uncertainty import doubts, scene_variance
from polaropt.optics.rivals import Rival, widened
from polaropt.optics.scene import SceneErrors, SceneParameters
from polaropt.simulation.metrics import psnr_db
from polaropt.solving import Problem, Weights
from polaropt.solving.solution import tiles
from tests.blends import Blend, blend

BLIND = SceneParameters(None, None, None)


def added(example: Blend, scene: object, errors: SceneErrors) -> np.ndarray:
    noise, growth = measured_noise(example.capture)
    return scene_variance(example.capture, noise, doubts(scene, errors), growth=growth)


@pytest.mark.parametrize(
    ("scene", "name", "off"),
    [
        ({"incidence_deg": 80.0}, "incidence_deg", 1.5),
        ({"incidence_deg": 75.0, "noise": 0.002}, "ghost_shift", 1.0),
        ({"incidence_deg": 70.0, "ghost_shift": 0.0, "focal_px": 250.0, "noise": 0.002}, "incidence_deg", 3.0),
        ({"incidence_deg": 70.0, "ghost_shift": 0.0, "focal_px": 250.0, "noise": 0.002}, "focal_px", 100.0),
        ({"incidence_deg": 70.0, "ghost_shift": 0.0, "focal_px": 250.0, "noise": 0.002}, "azimuth_deg", 4.0),
    ],
)
def test_a_scene_that_is_off_by_its_error_is_covered(scene, name, off):
    example = blend(size=96, **scene)
    wrong = example.scene.replace(**{name: getattr(example.scene, name) + off})
    result = separate(example.capture, wrong)
    miss = np.abs(result.layers - example.layers)
    variance = added(example, wrong, SceneErrors(**{name: off}))
    without, covered = (
        (miss <= 2 * stated).reshape(2, -1).mean(axis=1)
        for stated in (result.uncertainty, np.sqrt(result.uncertainty**2 + variance))
    )
    assert without.min() < 0.9
    assert (covered >= 0.9).all()


@pytest.mark.parametrize("incidence", [45.0, 65.0])
def test_of_photographs_without_noise_nothing_is_said_that_no_picture_shows(incidence):
    """A thousandth of a degree is many times what rounding leaves, and loses less than anybody sees."""
    example = blend(incidence, 96, noise=0.0, ghost_shift=0.0)
    result = separate(example.capture, BLIND)
    assert all(psnr_db(*pair, border=16) > 50 for pair in zip(result.layers, example.layers, strict=True))
    assert not {"SCENE_UNCERTAIN", "MODEL_DOES_NOT_EXPLAIN"} & {one.name for one in result.diagnostics.warnings}


def test_a_scene_that_is_given_adds_nothing():
    example = blend(60, 96)
    blind = separate(example.capture, BLIND)
    given = separate(example.capture, blind.scene)
    assert doubts(given.scene, given.errors) == ()
    np.testing.assert_allclose(
        blind.uncertainty**2, given.uncertainty**2 + added(example, blind.scene, blind.errors), rtol=1e-3
    )
    assert (blind.uncertainty > given.uncertainty).mean() > 0.9


def test_variance_grows_with_the_square_of_the_error():
    example = blend(60, 64)
    once, twice = (added(example, example.scene, SceneErrors(incidence_deg=error)).sum() for error in (0.5, 1.0))
    assert twice == pytest.approx(4 * once, rel=0.1)


@pytest.mark.parametrize("incidence_deg", [0.0, 0.3, 89.9])
def test_errors_beyond_what_a_pane_can_have_stay_within_its_range(incidence_deg):
    example = blend(60, 48)
    scene = example.scene.replace(incidence_deg=incidence_deg)
    errors = SceneErrors(incidence_deg=50.0, ghost_shift=float("inf"))
    for doubt in doubts(scene, errors):
        assert 0 <= doubt.below.incidence_deg <= doubt.above.incidence_deg < 90
        assert doubt.above.ghost_shift - doubt.below.ghost_shift < 20


def test_glass_whose_tint_is_hardly_known_does_not_brighten_what_is_behind_it():
    # It ended with an error: an absorption of -0.25.
    scene = SceneParameters(50.0, 20.0, 3.0, absorption=0.1)
    moved = {doubt.number: doubt for doubt in doubts(scene, SceneErrors(absorption=0.35))}
    assert moved["absorption"].below.absorption == pytest.approx(0)
    assert moved["absorption"].above.absorption == pytest.approx(0.2)


def test_each_number_of_a_bend_is_in_doubt_and_ghosts_are_left_out():
    example = blend(60, 48)
    scene = example.scene.replace(bend_deg_per_px=(0.02, 0.0, 0.01))
    doubtful = doubts(scene, SceneErrors(1.0, bend_deg_per_px=(0.004, 0.004, 0.004)))
    assert len(doubtful) == 4
    assert not any(doubt.below.has_ghosts or doubt.above.has_ghosts for doubt in doubtful)
    assert doubtful[-1].above.bend_deg_per_px == pytest.approx((0.02, 0.0, 0.014))


def test_tiles_add_what_the_whole_adds(monkeypatch):
    example = blend(75, 200, color=False)
    whole = separate(example.capture, example.scene.replace(incidence_deg=None))
    monkeypatch.setattr(polaropt.solving.solution, "tiles", lambda height, width: tiles(height, width, 160))
    parts = separate(example.capture, whole.scene, scene_errors=whole.errors)
    assert np.median(parts.uncertainty / whole.uncertainty) == pytest.approx(1, abs=0.15)


@pytest.mark.parametrize(("incidence_deg", "error"), [(80.0, 1.5), (60.0, 1.0), (30.0, 3.0)])
def test_the_loss_that_is_expected_is_that_of_a_scene_off_by_its_error(incidence_deg, error):
    example = blend(incidence_deg, 96, noise=0.002)

    def mean_square(scene):
        miss = separate(example.capture, scene).layers - example.layers
        return np.square(miss).reshape(2, -1).mean(axis=1)

    known = mean_square(example.scene)
    moved = [example.scene.replace(incidence_deg=incidence_deg + sign * error) for sign in (-1, 1)]
    true = 10 * np.log10(np.mean([mean_square(scene) for scene in moved], axis=0) / known)
    noise, growth = measured_noise(example.capture)
    loss = scene_loss(example.capture, noise, example.scene, SceneErrors(incidence_deg=error), known, growth)
    assert loss is not None
    assert (loss.number, loss.error) == ("incidence_deg", error)
    assert loss.transmission_db == pytest.approx(true[0], rel=0.35, abs=1)
    assert loss.reflection_db == pytest.approx(true[1], rel=0.35, abs=1)


def test_the_loss_is_that_of_the_middle_of_the_frame_about_its_own_middle(monkeypatch):
    middles = []

    def seen(part, noise, doubtful, center, growth):
        middles.append((part.shape[-2:], center))
        return scene_variance(part, noise, doubtful, center, growth)

    monkeypatch.setattr("polaropt.judging.loss._SIDE", 64)
    monkeypatch.setattr("polaropt.judging.loss.scene_variance", seen)
    example = blend(60, 192, ghost_shift=0.0, focal_px=200.0)
    scene_loss(example.capture, 0.005, example.scene, SceneErrors(incidence_deg=1.0), np.full(2, 1e-4))
    # A part of 64 px in the middle of 192 begins at 64; the frame's middle is its pixel 95.5.
    assert middles[0] == ((64, 64), (31.5, 31.5))


def test_the_number_that_costs_most_is_named_and_rivals_of_a_shift_cost_nothing():
    example = blend(70, 64, ghost_shift=0.0, focal_px=125.0)
    noise, growth = measured_noise(example.capture)

    def loss(**errors):
        of_noise = np.full(2, noise**2)
        return scene_loss(example.capture, noise, example.scene, SceneErrors(**errors), of_noise, growth)

    assert loss(incidence_deg=1.0, focal_px=0.1).number == "incidence_deg"
    assert loss(incidence_deg=0.01, focal_px=30.0).number == "focal_px"
    assert loss() is None
    assert loss(ghost_shift=3.0) is None


@pytest.mark.parametrize("weights", [[2.2], [0.3, 0.3, 0.3], [5.0, 0.1], [1.0, 0.5, 0.2, 0.1]])
def test_the_chance_of_a_loss_is_that_of_normal_errors(weights):
    drawn = np.square(np.random.default_rng(0).standard_normal((20000, len(weights)))) @ weights
    assert _chance(np.array(weights), 1.0) == pytest.approx((drawn > 1).mean(), abs=0.02)


def test_errors_of_polarized_light_cost_the_layers_as_well():
    example = blend(60, 64, transmission_polarization=(0.6, 140.0))
    noise, growth = measured_noise(example.capture)
    of_noise = np.full(2, noise**2)
    errors = SceneErrors(incidence_deg=0.01, transmission_polarization=(0.1, 5.0))
    loss = scene_loss(example.capture, noise, example.scene, errors, of_noise, growth)
    assert loss.number == "transmission_polarization"
    assert loss.chance > 0.5


@pytest.mark.parametrize(("incidence_deg", "chance"), [(30.0, 0.2), (60.001, 0.0)])
def test_another_pane_costs_the_layers_much_as_often_as_it_is_the_true_one(incidence_deg, chance):
    example = blend(60, 64)
    noise, growth = measured_noise(example.capture)
    other = Rival(example.scene.replace(incidence_deg=incidence_deg), 0.2)
    near, of_noise = SceneErrors(incidence_deg=0.001), np.full(2, noise**2)
    loss = scene_loss(example.capture, noise, example.scene, near, of_noise, growth, [other])
    assert loss.chance == pytest.approx(chance, abs=1e-3)
    assert (loss.transmission_db > 1) == (chance > 0)
    # Were it an error of that size, the scene found would hardly be the true one.
    wide = widened(near, example.scene, [other])
    assert loss.error == pytest.approx(wide.incidence_deg)
    if chance:
        assert scene_loss(example.capture, noise, example.scene, wide, of_noise, growth).chance > 0.5


def test_degree_and_angle_of_polarized_light_are_in_doubt_where_ghosts_tell_them():
    scene = SceneParameters(60.0, 25.0, 5.0, transmission_polarization=(0.8, 140.0))
    errors = SceneErrors(transmission_polarization=(0.3, 5.0), reflection_polarization=(0.1, 20.0))
    degree, angle = doubts(scene, errors)
    assert degree.below.transmission_polarization == pytest.approx((0.5, 140.0))
    assert degree.above.transmission_polarization == pytest.approx((1.0, 140.0))
    assert degree.n_errors == pytest.approx(2.5 / 3)
    assert angle.above.transmission_polarization == pytest.approx((0.8, 145.0))
    assert doubts(scene.replace(ghost_shift=0.0), errors) == ()


def test_what_a_rival_makes_of_the_layers_counts_by_its_chance():
    example = blend(60, 64, ghost_shift=0.0, transmission_polarization=(0.6, 140.0))
    noise, _ = measured_noise(example.capture)
    other = example.scene.replace(incidence_deg=50.0)
    likely, sure = (
        scene_variance(example.capture, noise, doubts(example.scene, SceneErrors(), [Rival(other, chance)]))
        for chance in (0.25, 1.0)
    )
    np.testing.assert_allclose(4 * likely, sure, rtol=1e-4)
    moved = [Problem(example.capture, scene, noise, Weights()).known.layers for scene in (example.scene, other)]
    assert sure.mean() == pytest.approx(np.square(moved[1] - moved[0]).mean(), rel=0.3)
