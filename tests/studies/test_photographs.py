"""Pairs of photographs are cut, numbered and made linear as scenes need them."""

from __future__ import annotations

import numpy as np
import pytest
from skimage.io import imsave

from polaropt.errors import InputError
from polaropt.training.pictures import FROM_SKIMAGE, FROM_SKLEARN
from studies.photographs import SHIPPED, Photographs, Size, folder_pairs, measured_pairs, shipped_pairs, sized_pair
from studies.ways import seen_in_training


@pytest.fixture(scope="module")
def photos(tmp_path_factory):
    folder = tmp_path_factory.mktemp("photos")
    for number in range(24):
        imsave(folder / f"p{number:02d}.png", np.full((40, 50, 3), 10 * number, np.uint8), check_contrast=False)
    return folder


def test_pairs_are_every_second_photograph_with_the_eleventh_after_it(photos):
    pairs = folder_pairs(photos, size=16, margin=8)
    assert len(pairs) == 12
    for i, pair in enumerate(pairs):
        behind, mirrored = pair.frames
        assert behind.shape == (16, 16, 3)
        assert behind[0, 0, 0] * 255 == pytest.approx(10 * 2 * i)
        assert mirrored[0, 0, 0] * 255 == pytest.approx(10 * ((2 * i + 11) % 24))


def test_no_network_is_trained_on_the_photographs_that_studies_are_made_of():
    assert not set(SHIPPED) & {*FROM_SKIMAGE, *FROM_SKLEARN}
    assert seen_in_training(None) == ""


def test_photographs_are_mirrored_where_they_end(tmp_path):
    ramp = np.repeat(np.arange(20, dtype=np.uint8)[:, None], 20, axis=1)
    for name in "ab":
        imsave(tmp_path / f"{name}.png", np.stack([ramp] * 3, axis=-1), check_contrast=False)
    larger = folder_pairs(tmp_path, size=20, margin=4)[0].transmission[:, 0, 0] * 255
    np.testing.assert_allclose(larger, [3, 2, 1, 0, *range(20), 19, 18, 17, 16], atol=1e-4)


def test_a_folder_without_photographs_is_refused(tmp_path):
    with pytest.raises(InputError, match="at least 2"):
        folder_pairs(tmp_path)


def test_layers_are_the_frames_with_colours_first():
    pair = shipped_pairs(size=32, margin=16)[1]
    assert pair.height == 32
    assert pair.layers.shape == (2, 3, 32, 32)
    for layer, frame in zip(pair.layers, pair.frames, strict=True):
        np.testing.assert_array_equal(np.moveaxis(layer, 0, -1), frame)


def test_frames_need_not_be_square():
    size = Size(48, 56)
    assert str(size) == "56x48"
    assert sized_pair(Photographs(), size).layers.shape == (2, 3, 48, 56)


def test_measured_layers_are_white_at_their_brightest(tmp_path):
    for name, level in (("a_T", 128), ("a_R", 64)):
        ramp = np.linspace(0, level, 40 * 30).reshape(40, 30).astype(np.uint8)
        imsave(tmp_path / f"{name}.png", np.stack([ramp] * 3, axis=-1), check_contrast=False)
    (pair,) = measured_pairs(tmp_path, 32, 16)
    assert pair.transmission.shape == (64, 64, 3)
    assert pair.transmission.max() == pair.reflection.max() == 1
    with pytest.raises(InputError, match="NAME_T"):
        measured_pairs(tmp_path / "nothing")
