"""Gaps that are filled smoothly, with nothing else changed, and means of blocks at their full size again."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from polaropt.numerics import block_mean, enlarged, smoothly_filled


def test_a_slope_goes_on_through_a_gap_without_steps() -> None:
    rows, columns = np.mgrid[:96, :96].astype(np.float32)
    slope = 0.01 * rows - 0.005 * columns
    known = np.ones(slope.shape, bool)
    known[30:62, 20:70] = False
    filled = smoothly_filled(np.where(known, slope, 9), known)
    inner = filled[32:60, 22:68]
    # Means of what is around know of the slope near the gap's edges alone.
    assert np.abs(filled - slope)[~known].max() < 0.2
    assert max(np.abs(np.diff(inner, axis=axis)).max() for axis in (0, 1)) < 0.03


@given(
    st.tuples(st.integers(1, 40), st.integers(1, 40)),
    st.integers(0, 2**32 - 1),
    st.floats(0, 1),
    st.floats(-2, 2, width=32),
)
@settings(max_examples=60, deadline=None)
def test_what_is_known_stays_and_what_is_not_lies_between(
    shape: tuple[int, int], seed: int, share: float, offset: float
) -> None:
    random = np.random.default_rng(seed)
    images = (offset + random.uniform(size=(2, *shape))).astype(np.float32)
    known = random.uniform(size=shape) < share
    filled = smoothly_filled(images, known)
    np.testing.assert_array_equal(filled[:, known], images[:, known])
    for image, found in zip(images, filled, strict=True):
        low, high = (image[known].min(), image[known].max()) if known.any() else (0, 0)
        assert low - 1e-4 <= found.min()
        assert found.max() <= high + 1e-4


@pytest.mark.parametrize("shape", [(1, 1), (7, 33), (64, 5)])
def test_images_of_which_nothing_is_known_are_black(shape: tuple[int, int]) -> None:
    assert (smoothly_filled(np.full((3, *shape), 5, np.float32), np.zeros(shape, bool)) == 0).all()


@pytest.mark.parametrize("side", [2, 3])
def test_between_the_middles_of_blocks_values_change_evenly(side):
    shape = (8 * side, 6 * side)
    y, x = np.mgrid[: shape[0], : shape[1]].astype(np.float32)
    ramp = (3 * y - 2 * x)[None]
    found = enlarged(block_mean(ramp, side), side, shape)
    inside = (..., slice(side, -side), slice(side, -side))
    np.testing.assert_allclose(found[inside], ramp[inside], atol=1e-4)
    # Beyond the outermost middles they stay as they are.
    np.testing.assert_array_equal(found[0, 0, : side // 2], np.full(side // 2, found[0, 0, 0]))
    np.testing.assert_array_equal(enlarged(np.ones((1, 1, 1), np.float32), 3, (3, 3)), np.ones((1, 3, 3)))
