"""Mosaics: every polarizer and colour where the sensor has it."""

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from polaropt import InputError
from polaropt.capture.mosaic import (
    bayer_contrast,
    check_cell_order,
    looks_color,
    registered_cells,
    sampling_of,
    share_of_noise,
    wiener_photographs,
)
from polaropt.numerics import block_mean
from tests.captured import ANGLES, color_mosaic, mono_mosaic, scene_intensities


def test_mono_cells_are_sonys():
    sampling, angles = sampling_of(color=False)
    assert angles == ANGLES
    assert [[angles[k] for k in row] for row in sampling.photographs] == [[90, 45], [135, 0]]
    assert (sampling.period, sampling.n_channels) == (2, 1)


def test_color_cells_are_red_green_green_blue():
    sampling, angles = sampling_of(color=True)
    assert sampling.channels == ((0, 0, 1, 1), (0, 0, 1, 1), (1, 1, 2, 2), (1, 1, 2, 2))
    assert [angles[k] for k in sampling.photographs[2]] == [90, 45, 90, 45]


def test_another_cell_order_is_sorted_by_angle():
    sampling, angles = sampling_of(color=False, cell_order=(0, 45, 135, 90))
    assert angles == ANGLES
    assert sampling.photographs == ((0, 1), (3, 2))


@pytest.mark.parametrize("wrong", [(0, 45, 90), (0, 45, 90, 180), (0, 45, 90, "x"), (0, 45, 90, np.nan), 7])
def test_a_wrong_cell_order_is_one_line(wrong):
    with pytest.raises(InputError, match="four different angles"):
        check_cell_order(wrong)


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("balance", [(0.55, 1.0, 0.6), (0.9, 1.0, 0.95)])
def test_color_sensors_are_told_from_mono_ones(seed, balance):
    gray = scene_intensities((96, 96), seed=seed)
    colors = np.stack([share * gray for share in balance], axis=1)
    noise = 0.01 * np.random.default_rng(seed).standard_normal((96, 96))
    assert not looks_color(mono_mosaic(gray) + noise)
    assert looks_color(color_mosaic(colors) + noise) or balance[0] > 0.8
    assert bayer_contrast(color_mosaic(colors)) > 2 * bayer_contrast(mono_mosaic(gray))


@pytest.mark.parametrize("color", [False, True])
def test_cells_of_a_slope_are_its_values_in_their_middle_at_every_angle(color):
    sampling, _ = sampling_of(color)
    rows, columns = np.mgrid[:96, :96].astype(np.float32)
    slope = 0.2 + 0.004 * rows - 0.001 * columns
    cells, valid = registered_cells(slope, np.ones(slope.shape, bool), sampling, 4)
    middle = block_mean(slope, sampling.period)
    inside = (..., slice(5, -5), slice(5, -5))
    np.testing.assert_allclose(cells[inside], np.broadcast_to(middle, cells.shape)[inside], atol=1e-6)
    assert valid.all()


@pytest.mark.parametrize("color", [False, True])
def test_cells_have_the_share_of_the_noise_that_is_told(color):
    sampling, _ = sampling_of(color)
    noise = np.random.default_rng(0).standard_normal((256, 256)).astype(np.float32)
    cells, _ = registered_cells(noise, np.ones(noise.shape, bool), sampling, 4)
    assert np.sqrt(np.square(cells).mean()) == pytest.approx(share_of_noise(sampling), rel=0.05)


def test_cells_next_to_a_clipped_sample_are_not_trusted():
    sampling, _ = sampling_of(color=False)
    valid = np.ones((64, 64), dtype=bool)
    valid[20, 20] = False
    _, trusted = registered_cells(np.full(valid.shape, 0.5, np.float32), valid, sampling, 4)
    untrusted = np.argwhere(~trusted)
    assert {tuple(where[:2]) for where in untrusted} == {(2, 0)}, "the top left corner is at 90 degrees"
    assert np.abs(untrusted[:, 2:] - 10).max() <= 2


@pytest.mark.parametrize("color", [False, True])
def test_likely_photographs_are_nearer_to_the_truth_than_the_nearest_samples(color):
    images = scene_intensities((128, 128), seed=3)
    truth = np.stack([share * images for share in (0.6, 1.0, 0.7)], axis=1) if color else images[:, None]
    truth = gaussian_filter(truth, (0, 0, 1, 1)).astype(np.float32)
    sampling, angles = sampling_of(color)
    raw = sampling.sample(truth) + 0.002 * np.random.default_rng(0).standard_normal(truth.shape[-2:])
    valid = np.ones(raw.shape, dtype=bool)
    cells, _ = registered_cells(raw.astype(np.float32), valid, sampling, 4)
    found = wiener_photographs(raw.astype(np.float32), valid, sampling, angles, 0.002, cells)
    nearest = np.repeat(np.repeat(cells, sampling.period, axis=-2), sampling.period, axis=-1)
    assert np.square(found - truth).mean() < 0.5 * np.square(nearest - truth).mean()
