"""The penalties: gradients by differences, and what each must and must not see."""

from __future__ import annotations

import numpy as np
import pytest

from polaropt.numerics.color import opponent_basis
from priors.edge_independence import EdgeIndependence
from priors.gradient_sparsity import GradientSparsity, LayerSparsity
from priors.natural_image import NaturalImage
from priors.nonnegativity import Nonnegativity
from tests.checks import assert_gradient

SPARSITY = GradientSparsity((LayerSparsity(2.0, 0.02, 0.001), LayerSparsity(5.0, 0.05, 0.004)), exponent=0.6)


def natural(channels: int, height: int, width: int) -> NaturalImage:
    power = np.random.default_rng(3).uniform(0.1, 1, (2, channels, height, width // 2 + 1)).astype(np.float32)
    # Conjugate frequencies of a real image are equally strong.
    power[..., 1:, 0] = 0.5 * (power[..., 1:, 0] + power[..., :0:-1, 0])
    if width % 2 == 0:
        power[..., 1:, -1] = 0.5 * (power[..., 1:, -1] + power[..., :0:-1, -1])
    mean = np.full((2, channels, 1, 1), 0.3, dtype=np.float32)
    strength = np.array([0.7, 0.2], dtype=np.float32)[:, None, None, None]
    return NaturalImage(strength / power, mean, opponent_basis(channels))


def penalties(channels: int, height: int, width: int) -> list[object]:
    return [
        SPARSITY,
        EdgeIndependence(0.3, (0.02, 0.05)),
        Nonnegativity((4.0, 2.0)),
        natural(channels, height, width),
    ]


@pytest.mark.parametrize("shape", [(2, 1, 17, 22), (2, 3, 16, 13), (2, 4, 20, 20)])
@pytest.mark.parametrize("which", range(4))
def test_gradient_is_the_slope_of_the_value(shape, which):
    penalty = penalties(*shape[1:])[which]
    x = np.random.default_rng(0).standard_normal(shape).astype(np.float64) * 0.2
    assert_gradient(penalty.value_and_grad, x, step=1e-4, tolerance=2e-3)


@pytest.mark.parametrize("penalty", [SPARSITY, EdgeIndependence(1.0, (0.1, 0.1))])
def test_constant_layers_cost_nothing(penalty):
    layers = np.ones((2, 3, 16, 16), dtype=np.float32) * np.array([0.2, 0.7], dtype=np.float32).reshape(2, 1, 1, 1)
    value, gradient = penalty.value_and_grad(layers)
    assert value == pytest.approx(0, abs=1e-3)
    assert np.abs(gradient).max() == 0


def test_edges_in_different_places_are_independent():
    layers = np.zeros((2, 1, 32, 32), dtype=np.float32)
    layers[0, :, :, 8:] = 1
    layers[1, :, :, 24:] = 1
    apart, _ = EdgeIndependence(1.0, (0.1, 0.1)).value_and_grad(layers)
    layers[1] = layers[0]
    together, _ = EdgeIndependence(1.0, (0.1, 0.1)).value_and_grad(layers)
    assert apart == 0
    assert together > 10


def test_one_large_edge_is_cheaper_than_many_small_ones():
    steps = np.zeros((2, 1, 32, 64), dtype=np.float32)
    steps[0] = (np.arange(64) // 8 / 7).astype(np.float32)
    edge = np.zeros_like(steps)
    edge[0, :, :, 32:] = 1
    assert SPARSITY.value_and_grad(edge)[0] < 0.85 * SPARSITY.value_and_grad(steps)[0]


def test_an_edge_of_one_colour_costs_more_than_a_grey_edge_of_the_same_energy():
    grey = np.zeros((2, 3, 16, 16), dtype=np.float32)
    grey[0, :, :, 8:] = 1 / np.sqrt(3)
    red = np.zeros_like(grey)
    red[0, 0, :, 8:] = 1
    assert SPARSITY.value_and_grad(red)[0] > SPARSITY.value_and_grad(grey)[0]


def test_light_that_is_not_negative_is_free():
    layers = np.random.default_rng(0).uniform(0, 1, (2, 1, 8, 8)).astype(np.float32)
    assert Nonnegativity((1.0, 3.0)).value_and_grad(layers)[0] == 0
    layers[1, 0, 2, 3] = -0.5
    value, gradient = Nonnegativity((1.0, 3.0)).value_and_grad(layers)
    assert value == pytest.approx(3 / 2 * 0.25)
    assert gradient[1, 0, 2, 3] == pytest.approx(-1.5)


def test_the_expected_mean_is_free_of_charge():
    prior = natural(3, 16, 16)
    basis = opponent_basis(3)
    layers = np.einsum("oc,loyx->lcyx", basis, np.broadcast_to(prior.mean, (2, 3, 16, 16))).astype(np.float32)
    assert prior.value_and_grad(layers)[0] == pytest.approx(0, abs=1e-8)


@pytest.mark.parametrize("n_channels", [1, 2, 3, 5])
def test_the_colour_basis_is_orthonormal_and_starts_with_the_mean(n_channels):
    basis = opponent_basis(n_channels)
    np.testing.assert_allclose(basis @ basis.T, np.eye(n_channels), atol=1e-14)
    np.testing.assert_allclose(basis[0], 1 / np.sqrt(n_channels))
