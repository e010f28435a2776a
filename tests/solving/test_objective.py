"""The objective: its gradient, its units, its switches and masks; and the change of variables it is solved in."""

from __future__ import annotations

import numpy as np
import pytest

from polaropt.capture.capture import Capture
from polaropt.errors import InputError
from polaropt.inversion.canvas import canvas_for
from polaropt.inversion.closed_form import natural_image_layers
from polaropt.inversion.whitening import AssumedHessian, FourierPreconditioner
from polaropt.numerics.color import opponent_basis
from polaropt.optics.engine import PSE
from polaropt.solving.objective import Misfit, Weights, build_objective, default_penalties, unknown_shares
from priors.natural_image import NaturalImage
from tests.blends import Blend, blend
from tests.checks import assert_gradient

NAMES = ("misfit", "edge_independence", "gradient_sparsity", "nonnegativity", "natural_image")


def built(example: Blend, noise: float = 0.005, weights: Weights | None = None, robust: bool = False):
    pse = PSE(example.scene, example.capture.angles_deg)
    canvas = canvas_for(pse, *example.capture.shape[-2:])
    known = natural_image_layers(example.capture, pse, canvas, noise)
    misfit = Misfit(example.capture, pse, canvas, noise, robust)
    objective = build_objective(misfit, default_penalties(known, noise), canvas, weights or Weights())
    return objective, known, misfit, canvas


@pytest.mark.parametrize("robust", [False, True])
@pytest.mark.parametrize("color", [False, True])
def test_gradient_is_the_slope_of_the_value(color, robust):
    objective, known, _, _ = built(blend(60, 24, color=color), robust=robust)
    x = known.layers.astype(np.float64) + 0.01 * np.random.default_rng(0).standard_normal(known.layers.shape)
    assert_gradient(objective.value_and_grad, x, step=1e-3, tolerance=5e-3)


@pytest.mark.parametrize("name", NAMES)
def test_every_term_can_be_switched_off_and_is_still_reported(name):
    example = blend(60, 24)
    objective, known, _, _ = built(example, weights=Weights(**{name: 0}))
    everything, _, _, _ = built(example)
    terms, value = objective.terms(known.layers), objective.value_and_grad(known.layers)[0]
    assert set(terms) == set(NAMES)
    assert terms[name].weight == 0
    assert terms[name].value == pytest.approx(everything.terms(known.layers)[name].value)
    assert value == pytest.approx(sum(term.weight * term.value for term in terms.values()))


def test_a_factor_multiplies_its_term():
    example = blend(60, 24)
    objective, known, _, _ = built(example, weights=Weights(gradient_sparsity=2.5))
    assert objective.terms(known.layers)["gradient_sparsity"].weight == 2.5


@pytest.mark.parametrize("factor", [-1.0, np.nan, np.inf])
def test_a_weight_is_a_factor(factor):
    with pytest.raises(InputError, match="edge_independence"):
        Weights(edge_independence=factor)


def test_no_weight_depends_on_the_exposure():
    """Half the light with half the noise is the same picture, and costs the same."""
    values = []
    for exposure in (1.0, 0.5):
        example = blend(60, 32, exposure=exposure, noise=0.004 * exposure)
        objective, known, _, _ = built(example, noise=0.004 * exposure)
        values.append({name: term.value for name, term in objective.terms(known.layers).items()})
    for name in NAMES:
        assert values[0][name] == pytest.approx(values[1][name], rel=0.02, abs=1e-2)


def test_masked_pixels_have_no_say():
    example = blend(60, 32)
    valid = np.ones(example.capture.intensities.shape, dtype=bool)
    valid[2, :, 10:14, 10:14] = False
    damaged = example.capture.intensities.copy()
    damaged[2, :, 10:14, 10:14] = 0.95
    values = []
    for intensities in (example.capture.intensities, damaged):
        capture = Capture.of_planes(intensities, example.capture.angles_deg, valid)
        pse = PSE(example.scene, capture.angles_deg)
        misfit = Misfit(capture, pse, canvas_for(pse, 32, 32), 0.005)
        layers = np.full((2, 3, *canvas_for(pse, 32, 32).shape), 0.4, dtype=np.float32)
        values.append(misfit.value_and_grad(layers))
    assert values[0][0] == values[1][0]
    np.testing.assert_array_equal(values[0][1], values[1][1])


