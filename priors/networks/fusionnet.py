"""FusionNet, and the networks that separate: first layers, PolarNet, fusion."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import torch
from torch import Tensor, nn
from torch.nn.functional import avg_pool2d, pixel_shuffle, pixel_unshuffle

from priors.networks.blocks import (
    GROUPS,
    LARGE,
    N_BANDS,
    Hourglass,
    activity,
    bands,
    detail,
    from_opponent,
    gated,
    n_gates,
    opponent,
    padded,
    strengths,
)
from priors.networks.critics import CompactEncoder, Vgg19Encoder, vgg19_weights
from priors.networks.polarnet import PlainCNN, PolarNet
from priors.networks.unmixing import N_AXIS_NUMBERS, Unmixing, along_main_axis
from priors.observation import COLORS, N_CANDIDATES, Observation, n_scene_numbers

N_IMAGES = 4


@dataclass(frozen=True)
class First:
    """What is there before the networks change it.

    Attributes
    ----------
    images : Tensor, shape (batch, 4, 3, h, w)
        Both layers, and two images more: the sum and a difference of the views, or two differences.
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

    n_sources = 3

    def __init__(self, n_views: int) -> None:
        super().__init__()
        self.n_numbers = n_scene_numbers(n_views, conditioned=True)

    def forward(self, seen: Observation, parts: Tensor) -> First:
        """The layers in closed form, and sum and difference of the views along and across; no parts."""
        if seen.layers is None or seen.errors is None:
            raise ValueError("the conditioned form needs an observation with layers in closed form")
        total, contrast = seen.views.sum(1), seen.views[:, 0] - seen.views[:, 1]
        images = torch.cat([seen.layers, total[:, None], contrast[:, None]], dim=1)
        both = seen.view_errors.square().sum(1, keepdim=True).sqrt().expand(-1, 2 * COLORS)
        return First(images, torch.cat([seen.errors.flatten(1), both], dim=1), seen.scene)


class Unmixed(nn.Module):
    """Layers unmixed along the photographs' main direction of polarization, a closed form over candidate panes.

    Parameters
    ----------
    n_views : int
    """

    n_sources = 3

    def __init__(self, n_views: int) -> None:
        super().__init__()
        known = n_scene_numbers(n_views, conditioned=False) + N_AXIS_NUMBERS
        self._unmixing = Unmixing(known, N_CANDIDATES)
        self.n_numbers = known + 4

    def forward(self, seen: Observation, parts: Tensor) -> First:
        """Both layers, the intensity, and what differs between the directions in between; no parts."""
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


class PartSums(nn.Module):
    """PolarNet's parts of the photographs, and what differs between these: no pane is tried.

    Parameters
    ----------
    n_views : int
    """

    n_sources = 4

    def __init__(self, n_views: int) -> None:
        super().__init__()
        self.n_numbers = n_scene_numbers(n_views, conditioned=False)

    def forward(self, seen: Observation, parts: Tensor) -> First:
        """Both layers, as if the pane let half of each through, and Stokes s1 and s2.

        PolarNet begins with halves of the photographs, so that both layers begin as the intensity.
        """
        views, noise = seen.views, seen.view_errors.square()
        differences = torch.stack([views[:, 0] - views[:, 2], views[:, 1] - views[:, 3]], dim=1)
        images = torch.cat([parts.float().sum(1), differences], dim=1)
        of_layers = noise.sum(1, keepdim=True).sqrt() / 2
        of_differences = (noise[:, :2] + noise[:, 2:]).sqrt()
        errors = torch.cat([of_layers, of_layers, of_differences], dim=1)
        return First(images, errors.repeat_interleave(COLORS, dim=1), seen.scene)


Form = Literal["paper", "conditioned"]
Head = Literal["panes", "none"]
PAPER_VIEWS, PLATE_VIEWS = 4, 2


