"""Standard errors that are stated: they cover the truth, and grow where less is known."""

from __future__ import annotations

import numpy as np
import pytest
import tifffile
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.ndimage import map_coordinates
from skimage.data import astronaut, coffee

import polaropt.judging.precision as precision
import polaropt.judging.uncertainty as uncertainty
import polaropt.solving.solution
from polaropt import separate
from polaropt.capture.capture import Capture, planes_first
from polaropt.capture.files.decode import read_file
from polaropt.inversion.variance import SCALES, Knowledge, variance_table
from polaropt.judging.kernels import interpolated
from polaropt.optics.geometry import pixel_grid, plane_normal, viewing_angles
from polaropt.optics.scene import SceneErrors, SceneParameters
from polaropt.reporting.files import write_uncertainty
from polaropt.simulation.simulator import simulate
from polaropt.solving import Tile
from polaropt.solving.solution import tiles
from studies.coverage import LAYERS, Job, run
from studies.scenes import protocol
from tests.blends import blend
from tests.captured import mono_capture


@pytest.mark.parametrize(("incidence_deg", "color"), [(40.0, True), (60.0, False), (80.0, True), (80.0, False)])
def test_two_standard_errors_cover_nine_of_ten_true_values(incidence_deg, color):
    example = blend(incidence_deg, 128, color=color)
    result = separate(example.capture, example.scene)
    assert result.uncertainty.shape == result.layers.shape
    assert result.uncertainty.dtype == np.float32
    within = np.abs(result.layers - example.layers) <= 2 * result.uncertainty
    for covered in within.reshape(2, -1).mean(axis=1):
        assert 0.9 <= covered <= 0.999


def test_where_a_wide_lens_sees_the_glass_frontally_little_is_known():
    example = blend(20, 96, ghost_shift=0.0, focal_px=60.0, azimuth_deg=0.0, noise=0.003)
    result = separate(example.capture, example.scene)
    x, y = pixel_grid(96, 96, (47.5, 47.5))
    cosine, _, _ = viewing_angles(plane_normal(20, 0), 1 / 60, x, y)
    frontal = cosine > np.cos(np.radians(4))
    oblique = (cosine < np.cos(np.radians(40))) & (cosine > np.cos(np.radians(50)))
    of_reflection = result.uncertainty[1].mean(axis=0)
    assert of_reflection[frontal].mean() > 2 * of_reflection[oblique].mean()
    within = np.abs(result.layers[0] - example.layers[0]) <= 2 * result.uncertainty[0]
    assert within[..., frontal].mean() > 0.9
    assert within.mean() > 0.9


def test_frontal_glass_is_covered_on_average_over_pictures():
    # Slow errors of one picture are few draws.
    rows = [row for pair in range(4) for row in run(Job(protocol(10, noise=0.005), pair, size=128, way="known"))]
    for layer in LAYERS:
        assert 0.9 <= np.mean([row.covered for row in rows if row.layer == layer]) <= 0.99


def test_a_wide_lens_knows_least_of_each_layer_on_its_own_side():
    example = blend(60, 128, ghost_shift=0.0, focal_px=150.0, azimuth_deg=0.0)
    result = separate(example.capture, example.scene)
    sides = (
        result.uncertainty.mean(axis=1)[..., :16].mean(axis=(1, 2)),
        result.uncertainty.mean(axis=1)[..., -16:].mean(axis=(1, 2)),
    )
    x, y = pixel_grid(128, 128, (63.5, 63.5))
    cosine, _, _ = viewing_angles(plane_normal(60, 0), 1 / 150, x, y)
    oblique, frontal = (0, 1) if cosine[:, :16].mean() < cosine[:, -16:].mean() else (1, 0)
    assert sides[oblique][0] > 1.5 * sides[frontal][0]
    assert sides[frontal][1] > 1.5 * sides[oblique][1]
    within = np.abs(result.layers - example.layers) <= 2 * result.uncertainty
    assert (within.reshape(2, -1).mean(axis=1) > 0.9).all()


