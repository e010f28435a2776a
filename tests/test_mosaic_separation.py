"""A raw mosaic is separated at the sensor's resolution, on every rung, and told what it is."""

import json
from functools import cache

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from polaropt import SceneParameters, StoppingRule, estimate, read_capture, separate
from polaropt.capture import swapped_photographs
from polaropt.capture.files.write import write_png
from polaropt.cli.app import main
from polaropt.inversion import canvas_for, mosaic_layers
from polaropt.numerics import block_mean, turn_between
from polaropt.optics import PSE
from polaropt.reporting import inspect_capture
from polaropt.reporting.words import attention
from polaropt.simulation import (
    Camera,
    cut,
    exact_photographs,
    photograph_mosaic,
    psnr_db,
    sensor_image,
    shipped_photograph,
    simulated_mosaic,
    stack_layers,
)
from polaropt.solving.mosaic_pattern import mosaic_pattern
from polaropt.solving.objective import Weights
from polaropt.solving.problem import Problem
from tests.command_line import QUICK

SIDE, NOISE = 160, 0.005
SCENE = SceneParameters(60.0, 30.0, 4.0)
# Of one clear pane.
BLIND = SceneParameters(None, None, None)


def layers_of(color):
    """Both layers (2, [channel,] h, w) as a lens images them."""
    places = (("coffee", (0.5, 0.5)), ("astronaut", (0.1, 0.4)))
    images = [cut(shipped_photograph(name), (SIDE, SIDE), place) for name, place in places]
    camera = Camera(lens_blur_px=0.7)
    seen = [camera.through_lens(sensor_image(image, color)) for image in images]
    return np.stack([np.moveaxis(image, -1, 0) if color else image for image in seen]), images


def mosaic_file(folder, color, scene=SCENE, name="raw.png", spoil=lambda raw: raw):
    truth, images = layers_of(color)
    camera = Camera(noise=NOISE, bits=12, seed=3, lens_blur_px=0.7)
    raw = spoil(photograph_mosaic(images[0], images[1], scene, camera, color))
    write_png(folder / name, np.round(65535 * np.clip(raw, 0, 1)).astype(np.uint16))
    return folder / name, truth


def gains_db(result, capture, truth):
    """dB of the transmission, and by how much it gains on the plain intensity."""
    level = psnr_db(result.layers[0], truth[0], 16)
    return level, level - psnr_db(capture.stokes[0], truth[0], 16)


@pytest.mark.parametrize("color", [False, True])
def test_with_the_pane_known_the_transmission_gains_much(tmp_path, color):
    path, truth = mosaic_file(tmp_path, color)
    capture = read_capture(path, sensor="color" if color else "mono")
    result = separate(capture, SCENE)
    assert result.layers.shape == truth.shape
    level, gain = gains_db(result, capture, truth)
    assert level > 33
    assert gain > 8
    assert result.diagnostics.misfit_ratio < 1.5


@pytest.mark.parametrize("sensor", ["mono", "color"])
def test_what_is_expected_of_a_mosaic_in_each_place_is_nearer_than_the_closed_form(tmp_path, sensor):
    path, truth = mosaic_file(tmp_path, sensor == "color")
    problem = Problem(read_capture(path, sensor=sensor), SCENE, NOISE, Weights())
    closed, expected = problem.known.layers, problem.expected.in_colors(problem.known.basis)
    for i in (0, 1):
        levels = [
            psnr_db(problem.canvas.crop(part)[i].reshape(truth[i].shape), truth[i], 16) for part in (closed, expected)
        ]
        assert levels[1] > levels[0] + 0.1


