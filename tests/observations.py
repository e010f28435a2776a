"""Small observations and networks for the tests of what is learned."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import torch

from priors.networks.fusionnet import Architecture, Form, Head, SeparationNetwork
from priors.observation import N_CANDIDATES, Observation
from priors.training.trainer import Sample

SMALL = {"polar_widths": (4, 6), "fusion_widths": (6, 8), "fusion_blocks": (1, 1)}


def small_network(form: Form = "conditioned", seed: int = 0, head: Head = "panes") -> SeparationNetwork:
    torch.manual_seed(seed)
    return SeparationNetwork(Architecture(form, **SMALL, head=head))


def observation(form: Form = "conditioned", size: tuple[int, int] = (24, 24), seed: int = 0) -> Observation:
    random = torch.Generator().manual_seed(seed)

    def image(*lead: int) -> torch.Tensor:
        return torch.rand(1, *lead, 3, *size, generator=random)

    n_views = 4 if form == "paper" else 2
    seen = Observation(image(n_views), torch.full((1, n_views), 0.005), torch.ones(1, 1, 1, *size))
    if form == "paper":
        return replace(seen, shares=torch.rand(1, N_CANDIDATES, 2, generator=random))
    errors, mixing = torch.full((1, 2, 3), 0.05), torch.tensor([[[0.45, 0.05], [0.3, 0.2]]])
    step = torch.tensor([[3.0, -1.0]])
    return Observation(
        seen.views, seen.view_errors, seen.trusted, image(2), errors, mixing, step, image(2), torch.ones(1, 2, 3, *size)
    )


class Mixtures:
    """Samples whose views are a fixed mixture of random layers, without a pane."""

    mixing = torch.tensor([[0.45, 0.05], [0.3, 0.2]])

    def samples(self, numbers: Sequence[int]) -> Iterator[Sample]:
        return map(self.sample, numbers)

    def sample(self, number: int) -> Sample:
        random = torch.Generator().manual_seed(number % 1000)
        layers = torch.nn.functional.interpolate(torch.rand(2, 3, 8, 8, generator=random), size=(32, 32))
        views = torch.einsum("vl,lchw->vchw", self.mixing, layers)
        noisy = layers + 0.05 * torch.randn(layers.shape, generator=random)
        seen = Observation(
            views[None],
            torch.full((1, 2), 0.005),
            torch.ones(1, 1, 1, 32, 32),
            noisy[None],
            torch.full((1, 2, 3), 0.05),
            self.mixing[None],
            torch.zeros(1, 2),
            torch.zeros_like(noisy)[None],
            torch.ones_like(noisy)[None],
        )
        parts = torch.einsum("vl,lchw->vlchw", self.mixing, layers)
        return Sample(seen, layers[None], parts[None], lambda both: torch.einsum("vl,lchw->vchw", self.mixing, both))
