"""A mask in bits gives what it was made of."""

from __future__ import annotations

import numpy as np
import pytest

from polaropt.numerics import BitMask, count_true

MASK = np.random.default_rng(0).uniform(size=(4, 3, 20, 37)) > 0.3


def test_all_of_it_comes_back():
    bits = BitMask.of(MASK)
    assert (bits.shape, bits.size) == (MASK.shape, MASK.size)
    assert bits.bits.nbytes < MASK.nbytes / 7
    np.testing.assert_array_equal(np.asarray(bits), MASK)
    assert np.asarray(bits).dtype == bool
    assert count_true(bits) == count_true(MASK) == MASK.sum()
    np.testing.assert_array_equal(bits.all(axis=0), MASK.all(axis=0))
    np.testing.assert_array_equal(bits.all(axis=(0, 1)), MASK.all(axis=(0, 1)))
    np.testing.assert_array_equal(bits[2, 1], MASK[2, 1])
    assert all((own == given).all() for own, given in zip(bits, MASK, strict=True))


@pytest.mark.parametrize(
    "columns", [slice(None), slice(0, 8), slice(3, 30), slice(9, 10), slice(5, 5), slice(-4, None)]
)
@pytest.mark.parametrize("rows", [slice(None), slice(4, 11), np.array([1, 2, 17])])
def test_parts_are_those_of_the_whole(rows, columns):
    part = BitMask.of(MASK)[..., rows, columns]
    np.testing.assert_array_equal(part, MASK[..., rows, columns])
    assert part.flags.c_contiguous


def test_what_it_cannot_give_is_refused():
    bits = BitMask.of(MASK)
    with pytest.raises(IndexError, match="neighbouring"):
        bits[..., slice(None), slice(0, 10, 2)]
    for axis in (1, (1, 0), (0, 1, 2)):
        with pytest.raises(ValueError, match="first axes"):
            bits.all(axis=axis)
