"""A mosaic's sampling is linear: it has a transpose, and a pattern that goes on beyond any corner."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from polaropt.capture.mosaic import sampling_of
from polaropt.optics import PSE, SampledPSE, SceneParameters, VaryingPSE

RANDOM = np.random.default_rng(0)


@given(st.booleans(), st.integers(8, 21), st.integers(8, 21))
def test_spread_is_the_transpose_of_sample(color, height, width):
    sampling, _ = sampling_of(color)
    images = RANDOM.standard_normal((4, sampling.n_channels, height, width))
    raw = RANDOM.standard_normal((height, width))
    assert np.vdot(sampling.sample(images), raw) == pytest.approx(np.vdot(images, sampling.spread(raw, 4)))


@given(st.booleans(), st.integers(-9, 9), st.integers(-9, 9))
def test_a_part_is_sampled_as_the_whole_is(color, top, left):
    sampling, _ = sampling_of(color)
    images = RANDOM.standard_normal((4, sampling.n_channels, 40, 40))
    top, left = top + 10, left + 10
    part = sampling.moved(top, left).sample(images[..., top:, left:])
    np.testing.assert_array_equal(part, sampling.sample(images)[top:, left:])


def test_every_sample_belongs_to_one_photograph():
    sampling, _ = sampling_of(color=True)
    assert sampling.spread(np.ones((12, 12), dtype=int), 4).sum(axis=(0, 1)).tolist() == np.ones((12, 12)).tolist()


@pytest.mark.parametrize("color", [False, True])
def test_a_pixel_of_the_pattern_weighs_images_as_its_photograph_and_its_colour_do(color):
    sampling, _ = sampling_of(color)
    mixing, basis = RANDOM.standard_normal((4, 2)), RANDOM.standard_normal((sampling.n_channels, sampling.n_channels))
    images = RANDOM.standard_normal((len(basis), 2, sampling.period, sampling.period))
    photographs = np.einsum("ke,bc,beyx->kcyx", mixing, basis, images)
    weights = sampling.weights(mixing, basis).reshape(images.shape)
    np.testing.assert_allclose((weights * images).sum(axis=(0, 1)), sampling.sample(photographs))


@pytest.mark.parametrize("color", [False, True])
@pytest.mark.parametrize("shift", [0.0, 3.0, 2.4])
@pytest.mark.parametrize("focal_px", [None, 30.0])
def test_a_pane_behind_a_mosaic_has_a_transpose(color, shift, focal_px):
    sampling, angles = sampling_of(color)
    scene = SceneParameters(55.0, 30.0, shift, focal_px=focal_px)
    engine = (PSE if focal_px is None else VaryingPSE)(scene, angles)
    sampled = SampledPSE(engine, sampling)
    layers = RANDOM.standard_normal((2, sampling.n_channels, 17, 22))
    raw = RANDOM.standard_normal((17, 22))
    assert np.vdot(sampled.forward(layers), raw) == pytest.approx(np.vdot(layers, sampled.adjoint(raw)), rel=1e-5)


def test_values_of_each_photograph_and_colour_lie_where_they_are_sampled():
    sampling, _ = sampling_of(color=True)
    values = RANDOM.standard_normal((4, sampling.n_channels)).astype(np.float32)
    everywhere = np.broadcast_to(values[..., None, None], (*values.shape, 12, 8))
    np.testing.assert_array_equal(sampling.laid_out(values, (12, 8)), sampling.sample(everywhere))
    assert sampling.sample(everywhere).shape == (12, 8)


@pytest.mark.parametrize("color", [False, True])
@pytest.mark.parametrize(
    ("cell", "expected"),
    [
        ((90.0, 45.0, 135.0, 0.0), {(0.0, 0.5), (0.5, 0.0)}),
        ((0.0, 90.0, 45.0, 135.0), {(0.0, 0.5), (0.5, 0.5)}),
        ((0.0, 45.0, 90.0, 135.0), {(0.5, 0.0), (0.5, 0.5)}),
    ],
)
def test_polarized_light_alternates_but_not_by_what_tells_orthogonal_pairs_apart(color, cell, expected):
    sampling, angles = sampling_of(color, cell)
    assert set(sampling.alternations(angles)) == expected
    # Filters that stand a degree off make no others.
    assert set(sampling.alternations([angle + (-1) ** i for i, angle in enumerate(angles)])) == expected