@dataclass(frozen=True)
class Architecture:
    """What the networks are made of.

    Parameters
    ----------
    form : {"paper", "conditioned"}
        "paper" sees the photographs alone, as at 0, 45, 90 and 135 degrees; "conditioned" sees them along and across
        the plane of incidence, and the layers in closed form with their standard errors.
    polarnet : {"compact", "vgg19", "plain"}
        PolarNet's encoder; "plain" puts the ablation's multi-layer network in PolarNet's place.
    polar_widths : tuple of int
        Channels of the levels of the compact encoder, at 1/4, 1/8, ... of the photographs' size.
    fusion_widths, fusion_blocks : tuple of int
        Channels and residual blocks each way of FusionNet's levels, at 1/2, 1/4, ... of it.
    head : {"panes", "none"}
        Where the paper's form has its first layers from: what candidate panes in closed form would undo, which is not
        the source paper's, or PolarNet alone. The conditioned form has those in closed form at its scene, and no
        choice.
    """

    form: Form = "conditioned"
    polarnet: Literal["compact", "vgg19", "plain"] = "compact"
    polar_widths: tuple[int, ...] = (16, 24, 32)
    fusion_widths: tuple[int, ...] = (32, 48, 64, 96)
    fusion_blocks: tuple[int, ...] = (1, 2, 2, 1)
    head: Head = "panes"

    def __post_init__(self) -> None:
        if self.head == "none" and self.form != "paper":
            raise ValueError("only the paper's form can do without its head")

    @property
    def n_views(self) -> int:
        """Photographs that the networks see."""
        return PAPER_VIEWS if self.form == "paper" else PLATE_VIEWS


FusionSize = Literal["compact", "large"]
FUSION_SIZES: dict[FusionSize, dict[str, tuple[int, ...]]] = {
    "compact": {"fusion_widths": (32, 48, 64, 96), "fusion_blocks": (1, 2, 2, 1)},
    "large": {"fusion_widths": (64, 96, 128, 160), "fusion_blocks": (1, 2, 3, 2)},
}
"""Of FusionNet: the large one takes as many seconds as a solve, twice those of the compact one."""


class FusionNet(nn.Module):
    """Gates for the bands of two first layers, and what no gate can give, from an hourglass that sees everything.

    The first layers are those in closed form, or what the photographs alone tell (see above). Bands are those of the
    layers and of the sum of the views, or of the differences where the layers add up to that sum.

    Parameters
    ----------
    architecture : Architecture
    """

    def __init__(self, architecture: Architecture) -> None:
        super().__init__()
        n_views = architecture.n_views
        self._first = _first(architecture)
        self._n_sources = self._first.n_sources
        # Local contrast in four phases, values, PolarNet's pairs, what happens where, what is trusted.
        n_planes = COLORS * (4 * N_IMAGES + N_IMAGES + 2 * n_views + (N_BANDS - 2) * self._n_sources) + 1
        self._knows_layers = architecture.form == "conditioned"
        if self._knows_layers:
            # What is unexplained of both layers and what pixels tell of them, in four phases.
            n_planes += COLORS * 2 * 2 * 4
        self._n_gates = n_gates(self._n_sources)
        levels = list(zip(architecture.fusion_widths, architecture.fusion_blocks, strict=True))
        self._hourglass = Hourglass(n_planes, self._n_gates + 8 * COLORS, levels, self._first.n_numbers)
        self._multiple = max(2 * self._hourglass.multiple, 2 ** (N_BANDS - 1))

    def forward(self, seen: Observation, parts: Tensor) -> Tensor:
        """Layers (batch, 2, 3, h, w) from an observation and PolarNet's parts (batch, view, 2, 3, h, w)."""
        height, width = seen.views.shape[-2:]
        # What is known to less than the noise must not be rounded to half precision.
        with torch.autocast(seen.views.device.type, enabled=False):
            first: First = self._first(seen, parts)
            known = padded(opponent(first.images).flatten(1, 2), self._multiple)
            pyramid = bands(known[:, : COLORS * self._n_sources])
            events = activity(pyramid, first.errors[:, : COLORS * self._n_sources])
            others = [
                padded(images.flatten(1, -3), self._multiple) for images in (opponent(parts.float()), seen.trusted)
            ]
            halves = [avg_pool2d(planes, 2) for planes in (known, *others)]
            phases = [detail(known, first.errors)]
            if self._knows_layers:
                phases += [padded(images.flatten(1, 2), self._multiple) for images in _of_pixels(seen)]
            contrast = [pixel_unshuffle(planes, 2) for planes in phases]
        x = self._hourglass(torch.cat([*contrast, events, *halves], 1), first.numbers)
        with torch.autocast(seen.views.device.type, enabled=False):
            gates, free = x.float().split([self._n_gates, 8 * COLORS], dim=1)
            change = gated(pyramid, gates, _factors(seen, pyramid, self._n_sources))
            change = change + torch.unflatten(pixel_shuffle(free, 2), 1, (2, COLORS)) * _scale(seen)
            return first.images[:, :2] + from_opponent(change[..., :height, :width])


