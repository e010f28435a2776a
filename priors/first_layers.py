"""What is there before the networks change it: the layers in closed form, or as the photographs alone tell them."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor, nn

from priors.main_axis import N_AXIS_NUMBERS, along_main_axis
from priors.observation import COLORS, N_CANDIDATES, Observation, n_scene_numbers
from priors.unmixing import Unmixing

N_IMAGES = 4


@dataclass(frozen=True)
class First:
    """What is there before the networks change it.

    Attributes
    ----------
    images : Tensor, shape (batch, 4, 3, h, w)
        Both layers, the sum of the views, and a difference of views.
    errors : Tensor, shape (batch, 12)
        Their standard errors in the opponent basis.
    numbers : Tensor, shape (batch, number)
        What is known of scene and noise.
    """

    images: Tensor
    errors: Tensor
    numbers: Tensor


class ClosedForm(nn.Module):
    """Takes the layers of an observation as they are.

    Parameters
    ----------
    n_views : int
    """

    def __init__(self, n_views: int) -> None:
        super().__init__()
        self.n_numbers = n_scene_numbers(n_views, conditioned=True)

    def forward(self, seen: Observation) -> First:
        """The layers in closed form, and sum and difference of the views along and across."""
        if seen.layers is None or seen.errors is None:
            raise ValueError("the conditioned form needs an observation with layers in closed form")
        total, contrast = seen.views.sum(1), seen.views[:, 0] - seen.views[:, 1]
        images = torch.cat([seen.layers, total[:, None], contrast[:, None]], dim=1)
        both = seen.view_errors.square().sum(1, keepdim=True).sqrt().expand(-1, 2 * COLORS)
        return First(images, torch.cat([seen.errors.flatten(1), both], dim=1), seen.scene)


class Unmixed(nn.Module):
    """Layers unmixed along the photographs' main direction of polarization.

    Parameters
    ----------
    n_views : int
    """

    def __init__(self, n_views: int) -> None:
        super().__init__()
        known = n_scene_numbers(n_views, conditioned=False) + N_AXIS_NUMBERS
        self._unmixing = Unmixing(known, N_CANDIDATES)
        self.n_numbers = known + 4

    def forward(self, seen: Observation) -> First:
        """Both layers, the intensity, and what differs between the directions in between."""
        if seen.shares is None:
            raise ValueError("the paper's form needs an observation with candidate panes")
        shown = along_main_axis(seen.views, seen.view_errors)
        axes, noise = shown.images[:, :2], shown.errors[:, :2]
        numbers = torch.cat([seen.scene, shown.numbers], dim=1)
        factors = self._unmixing(axes, seen.shares, numbers)
        layers = torch.einsum("bli,bichw->blchw", factors, axes)
        images = torch.cat([layers, axes.sum(1, keepdim=True), shown.images[:, 2:]], dim=1)
        of_layers = (factors * noise[:, None]).square().sum(2).sqrt()
        errors = torch.cat([of_layers, noise.square().sum(1, keepdim=True).sqrt(), shown.errors[:, 2:]], dim=1)
        numbers = torch.cat([numbers, torch.asinh(factors.flatten(1))], dim=1)
        return First(images, errors.repeat_interleave(COLORS, dim=1), numbers)