def test_true_layers_fit_to_the_noise():
    example = blend(60, 64, ghost_shift=0.0)
    _, _, misfit, canvas = built(example)
    value, _ = misfit.value_and_grad(canvas.extend(example.layers.astype(np.float32)))
    assert 2 * value / example.capture.intensities.size == pytest.approx(1, abs=0.03)


def test_outliers_count_linearly_in_the_robust_misfit():
    example = blend(60, 24)
    _, known, square, _ = built(example)
    _, _, robust, _ = built(example, robust=True)
    far = known.layers + np.float32(1)
    assert robust.value_and_grad(far)[0] < 0.2 * square.value_and_grad(far)[0]
    assert robust.value_and_grad(known.layers)[0] == pytest.approx(square.value_and_grad(known.layers)[0], rel=0.1)


def test_the_reflection_is_told_less_near_normal_incidence():
    shares = [unknown_shares(built(blend(incidence, 64))[1])[1] for incidence in (10, 40, 70)]
    assert shares[0] > 0.9
    assert shares == sorted(shares, reverse=True)


def hessian_for(shape: tuple[int, ...], curvature: float = 0.3) -> AssumedHessian:
    random = np.random.default_rng(0)
    half = (shape[2], shape[3] // 2 + 1)
    return AssumedHessian(
        told=random.uniform(2, 3, (2, *half)).astype(np.float32),
        cross=np.exp(1j * random.uniform(0, 6, half)).astype(np.complex64),
        stiffness=random.uniform(0.1, 1, (2, shape[1], *half)).astype(np.float32),
        curvature=np.full((2, shape[1]), curvature),
    )


@pytest.mark.parametrize("shape", [(2, 1, 17, 22), (2, 3, 16, 15)])
def test_whitened_coordinates_turn_gradients_by_the_transpose(shape):
    random = np.random.default_rng(0)
    mean = np.zeros((2, shape[1], 1, 1), dtype=np.float32)
    whitened = FourierPreconditioner(hessian_for(shape), mean, opponent_basis(shape[1]), shape[3])
    layers, g = (random.standard_normal(shape).astype(np.float32) for _ in range(2))
    z = whitened.coordinates(layers)
    assert np.vdot(whitened.layers(z), g) == pytest.approx(np.vdot(z, whitened.gradient(g)), rel=1e-3)


@pytest.mark.parametrize("shape", [(2, 1, 17, 22), (2, 3, 16, 15)])
def test_layers_come_back_from_their_coordinates(shape):
    mean = np.full((2, shape[1], 1, 1), 0.3, dtype=np.float32)
    whitened = FourierPreconditioner(hessian_for(shape), mean, opponent_basis(shape[1]), shape[3])
    layers = np.random.default_rng(0).standard_normal(shape).astype(np.float32)
    np.testing.assert_allclose(whitened.layers(whitened.coordinates(layers)), layers, atol=2e-5)


def test_a_quadratic_with_the_assumed_hessian_becomes_round():
    """Of the natural-image prior alone, one step along the gradient finds the minimum."""
    _, known, _, canvas = built(blend(60, 48))
    prior = NaturalImage(1 / known.prior, np.zeros_like(known.mean), known.basis)
    nothing = AssumedHessian(np.zeros_like(known.told), np.zeros_like(known.cross), 1 / known.prior, np.zeros((2, 3)))
    whitened = FourierPreconditioner(nothing, np.zeros_like(known.mean), known.basis, canvas.shape[1])
    z = whitened.coordinates(np.random.default_rng(0).standard_normal(known.layers.shape).astype(np.float32))
    value, gradient = prior.value_and_grad(whitened.layers(z))
    after, _ = prior.value_and_grad(whitened.layers(z - whitened.gradient(gradient)))
    assert after < 1e-6 * value