def _of_pixels(seen: Observation) -> tuple[Tensor, Tensor]:
    """What is unexplained of both layers, compressed, and what pixels tell of them, (batch, 2, 3, h, w) each."""
    if seen.unexplained is None or seen.told is None:
        raise ValueError("the conditioned form needs an observation with what is unexplained of the layers")
    return seen.unexplained / (1 + seen.unexplained.abs() / LARGE), seen.told.sqrt() - 1


def _first(architecture: Architecture) -> ClosedForm | Unmixed | PartSums:
    if architecture.form == "conditioned":
        return ClosedForm(architecture.n_views)
    return Unmixed(architecture.n_views) if architecture.head == "panes" else PartSums(architecture.n_views)


def _factors(seen: Observation, pyramid: list[Tensor], n_sources: int) -> Tensor:
    """Factors on the gates; without a closed form there is everything to change."""
    if seen.errors is None:
        return seen.views.new_ones(1, N_BANDS, 2, GROUPS, n_sources, 1, 1)
    return strengths(pyramid, seen.errors, n_sources)


def _scale(seen: Observation) -> Tensor:
    """Size of what is left to find, (batch, 2, 3, 1, 1)."""
    if seen.errors is None:
        return seen.views.new_full((1, 2, COLORS, 1, 1), 0.1)
    return seen.errors[..., None, None]


@dataclass(frozen=True)
class Separated:
    """What the networks make of an observation.

    Attributes
    ----------
    layers : Tensor, shape (batch, 2, 3, h, w)
    parts : Tensor, shape (batch, view, 2, 3, h, w)
        PolarNet's transmitted and reflected part of every view.
    """

    layers: Tensor
    parts: Tensor


class SeparationNetwork(nn.Module):
    """PolarNet on every view, then FusionNet.

    Parameters
    ----------
    architecture : Architecture
    vgg19 : Path, optional
        File of VGG-19's weights, for that encoder alone.
    """

    def __init__(self, architecture: Architecture, vgg19: Path | None = None) -> None:
        super().__init__()
        self.architecture = architecture
        self.polarnet = PlainCNN() if architecture.polarnet == "plain" else PolarNet(_encoder(architecture, vgg19))
        self.fusionnet = FusionNet(architecture)

    def forward(self, seen: Observation) -> Separated:
        """Layers and parts of an observation of any size."""
        parts = torch.unflatten(self.polarnet(seen.views.flatten(0, 1)), 0, seen.views.shape[:2])
        return Separated(self.fusionnet(seen, parts), parts)


def _encoder(architecture: Architecture, vgg19: Path | None) -> CompactEncoder | Vgg19Encoder:
    if architecture.polarnet == "compact":
        return CompactEncoder(architecture.polar_widths)
    return Vgg19Encoder(vgg19_weights(vgg19 or Path("vgg19-dcbb9e9d.pth")))