def test_before_a_wide_lens_what_double_images_hide_is_known_worse():
    """Taken for images in place, 83 % of the reflection lay within two errors."""
    example = blend(40, 128, ghost_shift=8.0, focal_px=120.0, noise=0.004)
    result = separate(example.capture, example.scene)
    within = np.abs(result.layers - example.layers) <= 2 * result.uncertainty
    transmission, reflection = within.reshape(2, -1).mean(axis=1)
    assert transmission > 0.93
    assert reflection > 0.88


def test_clipped_pixels_are_known_worse_and_the_others_as_before():
    example = blend(60, 96)
    valid = example.capture.valid.copy()
    valid[..., 30:60, 30:60] = False
    before = separate(example.capture, example.scene)
    after = separate(Capture.of_planes(example.capture.intensities, example.capture.angles_deg, valid), example.scene)
    inside, far = (..., slice(36, 54), slice(36, 54)), (..., slice(70, 96), slice(70, 96))
    for i in (0, 1):
        assert after.uncertainty[i][inside].min() > 2 * before.uncertainty[i][inside].mean()
        assert after.uncertainty[i][far].mean() == pytest.approx(before.uncertainty[i][far].mean(), rel=0.1)
    assert after.reflection_known[inside].max() < before.reflection_known[inside].mean()


def test_light_from_beyond_the_frame_is_known_worse():
    example = blend(80, 128, azimuth_deg=0.0, ghost_shift=11.0)
    errors = separate(example.capture, example.scene).uncertainty
    first = errors[:, :, :, 2:9].mean(axis=(1, 2, 3))
    last = errors[:, :, :, -9:-2].mean(axis=(1, 2, 3))
    assert (first > 1.2 * last).all()


def test_the_reflection_is_known_best_where_the_pane_is_oblique():
    known = [
        float(separate(example.capture, example.scene).reflection_known.mean())
        for example in (blend(angle, 96) for angle in (10, 40, 60, 80))
    ]
    assert known == sorted(known)
    assert known[0] < 0.2 < 0.5 < known[-1]


def test_tiles_state_what_the_whole_states(monkeypatch):
    example = blend(60, 200, color=False)
    whole = separate(example.capture, example.scene)
    monkeypatch.setattr(polaropt.solving.solution, "tiles", lambda height, width: tiles(height, width, 160))
    parts = separate(example.capture, example.scene)
    assert parts.uncertainty.shape == whole.uncertainty.shape
    ratio = parts.uncertainty / whole.uncertainty
    assert np.median(ratio) == pytest.approx(1, abs=0.15)
    assert np.abs(parts.reflection_known - whole.reflection_known).mean() < 0.1


def test_without_polarization_each_layer_may_be_all_of_the_light():
    random = np.random.default_rng(0)
    picture = random.uniform(0.2, 0.4, (48, 48))
    capture = Capture(picture + 0.005 * random.standard_normal((4, 48, 48)))
    result = separate(capture)
    assert (result.uncertainty >= result.layers[0]).all()
    assert (result.reflection_known == 0).all()


def knowledge(told: float, cross_share: float, power: float) -> Knowledge:
    frequencies = np.linspace(0.05, 6, 40, dtype=np.float32)
    prior = np.broadcast_to(power / frequencies, (2, 3, 40)).astype(np.float32)
    flat = np.full((2, 40), told, dtype=np.float32)
    cross = np.full(40, (cross_share * told) ** 2, dtype=np.float32)
    return Knowledge(flat, cross, prior, np.full(40, 1 / 40, np.float32), frequencies, np.eye(3))


@settings(max_examples=40, deadline=None)
@given(st.floats(1, 1e5), st.floats(0, 0.99), st.floats(1e-4, 1))
def test_errors_fall_with_precision_and_grow_with_texture(told, cross_share, power):
    table = variance_table(knowledge(told, cross_share, power), np.array([0.01, 0.1, 1.0]))
    assert np.isfinite(table).all()
    assert (table[..., -1] <= 1.001).all()
    errors = table[..., :-1]
    assert (np.diff(errors, axis=0) <= 1e-6).all()
    for axis in (1, 2):
        assert (np.diff(errors, axis=axis) >= -1e-6).all()


