"""The losses that the networks are trained with: Eqs. (7) to (13) of the source paper, and one in decibels."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields
from typing import Any

import torch
from torch import Tensor, nn
from torch.nn.functional import avg_pool2d, softplus

from priors.networks.blocks import padded
from priors.networks.fusionnet import Separated
from priors.training.engines import Engine

# Scales of Eq. (11), each half the one before.
_SCALES = 3
# Share that a pixel which a photograph clips has in the loss in decibels: what it shows is hardly to be told, and would
# hide how well the others are told. Set by hand.
_CLIPPED = 1e-3
# Mean squares (white = 1) below which a root and a logarithm no longer follow them, which have no slope at 0.
_LEAST = 1e-12
_LEAST_SQUARE = 1e-8
# Pixels along the border whose ghosts may come from beyond the frame.
BORDER_PX = 12


@dataclass(frozen=True)
class LossWeights:
    """Factor on each term; those of Eqs. (7) to (13) are the paper's.

    Parameters
    ----------
    pixelwise : float
        Eq. (8).
    perceptual : float
        Eq. (9).
    pse : float
        Eq. (10): the engine must give the photographs back.
    edge_independence : float
        Eq. (11).
    adversarial : float
        Eqs. (12) and (13).
    decibel : float
        Mean logarithm of each layer's squared error, and none of the paper's: every sample counts by how much better
        it gets, whether its layers can be told well or hardly.
    """

    pixelwise: float = 1.0
    perceptual: float = 0.1
    pse: float = 2.0
    edge_independence: float = 0.1
    adversarial: float = 0.1
    decibel: float = 0.0

    def __post_init__(self) -> None:
        for field in fields(self):
            factor = getattr(self, field.name)
            if not 0 <= factor < float("inf"):
                raise ValueError(f"the loss {field.name} has the factor {factor}; give 0 (off) or more")


DECIBEL = LossWeights(pixelwise=0.3, perceptual=0, pse=0, edge_independence=0, adversarial=0, decibel=0.2)
"""What the conditioned form is trained with."""


def rms(difference: Tensor) -> Tensor:
    """Root mean square of each image (..., 3, h, w): the norm of Eq. (8), whatever the image's size."""
    return (difference.square().mean(dim=(-1, -2, -3)) + _LEAST).sqrt()


def pixelwise(found: Separated, layers: Tensor, parts: Tensor) -> Tensor:
    """Eq. (8): norms of the errors of both layers and of both parts of every view."""
    return (rms(found.layers - layers).sum(1) + rms(found.parts - parts).sum((1, 2))).mean()


def perceptual(found: Tensor, truth: Tensor, features: Callable[[Tensor], Sequence[Tensor]]) -> Tensor:
    """Eq. (9): mean absolute difference of the features, each level counting the same.

    Parameters
    ----------
    found, truth : Tensor, shape (batch, 2, 3, h, w)
    features : callable
        Levels of features of images (batch, 3, h, w), such as an encoder.
    """
    with torch.no_grad():
        wanted = features(padded(truth.flatten(0, 1), 32))
    got = features(padded(found.flatten(0, 1), 32))
    levels = [(a - b).abs().mean() for a, b in zip(got, wanted, strict=True)]
    return 2 * torch.stack(levels).mean()


def raw_pixels(found: Tensor, truth: Tensor) -> Tensor:
    """What Fig. 7n has in the place of Eq. (9): the norm of the plain difference."""
    return rms(found - truth).sum(1).mean()


def pse_loss(found: Tensor, views: Tensor, engine: Engine) -> Tensor:
    """Eq. (10): mean absolute difference of the views and those that the engine makes of the layers.

    Parameters
    ----------
    found : Tensor, shape (batch, 2, 3, h, w)
    views : Tensor, shape (batch, view, 3, h, w)
    engine : callable
        Of the whole batch, each sample with its own scene.
    """
    inside = (..., slice(BORDER_PX, -BORDER_PX), slice(BORDER_PX, -BORDER_PX))
    return (engine(found) - views)[inside].abs().mean(dim=(2, 3, 4)).sum(1).mean()


