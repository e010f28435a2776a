"""Photographs seen along and across their main direction of polarization, and how much they vary together there.

A network that sees photographs at fixed angles has to learn one thing for every azimuth of a pane. Turned to the
direction in which they are polarized most, which is the pane's azimuth or the one across, it learns it once.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor
from torch.nn.functional import avg_pool2d

_N_IMAGES = 3
N_AXIS_NUMBERS = 2 * 6 + 3 + 2
_LEAST = 1e-8


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
    errors = noise * noise.new_tensor([[0.75**0.5, 0.75**0.5, 0.5**0.5]])
    luminance = images.mean(2)
    finest = luminance - _smooth(luminance)
    means = luminance.mean(dim=(2, 3))
    numbers = [
        _together(luminance - means[..., None, None]),
        _together(finest),
        means / (means[:, :2].sum(1, True) + _LEAST),
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
    total = covariance.diagonal(dim1=1, dim2=2).sum(1, keepdim=True) + _LEAST
    shares = values / total
    # Roots spread the small shares.
    return shares.sign() * (shares.abs() + 1e-6).sqrt()