def test_detail_that_was_not_found_is_unknown():
    white = np.random.default_rng(0).standard_normal((1, 64, 64)).astype(np.float32)
    squared = 2 - 2 * np.cos(2 * np.pi * np.fft.fftfreq(64)).astype(np.float32)
    flat = np.ones(white.size, dtype=np.float32)
    known = Knowledge(
        told=np.stack([3 * flat, 3 * flat]),
        cross=0 * flat,
        prior=np.ones((2, 1, white.size), dtype=np.float32),
        share=flat / white.size,
        squared_frequency=np.add.outer(squared, squared).ravel(),
        basis=np.eye(1),
    )
    # Three parts told to one before: three quarters of the power are found where the spectrum is right.
    assert known.unknown_detail(np.sqrt(np.float32(0.75)) * white) == pytest.approx(0.25, rel=0.1)
    assert known.unknown_detail(0.1 * white) > 0.9
    assert known.unknown_detail(0 * white) == 1


def test_what_is_known_never_exceeds_what_a_layer_may_have():
    known = knowledge(1e-3, 0.0, 0.01)
    np.testing.assert_allclose(known.uncertainty(), known.prior, rtol=1e-3)
    assert (known.allowed().prior > 2 * known.prior).all()
    sure = knowledge(1e9, 0.0, 1.0)
    np.testing.assert_allclose(sure.allowed().prior, sure.prior, rtol=1e-3)


@settings(max_examples=25, deadline=None)
@given(st.integers(1, 4), st.integers(0, 2**31))
def test_the_table_is_read_as_scipy_reads_it(precisions, seed):
    random = np.random.default_rng(seed)
    table = random.uniform(0, 1, (precisions, len(SCALES), len(SCALES), 3)).astype(np.float32)
    reach = np.array([precisions, len(SCALES), len(SCALES)])[:, None, None]
    positions = (random.uniform(-1, 1.2, (3, 5, 7)) * reach).astype(np.float32)
    out = np.empty((3, 5, 7), dtype=np.float32)
    interpolated(table, positions, out, 0, 5)
    inside = np.clip(positions, 0, reach - 1).reshape(3, -1)
    expected = [map_coordinates(table[..., v], inside, order=1, mode="nearest").reshape(5, 7) for v in range(3)]
    np.testing.assert_allclose(out, expected, atol=1e-5)


@pytest.mark.parametrize("color", [False, True])
def test_files_hold_the_errors_and_the_report_what_is_faded(tmp_path, color):
    example = blend(10, 64, color=color)
    result = separate(example.capture, example.scene)
    told, _ = write_uncertainty(tmp_path, result)
    for i, name in enumerate(("transmission", "reflection")):
        written = tifffile.imread(tmp_path / f"{name}_error.tiff")
        # Written to three digits.
        np.testing.assert_allclose(planes_first(written), result.uncertainty[i], rtol=6e-4)
        assert told["typical_error"][name] == pytest.approx(np.sqrt(np.mean(written**2)), rel=1e-3)
    known = tifffile.imread(tmp_path / "reflection_known.tiff")
    np.testing.assert_allclose(known, result.reflection_known, rtol=6e-4, atol=1e-6)
    assert told["reflection_faded"]["share_of_pixels"] > 0.9
    picture = read_file(tmp_path / "uncertainty.png").pixels
    assert picture.shape[1] > 3 * 64
    marked = (picture[..., 0].astype(int) - picture[..., 1] > 40).sum()
    assert marked > 0.8 * 64 * 64


