"""Every warning is given where it is deserved, and none where it is not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from polaropt import Capture, ResultWarning, SceneParameters, SeparationWarning, StoppingRule, separate
from polaropt.capture.checks import visible_shift
from polaropt.capture.files.write import encode_srgb
from polaropt.capture.noise import noise_level
from polaropt.estimation.flat.estimate import estimate_scene
from polaropt.estimation.motion import agreeing_photographs, still_photographs
from polaropt.judging.loss import SceneLoss
from polaropt.judging.warnings import diagnose, noise_share
from polaropt.reporting.files import write_separation
from polaropt.reporting.pictures import misfit_map
from tests.blends import blend
from tests.shifted import shifted_blend

QUICK = StoppingRule(max_evaluations=4)
# Of one clear pane.
BLIND = SceneParameters(None, None, None)


def warnings_of(capture, scene=None):
    return set(separate(capture, scene, stopping=QUICK).diagnostics.warnings)


def told(capture, scene=None, **changes):
    """What is said of a capture by itself, its solution being perfect."""
    solution = {"misfit_ratio": 1.0, "reflection_unknown": 0.3, "estimate": None, **changes}
    return set(diagnose(capture, noise_level(capture), scene=scene, **solution).warnings)


def detail_correlation(image, truth):
    """Correlation of what is finer than about 5 px, away from the border."""
    fine = [layer - gaussian_filter(layer, (*(0,) * (layer.ndim - 2), 2, 2)) for layer in (image, truth)]
    return np.corrcoef(*(layer[..., 16:-16, 16:-16].ravel() for layer in fine))[0, 1]


@pytest.mark.parametrize(("noise", "color"), [(0.002, True), (0.01, False)])
@pytest.mark.parametrize("incidence", [60, 70, 80])
def test_good_captures_earn_no_warning(incidence, noise, color):
    example = blend(incidence, 96, color=color, noise=noise)
    assert warnings_of(example.capture, example.scene) == set()


@pytest.mark.parametrize("incidence", [40, 80])
def test_good_captures_earn_no_warning_blind(incidence):
    assert warnings_of(blend(incidence, 112).capture) == set()


@pytest.mark.parametrize(("noise", "color"), [(0.002, False), (0.01, True)])
@pytest.mark.parametrize("incidence", [20, 30, 40, 50])
def test_a_reflection_is_said_to_be_unknown_where_its_detail_is_not_the_true_one(incidence, noise, color):
    example = blend(incidence, 96, color=color, noise=noise)
    result = separate(example.capture, example.scene, stopping=QUICK)
    diagnostics = result.diagnostics
    correlation = detail_correlation(result.layers[1], example.layers[1])
    # Sparse edges tell more of it than the spectra by which it is judged.
    assert -0.15 < correlation - np.sqrt(1 - diagnostics.reflection_unknown) < 0.2
    said = SeparationWarning.REFLECTION_NOT_IDENTIFIABLE in diagnostics.warnings
    assert said or correlation > 0.23
    assert not said or correlation < 0.5


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("angles", [(0, 60, 120), (5, 40, 77, 110, 150)])
def test_good_captures_at_other_angles_earn_no_warning(angles, seed):
    example = blend(60, 96, angles_deg=angles, azimuth_deg=60 * seed)
    assert told(example.capture, example.scene) == set()


@pytest.mark.parametrize(("angles", "noise", "asked"), [((0, 45, 90), 0.003, BLIND), ((0, 60, 120), 0.01, None)])
def test_three_good_photographs_earn_no_warning(angles, noise, asked):
    example = blend(60, 128, color=False, angles_deg=angles, noise=noise)
    assert separate(example.capture, asked).diagnostics.warnings == ()


def test_glass_seen_frontally():
    example = blend(8, 96)
    # What is frontal and yet told needs no warning.
    assert told(example.capture, example.scene) == set()
    uncertain = SceneLoss(8.0, 8.0, 0.6, "incidence_deg", 1.0)
    assert SeparationWarning.NEAR_NORMAL in told(example.capture, example.scene, loss=uncertain)
    found = warnings_of(example.capture, example.scene)
    assert {SeparationWarning.NEAR_NORMAL, SeparationWarning.REFLECTION_NOT_IDENTIFIABLE} <= found
    assert SeparationWarning.NOISE_TOO_HIGH not in found


def test_an_unpolarized_capture_is_not_said_to_be_frontal():
    image = blend(60, 64).layers[0]
    capture = Capture.of_planes(
        np.stack([image / 2] * 4) + 0.005 * np.random.default_rng(0).standard_normal((4, *image.shape))
    )
    found = warnings_of(capture)
    assert {SeparationWarning.NO_POLARIZATION, SeparationWarning.REFLECTION_NOT_IDENTIFIABLE} <= found
    with pytest.warns(ResultWarning, match="is left black, and what there is of it stays in the transmission"):
        separate(capture)
    assert found.isdisjoint({SeparationWarning.NEAR_NORMAL, SeparationWarning.GRAZING})


def test_glass_seen_at_a_grazing_angle():
    example = blend(87, 96)
    uncertain = SceneLoss(8.0, 8.0, 0.6, "incidence_deg", 0.2)
    assert SeparationWarning.GRAZING in told(example.capture, example.scene, loss=uncertain)
    assert SeparationWarning.GRAZING in told(example.capture, example.scene, noise_share=0.5)
    # Where it is known and light enough passes the pane, it does no harm.
    assert warnings_of(example.capture, example.scene) == set()


def test_noise_that_hides_the_reflection():
    example = blend(40, 96, noise=0.06)
    found = warnings_of(example.capture, example.scene)
    assert {SeparationWarning.NOISE_TOO_HIGH, SeparationWarning.REFLECTION_NOT_IDENTIFIABLE} <= found


def test_noise_that_hides_everything_though_the_polarization_is_strong():
    example = blend(75, 96, noise=0.25)
    assert SeparationWarning.NOISE_TOO_HIGH in warnings_of(example.capture, example.scene)


@pytest.mark.parametrize("exposure", [0.1, 1.0])
def test_noise_counts_against_what_was_changed_of_the_intensity(exposure):
    example = blend(60, 96, noise=0.0, exposure=exposure)
    intensity = example.capture.stokes[0]
    changed = float(np.sqrt(np.mean(np.square(example.layers[0] - intensity))))
    share = noise_share(example.capture, example.layers[0], (0.2 * changed) ** 2)
    assert share == pytest.approx(0.2, rel=1e-3)
    assert told(example.capture, example.scene, noise_share=share) == set()
    assert told(example.capture, example.scene, noise_share=0.5) == {SeparationWarning.NOISE_TOO_HIGH}


@pytest.mark.parametrize("order", [(0, 2, 1, 3), (0, 1, 3, 2), (1, 0, 2, 3)])
def test_a_wrong_order(order):
    capture = blend(60, 128).capture
    found = told(Capture.of_planes(capture.intensities[list(order)]))
    assert SeparationWarning.ANGLES_SWAPPED in found
    # They break the same identity: one mistake, one warning.
    assert found.isdisjoint({SeparationWarning.GAMMA_ENCODED, SeparationWarning.MISALIGNED})


@pytest.mark.parametrize("order", [(0, 2, 1, 3), (0, 1, 3, 2)])
def test_photographs_in_a_wrong_order_are_not_made_to_agree(order):
    capture = Capture.of_planes(blend(60, 128).capture.intensities[list(order)])
    still = still_photographs(capture)
    assert agreeing_photographs(capture, still) == (capture, still, None)


@pytest.mark.parametrize("color", [False, True])
@pytest.mark.parametrize("incidence", [20, 50, 80])
@pytest.mark.parametrize("distance", [1.0, 2.5, 12.0])
def test_photographs_that_moved(incidence, distance, color):
    shifts = np.array([[0, 0], [distance, 0], [0, distance / 2], [0, 0]])
    found = told(shifted_blend(incidence, 128, shifts, color=color).capture)
    assert SeparationWarning.MISALIGNED in found
    assert SeparationWarning.GAMMA_ENCODED not in found


@pytest.mark.parametrize("incidence", [20, 50, 80])
def test_photographs_that_hardly_moved(incidence):
    shifts = np.array([[0, 0], [0.1, 0], [0, 0.15], [-0.1, 0]])
    assert told(shifted_blend(incidence, 128, shifts).capture) == set()


@pytest.mark.parametrize("shape", [(16, 16), (3, 17, 40), (1, 40, 16)])
def test_small_and_clipped_captures_are_looked_at_too(shape):
    images = np.random.default_rng(0).random((4, *shape))
    assert visible_shift(Capture.of_planes(images)) == 0
    assert visible_shift(Capture.of_planes(np.minimum(images, 0.4), valid=images < 0.4)) == 0


def test_the_cells_of_a_mosaic_do_not_move():
    capture = shifted_blend(60, 128, np.array([[0, 0], [0, 1], [1, 1], [1.0, 0]])).capture
    assert visible_shift(capture) > 0
    capture = capture.with_origin(layout="mono mosaic", sample_type="uint8")
    assert visible_shift(capture) == 0


def test_encoded_values():
    capture = blend(65, 144, noise=0.003).capture
    assert SeparationWarning.GAMMA_ENCODED in told(Capture.of_planes(encode_srgb(np.clip(capture.intensities, 0, 1))))


def test_clipped_pixels():
    capture = blend(60, 96).capture
    valid = capture.intensities < np.quantile(capture.intensities, 0.95)
    assert told(Capture.of_planes(capture.intensities, valid=valid)) == {SeparationWarning.SATURATED}


def test_what_the_model_does_not_explain_is_shown(tmp_path):
    example = blend(60, 96)
    images = example.capture.intensities.copy()
    images[1, :, 20:60, 20:60] = images[1, :, 20:60, 60:20:-1]
    capture = Capture.of_planes(images)
    result = separate(capture, example.scene, stopping=QUICK)
    result = replace(result, diagnostics=replace(result.diagnostics, noise=0.005))
    shown = misfit_map(result, capture)
    assert shown.shape == (96, 96)
    assert shown[25:55, 25:55].mean() > 3 * np.median(shown[:, 70:])
    for warnings, written in (((), False), ((SeparationWarning.MODEL_DOES_NOT_EXPLAIN,), True)):
        folder = tmp_path / str(written)
        folder.mkdir()
        diagnosed = replace(result, diagnostics=replace(result.diagnostics, warnings=warnings))
        report = write_separation(folder, diagnosed, capture)
        assert ((folder / "misfit.tiff").exists(), (folder / "misfit.png").exists()) == (written, written)
        assert (report["misfit_map"] is not None) == written


def test_an_azimuth_that_was_given_wrongly_does_not_accuse_the_angles():
    found = warnings_of(blend(60, 128).capture, SceneParameters(None, 35.0, None))
    assert found.isdisjoint({SeparationWarning.ANGLES_REVERSED, SeparationWarning.ANGLES_ROTATED})


def test_a_scene_that_does_not_fit():
    example = blend(75, 96, noise=0.002)
    wrong = SceneParameters(75.0, 25.0 + 45, 5.3)
    assert SeparationWarning.MODEL_DOES_NOT_EXPLAIN in warnings_of(example.capture, wrong)


def test_light_that_arrives_polarized():
    example = blend(60, 64)
    polarized = example.scene.replace(transmission_polarization=(0.6, 30.0))
    found = estimate_scene(example.capture, example.scene)
    assert told(example.capture, polarized, estimate=found) == {SeparationWarning.POLARIZED_SOURCE}
    # Who gives the polarization knows of it.
    assert told(example.capture, polarized) == set()


@pytest.mark.parametrize("chance", [0.4, 0.6])
def test_errors_of_the_pane_that_cost_the_transmission_much_more_likely_than_not(chance):
    example = blend(60, 64)
    found = told(example.capture, example.scene, loss=SceneLoss(5.0, 0.1, chance, "incidence_deg", 0.5))
    assert found == ({SeparationWarning.SCENE_UNCERTAIN} if chance > 0.5 else set())


@pytest.mark.parametrize(("incidence", "warned"), [(20, True), (60, False)])
def test_gains_that_make_a_pane_of_their_own(incidence, warned):
    # As much as faint polarized light, and little beside what an oblique pane polarizes.
    example = blend(incidence, 96, noise=0.002)
    gains = np.array([1.003, 0.997, 1.003, 0.997], dtype=np.float32)[:, None, None, None]
    found = told(Capture.of_planes(example.capture.intensities * gains), example.scene)
    assert found == ({SeparationWarning.MODEL_DOES_NOT_EXPLAIN} if warned else set())


def test_a_failed_solver():
    assert told(blend(60, 64).capture, finite=False) == {SeparationWarning.SOLVER_FAILED}


@pytest.mark.parametrize("warning", list(SeparationWarning))
def test_every_warning_is_a_sentence(warning):
    assert warning.value[0].isupper()
    assert warning.value.endswith(".")
