"""Parts that the networks share: residual blocks that know the scene, an hourglass with skips, colour, any size."""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import torch
from torch import Tensor, nn
from torch.nn.functional import avg_pool2d, interpolate, leaky_relu, pad

# Rows: luminance and two differences of the colours.
_OPPONENT = (
    (3**-0.5, 3**-0.5, 3**-0.5),
    (2**-0.5, -(2**-0.5), 0.0),
    (6**-0.5, 6**-0.5, -2 * 6**-0.5),
)
_COARSE = 8
# Local contrast in units of its error, where it is compressed to half.
_LARGE = 4.0


def opponent(images: Tensor) -> Tensor:
    """Images (..., 3, h, w) in an orthonormal basis of luminance and two differences of the colours."""
    return torch.einsum("ij,...jhw->...ihw", images.new_tensor(_OPPONENT), images)


def from_opponent(images: Tensor) -> Tensor:
    """Inverse of `opponent`."""
    return torch.einsum("ij,...ihw->...jhw", images.new_tensor(_OPPONENT), images)


def detail(images: Tensor, errors: Tensor) -> Tensor:
    """Local contrast of images (batch, plane, h, w) in units of their errors (batch, plane), compressed."""
    mean = avg_pool2d(images, _COARSE, ceil_mode=True)
    smooth = interpolate(mean, size=images.shape[-2:], mode="bilinear", align_corners=False)
    contrast = (images - smooth) / errors[:, :, None, None].clamp(min=1e-4)
    return contrast / (1 + contrast.abs() / _LARGE)


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
