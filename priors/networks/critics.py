"""Networks that judge layers as they train: features of an image, and a discriminator."""

from __future__ import annotations

import hashlib
import itertools
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import torch
from torch import Tensor, nn
from torch.nn.functional import leaky_relu, pixel_unshuffle, relu

from priors.networks.blocks import ResidualBlock

# VGG-19's convolutions: numbers in torchvision's `features`, input and output channels; a new row after each pooling.
_VGG = (
    ((0, 3, 64), (2, 64, 64)),
    ((5, 64, 128), (7, 128, 128)),
    ((10, 128, 256), (12, 256, 256), (14, 256, 256), (16, 256, 256)),
    ((19, 256, 512), (21, 512, 512), (23, 512, 512), (25, 512, 512)),
    ((28, 512, 512), (30, 512, 512), (32, 512, 512), (34, 512, 512)),
)
# Side of the squares of pixels that the compact encoder takes as one.
_PATCH = 4
_IMAGENET_MEAN = (0.485, 0.456, 0.406)
_IMAGENET_SPREAD = (0.229, 0.224, 0.225)
VGG19_DIGEST = "dcbb9e9d"
"""First digits of the SHA-256 digest of torchvision's VGG-19 weights (IMAGENET1K_V1), as in the file's name."""


class WrongWeights(ValueError):
    """Weights from a file cannot be used; the text is one line that says why and what to do."""


class CompactEncoder(nn.Module):
    """A small encoder at 1/4, 1/8, ... of the image's size.

    Parameters
    ----------
    widths : sequence of int
        Channels of each level.
    """

    name = "compact"

    def __init__(self, widths: Sequence[int] = (16, 24, 32)) -> None:
        super().__init__()
        self.channels = tuple(widths)
        self.strides = tuple(_PATCH * 2**level for level in range(len(widths)))
        self._entry = nn.Conv2d(3 * _PATCH**2, widths[0], 3, padding=1)
        self._blocks = nn.ModuleList(ResidualBlock(n) for n in widths)
        steps = itertools.pairwise(widths)
        self._downs = nn.ModuleList(nn.Conv2d(fine, coarse, 2, stride=2) for fine, coarse in steps)

    def forward(self, images: Tensor) -> list[Tensor]:
        """Features of images (batch, 3, h, w), finest first; sides must be multiples of the last stride."""
        x = self._entry(pixel_unshuffle(images, _PATCH))
        features = []
        for level, block in enumerate(self._blocks):
            if level:
                x = leaky_relu(self._downs[level - 1](x), 0.1)
            x = block(x)
            features.append(x)
        return features


class Vgg19Encoder(nn.Module):
    """The convolutions of VGG-19 with fixed weights; features are conv1_2, conv2_2, conv3_4, conv4_4 and conv5_4.

    Parameters
    ----------
    weights : dict of str to Tensor
        In torchvision's layout, see `vgg19_weights`.

    References
    ----------
    K. Simonyan, A. Zisserman, Very deep convolutional networks for large-scale image recognition, ICLR 2015.
    """

    name = "vgg19"

    def __init__(self, weights: dict[str, Tensor]) -> None:
        super().__init__()
        self.channels = tuple(stage[-1][2] for stage in _VGG)
        self.strides = tuple(2**level for level in range(len(_VGG)))
        self._stages = nn.ModuleList()
        for stage in _VGG:
            self._stages.append(nn.ModuleList(_vgg_convolution(weights, *each) for each in stage))
        self.requires_grad_(False)

    def forward(self, images: Tensor) -> list[Tensor]:
        """Features of images (batch, 3, h, w), finest first; sides must be multiples of 16."""
        mean, spread = (images.new_tensor(values)[:, None, None] for values in (_IMAGENET_MEAN, _IMAGENET_SPREAD))
        x = (images - mean) / spread
        features: list[Tensor] = []
        for stage in self._stages:
            if features:
                x = nn.functional.max_pool2d(x, 2)
            for convolution in stage:  # type: ignore[attr-defined]
                x = relu(convolution(x))
            features.append(x)
        return features


def _vgg_convolution(weights: dict[str, Tensor], number: int, n_in: int, n_out: int) -> nn.Conv2d:
    convolution = nn.Conv2d(n_in, n_out, 3, padding=1)
    convolution.load_state_dict({part: weights[f"features.{number}.{part}"] for part in ("weight", "bias")})
    return convolution


def vgg19_weights(path: Path, digest: str | None = VGG19_DIGEST) -> dict[str, Tensor]:
    """Weights of VGG-19's convolutions from a file in the layout of torchvision's state dict.

    Parameters
    ----------
    path : Path
        Such as vgg19-dcbb9e9d.pth; it is read as numbers only, no code in it is run.
    digest : str, optional
        First digits of the file's SHA-256 digest in hexadecimal; None takes any file of the right shapes.

    Raises
    ------
    WrongWeights
        No file, another digest, or weights of another layout.
    """
    if not path.is_file():
        raise WrongWeights(
            f"{path}: no such file; give VGG-19's weights as torchvision saves them (vgg19-{VGG19_DIGEST}.pth), "
            "or take the encoder compact"
        )
    content = path.read_bytes()
    found = hashlib.sha256(content).hexdigest()
    if digest is not None and not found.startswith(digest):
        raise WrongWeights(f"{path}: the SHA-256 digest begins with {found[:8]}, not {digest}; download it again")
    del content
    try:
        state: Any = torch.load(path, map_location="cpu", weights_only=True)
    except Exception:
        raise WrongWeights(f"{path}: is no state dict of torch; give the file as torchvision saves it") from None
    _check_layout(path, state)
    return dict(state)


def _check_layout(path: Path, state: Any) -> None:
    for stage in _VGG:
        for number, n_in, n_out in stage:
            for part, shape in (("weight", (n_out, n_in, 3, 3)), ("bias", (n_out,))):
                name = f"features.{number}.{part}"
                tensor = state.get(name) if isinstance(state, dict) else None
                if not isinstance(tensor, Tensor) or tuple(tensor.shape) != shape:
                    raise WrongWeights(f"{path}: lacks {name} of shape {shape}; give VGG-19's weights, not another net")
                if not bool(torch.isfinite(tensor).all()):
                    raise WrongWeights(f"{path}: {name} holds NaN or infinite values; download it again")


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
