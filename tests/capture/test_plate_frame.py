"""A capture in the plate's frame, its gaps, its blocks at any shift and its spectra."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.ndimage import shift as spline_shift

from polaropt.capture.polarization import PlateFrame, plate_frame, stokes_images
from polaropt.estimation.flat.ghosts import CrossSpectra, ShiftLikelihood, cross_spectra
from polaropt.estimation.flat.overlap import BlockImages, block_images
from polaropt.numerics.blocks import block_mean, fill_gaps
from tests.blends import blend


@pytest.fixture(scope="module")
def frame() -> PlateFrame:
    example = blend(60, 160, azimuth_deg=35, ghost_shift=5.3)
    return plate_frame(stokes_images(example.capture, 0.005), 35)


def assert_same(found: object, expected: object, tolerance: float) -> None:
    for name, value in vars(expected).items():
        if isinstance(value, np.ndarray):
            np.testing.assert_allclose(getattr(found, name), value, atol=tolerance * np.abs(value).max(), err_msg=name)


def test_the_frame_across_exchanges_the_polarizations(frame):
    example = blend(60, 160, azimuth_deg=35, ghost_shift=5.3)
    across = plate_frame(stokes_images(example.capture, 0.005), 125)
    assert_same(frame.across(), across, 1e-5)
    assert_same(block_images(frame, 80).across(), block_images(across, 80), 1e-5)
    assert_same(cross_spectra(frame).across(), cross_spectra(across), 1e-4)


@pytest.mark.parametrize("aliased", [False, True])
def test_angles_that_count_the_other_way_turn_one_component_and_leave_the_rest(aliased: bool) -> None:
    stokes = replace(stokes_images(blend(60, 160, azimuth_deg=35).capture, 0.005), aliased=aliased)
    other = stokes.reversed()
    np.testing.assert_allclose(other.images, stokes.images * np.array([1, 1, -1])[:, None, None, None], atol=1e-6)
    assert other.aliased == aliased
    assert other.block_noise(8) == pytest.approx(stokes.block_noise(8), rel=1e-5)
    assert stokes.block_noise(8) > 1 if aliased else stokes.block_noise(8) == 1


@pytest.mark.parametrize("ghost_shift", [5.3, -7.9, 4.0])
@pytest.mark.parametrize("azimuth_deg", [0, 35, 90, 145])
def test_blocks_of_shifted_copies_are_those_of_shifted_pictures(azimuth_deg, ghost_shift):
    example = blend(60, 96)
    frame = plate_frame(stokes_images(example.capture, 0.005), azimuth_deg)
    blocks = block_images(frame, 24)
    assert (blocks.spacing, blocks.length) == (1, 4)
    copies, _ = blocks.copies(ghost_shift, 3)
    right, down = blocks.step(ghost_shift)
    image = frame.images[0, 0].astype(float)
    for k in range(3):
        moved = spline_shift(image, (k * down, k * right), order=1, mode="nearest")
        top, left = (int(np.ceil(max(0.0, 2 * distance) - 1e-9)) for distance in (down, right))
        expected = block_mean(moved[top:, left:].astype(np.float32), 4)
        found = copies[k, 0, 0]
        np.testing.assert_allclose(found, expected[: found.shape[0], : found.shape[1]], atol=1e-5)


def test_large_frames_are_halved_first(frame):
    blocks = block_images(frame, 20)
    assert (blocks.spacing, blocks.length, blocks.sizes) == (2, 4, (8, 16))
    assert blocks.side == 160
    copies, _ = blocks.copies(0.0, 1)
    np.testing.assert_allclose(copies[0], block_mean(frame.images, 8), rtol=1e-5)


def test_blocks_know_what_is_valid(frame):
    valid = frame.valid.copy()
    valid[:, 40:80, :] = False
    blocks = block_images(PlateFrame(frame.images, frame.covariance, valid, 0), 40)
    known = blocks.copies(0.0, 1)[1]
    np.testing.assert_array_equal(known, block_mean(valid.astype(np.float32), 4) == 1)
    turned = BlockImages(**{**vars(blocks), "azimuth_deg": 90.0})
    assert turned.copies(-8.0, 3)[1].mean() < known.mean() - 0.1


def test_gaps_take_the_mean_around_them():
    rows = np.arange(32, dtype=np.float32)[:, None]
    images = np.broadcast_to(rows, (2, 1, 32, 32)) * np.array([1, -1], np.float32)[:, None, None, None]
    valid = np.ones((1, 32, 32), bool)
    valid[:, 8:20, 8:20] = False
    filled = fill_gaps(images, valid)
    assert (filled[:, valid] == images[:, valid]).all()
    assert np.abs(filled - images).max() < 9
    np.testing.assert_allclose(filled[0], -filled[1])


def test_a_channel_without_anything_is_black():
    valid = np.zeros((2, 20, 20), bool)
    valid[0, 3, 5] = True
    filled = fill_gaps(np.full((2, 20, 20), 7, np.float32), valid)
    assert (filled[0] == 7).all()
    assert (filled[1] == 0).all()


def test_the_likelihood_knows_the_shift_and_its_sense(frame):
    likelihood = ShiftLikelihood(cross_spectra(frame), blend(60, 16).scene)
    shifts = np.arange(-12, 12.1, 0.5)
    misfit = likelihood.misfit(60.0, shifts)
    assert abs(shifts[np.argmin(misfit)] - 5.3) <= 0.5
    assert misfit[np.isclose(shifts, -5.5)] > misfit.min() + 0.005


def test_trials_may_differ_in_incidence(frame):
    likelihood = ShiftLikelihood(cross_spectra(frame), blend(60, 16).scene)
    together = likelihood.misfit(np.array([40.0, 60.0]), [4.0, 5.0, 6.0])
    alone = [likelihood.misfit(incidence, [4.0, 5.0, 6.0]) for incidence in (40.0, 60.0)]
    np.testing.assert_allclose(together, alone, atol=1e-5)


def test_large_frames_have_no_more_tiles(monkeypatch):
    seen = []

    def spectra(side: int) -> CrossSpectra:
        images = np.random.default_rng(0).standard_normal((2, 1, side, side)).astype(np.float32)
        return cross_spectra(PlateFrame(images, np.eye(2), np.ones((1, side, side), bool), 0))

    monkeypatch.setattr("polaropt.estimation.flat.ghosts._power", lambda part: seen.append(1) or part[0].real)
    for side in (256, 2048):
        spectra(side)
        assert len(seen) <= 256
        seen.clear()