def cells_in_noise(color, noise, lens_blur_px=0.7, side=192):
    """A mosaic at the resolution of its cells, with its true layers and photographs there."""
    places = (("coffee", (0.5, 0.5)), ("astronaut", (0.1, 0.4)))
    images = [cut(shipped_photograph(name), (side, side), place) for name, place in places]
    camera = Camera(noise=noise, bits=12, seed=5, lens_blur_px=lens_blur_px)
    raw = photograph_mosaic(*images, SCENE, camera, color)
    capture = simulated_mosaic(raw, color, "cell")
    seen = [camera.through_lens(sensor_image(image, color)) for image in images]
    layers = stack_layers(*seen)
    photographs = exact_photographs(layers, SCENE, capture.angles_deg)
    n = side // capture.shape[-1]
    return capture, block_mean(layers, n), block_mean(photographs.reshape(4, -1, side, side), n)


@pytest.mark.parametrize("color", [False, True])
@pytest.mark.parametrize(("noise", "lens_blur_px"), [(0.005, 0.0), (0.005, 1.0), (0.02, 0.7)])
def test_photographs_of_cells_are_off_by_as_much_as_is_said(color, noise, lens_blur_px):
    capture, _, true = cells_in_noise(color, noise, lens_blur_px)
    off = (capture.intensities.reshape(true.shape) - true)[..., 4:-4, 4:-4].std()
    assert 0.6 < off / capture.origin.filtered_noise < 1.4
    assert noise == 0.005 or capture.origin.filtered_noise < 0.7 * capture.origin.raw_noise


def test_a_solve_of_cells_ends_where_it_begins_or_nearer_and_errors_are_as_large_as_is_said():
    capture, truth, _ = cells_in_noise(False, 0.02)
    pane = SCENE.scaled(0.5)
    begun, ended = (separate(capture, pane, stopping=StoppingRule(max_evaluations=n)) for n in (1, 60))
    for i in (0, 1):
        levels = [psnr_db(result.layers[i], truth[i], 8) for result in (begun, ended)]
        assert levels[1] > levels[0] - 0.2
        covered = np.abs(ended.layers[i] - truth[i]) <= 2 * np.asarray(ended.uncertainty[i])
        assert 0.9 < covered[8:-8, 8:-8].mean() < 0.995
    assert 0.6 < ended.diagnostics.misfit_ratio < 1.4


@pytest.mark.parametrize(("noise", "cause"), [(0.001, "UNDERSAMPLED"), (0.03, "NOISE_TOO_HIGH")])
def test_what_hides_the_reflection_of_a_colour_mosaic_is_named(noise, cause):
    pane = SCENE.replace(incidence_deg=20.0, ghost_shift=0.0)
    images = [cut(shipped_photograph(name), (SIDE, SIDE), (0.5, 0.5)) for name in ("coffee", "astronaut")]
    raw = photograph_mosaic(*images, pane, Camera(noise=noise, bits=12, seed=3, lens_blur_px=0.7), True)
    diagnostics = separate(simulated_mosaic(raw, True), pane, stopping=StoppingRule(max_evaluations=3)).diagnostics
    assert [told.name for told in diagnostics.warnings] == ["REFLECTION_NOT_IDENTIFIABLE", cause]


@pytest.fixture(scope="module")
def grey_mosaic(tmp_path_factory):
    return mosaic_file(tmp_path_factory.mktemp("grey"), False)[0]


@cache
def separated(path, resolution="sensor"):
    """What is separated blind of a grey mosaic."""
    return separate(read_capture(path, sensor="mono", resolution=resolution), BLIND)


@pytest.fixture(scope="module")
def doubled_mosaic(tmp_path_factory):
    """Its double images lie so far apart that few tiles tell them."""
    return mosaic_file(tmp_path_factory.mktemp("doubled"), False, SCENE.replace(ghost_shift=7.0))[0]


@pytest.mark.parametrize("resolution", ["sensor", "cell"])
def test_blind_the_pane_is_found_in_the_pixels_of_the_result(doubled_mosaic, resolution):
    incidence, azimuth, shift = separated(doubled_mosaic, resolution).scene.values()
    assert incidence == pytest.approx(60, abs=4)
    assert turn_between(azimuth, 30) == pytest.approx(0, abs=2)
    assert abs(shift) * (2 if resolution == "cell" else 1) == pytest.approx(7, abs=1)


