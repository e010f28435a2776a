"""Real captures: how far edges are shared."""

from __future__ import annotations

import numpy as np
import pytest

from studies.real_captures import edge_correlation


def test_edges_correlate_with_themselves():
    random = np.random.default_rng(0)
    image, other = random.standard_normal((2, 40, 40))
    assert edge_correlation(image, image) == pytest.approx(1)
    assert abs(edge_correlation(image, other)) < 0.2
