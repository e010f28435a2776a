"""The edges of two layers upon each other: what noise alone leaves of them."""

from __future__ import annotations

import math

import numpy as np
import pytest

from polaropt.estimation.flat.ghost_overlap import coarse_overlap
from polaropt.estimation.flat.overlap import NOISE_BEYOND, SHRINK


def test_what_noise_leaves_of_a_gradient_is_the_normal_tails_second_moment() -> None:
    tail, density = math.erfc(SHRINK / math.sqrt(2)) / 2, math.exp(-(SHRINK**2) / 2) / math.sqrt(2 * math.pi)
    assert pytest.approx(2 * ((1 + SHRINK**2) * tail - SHRINK * density), rel=0.005) == NOISE_BEYOND
    noise = np.random.default_rng(0).standard_normal(1_000_000)
    assert np.square(np.maximum(np.abs(noise) - SHRINK, 0)).mean() == pytest.approx(NOISE_BEYOND, rel=0.03)


def test_layers_without_edges_tell_nothing() -> None:
    """Their overlap was 0, whose logarithm ended in a traceback where photographs are as good as black."""
    assert coarse_overlap(np.zeros((2, 32, 32), np.float32)) == 1
    one = np.zeros((2, 32, 32), np.float32)
    one[0, :, 16:] = 1
    assert coarse_overlap(one) == pytest.approx(1)
