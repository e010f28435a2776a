"""Panes that photographs are explained by: what undoes them, and how the right one is told."""

from __future__ import annotations

import pytest
import torch
from hypothesis import assume, given
from hypothesis import strategies as st

from polaropt.solving.observation import transmitted_shares
from priors.networks.unmixing import Unmixing, edge_dependence, inverse_mixing
from priors.observation import N_CANDIDATES

SHARES = torch.from_numpy(transmitted_shares(1.5, N_CANDIDATES)).float()[None]


def mixed(layers: torch.Tensor, shares: torch.Tensor) -> torch.Tensor:
    """What a polarizer along and across shows, (2, h, w), of layers (2, h, w)."""
    mixing = torch.stack([shares, 1 - shares], dim=1) / 2
    return torch.einsum("il,lhw->ihw", mixing, layers)


def layers_with_edges(seed: int = 0, size: int = 96) -> torch.Tensor:
    """Two scenes of patches of random shape, (2, h, w)."""
    noise = torch.randn(2, 1, size + 12, size + 12, generator=torch.Generator().manual_seed(seed))
    smooth = torch.nn.functional.avg_pool2d(torch.nn.functional.avg_pool2d(noise, 7, stride=1), 7, stride=1)
    return (smooth[:, 0] > 0).float() * 0.5 + 0.2


@given(st.floats(0.05, 0.95), st.floats(0.05, 0.95))
def test_the_inverse_gives_both_layers_back(along: float, across: float) -> None:
    assume(abs(along - across) > 0.2)
    layers, shares = layers_with_edges(size=16), torch.tensor([along, across])
    found = torch.einsum("li,ihw->lhw", inverse_mixing(shares), mixed(layers, shares))
    assert torch.allclose(found, layers, atol=0.01 * float(layers.abs().max()))


def test_where_a_pane_mixes_alike_in_both_directions_its_inverse_is_damped() -> None:
    assert float(inverse_mixing(torch.tensor([0.92, 0.92])).abs().max()) == 0
    assert float(inverse_mixing(torch.tensor([0.921, 0.919])).abs().max()) < 50


@pytest.mark.parametrize("true", [8, 16, 22, 27])
def test_under_the_right_pane_edges_have_least_to_do_with_each_other(true: int) -> None:
    images = mixed(layers_with_edges(seed=true), SHARES[0, true])[None]
    dependence = edge_dependence(images, inverse_mixing(SHARES))
    finest = dependence[0, 0]
    assert abs(int(finest.argmin()) - true) <= 1
    assert float(finest[true]) < 0.05 < float(finest.max())


def test_images_larger_than_needed_are_told_alike_from_some_of_their_rows() -> None:
    layers = torch.nn.functional.interpolate(layers_with_edges()[None], size=(384, 384), mode="bilinear")[0]
    images = mixed(layers, SHARES[0, 20])[None]
    whole = edge_dependence(images[..., :128, :128], inverse_mixing(SHARES))
    sampled = edge_dependence(images, inverse_mixing(SHARES))
    assert sampled.shape == whole.shape
    assert abs(int(sampled[0, 4].argmin()) - 20) <= 2


def test_untrained_it_is_already_nearer_than_the_intensity() -> None:
    torch.manual_seed(0)
    unmixing = Unmixing(3, N_CANDIDATES)
    layers = layers_with_edges(seed=3)
    images = mixed(layers, SHARES[0, 20]).unsqueeze(1).expand(2, 3, 96, 96)[None]
    factors = unmixing(images, SHARES, torch.zeros(1, 3)).detach()
    found = torch.einsum("bli,bichw->blchw", factors, images)
    error, plain = (float((x - layers[0]).square().mean()) for x in (found[0, 0, 0], images[0, :, 0].sum(0)))
    assert error < plain / 2
