"""What training needs to know: samples and how they come, batches, options."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Protocol

from torch import Tensor

from priors.losses import Engine, LossWeights
from priors.observation import Observation

_WARM_UP = 50
_LAST_RATE = 0.02


@dataclass(frozen=True)
class Sample:
    """A batch of one capture: what is seen, both layers and both parts of every view, and the engine of its scene."""

    observation: Observation
    layers: Tensor
    parts: Tensor
    engine: Engine


@dataclass(frozen=True)
class Batch:
    """Several samples; `layers` (batch, 2, 3, h, w), `parts` (batch, view, 2, 3, h, w)."""

    observation: Observation
    layers: Tensor
    parts: Tensor
    engines: tuple[Engine, ...]


class SampleSource(Protocol):
    """Samples by number, always the same."""

    def samples(self, numbers: range) -> Iterator[Sample]:
        """Samples in the order of their numbers."""


@dataclass(frozen=True)
class TrainingOptions:
    """How to train.

    Parameters
    ----------
    steps, batch_size : int
    learning_rate : float
        Adam's, falling to a fiftieth along a cosine.
    weights : LossWeights
    window : int
        Samples that are kept at a time: each batch is drawn from the newest.
    fresh : float
        New samples per step.
    averaging : float
        Share of the averaged weights that stays with each step.
    test_samples, test_every : int
        Samples that are never trained on, and steps between two looks at them; the state is saved then.
    seed : int
    device : str
        As torch names it.
    half_precision : bool, optional
        Products in half precision. Default: on a GPU.
    """

    steps: int = 4000
    batch_size: int = 6
    learning_rate: float = 1e-4
    weights: LossWeights = field(default_factory=LossWeights)
    window: int = 128
    fresh: float = 2.0
    averaging: float = 0.997
    test_samples: int = 12
    test_every: int = 200
    seed: int = 0
    device: str = "cpu"
    half_precision: bool | None = None

    @property
    def mixed(self) -> bool:
        """Whether products are computed in half precision."""
        return self.device.startswith("cuda") if self.half_precision is None else self.half_precision

    def newest(self, step: int) -> int:
        """How many samples have been made when a step begins."""
        return self.batch_size + int(step * self.fresh)

    def rate(self, step: int) -> float:
        """Learning rate of a step."""
        fallen = _LAST_RATE + (1 - _LAST_RATE) * 0.5 * (1 + math.cos(math.pi * min(1.0, step / self.steps)))
        return self.learning_rate * min(1.0, (step + 1) / _WARM_UP) * fallen
