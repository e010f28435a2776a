"""Captures refuse what cannot be photographs, and their noise and gain are measured right."""

import dataclasses
import pickle
import time

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from polaropt import Capture, InputError
from polaropt.capture.capture import Origin
from polaropt.capture.noise import noise_level
from polaropt.capture.pair_gain import divide_out_gain, orthogonal_pairs, pair_gain_of, redundancy_residual
from polaropt.numerics import quantization_step
from tests.captured import ANGLES, photographed, scene_intensities


def test_shapes_and_stokes():
    capture = Capture(np.moveaxis(scene_intensities((3, 20, 24)), 1, -1))
    assert capture.shape == (3, 20, 24)
    assert capture.color
    assert capture.stokes.shape == (3, 3, 20, 24)
    assert capture.intensities.dtype == np.float32
    assert capture.origin is None


def test_colours_come_last_in_what_a_capture_takes_and_first_in_what_it_holds():
    planes = scene_intensities((3, 20, 24)).astype(np.float32)
    valid = np.random.default_rng(0).random(planes.shape) > 0.1
    capture = Capture(np.moveaxis(planes, 1, -1), ANGLES, np.moveaxis(valid, 1, -1))
    same = Capture.of_planes(planes, ANGLES, valid)
    for one in (capture, same):
        np.testing.assert_array_equal(one.intensities, planes)
        np.testing.assert_array_equal(one.valid, valid)
        assert one.intensities.flags.c_contiguous
        assert one.valid.flags.c_contiguous


def test_a_capture_does_not_change():
    capture = Capture(scene_intensities())
    with pytest.raises(AttributeError):
        capture.origin = Origin()
    with pytest.raises(AttributeError):
        capture.intensities = capture.intensities
    # It would give planes to a constructor that takes colours last.
    with pytest.raises((TypeError, ValueError)):
        dataclasses.replace(capture, angles_deg=(0, 30, 60, 90))
    again = pickle.loads(pickle.dumps(capture.with_origin(files=("a.png",))))
    np.testing.assert_array_equal(again.intensities, capture.intensities)
    assert again.origin == Origin(("a.png",))


def test_another_capture_is_made_of_one():
    capture = Capture(np.moveaxis(scene_intensities((3, 20, 24)), 1, -1)).with_origin(files=("a.png",))
    turned = capture.replace(angles_deg=(10, 55, 100, 145)).with_origin(start_deg=10.0)
    assert turned.angles_deg == (10.0, 55.0, 100.0, 145.0)
    assert turned.origin == Origin(("a.png",), start_deg=10.0)
    assert turned.intensities is capture.intensities
    assert (capture.origin, capture.angles_deg) == (Origin(("a.png",)), ANGLES)
    with pytest.raises(InputError, match="photographs but"):
        capture.replace(angles_deg=(0, 60, 120))
    with pytest.raises(InputError, match="validity mask"):
        capture.replace(valid=np.ones((4, 20, 24), dtype=bool))
    # A part need not be a capture that makes sense by itself.
    black = capture.replace(intensities=0 * capture.intensities)
    assert black.part(slice(2, 18), slice(0, 16)).shape == (3, 16, 16)


@pytest.mark.parametrize(
    ("shape", "words"),
    [
        ((4, 3, 20, 24), r"channels last, \(angle, height, width, 3\)"),
        ((4, 20, 24, 1), "leave out any other channel"),
        ((4, 20, 24, 4), "leave out any other channel"),
        ((4, 1, 20, 24), "leave out any other channel"),
        ((4, 2, 3, 20, 24), r"expected \(angle, height, width\)"),
    ],
)
def test_another_order_of_channels_is_refused_with_what_to_do(shape, words):
    images = np.random.default_rng(0).uniform(0.1, 0.9, shape)
    with pytest.raises(InputError, match=words) as caught:
        Capture(images)
    assert "\n" not in str(caught.value)


def test_a_mask_has_the_order_of_the_photographs():
    images = np.moveaxis(scene_intensities((3, 20, 24)), 1, -1)
    with pytest.raises(InputError, match="validity mask"):
        Capture(images, valid=np.ones((4, 3, 20, 24), dtype=bool))


def test_white_is_not_valid_by_default():
    images = scene_intensities()
    images[1, 3, 4] = 1
    capture = Capture(images)
    assert not capture.valid[1, 3, 4]
    assert capture.valid.sum() == images.size - 1


def spoiled(change):
    images = scene_intensities((20, 20))
    return change(images)


def with_value(value):
    def change(images):
        images[0, 5, 5] = value
        return images

    return change


