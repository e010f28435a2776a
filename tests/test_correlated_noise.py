"""Photographs whose neighbours' noise is alike, as demosaicked ones: pane, double images and errors are found."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from polaropt import Capture, Separation, estimate, separate
from tests.blends import Blend, blend

NOISE, SIDE = 0.005, 160


def with_noise(true: Blend, blur_px: float) -> Capture:
    """A capture without noise, with such."""
    white = np.random.default_rng(3).standard_normal(true.capture.planes.shape)
    drawn = gaussian_filter(white, blur_px, axes=(-2, -1))
    return Capture.of_planes((true.capture.planes + NOISE * drawn / drawn.std()).astype(np.float32))


@cache
def example(incidence_deg: float, ghost_shift: float, blur_px: float) -> tuple[Blend, Separation]:
    """A capture with such noise, and its separation blind."""
    true = blend(incidence_deg, SIDE, ghost_shift=ghost_shift, noise=0.0)
    return true, separate(with_noise(true, blur_px))


@pytest.mark.parametrize("blur_px", [0.7, 1.2])
@pytest.mark.parametrize(("incidence_deg", "ghost_shift"), [(55.0, 5.0), (65.0, 0.0)])
def test_the_pane_is_found_and_nothing_is_warned_of(incidence_deg: float, ghost_shift: float, blur_px: float) -> None:
    true, found = example(incidence_deg, ghost_shift, blur_px)
    assert found.scene.ghost_shift == pytest.approx(ghost_shift, abs=0.2)
    assert found.scene.incidence_deg == pytest.approx(true.scene.incidence_deg, abs=1.5)
    assert found.diagnostics.warnings == ()


def test_edges_that_are_steeper_than_they_were_tell_no_index() -> None:
    true = blend(45.0, SIDE, ghost_shift=0.0, noise=0.0)
    capture = with_noise(true, 0.7)
    assert separate(capture).scene.refractive_index == true.scene.refractive_index
    free = estimate(capture, refractive_index=None)
    assert free.scene.refractive_index == pytest.approx(true.scene.refractive_index, abs=0.15)


@pytest.mark.parametrize("blur_px", [0.7, 1.2])
@pytest.mark.parametrize(("incidence_deg", "ghost_shift"), [(55.0, 5.0), (65.0, 0.0)])
def test_layers_lie_within_two_of_their_errors(incidence_deg: float, ghost_shift: float, blur_px: float) -> None:
    true, found = example(incidence_deg, ghost_shift, blur_px)
    errors = np.asarray(found.uncertainty).reshape(found.layers.shape)
    within = (np.abs(found.layers - true.layers) < 2 * errors).mean(axis=(1, 2, 3))
    assert within.min() > 0.9


@pytest.mark.parametrize("blur_px", [0.7, 1.2])
def test_the_misfit_is_in_units_of_a_pixels_noise(blur_px: float) -> None:
    """Though layers are solved for more of it."""
    _, found = example(55.0, 5.0, blur_px)
    assert found.diagnostics.noise == pytest.approx(NOISE, rel=0.05)
    assert 0.9 < found.diagnostics.misfit_ratio < 2.1
