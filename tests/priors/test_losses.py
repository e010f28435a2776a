"""The losses against their formulas, written out."""

from __future__ import annotations

import math

import pytest
import torch

from priors.networks.critics import Discriminator
from priors.networks.fusionnet import Separated
from priors.training.engines import BatchEngine
from priors.training.losses import (
    BORDER_PX,
    Critics,
    LossWeights,
    adversarial,
    decibel,
    discriminator_loss,
    edge_independence,
    loss_terms,
    perceptual,
    pixelwise,
    pse_loss,
    raw_pixels,
)
from priors.training.trainer import Batch
from tests.observations import Mixtures


def random_layers(seed: int, size: int = 32) -> torch.Tensor:
    return torch.rand(2, 2, 3, size, size, generator=torch.Generator().manual_seed(seed), dtype=torch.float64)


def test_pixelwise_is_the_norms_of_all_errors() -> None:
    layers, parts = torch.zeros(1, 2, 3, 8, 8), torch.zeros(1, 4, 2, 3, 8, 8)
    found = Separated(layers + torch.tensor([0.1, 0.2])[:, None, None, None], parts + 0.01)
    # Two layers, then four views of two parts.
    assert pixelwise(found, layers, parts) == pytest.approx(0.1 + 0.2 + 8 * 0.01, rel=1e-5)


def test_the_decibel_loss_falls_by_the_logarithm_of_the_squared_error() -> None:
    truth = random_layers(0)
    error = 0.01 * random_layers(1)
    drop = decibel(truth + error, truth) - decibel(truth + 0.5 * error, truth)
    assert float(drop) == pytest.approx(math.log(4), rel=1e-3)


def test_what_photographs_clip_hardly_counts_in_decibels() -> None:
    truth, error = random_layers(0), 0.01 * random_layers(1)
    trusted = torch.ones(2, 1, 1, 32, 32, dtype=torch.float64)
    trusted[..., 14:18] = 0.75
    without = float(decibel(truth + error, truth))
    assert float(decibel(truth + error, truth, torch.ones_like(trusted))) == pytest.approx(without)
    found = truth + error + 0.1 * (trusted < 1)
    assert float(decibel(found, truth)) > without + 4
    assert float(decibel(found, truth, trusted)) < without + 1


def test_edges_are_compared_at_three_scales() -> None:
    truth = random_layers(0)
    # A constant has no gradient; a slope of 0.01 per pixel has the same at every scale, in one of two directions.
    assert float(edge_independence(truth + 0.3, truth)) == pytest.approx(0, abs=1e-12)
    slope = 0.01 * torch.arange(32, dtype=torch.float64)
    loss = float(edge_independence((truth + slope)[..., 4:-4, :], truth[..., 4:-4, :]))
    assert loss == pytest.approx(2 * 3 * 0.01 / 2, rel=0.1)


def test_perceptual_compares_features_and_raw_pixels_compare_values() -> None:
    truth = random_layers(0)

    def features(images: torch.Tensor) -> list[torch.Tensor]:
        return [images, 3 * images]

    # The mean over two levels whose differences are 0.1 and 0.3, for two layers.
    assert float(perceptual(truth + 0.1, truth, features)) == pytest.approx(0.4)
    assert float(raw_pixels(truth + 0.1, truth)) == pytest.approx(0.2)


def test_the_engine_gives_the_views_back_from_true_layers_alone() -> None:
    sample = Mixtures().sample(1)
    views = sample.observation.views
    assert float(pse_loss(sample.layers, views, BatchEngine((sample.engine,)))) == pytest.approx(0, abs=1e-6)
    off = sample.layers + torch.tensor([0.1, 0.0])[:, None, None, None]
    assert float(pse_loss(off, views, BatchEngine((sample.engine,)))) == pytest.approx(0.1 * (0.45 + 0.3), rel=1e-4)


def test_what_may_come_from_beyond_the_frame_does_not_count() -> None:
    truth = random_layers(0, 64)
    off = truth.clone()
    off[..., :BORDER_PX, :] += 1
    views = torch.zeros(2, 2, 3, 64, 64, dtype=torch.float64)
    inside = (..., slice(BORDER_PX, -BORDER_PX), slice(BORDER_PX, -BORDER_PX))
    assert torch.equal(off[inside], truth[inside])

    def same(layers: torch.Tensor) -> torch.Tensor:
        return layers

    assert float(pse_loss(off, views, same)) == float(pse_loss(truth, views, same))
    assert float(decibel(off, truth)) == pytest.approx(math.log(1e-8))


def test_gradients_of_the_losses() -> None:
    truth, start = random_layers(0, 26), random_layers(1, 26).requires_grad_()
    views = random_layers(2, 26)
    for loss in (
        lambda x: decibel(x, truth),
        lambda x: pse_loss(x, views, lambda layers: 0.5 * layers),
        lambda x: edge_independence(x, truth),
        lambda x: raw_pixels(x, truth),
    ):
        # Absolute values have kinks; random points are not on them.
        assert torch.autograd.gradcheck(loss, (start,), eps=1e-7, atol=1e-5, fast_mode=True)


def test_a_judge_that_cannot_tell_costs_two_logarithms_of_two() -> None:
    judge = Discriminator(4)
    for parameter in judge.parameters():
        torch.nn.init.zeros_(parameter.requires_grad_(False))
    views, layers = torch.rand(2, 4, 3, 32, 32), torch.rand(2, 2, 3, 32, 32)
    assert float(adversarial(judge, views, layers)) == pytest.approx(math.log(2))
    assert float(discriminator_loss(judge, views, layers, layers)) == pytest.approx(2 * math.log(2))


def test_the_judge_learns_nothing_through_the_layers() -> None:
    judge, layers = Discriminator(4), torch.rand(1, 2, 3, 32, 32, requires_grad=True)
    discriminator_loss(judge, torch.rand(1, 2, 3, 32, 32), layers, torch.rand(1, 2, 3, 32, 32)).backward()
    assert layers.grad is None


def test_terms_that_are_off_are_not_computed() -> None:
    sample = Mixtures().sample(0)
    batch = Batch(sample.observation, sample.layers, sample.parts, BatchEngine((sample.engine,)))
    found = Separated(sample.layers + 0.1, sample.parts)
    weights = LossWeights(perceptual=0, edge_independence=0, adversarial=0)
    terms = loss_terms(found, batch, weights, Critics(features=lambda _: pytest.fail("computed")))
    assert set(terms) == {"pixelwise", "pse"}
    assert float(terms["pse"]) == pytest.approx(2 * 0.1 * 1.0, rel=1e-3)


def test_factors_are_finite_and_not_negative() -> None:
    with pytest.raises(ValueError, match="perceptual"):
        LossWeights(perceptual=-1)
