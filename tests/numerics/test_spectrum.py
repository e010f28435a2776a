"""Half spectra and windows."""

from __future__ import annotations

import numpy as np
import pytest

from polaropt.numerics.blocks import middle_part
from polaropt.numerics.spectrum import column_multiplicity, hann_autocorrelation, hann_window, tukey_window


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
