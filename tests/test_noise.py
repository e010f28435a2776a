"""Noise of large captures, from a part of their pixels."""

from __future__ import annotations

import numpy as np
import pytest

from polaropt.capture import Capture
from polaropt.noise import noise_level


def test_a_large_capture_is_sampled_all_over() -> None:
    rng = np.random.default_rng(0)
    sigma = np.linspace(0.004, 0.012, 900)[:, None]
    images = 0.4 + 0.2 * np.sin(np.arange(900) / 40) + sigma * rng.standard_normal((4, 900, 900))
    found = noise_level(Capture(images.astype(np.float32)))
    few = noise_level(Capture(images[:, ::3, ::3].astype(np.float32)))
    assert found == pytest.approx(few, rel=0.02)
    assert found == pytest.approx(0.0078, rel=0.05)
