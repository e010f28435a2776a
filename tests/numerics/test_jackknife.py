"""Errors by leaving parts out."""

from __future__ import annotations

import math

import numpy as np
import pytest

from polaropt.numerics.jackknife import grid_sums, jackknife_error, left_out


def test_of_a_mean_it_is_the_textbook_standard_error():
    values = np.random.default_rng(0).normal(size=30)
    estimates = left_out(values) / (values.size - 1)
    assert jackknife_error(estimates) == pytest.approx(values.std(ddof=1) / math.sqrt(values.size))


def test_one_part_tells_no_error():
    assert jackknife_error(np.array([1.0])) == math.inf


@pytest.mark.parametrize("shape", [(3, 17, 23), (2, 3)])
def test_parts_add_up_to_the_whole(shape):
    maps = np.random.default_rng(0).random(shape)
    parts = grid_sums(maps, 4)
    assert parts.shape == (*shape[:-2], min(4, shape[-2]) * min(4, shape[-1]))
    np.testing.assert_allclose(parts.sum(axis=-1), maps.sum(axis=(-2, -1)))
