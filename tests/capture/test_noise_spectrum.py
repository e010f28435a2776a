"""Noise whose neighbours are alike is told from white noise, and made white."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.fft import irfft2, rfft2

from polaropt.capture import Capture, JpegFacts, Origin, correlated_noise, noise_level, noise_of_blocks
from polaropt.capture.noise_spectrum import NoiseSpectrum, noise_spectrum
from polaropt.numerics import block_mean, frequencies
from tests.blends import blend

NOISE, SIDE = 0.005, 192


def standing_out(height: int, width: int) -> np.ndarray:
    rows, columns = frequencies(height, width)
    return 1 - (np.cos(rows) + np.cos(columns)) / 2


def drawn(blur_px: float, shape: tuple[int, ...] = (4, 3, SIDE, SIDE), seed: int = 0) -> np.ndarray:
    """Noise of unit variance that was smoothed by something like a Gaussian."""
    white = np.random.default_rng(seed).standard_normal(shape)
    if not blur_px:
        return white
    response = np.exp(-2 * blur_px**2 * standing_out(*shape[-2:]))
    noise = irfft2(rfft2(white) * response, shape[-2:])
    return noise / noise.std()


def noisy(blur_px: float, scene: str = "photographs") -> Capture:
    """A colour capture with such noise."""
    light = blend(55, SIDE, noise=0.0).capture.planes if scene == "photographs" else np.full((4, 1, SIDE, SIDE), 0.4)
    return Capture.of_planes((light + NOISE * drawn(blur_px)).astype(np.float32))


def test_white_noise_is_white() -> None:
    spectrum = noise_spectrum(noisy(0.0))
    assert spectrum is not None
    assert spectrum.white
    assert np.abs(spectrum.level - 1).max() < 0.06
    assert correlated_noise(noisy(0.0), NOISE) is None


@pytest.mark.parametrize("scene", ["photographs", "a grey wall"])
@pytest.mark.parametrize("blur_px", [0.5, 0.8])
def test_the_spectrum_is_that_of_the_noise_whatever_it_lies_on(blur_px: float, scene: str) -> None:
    spectrum = correlated_noise(noisy(blur_px, scene), NOISE)
    assert spectrum is not None
    passed = np.exp(-2 * blur_px**2 * standing_out(SIDE, SIDE))
    columns = np.r_[1, np.full(SIDE // 2 - 1, 2), 1]
    true = np.exp(-2 * blur_px**2 * spectrum.frequency) / np.sqrt((passed**2 * columns).sum() / SIDE**2)
    assert spectrum.level == pytest.approx(true, rel=0.1, abs=0.03)


@pytest.mark.parametrize("blur_px", [0.5, 1.2])
def test_means_over_blocks_are_as_noisy_as_is_told(blur_px: float) -> None:
    capture = noisy(blur_px, "a grey wall")
    measured = 8 * block_mean(capture.intensities - 0.4, 8).std()
    level = noise_level(capture)
    assert level == pytest.approx(NOISE, rel=0.05)
    # Blocks of 8 px see changes, too, that are not as slow as that.
    assert 0.95 < noise_of_blocks(capture, level) / measured < 1.25


def test_what_is_made_white_is_and_keeps_slow_changes() -> None:
    capture = noisy(0.7)
    spectrum = correlated_noise(capture, NOISE)
    assert spectrum is not None
    white = spectrum.whitened(capture)
    after = noise_spectrum(white)
    assert after is not None
    # Of what is weaker than a sixth of the strongest, less is made.
    strong = spectrum.level > spectrum.level.max() / 6
    assert np.abs(after.level[strong] / after.level[0] - 1).max() < 0.25
    slow = block_mean(capture.intensities, 32)
    assert np.abs(block_mean(white.intensities, 32) - slow).max() < 0.01 * slow.mean()
    assert noise_level(white) == pytest.approx(NOISE * spectrum.slow, rel=0.3)


def test_strips_and_edges_are_as_the_whole() -> None:
    """A picture that goes on as at its edge, each frequency times what the weights make of it."""
    spectrum = NoiseSpectrum(np.linspace(0, 2, 14), np.exp(-np.linspace(0, 2, 14)))
    capture = noisy(0.0)
    rim = 32
    padded = np.pad(capture.intensities, [(0, 0), (0, 0), (rim, rim), (rim, rim)], mode="edge").astype(float)
    weights = spectrum._weights / spectrum._weights[0]
    response = np.polynomial.polynomial.polyval(standing_out(*padded.shape[-2:]), weights)
    expected = irfft2(rfft2(padded) * response, padded.shape[-2:])[..., rim:-rim, rim:-rim]
    assert spectrum.whitened(capture).intensities == pytest.approx(expected, abs=1e-5)


def test_pixels_that_see_one_that_cannot_be_trusted_cannot_either() -> None:
    capture = noisy(0.7)
    valid = np.ones(capture.intensities.shape, bool)
    valid[1, 2, 60, 80] = False
    spectrum = correlated_noise(capture, NOISE)
    assert spectrum is not None
    marked = capture.replace(valid=valid)
    changed = marked.replace(intensities=np.where(valid, capture.intensities, 0.9).astype(np.float32))
    seen = spectrum.whitened(changed).intensities != spectrum.whitened(marked).intensities
    assert seen.any()
    assert not (seen & spectrum.whitened(marked).valid).any()
    # Nothing beyond is lost, nor in other photographs and colours.
    assert np.count_nonzero(~spectrum.whitened(marked).valid) <= 9 * 9


@pytest.mark.parametrize(("share", "common"), [(0.0, 1.0), (0.5, np.sqrt(2.0)), (1.0, np.sqrt(3.0))])
def test_noise_that_colours_have_in_common_is_told(share: float, common: float) -> None:
    own, shared = drawn(0.0), drawn(0.0, (4, 1, SIDE, SIDE), 1)
    noise = NOISE * (np.sqrt(1 - share) * own + np.sqrt(share) * shared)
    light = blend(55, SIDE, noise=0.0).capture.planes
    capture = Capture.of_planes((light + noise).astype(np.float32))
    found = correlated_noise(capture, NOISE)
    if not share:
        assert found is None
        return
    assert found is not None
    assert found.white
    assert found.common == pytest.approx(common, rel=0.04)
    # Means over blocks of a colour are as noisy as if it were alone.
    assert noise_of_blocks(capture, NOISE) == NOISE


def test_layers_are_solved_for_more_noise_than_a_pixels() -> None:
    frequency = np.linspace(0, 2, 14)
    assert NoiseSpectrum(frequency, np.ones(14)).of_layers == 1
    assert NoiseSpectrum(frequency, np.exp(-frequency)).of_layers == 1
    slow, common = NoiseSpectrum(frequency, 2.4 * np.exp(-frequency)), NoiseSpectrum(frequency, np.ones(14), 1.7)
    assert 1.2 < slow.of_layers < 1.4
    assert 1.4 < common.of_layers < 1.6
    both = NoiseSpectrum(frequency, slow.level, 1.7)
    assert both.of_layers == max(slow.of_layers, common.of_layers)


@pytest.mark.parametrize("wrong", ["gains", "angles"])
def test_gains_and_angles_that_are_off_are_no_noise_of_neighbours(wrong: str) -> None:
    capture = noisy(0.0)
    gains = np.array([1, 1.01, 0.99, 1.005] if wrong == "gains" else np.ones(4), np.float32)
    turned = 0.02 * np.roll(capture.intensities, 1, axis=0) * [[[[1]]], [[[-1]]], [[[1]]], [[[-1]]]]
    off = capture.intensities + (turned if wrong == "angles" else 0)
    assert correlated_noise(capture.replace(intensities=off * gains[:, None, None, None]), NOISE) is None


def test_what_jpeg_took_away_is_not_taken_for_quiet_detail() -> None:
    """It is the same in all photographs, which therefore agree."""
    capture = noisy(0.7)
    assert correlated_noise(capture, NOISE) is not None
    strong = Origin(jpeg=JpegFacts(quality=75, halved_colors=False, step=0.05))
    assert correlated_noise(capture.replace(origin=strong), NOISE) is None


def test_three_photographs_small_ones_and_mosaics_tell_nothing() -> None:
    capture = noisy(0.7, "a grey wall")
    three = Capture.of_planes(capture.intensities[:3], (0.0, 60.0, 120.0))
    assert correlated_noise(three, NOISE) is None
    assert correlated_noise(capture.part(slice(0, 64), slice(0, 64)), NOISE) is None
    assert correlated_noise(capture.replace(origin=Origin(layout="mono mosaic")), NOISE) is None


def test_coarse_grey_levels_have_rounding_errors_and_no_such_noise() -> None:
    capture = noisy(0.7)
    coarse = capture.replace(intensities=np.round(capture.intensities * 15) / np.float32(15))
    assert correlated_noise(coarse, noise_level(coarse)) is None
