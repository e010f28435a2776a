"""Layers as sums of the bands of what is seen, each band with a gate per pixel.

A linear filter has the same gates everywhere. What a network has to learn beyond it is where to open and where to
close them: it learns that many times faster than to draw the layers itself.
"""

from __future__ import annotations

import torch
from torch import Tensor
from torch.nn.functional import avg_pool2d, interpolate

N_BANDS = 5
GROUPS = 2
"""Luminance, and both differences of the colours together."""


def doubled(images: Tensor) -> Tensor:
    """Images (batch, plane, h, w) at twice the size."""
    return interpolate(images, scale_factor=2, mode="bilinear", align_corners=False)


def bands(images: Tensor) -> list[Tensor]:
    """Bands that add up to the images, finest first; all but the first at half size.

    Parameters
    ----------
    images : Tensor, shape (batch, plane, h, w)
        Sides are multiples of 16.
    """
    half = avg_pool2d(images, 2)
    found, level = [images - doubled(half)], half
    for scale in range(1, N_BANDS - 1):
        coarse = avg_pool2d(level, 2)
        found.append(_at_half(level - doubled(coarse), scale))
        level = coarse
    return [*found, _at_half(level, N_BANDS - 1)]


def _at_half(band: Tensor, scale: int) -> Tensor:
    for _ in range(scale - 1):
        band = doubled(band)
    return band


def activity(parts: list[Tensor], errors: Tensor) -> Tensor:
    """How much happens in the finer bands beyond the noise, at half size, (batch, (N_BANDS - 2) plane, h / 2, w / 2).

    Parameters
    ----------
    parts : list of Tensor
        See `bands`.
    errors : Tensor, shape (batch, plane)
        Standard errors of the images.
    """
    noise = errors[..., None, None].clamp(min=1e-4)
    sizes = [avg_pool2d(parts[0].abs(), 2), *(part.abs() for part in parts[1 : N_BANDS - 2])]
    ratios = [avg_pool2d(size / noise, 3, stride=1, padding=1) for size in sizes]
    return torch.cat([ratio / (1 + ratio / 4) for ratio in ratios], dim=1)


def strengths(parts: list[Tensor], errors: Tensor, n_sources: int) -> Tensor:
    """Factor on each gate by which a gate of 1 changes a layer by its own standard error, on average.

    Parameters
    ----------
    parts : list of Tensor
        Bands of images (batch, 3 n_sources, h, w) in the opponent basis.
    errors : Tensor, shape (batch, 2, 3)
        Standard errors of the layers in that basis.
    n_sources : int

    Returns
    -------
    Tensor, shape (batch, N_BANDS, 2, GROUPS, n_sources, 1, 1)
    """
    factors = []
    for part in parts:
        power = torch.unflatten(part.square().mean(dim=(-1, -2)), 1, (n_sources, 3))
        size = torch.stack([power[..., 0], power[..., 1:].mean(-1)], dim=1).sqrt()
        wanted = torch.stack([errors[..., 0], errors[..., 1:].mean(-1)], dim=2)
        factors.append(wanted[..., None] / (size[:, None] + wanted[..., None]).clamp(min=1e-6))
    return torch.stack(factors, dim=1)[..., None, None]


def gated(parts: list[Tensor], gates: Tensor, factors: Tensor) -> Tensor:
    """Sum of gates times bands for both layers, in the opponent basis, (batch, 2, 3, h, w).

    Parameters
    ----------
    parts : list of Tensor
        Bands of images (batch, 3 n_sources, h, w) in the opponent basis.
    gates : Tensor, shape (batch, `n_gates(n_sources)`, h / 2, w / 2)
    factors : Tensor
        On the gates, see `strengths`.
    """
    n_sources = factors.shape[4]
    split = torch.unflatten(gates, 1, (N_BANDS, 2, GROUPS, n_sources)) * factors
    fine = torch.unflatten(doubled(split[:, 0].flatten(1, 3)), 1, (2, GROUPS, n_sources))
    coarse = sum(_mixed(split[:, k], parts[k], n_sources) for k in range(1, N_BANDS))
    assert isinstance(coarse, Tensor)
    return _mixed(fine, parts[0], n_sources) + torch.unflatten(doubled(coarse.flatten(1, 2)), 1, (2, 3))


def n_gates(n_sources: int) -> int:
    """Gates per pixel."""
    return N_BANDS * 2 * GROUPS * n_sources


def _mixed(gates: Tensor, band: Tensor, n_sources: int) -> Tensor:
    """Gates (batch, 2, GROUPS, source, h, w) times a band (batch, 3 source, h, w), summed over the sources."""
    colors = torch.unflatten(band, 1, (n_sources, 3))
    luminance = (gates[:, :, 0] * colors[:, None, :, 0]).sum(2, keepdim=True)
    chroma = torch.einsum("blshw,bschw->blchw", gates[:, :, 1], colors[:, :, 1:])
    return torch.cat([luminance, chroma], dim=2)
