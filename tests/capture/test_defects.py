"""Hot and dead pixels of a mosaic's sensor: found, replaced and told; what a lens can draw stays."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.ndimage import gaussian_filter
from skimage.data import brick, grass

from polaropt import FrameReader, inspect, read_capture, separate
from polaropt.capture import SONY_CELL, mosaic_capture
from polaropt.capture.capture import Capture
from polaropt.capture.files.write import write_png
from polaropt.optics import SceneParameters
from polaropt.reporting import inspection_sentences
from polaropt.simulation import Camera, cut, photograph_mosaic, shipped_photograph, simulated_mosaic
from polaropt.simulation.metrics import psnr_db
from tests.captured import color_mosaic, mono_mosaic

LEVELS = 4095


def smooth_mosaic(color: bool, seed: int = 0, noise: float = 0.003) -> np.ndarray:
    """A raw mosaic (64, 96) of 12 bits: two gentle waves behind a pane, 0.1 to 0.6."""
    random = np.random.default_rng(seed)
    rows, columns = np.mgrid[:64, :96]
    waves = [0.5 + 0.4 * np.sin(2 * np.pi * (rows / 128 + columns / 96) + random.uniform(0, 6)) for _ in range(2)]
    photographs = np.stack([0.4 * waves[0] + share * waves[1] + 0.05 for share in (0.05, 0.1, 0.15, 0.1)])
    if color:
        photographs = np.multiply.outer(np.array([0.9, 1.0, 0.7]), photographs).swapaxes(0, 1)
    raw = color_mosaic(photographs) if color else mono_mosaic(photographs)
    return rounded(raw + noise * random.standard_normal(raw.shape))


def rounded(raw: np.ndarray) -> np.ndarray:
    return (np.round(np.clip(raw, 0, 1) * LEVELS) / LEVELS).astype(np.float32)


def read(raw: np.ndarray, color: bool = False, **reading) -> Capture:
    kind = "color" if color else "mono"
    return mosaic_capture(raw, sensor=kind, cell_order=SONY_CELL, pair_gain=1.0, white_level=1.0, **reading)


@settings(max_examples=20, deadline=None)
@given(st.booleans(), st.integers(0, 999), st.sampled_from([0.0, 0.9, 1.2]))
def test_defects_are_found_and_nothing_else(color, seed, value):
    raw = smooth_mosaic(color, seed)
    far = np.flatnonzero(np.abs(raw - value) > 0.25)
    places = np.random.default_rng(seed).choice(far, 6, replace=False)
    broken = raw.copy()
    broken.flat[places] = value
    capture = read(rounded(broken), color)
    found = np.flatnonzero(capture.samples.values != rounded(broken))
    assert set(found) == set(places)
    assert capture.origin.defects == len(places)
    # What takes their place is what was there, as far as the nearest samples of their kind tell.
    assert np.abs(capture.samples.values.flat[places] - raw.flat[places]).max() < 0.12
    # One that shone brighter than white is measured by those around it, and no longer clipped.
    assert capture.samples.valid.flat[places].all()


@pytest.mark.parametrize("color", [False, True])
@pytest.mark.parametrize("noise", [0.0, 0.003, 0.03])
def test_a_sensor_without_defects_is_read_as_it_is(color, noise):
    raw = smooth_mosaic(color, 3, noise)
    capture = read(raw, color)
    assert capture.origin.defects == 0
    np.testing.assert_array_equal(capture.samples.values, raw)


@pytest.mark.parametrize("picture", [brick, grass])
def test_textures_are_no_defects(picture):
    layer = gaussian_filter(picture()[:256, :256] / 255, 0.7).astype(np.float32)
    scene = SceneParameters(60.0, 20.0, 3.0)
    raw = photograph_mosaic(layer, layer[::-1], scene, Camera(noise=0.003, bits=12), color=False)
    assert read(raw).origin.defects == 0


def test_lights_as_small_as_a_lens_draws_them_are_no_defects():
    points = np.zeros((128, 128))
    points[12::16, 11::17] = 1.0
    light = gaussian_filter(points, 0.7)
    raw = rounded(0.05 + 0.8 * light / light.max() + 0.002 * np.random.default_rng(0).standard_normal(light.shape))
    assert read(raw).origin.defects == 0


def test_a_pattern_of_single_bright_samples_is_the_scene():
    raw = np.full((128, 128), 0.2, np.float32)
    raw[::6, ::6] = 0.9
    capture = read(raw)
    assert capture.origin.defects == 0
    np.testing.assert_array_equal(capture.samples.values, raw)


def test_where_the_light_clips_only_what_is_far_darker_is_defective():
    raw = smooth_mosaic(False)
    raw[10:50, 10:50] = 1.0
    raw[20, 20], raw[40, 40] = 0.95, 0.1
    capture = read(raw)
    assert capture.samples.values[20, 20] == np.float32(0.95)
    assert capture.samples.values[40, 40] == 1
    assert not capture.samples.valid[40, 40]


def test_the_layers_lose_hardly_anything_to_a_thousandth_of_hot_pixels():
    layers = [cut(shipped_photograph(name), (160, 160)) for name in ("astronaut", "coffee")]
    scene = SceneParameters(60.0, 20.0)
    camera = Camera(noise=0.004, bits=12, seed=1, lens_blur_px=0.7)
    raw = photograph_mosaic(*layers, scene, camera, color=False)
    random = np.random.default_rng(5)
    hot = np.clip(raw + (random.uniform(size=raw.shape) < 1e-3) * random.uniform(0.1, 0.6, raw.shape), 0, 1)
    truth = camera.through_lens(layers[0].mean(axis=-1))

    def level(capture: Capture) -> float:
        return psnr_db(separate(capture, scene).transmission, truth, border=16)

    clean = level(simulated_mosaic(raw, False))
    assert level(simulated_mosaic(hot.astype(np.float32), False)) > clean - 1.5
    kept = read(hot.astype(np.float32), keep_defects=True)
    assert kept.origin.defects == 0
    assert level(kept) < clean - 5


def test_a_camera_s_frames_have_the_defects_of_the_first():
    raw = smooth_mosaic(False)
    hot = raw.copy()
    hot[30, 41] = 0.95
    of_cells = {"sensor": "mono", "resolution": "cell", "cell_order": SONY_CELL, "white_level": 1.0, "pair_gain": 1.0}
    camera, clean = FrameReader(**of_cells), FrameReader(**of_cells)
    camera.read(hot), clean.read(raw)
    # The second frame hides the hot pixel in something bright.
    second, expected = camera.read(hot), clean.read(raw)
    assert np.abs(second.intensities - expected.intensities).max() < 0.02


def test_defects_are_told_and_kept_on_request(tmp_path):
    raw = smooth_mosaic(False)
    raw[30, 41] = 0.95
    file = tmp_path / "raw.png"
    write_png(file, np.round(raw * 65535).astype(np.uint16))
    assert any("1 sample stands out by itself" in line for line in inspection_sentences(inspect(read_capture(file))))
    kept = read_capture(file, keep_defects=True)
    assert kept.samples.values[30, 41] == pytest.approx(0.95, abs=1e-3)
    assert not any("out by" in line for line in inspection_sentences(inspect(kept)))
