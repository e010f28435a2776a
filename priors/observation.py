"""What the networks are shown of a capture: its views, and what a closed form makes of them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

COLORS = 3
N_CANDIDATES = 33
"""Panes that the paper's form chooses from."""
# Standard error (white = 1) below which the networks are told no less: set by hand; those shipped were trained so.
_LEAST_ERROR = 1e-4


@dataclass(frozen=True)
class Observation:
    """A batch of captures, each as two or more views: what a linear polarizer shows at as many angles.

    The layers and all that follows them are for the conditioned form alone, the shares for the other.

    Attributes
    ----------
    views : Tensor, shape (batch, view, 3, h, w)
        For the conditioned form: polarizer along and across the plane of incidence.
    view_errors : Tensor, shape (batch, view)
        Standard deviation of the views' noise.
    trusted : Tensor, shape (batch, 1, 1, h, w)
        Share of the photographs that are not clipped.
    layers : Tensor, shape (batch, 2, 3, h, w)
        Transmission and reflection in closed form.
    errors : Tensor, shape (batch, 2, 3)
        Their standard errors in the opponent basis.
    mixing : Tensor, shape (batch, view, 2)
        Share of each layer in each view.
    step : Tensor, shape (batch, 2)
        From one ghost to the next in pixels: to the right and down.
    unexplained : Tensor, shape (batch, 2, 3, h, w)
        Where the photographs ask the layers to change: downhill of their misfit at the layers, in units of what noise
        does to it.
    told : Tensor, shape (batch, 2, 3, h, w)
        How much a pixel's photographs tell of each layer, over the frame's mean: of a raw mosaic what its filter shows.
    shares : Tensor, shape (batch, `N_CANDIDATES`, 2)
        Of the light along and across its plane of incidence, what a pane can transmit.
    """

    views: Tensor
    view_errors: Tensor
    trusted: Tensor
    layers: Tensor | None = None
    errors: Tensor | None = None
    mixing: Tensor | None = None
    step: Tensor | None = None
    unexplained: Tensor | None = None
    told: Tensor | None = None
    shares: Tensor | None = None

    @property
    def scene(self) -> Tensor:
        """The numbers that describe noise and pane, scaled for a network, (batch, `n_scene_numbers(view)`)."""
        noise = [torch.log(self.view_errors.clamp(min=_LEAST_ERROR)) + 5]
        if self.layers is None:
            return noise[0]
        errors, mixing, step = _known(self.errors), _known(self.mixing), _known(self.step)
        spread = torch.log(errors.clamp(min=_LEAST_ERROR)).flatten(1) + 4
        shares = mixing.flatten(1)
        # Roots spread the small shares, on which all depends near normal incidence.
        return torch.cat([*noise, spread, shares, shares.clamp(min=0).sqrt(), step / 8], dim=1)


def n_scene_numbers(n_views: int, conditioned: bool) -> int:
    """Length of `Observation.scene`."""
    return n_views + (2 * COLORS + 4 * n_views + 2 if conditioned else 0)


def _known(tensor: Tensor | None) -> Tensor:
    if tensor is None:
        raise ValueError("an observation with layers needs their errors, the mixing and the ghosts' step")
    return tensor


def of_arrays(**arrays: NDArray[Any]) -> Observation:
    """An observation of one capture from numpy arrays: the attributes of `Observation` without the batch axis.

    Images may be grey, (..., 1, h, w).
    """
    tensors = {name: torch.from_numpy(np.ascontiguousarray(array, np.float32)) for name, array in arrays.items()}
    for name in _IMAGES:
        if name in tensors:
            tensors[name] = in_color(tensors[name])
    return Observation(**{name: tensor[None] for name, tensor in tensors.items()})


def in_color(images: Tensor) -> Tensor:
    """Images (..., channel, h, w) with three channels; grey ones three times the same."""
    if images.shape[-3] == COLORS:
        return images
    if images.shape[-3] != 1:
        raise ValueError(f"images have {images.shape[-3]} channels; the networks take 1 or {COLORS}")
    return images.expand(*images.shape[:-3], COLORS, *images.shape[-2:])


def collated(observations: Sequence[Observation]) -> Observation:
    """One batch of several, in single precision."""
    return Observation(**{name: _joined([getattr(one, name) for one in observations]) for name in _NAMES})


def placed(observation: Observation, device: Any) -> Observation:
    """On a device."""
    moved = {name: getattr(observation, name) for name in _NAMES}
    there: dict[str, Any] = {name: None if x is None else x.to(device) for name, x in moved.items()}
    return Observation(**there)


def turned_observation(
    observation: Observation, images: Callable[[Tensor], Tensor], vectors: Callable[[Tensor], Tensor]
) -> Observation:
    """With all images and the ghosts' step as these functions turn them."""
    kept: dict[str, Any] = {name: getattr(observation, name) for name in _NAMES}
    for name in (*_IMAGES, "trusted"):
        kept[name] = None if kept[name] is None else images(kept[name])
    kept["step"] = None if observation.step is None else vectors(observation.step)
    return Observation(**kept)


def _joined(tensors: list[Tensor | None]) -> Any:
    known = [tensor for tensor in tensors if tensor is not None]
    if known and len(known) != len(tensors):
        raise ValueError("some observations have layers and some have not; a batch is of one form")
    return torch.cat(known).float() if known else None


_IMAGES = ("views", "layers", "unexplained", "told")
_NAMES = (*_IMAGES, "view_errors", "trusted", "errors", "mixing", "step", "shares")