def test_an_estimation_tells_what_a_separation_finds(grey_mosaic):
    told = estimate(read_capture(grey_mosaic, sensor="mono", resolution="cell"), BLIND)
    result = separated(grey_mosaic, "cell")
    assert told.scene == result.scene
    assert told.errors == result.errors


def test_the_command_estimate_tells_what_a_separation_finds(grey_mosaic, capsys):
    assert main(["estimate", str(grey_mosaic), "--sensor", "mono", "--panes", "1", "--json"]) == 0
    found = separated(grey_mosaic).scene
    told = json.loads(capsys.readouterr().out)
    assert told["scene"]["ghost_shift"] == pytest.approx(found.ghost_shift)
    assert told["scene"]["incidence_deg"] == pytest.approx(found.incidence_deg)


@pytest.mark.parametrize(
    "scene",
    [
        SceneParameters(55.0, 30.0, 0.0, focal_px=150.0),
        SceneParameters(55.0, 30.0, 3.0, focal_px=200.0),
        SceneParameters(60.0, 30.0, 0.0, bend_deg_per_px=(0.05, 0.0, 0.0)),
        SceneParameters(60.0, 30.0, 4.0, transmission_polarization=(0.4, 70.0)),
        SceneParameters(60.0, 30.0, 0.0, 1.33, single_surface=True),
    ],
    ids=["lens", "lens with ghosts", "bent", "polarized", "water"],
)
def test_every_rung_takes_samples(tmp_path, scene):
    path, truth = mosaic_file(tmp_path, False, scene)
    capture = read_capture(path, sensor="mono")
    result = separate(capture, scene)
    _, gain = gains_db(result, capture, truth)
    assert gain > 4


def test_clipped_samples_are_left_out(tmp_path):
    path, truth = mosaic_file(tmp_path, False, spoil=lambda raw: np.minimum(2.3 * raw, 1))
    capture = read_capture(path, sensor="mono")
    assert 0.001 < np.mean(~capture.samples.valid) < 0.2
    result = separate(capture, SCENE)
    assert psnr_db(result.layers[0] / 2.3, truth[0], 16) > 35


def test_a_tile_knows_its_place_in_the_pattern(tmp_path):
    path, _ = mosaic_file(tmp_path, True)
    capture = read_capture(path, sensor="color")
    whole = separate(capture, SCENE).layers
    part = capture.part(slice(3, 157), slice(2, 155))
    inner = (..., slice(30, -30), slice(30, -30))
    apart = separate(part, SCENE).layers[inner] - whole[..., 3:157, 2:155][inner]
    assert np.sqrt(np.square(apart).mean()) < 0.01
    assert np.abs(apart).max() < 0.1


def test_the_solve_begins_at_the_closed_form_less_what_alternates_and_the_terms_tell_the_samples_misfit(tmp_path):
    path, _ = mosaic_file(tmp_path, False)
    capture = read_capture(path, sensor="mono")
    problem = Problem(capture, SCENE, NOISE, Weights())
    pse = PSE(SCENE, capture.angles_deg)
    canvas = canvas_for(pse, *capture.shape, 2)
    assert canvas.shape[0] % 2 == canvas.shape[1] % 2 == 0
    closed = mosaic_layers(capture, problem.pse, problem.canvas, NOISE).layers
    pattern = np.zeros_like(closed)
    alternations = capture.samples.sampling.alternations(capture.angles_deg)
    problem.canvas.crop(pattern)[...] = mosaic_pattern(problem.canvas.crop(closed), alternations)
    np.testing.assert_array_equal(problem.known.layers, closed - pattern)
    objective = problem.compiled(problem.known.layers)
    objective.value_and_grad(objective.coordinates(problem.known.layers))
    residual = PSE(SCENE, capture.angles_deg).forward(problem.known.layers)[:, 0] * 1.0
    sampling = capture.samples.sampling
    sampled = sampling.sample(problem.canvas.crop(residual)[:, None])
    explained = sampling.sample(problem.observed.intensities[:, None])
    expected = 0.5 * np.sum(np.square((sampled - explained) / NOISE), dtype=np.float64)
    assert objective.misfit == pytest.approx(expected, rel=1e-3)


