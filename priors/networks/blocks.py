"""Parts that the networks are built of: colours, residual blocks, hourglasses, gates.

A linear filter has the same gates everywhere. What a network has to learn beyond it is where to open and where to
close them: it learns that many times faster than to draw the layers itself.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from typing import Any

import torch
from torch import Tensor, nn
from torch.nn.functional import avg_pool2d, interpolate, leaky_relu, pad

# Factors on luminance and on two differences of the colours.
_GREY, _RED_GREEN, _BLUE = 3**-0.5, 2**-0.5, 6**-0.5
# Side of the squares, in pixels, over which a mean counts as coarse: set by hand.
_COARSE = 8
LARGE = 4.0
"""Planes in units of their errors are compressed to half here."""


def opponent(images: Tensor) -> Tensor:
    """Images (..., 3, h, w) in an orthonormal basis of luminance and two differences of the colours."""
    red, green, blue = images.unbind(-3)
    both = red + green
    return torch.stack([_GREY * (both + blue), _RED_GREEN * (red - green), _BLUE * (both - 2 * blue)], dim=-3)


def from_opponent(images: Tensor) -> Tensor:
    """Inverse of `opponent`."""
    grey, red_green, blue = images.unbind(-3)
    both = _GREY * grey + _BLUE * blue
    difference = _RED_GREEN * red_green
    return torch.stack([both + difference, both - difference, _GREY * grey - 2 * _BLUE * blue], dim=-3)


def constant(values: Any, like: Tensor) -> Tensor:
    """Numbers in the dtype and on the device of a tensor; a GPU need not be done with what it does to take them."""
    return torch.as_tensor(values, dtype=like.dtype).to(like.device, non_blocking=True)


def detail(images: Tensor, errors: Tensor) -> Tensor:
    """Local contrast of images (batch, plane, h, w) in units of their errors (batch, plane), compressed."""
    mean = avg_pool2d(images, _COARSE, ceil_mode=True)
    smooth = interpolate(mean, size=images.shape[-2:], mode="bilinear", align_corners=False)
    contrast = (images - smooth) / errors[:, :, None, None].clamp(min=1e-4)
    return contrast / (1 + contrast.abs() / LARGE)


class Modulation(nn.Module):
    """Turns the numbers of a scene into a factor and an offset per channel of several layers.

    Parameters
    ----------
    n_numbers : int
        0 for layers that know nothing of the scene.
    channels : sequence of int
        Of each layer.
    """

    def __init__(self, n_numbers: int, channels: Sequence[int]) -> None:
        super().__init__()
        self._channels = list(channels)
        self._hidden = nn.Linear(n_numbers, 32) if n_numbers else None
        self._out = nn.Linear(32, 2 * sum(channels)) if n_numbers else None
        if self._out is not None:
            nn.init.normal_(self._out.weight, std=0.02)
            nn.init.zeros_(self._out.bias)

    def forward(self, numbers: Tensor) -> list[tuple[Tensor, Tensor] | None]:
        """Factor and offset (batch, channel, 1, 1) of each layer; None where nothing is known of the scene."""
        if self._hidden is None or self._out is None:
            return [None] * len(self._channels)
        parts = self._out(leaky_relu(self._hidden(numbers), 0.1))[..., None, None]
        pieces = torch.split(parts, [2 * n for n in self._channels], dim=1)
        return [(1 + piece[:, :n], piece[:, n:]) for piece, n in zip(pieces, self._channels, strict=True)]


class ResidualBlock(nn.Module):
    """Two 3x3 convolutions beside the identity.

    Parameters
    ----------
    channels : int
    """

    def __init__(self, channels: int) -> None:
        super().__init__()
        self._first = nn.Conv2d(channels, channels, 3, padding=1)
        self._second = nn.Conv2d(channels, channels, 3, padding=1)
        nn.init.kaiming_normal_(self._first.weight, a=0.1)
        nn.init.kaiming_normal_(self._second.weight, a=1.0)
        with torch.no_grad():
            self._second.weight.mul_(0.3)

    def forward(self, x: Tensor, modulation: tuple[Tensor, Tensor] | None = None) -> Tensor:
        """Features of the same shape."""
        inner = self._first(x)
        if modulation is not None:
            inner = inner * modulation[0] + modulation[1]
        features: Tensor = x + self._second(leaky_relu(inner, 0.1))
        return features


class Level(nn.Module):
    """Residual blocks one after the other.

    Parameters
    ----------
    channels, n_blocks : int
    """

    def __init__(self, channels: int, n_blocks: int) -> None:
        super().__init__()
        self._blocks = nn.ModuleList(ResidualBlock(channels) for _ in range(n_blocks))

    def forward(self, x: Tensor, modulation: tuple[Tensor, Tensor] | None = None) -> Tensor:
        """Features of the same shape; the first block is modulated."""
        for number, block in enumerate(self._blocks):
            x = block(x, None if number else modulation)
        return x


class Hourglass(nn.Module):
    """Encoder and decoder with skips: each level halves the image, and the way back adds what was there before.

    Parameters
    ----------
    n_inputs, n_outputs : int
        Planes.
    levels : sequence of (int, int)
        Channels and residual blocks each way of each level; the first works at the planes' own size.
    n_numbers : int
        Numbers of the scene that modulate the blocks; 0 for none.
    """

    def __init__(self, n_inputs: int, n_outputs: int, levels: Sequence[tuple[int, int]], n_numbers: int = 0) -> None:
        super().__init__()
        widths = [width for width, _ in levels]
        steps = list(itertools.pairwise(widths))
        self.multiple = 2 ** (len(levels) - 1)
        # Many planes come in and go out: what mixes them sees no neighbours, the blocks do.
        self._entry = nn.Conv2d(n_inputs, widths[0], 1)
        self._down_blocks = nn.ModuleList(Level(width, n) for width, n in levels)
        self._up_blocks = nn.ModuleList(Level(width, n) for width, n in levels)
        self._downs = nn.ModuleList(nn.Conv2d(fine, coarse, 2, stride=2) for fine, coarse in steps)
        self._ups = nn.ModuleList(nn.Conv2d(coarse, 4 * fine, 1) for fine, coarse in steps)
        self._exit = nn.Conv2d(widths[0], n_outputs, 1)
        self._modulation = Modulation(n_numbers, [*widths, *widths])
        start_at_nothing(self._exit)

    def forward(self, planes: Tensor, numbers: Tensor) -> Tensor:
        """Planes (batch, n_inputs, h, w), sides multiples of `multiple`, to (batch, n_outputs, h, w)."""
        modulations = self._modulation(numbers)
        levels = len(self._down_blocks)
        x = self._entry(planes)
        skips = []
        for level in range(levels):
            x = self._down_blocks[level](x, modulations[level])
            if level < levels - 1:
                skips.append(x)
                x = leaky_relu(self._downs[level](x), 0.1)
        for level in reversed(range(levels)):
            if level < levels - 1:
                x = skips[level] + nn.functional.pixel_shuffle(self._ups[level](x), 2)
            x = self._up_blocks[level](x, modulations[levels + level])
        out: Tensor = self._exit(leaky_relu(x, 0.1))
        return out


def start_at_nothing(convolution: nn.Conv2d) -> None:
    """Make a convolution give zeros until it is trained."""
    with torch.no_grad():
        for parameter in convolution.parameters():
            parameter.zero_()


def padded(planes: Tensor, multiple: int) -> Tensor:
    """Planes (..., h, w) continued by their edges until both sides are multiples; crop to [..., :h, :w] after."""
    height, width = planes.shape[-2:]
    more = (0, -width % multiple, 0, -height % multiple)
    if not any(more):
        return planes
    flat = planes.reshape(-1, 1, height, width)
    return pad(flat, more, mode="replicate").reshape(*planes.shape[:-2], height + more[3], width + more[1])


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
    # As a product of matrices, which are small in each pixel, a GPU would take many times as long.
    chroma = (gates[:, :, 1, :, None] * colors[:, None, :, 1:]).sum(2)
    return torch.cat([luminance, chroma], dim=2)
