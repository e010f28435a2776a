"""Films of the study of sequences: what passes by, what is true of cells, and what a row says."""

from __future__ import annotations

import numpy as np
import pytest

from studies.photographs import Size
from studies.sequences import PANE, Job, Sensor, film, run

SMALL = Sensor("mono", Size(96, 128), "cell")


def test_a_still_film_shows_the_same_in_other_noise() -> None:
    shown = film(Job(None, 0, SMALL, "still", "known", 2))
    assert np.array_equal(*shown.layers)
    difference = shown.raw[1].astype(np.float64) - shown.raw[0]
    assert 0 < difference.std() < 0.01


def test_both_scenes_of_a_turning_camera_pass_by_each_in_its_way() -> None:
    first, second = film(Job(None, 0, Sensor("mono", Size(96, 128), "sensor"), "turning", "known", 2)).layers
    np.testing.assert_allclose(second[0, :, 2:, 1:], first[0, :, :-2, :-1], atol=1e-6)
    np.testing.assert_allclose(second[1, :, :-1, 2:], first[1, :, 1:, :-2], atol=1e-6)


@pytest.mark.parametrize(("kind", "scale"), [("mono", 2), ("color", 4)])
def test_the_truth_of_a_cell_is_the_mean_of_its_pixels(kind, scale) -> None:
    size = Size(96, 128)
    of_cells = film(Job(None, 1, Sensor(kind, size, "cell"), "still", "known", 1))
    of_sensor = film(Job(None, 1, Sensor(kind, size, "sensor"), "still", "known", 1))
    cells = of_sensor.layers[0].reshape(2, -1, 96 // scale, scale, 128 // scale, scale).mean(axis=(3, 5))
    np.testing.assert_allclose(of_cells.layers[0], cells, atol=1e-6)
    assert of_cells.scene.ghost_shift == PANE.ghost_shift / scale


def test_a_row_tells_how_far_layers_change_where_nothing_moves() -> None:
    (row,) = run(Job(None, 0, SMALL, "still", "known", 3))
    assert row.size == "64x48"
    assert row.transmission > 30
    assert 0.5 < row.change_transmission < 1.5
    assert row.cpu_s > 0
