"""Light of a mosaic that no pane explains is no detail of the layers."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.ndimage import gaussian_filter

from polaropt import SceneParameters, SeparationWarning, separate, simulate
from polaropt.simulation import cut, psnr_db, shipped_photograph
from polaropt.solving.mosaic_pattern import firmness, mosaic_pattern
from tests.captured import ANGLES, mono_capture

SHAPE = (128, 160)
# Of cells whose orthogonal pairs lie along the diagonals.
BY_ROWS_AND_COLUMNS = ((0.0, 0.5), (0.5, 0.0))
SCENE = SceneParameters(55.0, 20.0, 0.0)


def photographs(lens_blur_px=0.6):
    images = [cut(shipped_photograph(name), SHAPE).mean(-1) for name in ("coffee", "chelsea")]
    return [gaussian_filter(0.6 * image, lens_blur_px) for image in images]


def layers_of_photographs():
    return np.stack(photographs()).astype(np.float32)[:, None]


def alternating(shape, at):
    rows, columns = np.mgrid[: shape[0], : shape[1]]
    return np.cos(2 * np.pi * (at[0] * rows + at[1] * columns)).astype(np.float32)


def slow(shape, seed=0, reach_px=30.0):
    return gaussian_filter(np.random.default_rng(seed).standard_normal(shape), reach_px).astype(np.float32)


def test_photographs_hold_nothing_that_alternates_with_the_polarizers():
    layers = layers_of_photographs()
    found = mosaic_pattern(layers, BY_ROWS_AND_COLUMNS)
    assert found.shape == layers.shape
    assert found.std() < 1e-4 * layers.std()


@settings(max_examples=25, deadline=None)
@given(
    st.integers(17, 100), st.integers(17, 100), st.sampled_from(BY_ROWS_AND_COLUMNS), st.integers(0, 1), st.integers()
)
def test_what_alternates_and_changes_slowly_is_found_in_its_layer_alone(height, width, at, layer, seed):
    layers = np.zeros((2, 1, height, width), dtype=np.float32)
    strength = 0.05 * (1 + slow((height, width), abs(seed)))
    layers[layer, 0] = 0.4 + strength * alternating((height, width), at)
    found = mosaic_pattern(layers, BY_ROWS_AND_COLUMNS)
    np.testing.assert_allclose(found[layer, 0], layers[layer, 0] - 0.4, atol=0.005)
    assert not found[1 - layer].any()


@pytest.mark.parametrize("period_px", [2.3, 2.7, 3.0, 4.0])
def test_fine_stripes_of_the_scene_stay(period_px):
    layers = layers_of_photographs()
    stripes = 0.1 * np.cos(2 * np.pi * np.arange(SHAPE[1]) / period_px)
    layers[0, 0, 30:90] += stripes.astype(np.float32)
    found = mosaic_pattern(layers, BY_ROWS_AND_COLUMNS)
    assert found.std() < 0.05 * np.square(stripes).mean() ** 0.5


def test_only_near_the_alternations_layers_are_held_more():
    held = firmness(96, 120, BY_ROWS_AND_COLUMNS)
    assert held.shape == (96, 61)
    assert held[48, 0] == held[0, 60] == held.max() > 1
    assert held[0, 0] == held[48, 60] == held[24, 30] == 1
    assert (held > 1).mean() < 0.1


def partly_polarized(degree):
    """A mosaic of a pane, and photographs without noise: stripes of things behind it are polarized by themselves."""
    scenery = photographs()
    clean = simulate(*scenery, SCENE, noise=0.0).intensities
    # The light passes the glass about as it is.
    things = slow(SHAPE, 3, 6.0) > 0
    cosines = np.cos(2 * np.radians(np.subtract(ANGLES, 70.0)))[:, None, None]
    light = clean + 0.5 * degree * cosines * gaussian_filter(scenery[0] * things, 1.0)
    noise = 0.005 * np.random.default_rng(1).standard_normal(light.shape)
    return mono_capture(light + noise), scenery


def alternation(layer):
    """How far columns and rows alternate, root mean square."""
    parts = [gaussian_filter(layer * alternating(layer.shape, at), 3) for at in BY_ROWS_AND_COLUMNS]
    return float(np.sqrt(np.square(parts).mean()))


def test_things_that_are_polarized_by_themselves_leave_no_weave_in_the_layers_and_are_warned_of():
    capture, (behind, _) = partly_polarized(0.15)
    result = separate(capture, SCENE)
    # Taken for detail, it made 0.0112 of 0.0046, and 35 dB.
    assert alternation(result.layers[0]) == pytest.approx(alternation(behind), abs=2e-4)
    assert psnr_db(result.layers[0], behind.astype(np.float32), 16) > 43
    assert SeparationWarning.MODEL_DOES_NOT_EXPLAIN in result.diagnostics.warnings
    assert result.diagnostics.misfit_ratio > 3


def test_where_the_model_holds_nothing_is_taken_out_and_nothing_warned_of():
    capture, (behind, _) = partly_polarized(0.0)
    result = separate(capture, SCENE)
    assert SeparationWarning.MODEL_DOES_NOT_EXPLAIN not in result.diagnostics.warnings
    assert result.diagnostics.misfit_ratio < 1.3
    assert psnr_db(result.layers[0], behind.astype(np.float32), 16) > 45