def edge_independence(found: Tensor, truth: Tensor) -> Tensor:
    """Eq. (11): mean absolute difference of the gradients at three scales."""
    from kornia.filters import spatial_gradient

    difference = spatial_gradient((found - truth).flatten(0, 1), mode="diff").flatten(1, 2)
    total = difference.abs().mean()
    for _ in range(_SCALES - 1):
        difference = avg_pool2d(difference, 2)
        total = total + difference.abs().mean()
    return 2 * total


def decibel(found: Tensor, truth: Tensor, trusted: Tensor | None = None) -> Tensor:
    """Mean of ``log(mean squared error)`` of each layer, less what the border hides, and what photographs clip.

    Parameters
    ----------
    found, truth : Tensor, shape (batch, 2, 3, h, w)
    trusted : Tensor, shape (batch, 1, 1, h, w), optional
        Share of the photographs that are not clipped. Default: none is.
    """
    inside = (..., slice(BORDER_PX, -BORDER_PX), slice(BORDER_PX, -BORDER_PX))
    squares = (found - truth)[inside].square().mean(dim=2)
    if trusted is None:
        return torch.log(squares.mean(dim=(-1, -2)) + _LEAST_SQUARE).mean()
    counts = _CLIPPED + (1 - _CLIPPED) * (trusted[:, 0][inside] >= 1)
    means = (counts * squares).sum(dim=(-1, -2)) / counts.sum(dim=(-1, -2))
    return torch.log(means + _LEAST_SQUARE).mean()


def adversarial(discriminator: nn.Module, views: Tensor, found: Tensor) -> Tensor:
    """Eq. (13), ``-log D``, of the transmission, which Eq. (12) trains the discriminator on.

    As printed, Eq. (13) has the reflection, of which that discriminator knows nothing.
    """
    return softplus(-discriminator(views, found[:, 0])).mean()


def discriminator_loss(discriminator: nn.Module, views: Tensor, found: Tensor, truth: Tensor) -> Tensor:
    """Eq. (12) as a loss: ``-log D(truth) - log(1 - D(found))``, the usual form that is bounded below."""
    true, false = discriminator(views, truth[:, 0]), discriminator(views, found[:, 0].detach())
    return softplus(-true).mean() + softplus(false).mean()


@dataclass(frozen=True)
class Critics:
    """What some of the terms need beside the truth.

    Attributes
    ----------
    features : callable or None
        Levels of features for Eq. (9); None compares raw pixels instead (Fig. 7n).
    discriminator : Module or None
    """

    features: Callable[[Tensor], Sequence[Tensor]] | None = None
    discriminator: nn.Module | None = None


def loss_terms(found: Separated, batch: Any, weights: LossWeights, critics: Critics) -> dict[str, Tensor]:
    """The terms that count, each with its factor: their sum is Eq. (7).

    Parameters
    ----------
    found : Separated
    batch : Batch
        See `priors.training.trainer.Batch`.
    weights : LossWeights
    critics : Critics
    """
    layers, views = found.layers, batch.observation.views
    terms: dict[str, Callable[[], Tensor]] = {
        "pixelwise": lambda: pixelwise(found, batch.layers, batch.parts),
        "perceptual": lambda: (
            raw_pixels(layers, batch.layers)
            if critics.features is None
            else perceptual(layers, batch.layers, critics.features)
        ),
        "pse": lambda: pse_loss(layers, views, batch.engine),
        "edge_independence": lambda: edge_independence(layers, batch.layers),
        "decibel": lambda: decibel(layers, batch.layers, batch.observation.trusted),
    }
    if critics.discriminator is not None:
        judge = critics.discriminator
        terms["adversarial"] = lambda: adversarial(judge, views, layers)
    factors = {name: getattr(weights, name) for name in terms}
    return {name: factors[name] * term() for name, term in terms.items() if factors[name]}
