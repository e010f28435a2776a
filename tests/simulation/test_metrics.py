"""Measures of likeness."""

from __future__ import annotations

import math

import numpy as np
import pytest

from polaropt.simulation.metrics import psnr_db

IMAGE = np.random.default_rng(0).random((3, 20, 24))


@pytest.mark.parametrize(("error", "peak", "expected"), [(0.1, 1.0, 20), (0.01, 1.0, 40), (1.0, 255.0, 48.13)])
def test_psnr_of_a_known_error(error: float, peak: float, expected: float) -> None:
    assert psnr_db(IMAGE + error, IMAGE, peak=peak) == pytest.approx(expected, abs=0.01)


def test_a_border_is_left_out() -> None:
    spoilt = IMAGE + 0.1
    spoilt[:, :4] = spoilt[..., -4:] = 7
    assert psnr_db(spoilt, IMAGE, border=4) == pytest.approx(20)


def test_equal_images_give_a_finite_number() -> None:
    assert math.isfinite(psnr_db(IMAGE, IMAGE))


def test_images_that_do_not_fit_are_an_error() -> None:
    with pytest.raises(ValueError, match="shapes"):
        psnr_db(IMAGE[0], IMAGE)
    with pytest.raises(ValueError, match="leaves nothing"):
        psnr_db(np.moveaxis(IMAGE, 0, -1), np.moveaxis(IMAGE, 0, -1), border=4)
