"""Half spectra and windows."""

from __future__ import annotations

import numpy as np
import pytest

from polaropt.numerics.blocks import middle_part
from polaropt.numerics.spectrum import (
    bilinear_transfer,
    column_multiplicity,
    frequencies,
    hann_autocorrelation,
    hann_spectra,
    hann_window,
    tukey_window,
)


@pytest.mark.parametrize("shape", [(6, 8), (5, 7), (4, 1), (3, 2)])
def test_half_a_spectrum_holds_all_the_power(shape: tuple[int, int]) -> None:
    image = np.random.default_rng(0).standard_normal(shape)
    half = np.abs(np.fft.rfft2(image, norm="ortho")) ** 2
    assert (column_multiplicity(shape[1]) * half).sum() == pytest.approx(np.square(image).sum())


def test_half_overlapping_hann_windows_add_up_to_one() -> None:
    window = hann_window(63)
    assert (window > 0).all()
    np.testing.assert_allclose(window[:31] + window[32:], 1, atol=1e-15)


def test_the_autocorrelation_of_hanns_window_is_that_of_its_samples() -> None:
    window = hann_window(4000)
    lags = np.array([0, 400, -1000, 2000, 3600, 4000, 9000])
    samples = [float(window[: max(4000 - abs(k), 0)] @ window[min(abs(k), 4000) :]) for k in lags]
    np.testing.assert_allclose(hann_autocorrelation(lags / 4000), np.array(samples) / samples[0], atol=1e-3)


def test_tukeys_window_is_one_inside_and_falls_evenly() -> None:
    window = tukey_window(5, 4, 3)
    assert window.shape == (12,)
    assert (window[4:9] == 1).all()
    assert (np.diff(window[:5]) > 0).all()
    assert (np.diff(window[8:]) < 0).all()
    np.testing.assert_allclose(window[:4] + window[3::-1], 1)
    np.testing.assert_array_equal(tukey_window(3, 0, 0), np.ones(3))


def test_the_middle_of_a_frame() -> None:
    image = np.arange(35.0, dtype=np.float32).reshape(5, 7)
    np.testing.assert_array_equal(image[middle_part(image.shape, 3)], image[1:4, 2:5])
    np.testing.assert_array_equal(image[middle_part(image.shape, 9)], image)


@pytest.mark.parametrize(("right", "down"), [(3.0, -2.0), (0.25, 0.0), (-1.6, 5.3)])
def test_the_transfer_of_bilinear_interpolation_is_what_it_makes_of_a_picture(right: float, down: float) -> None:
    picture = np.random.default_rng(1).standard_normal((10, 12))
    rows, columns = np.broadcast_arrays(*frequencies(10, 12))
    (x, part_x), (y, part_y) = (divmod(shift, 1) for shift in (right, down))

    def moved(more_x: int, more_y: int) -> np.ndarray:
        return np.roll(picture, (int(y) + more_y, int(x) + more_x), axis=(0, 1))

    above, below = ((1 - part_x) * moved(0, step) + part_x * moved(1, step) for step in (0, 1))
    expected = np.fft.rfft2((1 - part_y) * above + part_y * below)
    transfer = bilinear_transfer(np.array([right]), np.array([down]), columns.ravel(), rows.ravel())
    np.testing.assert_allclose(transfer.reshape(rows.shape) * np.fft.rfft2(picture), expected, atol=1e-12)


def test_spectra_under_a_window_are_those_of_the_picture_but_for_its_mean() -> None:
    rows, columns = np.meshgrid(np.arange(64), np.arange(64), indexing="ij")
    window = np.outer(hann_window(64), hann_window(64))
    window /= np.sqrt(np.sum(window**2))
    waves = np.cos(2 * np.pi * (8 * columns + 3 * rows) / 64 + 0.4)
    plain, found = np.fft.rfft2(waves * window), hann_spectra(waves + 5)
    assert found[3, 8] == pytest.approx(plain[3, 8], rel=0.04)
    assert np.abs(found[30:34, 20:]).max() < 1e-3 * np.abs(plain).max()


def test_spectra_by_way_of_gradients_tell_the_shift_of_a_photograph_better() -> None:
    """Under the window alone all frequencies of a natural picture seem lower than they are, and so shifts smaller."""
    rng, n, shift = np.random.default_rng(2), 64, 9
    rows, columns = frequencies(16 * n, 16 * n)
    natural = np.fft.rfft2(rng.standard_normal((16 * n, 16 * n))) / np.maximum(np.hypot(rows, columns), 1e-3)
    picture = np.fft.irfft2(natural)
    tiles, later = (
        np.array([part[y : y + n, x : x + n] for y in range(0, 960, n) for x in range(n, 960, n)])
        for part in (picture, np.roll(picture, shift, axis=1))
    )
    window = np.outer(hann_window(n), hann_window(n))
    use = (4, 4)  # 4 cycles per tile along both, where the window counts for much

    def told(spectra: np.ndarray, of_later: np.ndarray) -> float:
        cross = (spectra * of_later.conj())[:, use[0], use[1]].sum()
        return float(np.angle(cross * np.exp(-2j * np.pi * use[1] * shift / n)) * n / (2 * np.pi * use[1]))

    means = (part.mean(axis=(1, 2), keepdims=True) for part in (tiles, later))
    plain = told(*(np.fft.rfft2((part - mean) * window) for part, mean in zip((tiles, later), means, strict=True)))
    white = told(*(hann_spectra(part) for part in (tiles, later)))
    assert plain < -0.02 * shift
    assert abs(white) < abs(plain) / 2


@pytest.mark.parametrize("shape", [(32, 32), (24, 33)])
def test_white_noise_keeps_its_power_by_way_of_gradients(shape: tuple[int, int]) -> None:
    noise = np.random.default_rng(3).standard_normal((4000, *shape))
    power = np.mean(np.abs(hann_spectra(noise)) ** 2, axis=0)
    # Those of one column are real, and scatter more.
    np.testing.assert_allclose(power.ravel()[1:], 1, atol=0.13)
    assert power[2:, 2:].mean() == pytest.approx(1, abs=2e-3)
    assert power[0, 0] == 0


@pytest.mark.parametrize("step", [2, 4])
def test_differences_of_pixels_that_see_alike_take_a_pattern_out_and_keep_what_it_carries(
    step: int,
) -> None:
    rng = np.random.default_rng(4)
    pattern = np.tile(rng.random((step, step)), (64 // step, 64 // step))
    rows, columns = np.mgrid[:64, :64]
    slow = np.cos(2 * np.pi * (5 * columns + 3 * rows) / 64)
    found = hann_spectra(slow * (1 + 0.5 * (-1.0) ** columns) + pattern, step)
    assert np.abs(hann_spectra(pattern, step)).max() < 1e-9
    # Columns 32 - 5 hold the conjugate of what is beside the carrier at half a turn per pixel.
    assert found[-3, 32 - 5] / found[3, 5].conj() == pytest.approx(0.5, abs=0.02)


def test_white_noise_keeps_its_power_by_way_of_differences_of_a_mosaic() -> None:
    power = np.mean(np.abs(hann_spectra(np.random.default_rng(5).standard_normal((4000, 32, 32)), 4)) ** 2, axis=0)
    # Differences do not see what repeats every four pixels.
    seen = np.ones(power.shape, bool)
    seen[::8, ::8] = False
    np.testing.assert_allclose(power[seen], 1, atol=0.13)
    assert np.all(power[~seen] == 0)