@pytest.mark.parametrize(
    ("change", "angles", "words"),
    [
        (lambda images: images[:2], (0, 90), "at least 3"),
        (lambda images: images, (0, 45, 180, 90), "equal"),
        (lambda images: images, (0, 45, np.nan, 90), "not a number"),
        (lambda images: images, (0, "x", 3, 90), "degrees"),
        (lambda images: images, (0, 60, 120), "4 photographs but 3"),
        (lambda images: images[0], ANGLES, "shape"),
        (lambda images: images[:, :15], ANGLES, "at least 16x16"),
        (with_value(np.nan), ANGLES, "NaN"),
        (with_value(np.inf), ANGLES, "NaN or infinite"),
        (with_value(-0.02), ANGLES, "black level"),
        (lambda images: 0 * images, ANGLES, "all black"),
        (lambda images: 0 * images + 0.3, ANGLES, "constant"),
        (lambda images: 0 * images + 1, ANGLES, "saturated"),
        (lambda images: images.astype(complex), ANGLES, "complex"),
        (lambda images: [images[0], images[1][:5]], (0, 45), "differ in shape"),
        (lambda images: (255 * images).astype(np.uint8), ANGLES, "whole numbers up to .* give floats"),
        (lambda images: (4095 * images).astype(np.uint16), ANGLES, "white is 1"),
        (lambda images: 255 * images, ANGLES, "beyond white, which is 1"),
    ],
)
def test_what_is_no_capture_is_one_clear_line(change, angles, words):
    with pytest.raises(InputError, match=words) as caught:
        Capture(spoiled(change), angles)
    assert "\n" not in str(caught.value)


def test_small_negative_values_are_noise_and_kept():
    capture = Capture(spoiled(with_value(-0.0099)))
    assert capture.intensities.min() == np.float32(-0.0099)


def test_a_mask_of_another_shape_is_refused():
    with pytest.raises(InputError, match="validity mask"):
        Capture(scene_intensities(), valid=np.ones((64, 64), dtype=bool))


@pytest.mark.parametrize("noise", [0.001, 0.005, 0.02, 0.05])
@pytest.mark.parametrize("bits", [None, 8, 12])
@pytest.mark.parametrize("angles", [ANGLES, (0, 60, 120), (0, 36, 72, 108, 144)])
def test_noise_is_measured_to_a_few_percent(noise, bits, angles):
    capture = photographed((128, 128), angles, noise, bits)
    expected = np.hypot(noise, 0 if bits is None else 1 / (2**bits - 1) / np.sqrt(12))
    # Three photographs say nothing twice: only their finest detail is left.
    tolerance = 0.06 if len(angles) > 3 else 0.3
    assert noise_level(capture) == pytest.approx(expected, rel=tolerance)


@pytest.mark.parametrize("exposure", [1.5, 2.5])
def test_noise_is_measured_under_strong_saturation(exposure):
    capture = photographed((128, 128), noise=0.02, exposure=exposure)
    assert np.mean(~capture.valid.all(axis=0)) > 0.2
    assert noise_level(capture) == pytest.approx(0.02, rel=0.05)


def test_a_pair_gain_is_no_noise():
    images = photographed((128, 128), noise=0.003).intensities.copy()
    images[[1, 3]] *= 1.025
    assert noise_level(Capture(images, valid=np.ones(images.shape, dtype=bool))) == pytest.approx(0.003, rel=0.05)


def test_noise_does_not_take_long():
    capture = photographed((3, 256, 256))
    noise_level(capture)
    start = time.perf_counter()
    noise_level(capture)
    assert time.perf_counter() - start < 0.3


@pytest.mark.parametrize("bits", [4, 5, 6, 8, 10, 12])
def test_grey_levels_are_found(bits):
    capture = photographed((128, 128), bits=bits)
    assert quantization_step(capture.intensities) == pytest.approx(1 / (2**bits - 1), rel=0.02)


def test_continuous_values_have_no_grey_levels():
    assert quantization_step(photographed().intensities) < 1e-4
    assert quantization_step(np.tile(np.float32([0.2, 0.7]), (4, 16, 8))) == 0


@given(st.lists(st.integers(0, 35), min_size=4, max_size=7, unique=True), st.integers(0, 99))
def test_the_redundancy_vanishes_for_every_stokes_vector(tens, seed):
    stokes = np.random.default_rng(seed).standard_normal((3, 5))
    angles = [5.0 * ten for ten in tens]
    double = 2 * np.radians(angles)[:, None]
    images = (stokes[0] + stokes[1] * np.cos(double) + stokes[2] * np.sin(double)) / 2
    residual = redundancy_residual(images, angles)
    assert residual.shape == (len(angles) - 3, 5)
    np.testing.assert_allclose(residual, 0, atol=1e-12)


@settings(max_examples=20)
@given(st.floats(0.92, 1.08), st.permutations(range(4)))
def test_the_pair_gain_is_found_in_any_order(gain, order):
    images = photographed((64, 64), noise=0.002).intensities.copy()
    images[[1, 3]] *= np.float32(gain)
    shuffled, angles = images[list(order)], [ANGLES[k] for k in order]
    found = pair_gain_of(shuffled, angles)
    assert found == pytest.approx(gain, rel=2e-3)
    assert pair_gain_of(divide_out_gain(shuffled, angles, found), angles) == pytest.approx(1, abs=1e-5)


def test_orthogonal_pairs():
    assert orthogonal_pairs(ANGLES) == ((0, 2), (1, 3))
    assert orthogonal_pairs((135, 0, 45, 90)) == ((1, 3), (0, 2))
    assert orthogonal_pairs((10, 100, 55, 145)) is not None
    assert orthogonal_pairs((0, 30, 60, 90)) is None
    assert orthogonal_pairs((0, 60, 120)) is None
    assert pair_gain_of(scene_intensities(angles_deg=(0, 60, 120)), (0, 60, 120)) is None
