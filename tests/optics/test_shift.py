"""Shifts on the padded frame against a shift written out pixel by pixel."""

from __future__ import annotations

import math
from functools import partial

import numpy as np
import pytest
from array_api_compat import array_namespace
from hypothesis import given
from hypothesis import strategies as st

from polaropt.optics.shift import PaddedFrame
from tests.checks import Array, assert_adjoint

DISTANCES = st.one_of(
    st.integers(-4, 4).map(float), st.floats(-5, 5), st.floats(-500, 500), st.sampled_from([1e-13, -1e-13, 0.5])
)


def slow_shift(image: Array, dx: float, dy: float) -> Array:
    """Bilinear interpolation at (row - dy, column - dx), pixel by pixel, edges continued."""
    height, width = image.shape
    out = np.zeros(image.shape)
    for row in range(height):
        for column in range(width):
            y, x = row - dy, column - dx
            for i in (math.floor(y), math.floor(y) + 1):
                for j in (math.floor(x), math.floor(x) + 1):
                    weight = (1 - abs(y - i)) * (1 - abs(x - j))
                    out[row, column] += weight * image[min(max(i, 0), height - 1), min(max(j, 0), width - 1)]
    return out


def shift_images(images: Array, frame: PaddedFrame, i: int) -> Array:
    xp = array_namespace(images)
    return np.asarray(frame.shifted(frame.extend(images, xp), frame.shifts[i], xp))


def shift_transposed(images: Array, frame: PaddedFrame, i: int) -> Array:
    xp = array_namespace(images)
    planes = np.zeros((*images.shape[:-2], frame.padded_size))
    frame.add_shifted_back(images, frame.shifts[i], planes, xp)
    return np.asarray(frame.fold(planes, xp))


@given(height=st.integers(1, 7), width=st.integers(1, 7), moves=st.lists(st.tuples(DISTANCES, DISTANCES), min_size=1))
def test_shifts_are_bilinear_with_continued_edges(height: int, width: int, moves: list[tuple[float, float]]) -> None:
    image = np.random.default_rng(0).random((height, width))
    frame = PaddedFrame(height, width, moves)
    for i, (dx, dy) in enumerate(moves):
        np.testing.assert_allclose(shift_images(image, frame, i), slow_shift(image, dx, dy), atol=1e-11)


@given(height=st.integers(1, 7), width=st.integers(1, 7), moves=st.lists(st.tuples(DISTANCES, DISTANCES), min_size=1))
def test_the_transpose_is_exact(height: int, width: int, moves: list[tuple[float, float]]) -> None:
    frame = PaddedFrame(height, width, moves)
    for i in range(len(moves)):
        there, back = partial(shift_images, frame=frame, i=i), partial(shift_transposed, frame=frame, i=i)
        assert_adjoint(there, back, (2, height, width))


def test_what_is_shifted_back_is_added() -> None:
    images = np.random.default_rng(0).random((2, 5, 6))
    frame = PaddedFrame(5, 6, [(1.3, -0.4)])
    planes = np.ones((2, frame.padded_size))
    frame.add_shifted_back(images, frame.shifts[0], planes, array_namespace(images))
    expected = shift_transposed(images, frame, 0) + frame.fold(np.ones_like(planes), array_namespace(images))
    np.testing.assert_allclose(frame.fold(planes, array_namespace(images)), expected)


def test_a_whole_shift_copies() -> None:
    image = np.arange(12.0).reshape(3, 4)
    frame = PaddedFrame(3, 4, [(1, 0), (0, -1)])
    np.testing.assert_array_equal(shift_images(image, frame, 0)[:, 1:], image[:, :-1])
    np.testing.assert_array_equal(shift_images(image, frame, 1)[:-1], image[1:])


def test_rounding_of_the_direction_makes_no_fractions() -> None:
    away = math.cos(math.radians(90)) * 6
    assert away != 0
    (shift,) = PaddedFrame(8, 8, [(away, -6.0)]).shifts
    assert (shift.across, shift.down, shift.scale) == (0, 0, 1)


@pytest.mark.parametrize("distance", [1e3, 1e9, -1e9])
def test_far_shifts_cost_no_memory(distance: float) -> None:
    frame = PaddedFrame(5, 6, [(distance, distance)])
    assert frame.padded_size <= 200
    image = np.random.default_rng(0).random((5, 6))
    corner = image[0, 0] if distance > 0 else image[-1, -1]
    np.testing.assert_allclose(shift_images(image, frame, 0), corner)