@pytest.mark.parametrize("mosaic", [False, True])
@pytest.mark.parametrize("pane", [SceneParameters(60.0, 25.0, 4.0), SceneParameters(55.0, 25.0, 0.0, focal_px=200.0)])
def test_large_frames_state_on_blocks_what_every_pixel_would(monkeypatch, pane, mosaic):
    behind, mirrored = coffee()[100:228, 100:228], astronaut()[30:158, 160:288]
    capture = simulate(behind, mirrored, pane, noise=0.005)
    if mosaic:
        capture = mono_capture(capture.intensities.mean(axis=1))
    found = pane.replace(incidence_deg=pane.values()[0] + 0.3)
    result = separate(capture, found)
    errors = SceneErrors(incidence_deg=0.6, ghost_shift=0.1 if pane.ghost_shift else None)

    def maps(least_side):
        monkeypatch.setattr(uncertainty, "_LEAST_COARSE", least_side)
        arguments = {**result.judge.keywords, "of_scene": errors}
        strips = result.judge.func(*result.judge.args, **arguments)
        return np.concatenate([strip.uncertainty.standard_error for strip in strips], axis=-2)

    fine, coarse = maps(10**6), maps(0)
    typical = [np.sqrt(np.square(each.reshape(2, -1)).mean(axis=1)) for each in (fine, coarse)]
    np.testing.assert_allclose(typical[1], typical[0], rtol=0.05)
    assert np.median(np.abs(coarse / fine - 1)) < 0.05


def test_what_a_lens_s_errors_do_is_compared_in_the_middle_of_the_frame_about_its_own_middle(monkeypatch):
    monkeypatch.setattr(uncertainty, "_LEAST_COARSE", 0)
    monkeypatch.setattr(uncertainty, "_COMPARED", 64)
    middles = []

    def seen(part, noise, doubtful, center, growth):
        middles.append((part.shape[-2:], center))
        return scene_variance(part, noise, doubtful, center, growth)

    scene_variance = uncertainty.scene_variance
    monkeypatch.setattr(uncertainty, "scene_variance", seen)
    example = blend(60, 192, ghost_shift=0.0, focal_px=200.0)
    uncertainty._Blocks.of(
        example.capture, 0.005, uncertainty.doubts(example.scene, SceneErrors(incidence_deg=1)), None
    )
    # A part of 64 px in the middle of 192 begins at 64; the frame's middle is its pixel 95.5.
    assert middles[0] == ((64, 64), (31.5, 31.5))


def test_what_is_done_of_a_frame_of_several_tiles_is_told_and_its_rows_come_once(monkeypatch):
    monkeypatch.setattr(polaropt.solving.solution, "tiles", lambda height, width: tiles(height, width, 96))
    example = blend(60, 160, color=False)
    result = separate(example.capture, example.scene)
    done = []
    strips = list(result.judge.func(*result.judge.args, **{**result.judge.keywords, "tell": done.append}))
    assert done == sorted(done)
    assert done[-1] == pytest.approx(1)
    assert len(done) > 2
    assert [row for strip in strips for row in range(160)[strip.rows]] == list(range(160))


def test_a_table_needs_some_of_the_frequencies_alone(monkeypatch):
    random, n = np.random.default_rng(0), 8192
    squared = np.square(random.uniform(0.01, np.pi, n)).astype(np.float32)
    # What a pane with ghosts tells depends on the direction, too.
    told = (100 * (1 + 0.8 * np.cos(random.uniform(0, 2 * np.pi, (2, n))))).astype(np.float32)
    prior = np.broadcast_to(1e-3 / squared, (2, 1, n)).astype(np.float32)
    cross = (0.3 * told[0] * told[1]).astype(np.float32)
    known = Knowledge(told, cross, prior, np.full(n, 1 / n, np.float32), squared, np.ones((1, 1)))
    some = variance_table(known, np.array([0.1, 1.0]))
    monkeypatch.setattr("polaropt.inversion.variance._MANY", n + 1)
    np.testing.assert_allclose(some, variance_table(known, np.array([0.1, 1.0])), rtol=0.05)


