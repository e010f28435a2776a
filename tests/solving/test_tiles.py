"""Large images in tiles: a partition of one, without seams, whatever a tile shows."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import polaropt.solving.solution
from polaropt import StoppingRule, separate
from polaropt.capture.capture import Capture
from polaropt.simulation.metrics import psnr_db
from polaropt.solving.solution import LARGEST_TILE, tiles
from tests.blends import blend


@settings(max_examples=60, deadline=None)
@given(st.integers(16, 700), st.integers(16, 700), st.integers(150, 400))
def test_weights_add_up_to_one_everywhere(height, width, largest):
    total = np.zeros((height, width), dtype=np.float32)
    for tile in tiles(height, width, largest):
        total[tile.where] += tile.weights
        assert max(tile.weights.shape) <= max(largest, 65)
    np.testing.assert_allclose(total, 1, atol=1e-6)


def test_a_usual_picture_is_one_tile():
    (tile,) = tiles(LARGEST_TILE, 512)
    assert tile.where == (slice(0, LARGEST_TILE), slice(0, 512))
    assert (tile.weights == 1).all()


@pytest.fixture
def small_tiles(monkeypatch):
    monkeypatch.setattr(polaropt.solving.solution, "tiles", lambda height, width: tiles(height, width, 160))


def test_tiles_agree_with_the_whole(monkeypatch):
    example = blend(60, 200)
    whole = separate(example.capture, example.scene)
    monkeypatch.setattr(polaropt.solving.solution, "tiles", lambda height, width: tiles(height, width, 160))
    parts = separate(example.capture, example.scene)
    assert parts.layers.shape == whole.layers.shape
    for i in (0, 1):
        quality = [psnr_db(result.layers[i], example.layers[i], 8) for result in (whole, parts)]
        assert quality[1] > quality[0] - 0.5
    assert parts.solver.n_evaluations <= 2 * whole.solver.n_evaluations
    assert parts.solver.value == pytest.approx(sum(t.weight * t.value for t in parts.terms.values()), rel=1e-4)
    assert parts.components.shape == whole.components.shape
    assert parts.diagnostics.warnings == whole.diagnostics.warnings == ()


@pytest.mark.parametrize("level", [0.0, 1.0])
def test_a_tile_may_show_nothing_at_all(small_tiles, level):
    example = blend(60, 200, color=False)
    intensities = example.capture.intensities.copy()
    intensities[..., :, 96:] = level
    result = separate(Capture.of_planes(intensities, example.capture.angles_deg), example.scene)
    assert np.isfinite(result.layers).all()
    seen = slice(8, 60)
    assert psnr_db(result.layers[0][..., seen], example.layers[0][..., seen]) > 30


def test_the_time_limit_is_that_of_all_tiles(small_tiles):
    example = blend(60, 200, color=False)
    result = separate(example.capture, example.scene, stopping=StoppingRule(seconds=1e-3, relative_change=0))
    assert result.solver.status.name == "TIME_LIMIT"
    assert result.solver.n_evaluations < 10


def test_progress_only_grows(small_tiles):
    example = blend(60, 200, color=False)
    told: list[float] = []
    separate(example.capture, example.scene, progress=lambda name, fraction: told.append(fraction))
    assert told == sorted(told)
    assert told[-1] <= 1