def test_the_command_line_tells_the_mosaic_and_writes_its_size(tmp_path):
    path, _ = mosaic_file(tmp_path, False)
    assert main(["separate", str(path), "--sensor", "mono", "--panes", "1", "-o", str(tmp_path / "out"), *QUICK]) == 0
    report = json.loads((tmp_path / "out" / "report.json").read_text())
    assert (report["input"]["width"], report["input"]["height"]) == (SIDE, SIDE)
    assert report["input"]["layout"] == "mono mosaic"
    assert abs(report["scene"]["incidence_deg"] - 60) < 4


def test_a_mosaic_needs_no_alignment(tmp_path, capsys):
    path, _ = mosaic_file(tmp_path, False)
    assert main(["separate", str(path), "--align", "-o", str(tmp_path / "out")]) == 2
    assert "leave --align out" in capsys.readouterr().err


# Orders of a cell that differ from the true one in what is orthogonal: the true one is Sony's.
OTHER_PAIRS = [(45.0, 90.0, 135.0, 0.0), (90.0, 0.0, 135.0, 45.0)]


def test_a_wrong_cell_order_that_was_given_is_kept_and_warned_of_naming_one_that_adds_up(tmp_path):
    path, _ = mosaic_file(tmp_path, False)
    capture = read_capture(path, sensor="mono", cell_order=OTHER_PAIRS[0])
    assert (capture.origin.cell_order, capture.origin.cell_order_found) == (OTHER_PAIRS[0], False)
    result = separate(capture, SCENE, stopping=StoppingRule(max_evaluations=3))
    assert "ANGLES_SWAPPED" in [warning.name for warning in result.diagnostics.warnings]
    (words,) = attention(inspect_capture(capture), ())
    assert "45,90,135,0" in words
    assert "90,45,135,0" in words


@pytest.mark.parametrize("color", [False, True])
@pytest.mark.parametrize("order", OTHER_PAIRS)
def test_the_pairs_of_a_cell_are_found_where_no_order_was_given(tmp_path, color, order):
    _, images = layers_of(color)
    camera = Camera(noise=NOISE, bits=12, seed=3, lens_blur_px=0.7)
    raw = photograph_mosaic(images[0], images[1], SCENE, camera, color, order)
    write_png(tmp_path / "a.png", np.round(65535 * np.clip(raw, 0, 1)).astype(np.uint16))
    capture = read_capture(tmp_path / "a.png", sensor="color" if color else "mono")
    assert capture.origin.cell_order_found
    assert capture.start_unknown, "closure tells neither the start of the angles nor their sense"
    assert orthogonal_corners(capture.origin.cell_order) == orthogonal_corners(order)
    assert swapped_photographs(capture.registered) == ()
    (words,) = attention(inspect_capture(capture), ())
    assert ",".join(f"{angle:g}" for angle in capture.origin.cell_order) in words


def test_pairs_of_which_two_choices_add_up_are_left_and_warned_of(tmp_path):
    # Light that is polarized between two of the angles adds up in two of the three pairings.
    _, images = layers_of(False)
    pane = SCENE.replace(azimuth_deg=22.5)
    camera = Camera(noise=NOISE, seed=3, lens_blur_px=0.7)
    choices = []
    for order in OTHER_PAIRS:
        raw = photograph_mosaic(images[0], images[1], pane, camera, False, order)
        write_png(tmp_path / "a.png", np.round(65535 * np.clip(raw, 0, 1)).astype(np.uint16))
        capture = read_capture(tmp_path / "a.png", sensor="mono", resolution="cell")
        choices.append((capture.origin.cell_order_found, bool(swapped_photographs(capture.registered))))
    assert (False, True) in choices
    assert not any(found for found, _ in choices)