@pytest.mark.parametrize("coarse", [False, True])
def test_before_a_lens_a_tile_s_errors_are_those_of_its_place_in_the_frame(monkeypatch, coarse):
    example = blend(60, 192, ghost_shift=0.0, focal_px=200.0, azimuth_deg=0.0)
    doubtful = uncertainty.doubts(example.scene, SceneErrors(incidence_deg=1.0))
    monkeypatch.setattr(uncertainty, "_LEAST_COARSE", 0 if coarse else 10**6)
    blocks = uncertainty._Blocks.of(example.capture, 0.005, doubtful, None)
    whole, *parts = (
        uncertainty._of_scene(example.capture, 0.005, Tile(rows, columns, None, None), doubtful, None, blocks)
        for rows, columns in [(slice(0, 192), slice(0, 192)), (slice(0, 96), slice(0, 96)), (slice(96, 192),) * 2]
    )
    straight = np.sqrt(uncertainty.scene_variance(example.capture, 0.005, doubtful)).reshape(whole.shape)
    np.testing.assert_allclose(whole.mean(axis=(1, 2)), straight.mean(axis=(1, 2)), rtol=0.2 if coarse else 1e-6)
    for found, expected in zip(parts, (whole[:, :96, :96], whole[:, 96:, 96:]), strict=True):
        np.testing.assert_allclose(*(np.sqrt(np.mean(of**2, axis=(1, 2))) for of in (found, expected)), rtol=0.3)
    assert (np.abs(np.log(whole[:, :, :32].mean(axis=(1, 2)) / whole[:, :, -32:].mean(axis=(1, 2)))) > 0.3).all()


def test_how_far_a_ghost_s_source_lies_from_what_is_seen():
    np.testing.assert_array_equal(precision._beyond(5, 2.0), [2, 1, 0, 0, 0])
    np.testing.assert_array_equal(precision._beyond(5, -1.5), [0, 0, 0, 0.5, 1.5])
    distance = precision._source_distance((3, 4), (2.0, -1.0), None)
    np.testing.assert_allclose(distance[0], [2, 1, 0, 0])
    np.testing.assert_allclose(distance[2], [np.sqrt(5), np.sqrt(2), 1, 1])
    unseen = np.zeros((3, 4), np.float32)
    unseen[1, 1] = 1
    np.testing.assert_allclose(precision._source_distance((3, 4), (1.0, 0.0), unseen)[1], [1, 0, 1, 0])
    clipped = np.ones((3, 4), np.float32)
    assert precision._distance_to_seen(clipped) is None
    clipped[:, 2:] = 0
    np.testing.assert_array_equal(precision._distance_to_seen(clipped)[0], [0, 0, 1, 2])


def test_only_ghosts_of_what_nobody_sees_are_unknown():
    known, variance = knowledge(100.0, 0.0, 0.1), np.full(3, 1e-4)
    clipped = np.ones((6, 8), np.float32)
    clipped[2, 3] = 0
    weights = np.full((3, 2, 2, 6, 8), 0.3)
    direct = precision._Ghosts(weights[:, :, :1], ((0.0, 0.0),))
    assert precision._of_unseen_light(direct, variance, known, clipped) is None
    still = precision._Ghosts(weights, ((0.0, 0.0), (0.0, 0.0)))
    assert precision._of_unseen_light(still, variance, known, None) is None
    beside = precision._Ghosts(weights, ((0.0, 0.0), (2.0, 0.0)))
    told = precision._of_unseen_light(beside, variance, known, clipped)
    less = np.zeros((6, 8), bool)
    # Beyond the frame on the left, and where the clipped pixel's ghost lies.
    less[:, :2] = less[2, 5] = True
    np.testing.assert_array_equal(told < 1, less)
    assert (told[:, 0] < told[:, 1]).all()
    fainter = precision._Ghosts(weights / 3, beside.displacements)
    assert (precision._of_unseen_light(fainter, variance, known, clipped)[less] > told[less]).all()
