"""Mosaics: every polarizer and colour where the sensor has it."""

import sys

import numpy as np
import pytest

from polaropt import InputError
from polaropt.capture.mosaic import bayer_contrast, check_cell_order, looks_color, merge_greens, split_mosaic
from tests.captured import ANGLES, color_mosaic, mono_mosaic, scene_intensities


def test_mono_cells_are_sonys():
    planes, angles = split_mosaic(np.arange(16).reshape(4, 4), color=False)
    assert angles == ANGLES
    assert [plane[0, 0] for plane in planes] == [5, 1, 0, 4]


def test_color_cells_are_red_green_green_blue():
    planes, angles = split_mosaic(np.arange(64).reshape(8, 8), color=True)
    assert planes.shape == (4, 4, 2, 2)
    assert angles == ANGLES
    assert planes[2, :, 0, 0].tolist() == [0, 2, 16, 18]
    assert merge_greens(planes.astype(np.float32))[2, :, 0, 0].tolist() == [0, 9, 18]


@pytest.mark.parametrize(("shape", "color", "expected"), [((7, 9), False, (3, 4)), ((10, 15), True, (2, 3))])
def test_what_is_no_whole_cell_is_cut_off(shape, color, expected):
    assert split_mosaic(np.zeros(shape), color)[0].shape[-2:] == expected


def test_another_cell_order_is_sorted_by_angle():
    planes, angles = split_mosaic(np.arange(16).reshape(4, 4), color=False, cell_order=(0, 45, 135, 90))
    assert angles == ANGLES
    assert [plane[0, 0] for plane in planes] == [0, 1, 5, 4]


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
def test_full_resolution_interpolates_what_the_cells_hold(color):
    pytest.importorskip("polanalyser", reason="polanalyser is not installed")
    from polaropt.capture.mosaic import demosaic_full

    levels = np.linspace(0.2, 0.8, 12).reshape(4, 3)
    flat = np.tile(levels[..., None, None], (1, 1, 32, 32)) if color else np.tile(levels[:, :1, None], (1, 32, 32))
    raw = color_mosaic(flat) if color else mono_mosaic(flat)
    images, valid, angles = demosaic_full(raw.astype(np.float32), np.ones(raw.shape, bool), color, (90, 45, 135, 0))
    assert angles == ANGLES
    np.testing.assert_allclose(images, flat, atol=1e-4)
    assert valid.all()


def test_full_resolution_spreads_what_is_not_valid():
    pytest.importorskip("polanalyser", reason="polanalyser is not installed")
    from polaropt.capture.mosaic import demosaic_full

    raw = mono_mosaic(scene_intensities((32, 32))).astype(np.float32)
    valid = np.ones(raw.shape, dtype=bool)
    valid[10, 10] = False
    before, _, _ = demosaic_full(raw, valid, False, (90, 45, 135, 0))
    raw[10, 10] = raw.mean()
    after, trusted, _ = demosaic_full(raw, valid, False, (90, 45, 135, 0))
    np.testing.assert_array_equal((np.abs(before - after) > 1e-3) & trusted, False)
    assert np.count_nonzero(~trusted) == 9


def test_a_missing_package_names_the_extra(monkeypatch):
    from polaropt.capture.mosaic import demosaic_full

    monkeypatch.setitem(sys.modules, "polanalyser", None)
    with pytest.raises(InputError, match=r"pip install polaropt\[demosaic\]"):
        demosaic_full(np.ones((32, 32), np.float32), np.ones((32, 32), bool), False, (90, 45, 135, 0))
