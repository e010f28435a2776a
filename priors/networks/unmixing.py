"""Layers unmixed along the main axis of polarization, by how independent candidate panes leave the edges.

A network that sees photographs at fixed angles has to learn one thing for every azimuth of a pane. Turned to the
direction in which they are polarized most, which is the pane's azimuth or the one across, it learns it once.

Of all panes there are, each undoes the mixing in its own way, and the right one leaves edges that have nothing to do
with each other. How much they still have to do is measured for every candidate; what that is worth is learned.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor, nn
from torch.nn.functional import avg_pool2d, leaky_relu

from priors.networks.blocks import constant

_N_IMAGES = 3
N_AXIS_NUMBERS = 2 * 6 + 3 + 2
# Added to what is divided by: far below any image's variance (white = 1).
_LEAST_LENGTH = 1e-8


@dataclass(frozen=True)
class AlongAxis:
    """What is seen along the main axis.

    Attributes
    ----------
    images : Tensor, shape (batch, 3, 3, h, w)
        A polarizer along the axis, across it, and half of what differs between the directions in between.
    errors : Tensor, shape (batch, 3)
        Standard deviations of their noise.
    numbers : Tensor, shape (batch, `N_AXIS_NUMBERS`)
        How much the images vary together, as they are and from pixel to pixel, their means, and where the axis lies.
    """

    images: Tensor
    errors: Tensor
    numbers: Tensor


def along_main_axis(views: Tensor, view_errors: Tensor) -> AlongAxis:
    """Turn views to their main axis.

    Parameters
    ----------
    views : Tensor, shape (batch, 4, 3, h, w)
        At 0, 45, 90 and 135 degrees.
    view_errors : Tensor, shape (batch, 4)
    """
    total, s1, s2 = views.sum(1) / 2, views[:, 0] - views[:, 2], views[:, 1] - views[:, 3]
    direction = _direction(s1.mean(1), s2.mean(1))
    cos, sin = (direction[:, k, None, None, None] for k in (0, 1))
    along, between = cos * s1 + sin * s2, cos * s2 - sin * s1
    images = torch.stack([(total + along) / 2, (total - along) / 2, between / 2], dim=1)
    noise = view_errors.mean(1, keepdim=True)
    errors = noise * constant([[0.75**0.5, 0.75**0.5, 0.5**0.5]], noise)
    luminance = images.mean(2)
    finest = luminance - _smooth(luminance)
    means = luminance.mean(dim=(2, 3))
    numbers = [
        _together(luminance - means[..., None, None]),
        _together(finest),
        means / (means[:, :2].sum(1, True) + _LEAST_LENGTH),
    ]
    return AlongAxis(images, errors, torch.cat([*numbers, direction], dim=1))


def _direction(s1: Tensor, s2: Tensor) -> Tensor:
    """Cosine and sine of twice the main axis, (batch, 2): the way in which more of the light is polarized."""
    xx, yy, xy = (product.mean(dim=(1, 2)) for product in (s1 * s1, s2 * s2, s1 * s2))
    angle = torch.atan2(2 * xy, xx - yy) / 2
    direction = torch.stack([angle.cos(), angle.sin()], dim=1)
    mean = torch.stack([s1.mean(dim=(1, 2)), s2.mean(dim=(1, 2))], dim=1)
    return direction * torch.where((direction * mean).sum(1, keepdim=True) < 0, -1.0, 1.0)


def _smooth(images: Tensor) -> Tensor:
    return avg_pool2d(images, 3, stride=1, padding=1, count_include_pad=False)


def _together(images: Tensor) -> Tensor:
    """Covariances of images (batch, 3, h, w), less the total, scaled for a network, (batch, 6)."""
    flat = images.flatten(2)
    covariance = flat @ flat.mT / flat.shape[-1]
    first, second = torch.triu_indices(_N_IMAGES, _N_IMAGES, device=images.device)
    values = covariance[:, first, second]
    total = covariance.diagonal(dim1=1, dim2=2).sum(1, keepdim=True) + _LEAST_LENGTH
    shares = values / total
    # Roots spread the small shares.
    return shares.sign() * (shares.abs() + 1e-6).sqrt()


# Levels of edges, each at half the size of the one before: set by hand, as the hidden width below.
_LEVELS = 3
_MEASURES = 2 * _LEVELS
_HIDDEN = 64
# Places at each level where edges are looked at, about.
_MOST_PLACES = 128 * 128
# Square of the contrast (white = 1) at which an edge counts half.
_LEAST_CONTRAST = 1e-4
# Added to what is divided by.
_LEAST = 1e-9
# What the choice among candidates begins with; it is learned.
_SHARPNESS = 4.0


class Unmixing(nn.Module):
    """Weighs candidate panes and mixes what they would undo.

    Parameters
    ----------
    n_numbers : int
        What is known beside: noise, and how the images vary together.
    n_candidates : int
    """

    def __init__(self, n_numbers: int, n_candidates: int) -> None:
        super().__init__()
        both = 2 * n_candidates
        self._sharpness = nn.Parameter(torch.full((_MEASURES,), _SHARPNESS))
        self._first = nn.Linear(n_numbers + _MEASURES * both, _HIDDEN)
        self._second = nn.Linear(_HIDDEN, _HIDDEN)
        self._last = nn.Linear(_HIDDEN, both + 2)
        with torch.no_grad():
            self._last.weight.mul_(0.1)

    def forward(self, images: Tensor, shares: Tensor, numbers: Tensor) -> Tensor:
        """Factors (batch, layer, 2) on the images along and across the main axis that give both layers.

        Parameters
        ----------
        images : Tensor, shape (batch, 2, 3, h, w)
            A polarizer along the main axis, and across it.
        shares : Tensor, shape (batch, candidate, 2)
            Of the light along and across a candidate's plane of incidence, what it transmits.
        numbers : Tensor, shape (batch, `n_numbers`)
        """
        # The main axis is the plane of incidence, or the direction across.
        inverses = inverse_mixing(torch.cat([shares, shares.flip(2)], dim=1))
        with torch.no_grad():
            dependence = edge_dependence(images.mean(2), inverses)
        hidden = leaky_relu(self._first(torch.cat([numbers, 2 * dependence.flatten(1)], dim=1)), 0.1)
        out = self._last(leaky_relu(self._second(hidden), 0.1))
        evidence = torch.einsum("m,bmk->bk", self._sharpness, dependence)
        # The last candidate is no pane at all: both layers are the intensity.
        weights = torch.cat([out[:, :-2] - evidence, out[:, -2:-1]], dim=1).softmax(dim=1)
        factors = torch.einsum("bk,bkli->bli", weights[:, :-1], inverses) + weights[:, -1, None, None]
        # A reflection that the photographs hardly tell is best dimmed.
        dimmed = torch.sigmoid(out[:, -1:])
        return factors * torch.stack([torch.ones_like(dimmed), dimmed], dim=1)


def inverse_mixing(shares: Tensor) -> Tensor:
    """What undoes the mixing of panes that lose no light, (..., layer, 2), from what they transmit, (..., 2).

    Along, an image is half of ``share * transmission + (1 - share) * reflection``; where a pane mixes both directions
    nearly alike the inverse is damped.
    """
    along, across = shares[..., 0], shares[..., 1]
    contrast = along - across
    size = 2 * contrast / (contrast.square() + _LEAST_CONTRAST)
    rows = [torch.stack([1 - across, along - 1], dim=-1), torch.stack([-across, along], dim=-1)]
    return size[..., None, None] * torch.stack(rows, dim=-2)


def edge_dependence(images: Tensor, inverses: Tensor) -> Tensor:
    """How much the edges of both layers have to do with each other, if a candidate were right.

    Parameters
    ----------
    images : Tensor, shape (batch, 2, h, w)
    inverses : Tensor, shape (batch, candidate, 2, 2)

    Returns
    -------
    Tensor, shape (batch, 6, candidate)
        At three scales: correlation of how strong the edges are, then the size of that of the edges themselves.
    """
    measures = []
    for level in range(_LEVELS):
        if level:
            images = avg_pool2d(images, 2)
        both = torch.einsum("bkli,bip->bklp", inverses, _edges(images))
        size = both.abs()
        # Compressed, so that the few strongest edges do not decide alone.
        both = both.div_(size.add_(size.mean(dim=3, keepdim=True) + _LEAST))
        product = both[:, :, 0] * both[:, :, 1]
        mean, square = both.abs().mean(dim=3), torch.linalg.vector_norm(both, dim=3).square() / both.shape[3]
        spread = (square - mean.square()).clamp(min=0).sqrt()
        signed = product.mean(dim=2).abs() / (mean.prod(dim=2) + _LEAST)
        strength = product.abs_().mean(dim=2) - mean.prod(dim=2)
        measures += [strength / (spread.prod(dim=2) + _LEAST), signed]
    return torch.stack(measures, dim=1)


def _edges(images: Tensor) -> Tensor:
    """Differences of neighbours to the right and below, (batch, 2, place); on large images of some rows alone."""
    rows = max(1, images.shape[-2] * images.shape[-1] // _MOST_PLACES)
    right = images[..., ::rows, 1:] - images[..., ::rows, :-1]
    down = (images[..., 1:, :] - images[..., :-1, :])[..., ::rows, :]
    return torch.cat([right.flatten(2), down.flatten(2)], dim=2)
