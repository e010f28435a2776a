"""Engines of a whole batch at once: every double image of every sample is shifted in one call.

One sample after the other, a batch asks for thousands of small operations, and a GPU waits for each to be told.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from torch.nn.functional import grid_sample

from priors.networks.blocks import constant

Engine = Callable[[Tensor], Tensor]
"""Views ([batch,] view, 3, h, w) of layers ([batch,] 2, 3, h, w), differentiable."""


@dataclass(frozen=True)
class ShiftedSum:
    """An engine whose views are sums of shifted layers, as behind every flat pane seen from far.

    Attributes
    ----------
    places : ndarray, shape (image, 2)
        Columns to the right and rows down from the direct image.
    weights : ndarray, shape (image, view, 2)
        Of each image of each layer in each view.
    """

    places: NDArray[np.float32]
    weights: NDArray[np.float32]

    def __call__(self, layers: Tensor) -> Tensor:
        """Views (view, 3, h, w) of layers (2, 3, h, w)."""
        return _summed([self], layers[None])[0]


@dataclass(frozen=True)
class BatchEngine:
    """The engines of a batch's samples as one."""

    engines: tuple[Engine, ...]

    def __call__(self, layers: Tensor) -> Tensor:
        """Views (batch, view, 3, h, w) of layers (batch, 2, 3, h, w)."""
        sums = {i: engine for i, engine in enumerate(self.engines) if isinstance(engine, ShiftedSum)}
        if len(sums) == len(self.engines):
            return _summed(list(sums.values()), layers)
        together = iter(_summed(list(sums.values()), layers[list(sums)]) if sums else ())
        return torch.stack([
            next(together) if i in sums else engine(layers[i]) for i, engine in enumerate(self.engines)
        ])  # fmt: skip


def _summed(engines: Sequence[ShiftedSum], layers: Tensor) -> Tensor:
    """Views (batch, view, 3, h, w) of layers (batch, 2, 3, h, w), one engine each."""

    n_samples, _, n_colors, height, width = layers.shape
    counts = [len(engine.places) for engine in engines]
    of_sample = torch.from_numpy(np.repeat(np.arange(n_samples), counts)).to(layers.device, non_blocking=True)
    places = constant(np.concatenate([engine.places for engine in engines]), layers)
    weights = constant(np.concatenate([engine.weights for engine in engines]), layers)
    # From -1 at the first sample of an axis to 1 at its last, as grid_sample takes them.
    columns = 2 * (torch.arange(width, device=layers.device) - places[:, :1]) / (width - 1) - 1
    rows = 2 * (torch.arange(height, device=layers.device) - places[:, 1:]) / (height - 1) - 1
    grid = torch.stack([columns[:, None].expand(-1, height, -1), rows[..., None].expand(-1, -1, width)], dim=-1)
    images = grid_sample(
        layers.flatten(1, 2)[of_sample], grid, mode="bilinear", padding_mode="border", align_corners=True
    )
    images = torch.einsum("nvl,nlchw->nvchw", weights, torch.unflatten(images, 1, (2, n_colors)))
    views = images.new_zeros(n_samples, *images.shape[1:])
    return views.index_add(0, of_sample, images)