def test_the_command_line_tells_an_order_that_was_found(tmp_path, capsys):
    _, images = layers_of(False)
    raw = photograph_mosaic(images[0], images[1], SCENE, Camera(lens_blur_px=0.7), False, OTHER_PAIRS[1])
    write_png(tmp_path / "a.png", np.round(65535 * np.clip(raw, 0, 1)).astype(np.uint16))
    for command in ("inspect", "estimate"):
        pane = ["--panes", "1"] if command == "estimate" else []
        assert main([command, str(tmp_path / "a.png"), "--sensor", "mono", *pane]) == 0
        assert "ATTENTION: the cell's orthogonal pairs do not add up" in capsys.readouterr().out


def orthogonal_corners(order):
    """Pairs of corners whose angles are 90 degrees apart."""
    return {frozenset((i, (order.index((angle + 90) % 180)))) for i, angle in enumerate(order)}


def test_layers_of_a_cell_whose_pairs_were_found_are_those_of_the_true_order_in_place(tmp_path):
    truth, images = layers_of(False)
    camera, pane = Camera(noise=NOISE, bits=12, seed=3, lens_blur_px=0.7), SCENE.replace(ghost_shift=0.0)
    raw = photograph_mosaic(images[0], images[1], pane, camera, False, OTHER_PAIRS[1])
    write_png(tmp_path / "a.png", np.round(65535 * np.clip(raw, 0, 1)).astype(np.uint16))
    capture = read_capture(tmp_path / "a.png", sensor="mono")
    result = separate(capture, BLIND)
    assert "CELL_ORDER_FOUND" in [warning.name for warning in result.diagnostics.warnings]
    assert abs(result.scene.incidence_deg - 60) < 4
    assert gains_db(result, capture, truth)[1] > 6


@pytest.mark.parametrize("noise", [0.002, 0.03])
@pytest.mark.parametrize("exposure", [1.0, 1.8])
@pytest.mark.parametrize("color", [False, True])
def test_the_right_order_is_left_alone(tmp_path, noise, exposure, color):
    _, images = layers_of(color)
    raw = exposure * photograph_mosaic(images[0], images[1], SCENE, Camera(noise=noise, seed=1), color)
    write_png(tmp_path / "a.png", np.round(65535 * np.clip(raw, 0, 1)).astype(np.uint16))
    capture = read_capture(tmp_path / "a.png", sensor="color" if color else "mono", resolution="cell")
    assert (capture.origin.cell_order, capture.origin.cell_order_found) == ((90, 45, 135, 0), False)
    assert not capture.start_unknown


def test_smooth_scenes_have_no_false_polarization(tmp_path):
    smooth = gaussian_filter(np.random.default_rng(0).uniform(0, 1, (128, 128)), 3)
    smooth = 0.2 + 0.6 * (smooth - smooth.min()) / np.ptp(smooth)
    raw = smooth / 2 + 0.001 * np.random.default_rng(1).standard_normal(smooth.shape)
    write_png(tmp_path / "a.png", np.round(65535 * raw).astype(np.uint16))
    s0, s1, s2 = read_capture(tmp_path / "a.png", sensor="mono").stokes
    assert np.quantile(np.hypot(s1, s2) / s0, 0.95) < 0.02


def test_truer_layers_of_a_mosaic_are_taken_though_they_follow_less_of_its_noise(tmp_path):
    # The closed form of a mosaic follows half of the noise, having more values than there are samples.
    path, truth = mosaic_file(tmp_path, False)
    problem = Problem(read_capture(path, sensor="mono"), SCENE, NOISE, Weights())
    before = problem.best_known()
    darker = truth * np.array([1, 0.6])[:, None, None]
    problem.expect_around(problem.canvas.continued(darker[:, None].astype(np.float32)))
    np.testing.assert_array_equal(problem.best_known(), before)
    softer = gaussian_filter(truth, (0, 0.8, 0.8))
    problem.expect_around(problem.canvas.continued(softer[:, None].astype(np.float32)))
    found = problem.best_known()
    first, better = (psnr_db(problem.canvas.crop(layers)[1, 0], truth[1], 16) for layers in (before, found))
    assert better > first + 2
