"""PolarNet: one polarizer photograph to its transmitted and its reflected part."""

from __future__ import annotations

import itertools
from typing import Any

import torch
from torch import Tensor, nn
from torch.nn.functional import leaky_relu, pixel_shuffle

from priors.networks.blocks import ResidualBlock, padded, start_at_nothing


class PolarNet(nn.Module):
    """An encoder of photographs and a decoder that takes its features in again on the way back to full size.

    Parameters
    ----------
    encoder : Module
        Gives features (batch, channels[i], h / strides[i], w / strides[i]), finest first: `CompactEncoder` or
        `Vgg19Encoder`.
    most_channels : int
        Of the decoder's levels.

    References
    ----------
    The source paper, section 4.1 and Fig. 2.
    """

    def __init__(self, encoder: Any, most_channels: int = 64) -> None:
        super().__init__()
        self.encoder = encoder
        widths = [min(n, most_channels) for n in encoder.channels]
        self._skips = nn.ModuleList(nn.Conv2d(n, m, 1) for n, m in zip(encoder.channels, widths, strict=True))
        self._ups = nn.ModuleList(nn.Conv2d(m, 4 * n, 1) for n, m in itertools.pairwise(widths))
        self._blocks = nn.ModuleList(ResidualBlock(n) for n in widths)
        self._exit = nn.Conv2d(widths[0], 6 * encoder.strides[0] ** 2, 3, padding=1)
        start_at_nothing(self._exit)

    def forward(self, photographs: Tensor) -> Tensor:
        """Photographs (batch, 3, h, w) to their two parts (batch, 2, 3, h, w), at first one half each."""
        height, width = photographs.shape[-2:]
        images = padded(photographs, self.encoder.strides[-1])
        features = self.encoder(images)
        x = self._skips[-1](features[-1])
        for level in reversed(range(len(features))):
            if level < len(features) - 1:
                x = pixel_shuffle(self._ups[level](x), 2) + self._skips[level](features[level])
            x = self._blocks[level](x)
        x = self._exit(leaky_relu(x, 0.1))
        change = pixel_shuffle(x, self.encoder.strides[0]) if self.encoder.strides[0] > 1 else x
        parts = change.reshape(-1, 2, 3, *images.shape[-2:]) + 0.5 * images[:, None]
        return parts[..., :height, :width]


class PlainCNN(nn.Module):
    """The ablation's multi-layer network in the place of PolarNet: no encoder, no levels, no skips (Fig. 7o).

    Parameters
    ----------
    channels, n_layers : int
    """

    def __init__(self, channels: int = 24, n_layers: int = 6) -> None:
        super().__init__()
        sizes = [3, *[channels] * (n_layers - 1)]
        inner: list[nn.Module] = []
        for before, after in itertools.pairwise(sizes):
            inner += [nn.Conv2d(before, after, 3, padding=1), nn.LeakyReLU(0.1)]
        self._layers = nn.Sequential(*inner, nn.Conv2d(channels, 6, 3, padding=1))

    def forward(self, photographs: Tensor) -> Tensor:
        """Photographs (batch, 3, h, w) to their two parts (batch, 2, 3, h, w)."""
        return torch.unflatten(self._layers(photographs), 1, (2, 3))
