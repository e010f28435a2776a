"""A raw mosaic is separated at the sensor's resolution, on every rung, and told what it is."""

import json

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from polaropt import SceneParameters, read_capture, separate
from polaropt.capture.write import write_png
from polaropt.cli.app import main
from polaropt.inversion import canvas_for, mosaic_layers
from polaropt.optics import PSE
from polaropt.simulation import Camera, cut, photograph_mosaic, psnr_db, sensor_image, shipped_photograph
from polaropt.solving.objective import Weights
from polaropt.solving.problem import Problem

SIDE, NOISE = 160, 0.005
SCENE = SceneParameters(60.0, 30.0, 4.0)


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


@pytest.mark.parametrize("resolution", ["sensor", "cell"])
def test_blind_the_pane_is_found_in_the_pixels_of_the_result(tmp_path, resolution):
    path, _ = mosaic_file(tmp_path, False)
    capture = read_capture(path, sensor="mono", resolution=resolution)
    result = separate(capture)
    incidence, azimuth, shift = result.scene.values()
    assert incidence == pytest.approx(60, abs=4)
    assert (azimuth - 30 + 90) % 180 - 90 == pytest.approx(0, abs=2)
    assert abs(shift) * (2 if resolution == "cell" else 1) == pytest.approx(4, abs=2.5)


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
    np.testing.assert_allclose(separate(part, SCENE).layers[inner], whole[..., 3:157, 2:155][inner], atol=0.05)


def test_the_solve_begins_at_the_closed_form_and_the_terms_tell_the_samples_misfit(tmp_path):
    path, _ = mosaic_file(tmp_path, False)
    capture = read_capture(path, sensor="mono")
    problem = Problem(capture, SCENE, NOISE, Weights())
    pse = PSE(SCENE, capture.angles_deg)
    canvas = canvas_for(pse, *capture.shape, 2)
    assert canvas.shape[0] % 2 == canvas.shape[1] % 2 == 0
    np.testing.assert_array_equal(
        problem.known.layers, mosaic_layers(capture, problem.pse, problem.canvas, NOISE).layers
    )
    objective = problem.compiled(problem.known.layers)
    objective.value_and_grad(objective.coordinates(problem.known.layers))
    residual = PSE(SCENE, capture.angles_deg).forward(problem.known.layers)[:, 0] * 1.0
    sampled = capture.samples.sampling.sample(problem.canvas.crop(residual)[:, None])
    expected = 0.5 * np.sum(np.square((sampled - capture.samples.values) / NOISE), dtype=np.float64)
    assert objective.misfit == pytest.approx(expected, rel=1e-3)


def test_the_command_line_tells_the_mosaic_and_writes_its_size(tmp_path, capsys):
    path, _ = mosaic_file(tmp_path, False)
    assert main(["separate", str(path), "--sensor", "mono", "-o", str(tmp_path / "out")]) == 0
    report = json.loads((tmp_path / "out" / "report.json").read_text())
    assert (report["input"]["width"], report["input"]["height"]) == (SIDE, SIDE)
    assert report["input"]["layout"] == "mono mosaic"
    capsys.readouterr()
    assert main(["estimate", str(path), "--sensor", "mono", "--json"]) == 0
    assert abs(json.loads(capsys.readouterr().out)["scene"]["incidence_deg"] - 60) < 4


def test_a_mosaic_needs_no_alignment(tmp_path, capsys):
    path, _ = mosaic_file(tmp_path, False)
    assert main(["separate", str(path), "--align", "-o", str(tmp_path / "out")]) == 2
    assert "leave --align out" in capsys.readouterr().err


def test_a_wrong_cell_order_is_warned_of(tmp_path):
    path, _ = mosaic_file(tmp_path, False)
    result = separate(read_capture(path, sensor="mono", cell_order=(45, 90, 135, 0)))
    assert "ANGLES_SWAPPED" in [warning.name for warning in result.diagnostics.warnings]


def test_smooth_scenes_have_no_false_polarization(tmp_path):
    smooth = gaussian_filter(np.random.default_rng(0).uniform(0, 1, (128, 128)), 3)
    smooth = 0.2 + 0.6 * (smooth - smooth.min()) / np.ptp(smooth)
    raw = smooth / 2 + 0.001 * np.random.default_rng(1).standard_normal(smooth.shape)
    write_png(tmp_path / "a.png", np.round(65535 * raw).astype(np.uint16))
    s0, s1, s2 = read_capture(tmp_path / "a.png", sensor="mono").stokes
    assert np.quantile(np.hypot(s1, s2) / s0, 0.95) < 0.02
