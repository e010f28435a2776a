"""Bands and gates: exact sums, and the closed form where nothing is changed."""

from __future__ import annotations

import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from priors.networks.blocks import GROUPS, N_BANDS, activity, bands, doubled, gated, n_gates, strengths


@settings(max_examples=10, deadline=None)
@given(st.integers(1, 3), st.integers(1, 3), st.integers(0, 1000))
def test_bands_add_up_to_the_image(rows: int, columns: int, seed: int) -> None:
    images = torch.rand(2, 3, 16 * rows, 16 * columns, generator=torch.Generator().manual_seed(seed))
    parts = bands(images)
    assert len(parts) == N_BANDS
    torch.testing.assert_close(parts[0] + doubled(sum(parts[1:])), images)


def test_open_gates_give_their_source() -> None:
    sources = torch.rand(1, 9, 32, 48)
    gates = torch.zeros(1, n_gates(3), 16, 24)
    split = torch.unflatten(gates, 1, (N_BANDS, 2, GROUPS, 3))
    split[:, :, 0, :, 2], split[:, :, 1, :, 0] = 1, 1
    layers = gated(bands(sources), gates, torch.ones(1, N_BANDS, 2, GROUPS, 3, 1, 1))
    torch.testing.assert_close(layers[:, 0], sources[:, 6:])
    torch.testing.assert_close(layers[:, 1], sources[:, :3])


def test_a_gate_of_one_changes_a_layer_by_about_its_standard_error() -> None:
    parts = bands(torch.rand(1, 6, 32, 32))
    errors = torch.full((1, 2, 3), 1e-3)
    factors = strengths(parts, errors, 2)
    for band in range(N_BANDS):
        gates = torch.zeros(1, n_gates(2), 16, 16)
        torch.unflatten(gates, 1, (N_BANDS, 2, GROUPS, 2))[:, band, 0, :, 0] = 1
        change = gated(parts, gates, factors)
        assert 0.5e-3 < float(change[:, 0].square().mean(dim=(-1, -2)).sqrt().mean()) < 2e-3
        assert not change[:, 1].any()


def test_nothing_happens_where_all_is_the_same() -> None:
    assert not activity(bands(torch.full((1, 3, 16, 16), 0.4)), torch.full((1, 3), 0.01)).any()


def test_grey_images_have_finite_factors() -> None:
    grey = torch.zeros(1, 6, 16, 16)
    assert torch.isfinite(strengths(bands(grey), torch.zeros(1, 2, 3), 2)).all()
