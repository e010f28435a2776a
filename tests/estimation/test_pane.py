"""Local fits of how a pane stands, and the errors they tell."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from polaropt.capture.polarization import StokesImages
from polaropt.estimation.wide.blocks import PolarizedBlocks
from polaropt.estimation.wide.pane import AZIMUTH, BEND, INCIDENCE, VIEW, Prior, fitted, with_errors
from polaropt.optics.geometry import bent_normal, plane_normal, viewing_angles

TRUE = np.array([np.radians(50.0), np.radians(200.0), 0.45, *np.radians([6.0, -3.0, 4.0])])
FLAT = np.array([*TRUE[:3], 0.0, 0.0, 0.0])
SIZE = 40


def seen(point: np.ndarray, seed: int = 0, noise: float = 0.01, stray: float = 0.0) -> PolarizedBlocks:
    """Blocks of a frame full of random light that is polarized along the plane of incidence, but for a stray spot."""
    random = np.random.default_rng(seed)
    middle = (np.arange(SIZE) - (SIZE - 1) / 2) * 2 / SIZE
    x, y = np.meshgrid(middle, -middle)
    normal = plane_normal(*np.degrees(point[:2]))
    _, cos, sin = viewing_angles(bent_normal(normal, tuple(point[3:]), point[VIEW], x, y), point[VIEW], x, y)
    along = random.uniform(-0.2, 0.3, (3, SIZE, SIZE))
    images = np.stack([np.ones_like(along), cos * along, sin * along])
    images[2] += stray * np.exp(-4 * (x * x + y * y))
    images[1:] += noise * random.standard_normal(images[1:].shape)
    return PolarizedBlocks(
        StokesImages(images.astype(np.float32), noise**2 * np.eye(3), np.ones((3, SIZE, SIZE), dtype=bool))
    )


@pytest.mark.parametrize(
    ("true", "free"),
    [(FLAT, (INCIDENCE, AZIMUTH, VIEW)), (FLAT, (INCIDENCE, AZIMUTH)), (TRUE, (AZIMUTH, *BEND))],
)
def test_the_light_tells_the_pane_within_its_errors(true, free):
    start = true.copy()
    start[list(free)] += 0.08
    blocks = seen(true)
    fit = with_errors(blocks, fitted(blocks, start, free), free)
    errors = np.sqrt(np.diag(fit.covariance))
    assert (np.abs(fit.point - true)[list(free)] < 4 * errors[list(free)]).all()
    rest = [i for i in range(6) if i not in free]
    np.testing.assert_array_equal(fit.point[rest], start[rest])
    assert (errors[rest] == 0).all()


@settings(max_examples=10, deadline=None)
@given(st.integers(0, 10_000), st.booleans())
def test_errors_are_as_large_as_told(seed, bent):
    free = (AZIMUTH, *BEND) if bent else (INCIDENCE, AZIMUTH, VIEW)
    true = TRUE if bent else FLAT
    blocks = seen(true, seed)
    fit = with_errors(blocks, fitted(blocks, true, free), free)
    away = (fit.point - true)[list(free)]
    covariance = fit.covariance[np.ix_(free, free)]
    # Chi squared of at most 4 degrees of freedom: more than 30 once in 200 000 times.
    assert away @ np.linalg.solve(covariance, away) < 30


def test_a_minimum_outside_the_bounds_is_not_followed():
    steep = FLAT.copy()
    steep[INCIDENCE] = np.radians(89.0)
    point = fitted(seen(steep), FLAT, (INCIDENCE, AZIMUTH))
    assert np.radians(85) < point[INCIDENCE] <= np.radians(86) + 1e-6


def test_a_prior_draws_what_the_light_does_not_tell():
    blocks = seen(TRUE)
    free = (INCIDENCE, AZIMUTH, VIEW, *BEND)
    prior = Prior(TRUE + 0.01, 1e12 * np.eye(6))
    fit = with_errors(blocks, fitted(blocks, TRUE, free, prior), free, prior)
    np.testing.assert_allclose(fit.point, prior.mean, atol=1e-4)
    np.testing.assert_allclose(np.sqrt(np.diag(fit.covariance)), 1e-6, rtol=0.1)


@pytest.mark.parametrize("free", [(INCIDENCE, AZIMUTH), (INCIDENCE, AZIMUTH, VIEW), (INCIDENCE, AZIMUTH, VIEW, *BEND)])
def test_the_light_across_grows_from_the_minimum_as_the_covariance_says(free):
    blocks = seen(TRUE, noise=1e-3)
    prior = Prior(TRUE, np.diag([1.0, 1.0, 10.0, 10.0, 10.0, 10.0]))
    fit = with_errors(blocks, fitted(blocks, TRUE, free, prior), free, prior)

    def cost(point):
        incidence, azimuth = np.degrees(point[:2])
        focal, bend = blocks.half_px / point[VIEW], tuple(point[3:] / blocks.half_px)
        return blocks.n * blocks.misfit(incidence, azimuth, focal, bend) + prior.distance(point)

    # In no direction is the error less than what the curvature makes it: there, one error off, the sum grows by 1.
    sizes, directions = np.linalg.eigh(fit.covariance[np.ix_(free, free)])
    for size, direction in zip(sizes, directions.T, strict=True):
        step = np.zeros(6)
        step[list(free)] = np.sqrt(size) * direction
        rise = (cost(fit.point + step) + cost(fit.point - step)) / 2 - cost(fit.point)
        assert rise > 0.95


def test_light_that_is_not_polarized_leaves_a_pane_where_it_is():
    dark = StokesImages(np.zeros((3, 3, SIZE, SIZE), np.float32), np.eye(3), np.ones((3, SIZE, SIZE), dtype=bool))
    np.testing.assert_array_equal(fitted(PolarizedBlocks(dark), TRUE, (INCIDENCE, AZIMUTH, VIEW)), TRUE)


def test_residuals_alike_in_neighbouring_blocks_widen_the_errors():
    blocks, other = seen(FLAT), seen(FLAT, stray=0.05)
    free = (INCIDENCE, AZIMUTH, VIEW)
    plain, widened = (with_errors(part, fitted(part, FLAT, free), free) for part in (blocks, other))
    assert widened.covariance[AZIMUTH, AZIMUTH] > 4 * plain.covariance[AZIMUTH, AZIMUTH]
