"""The conditional discriminator of the adversarial loss: does this layer belong behind that photograph?"""

from __future__ import annotations

import itertools

import torch
from torch import Tensor, nn


class Discriminator(nn.Module):
    """Judges patches of a layer beside the photograph that it came from.

    Parameters
    ----------
    channels : int
        Of the first level; each further one has twice as many.

    References
    ----------
    P. Isola, J.-Y. Zhu, T. Zhou, A. Efros, Image-to-image translation with conditional adversarial networks, CVPR
    2017 (PatchGAN).
    """

    def __init__(self, channels: int = 24) -> None:
        super().__init__()
        layers: list[nn.Module] = []
        sizes = (6, channels, 2 * channels, 4 * channels)
        for before, after in itertools.pairwise(sizes):
            layers += [nn.Conv2d(before, after, 4, stride=2, padding=1), nn.LeakyReLU(0.2)]
        self._layers = nn.Sequential(*layers, nn.Conv2d(sizes[-1], 1, 3, padding=1))

    def forward(self, photographs: Tensor, layers: Tensor) -> Tensor:
        """Logits per patch, above 0 for true.

        Parameters
        ----------
        photographs : Tensor, shape (batch, view, 3, h, w)
        layers : Tensor, shape (batch, 3, h, w)
        """
        beside = layers[:, None].expand(-1, photographs.shape[1], -1, -1, -1)
        logits: Tensor = self._layers(torch.cat([photographs, beside], dim=2).flatten(0, 1))
        return logits
