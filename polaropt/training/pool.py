"""The newest samples of a training on its device, of which each batch takes some."""

from __future__ import annotations

import itertools
import queue
import threading
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
import torch
from torch import Tensor

from polaropt.training.batches import N_SCENES, BatchMaker, Kind
from polaropt.training.samples import TrainingData
from priors.training.trainer import Batch, Sample, batch_of, tensors_of

# How often each kind is made; samples that are made at a time, and batches that each takes part in on average; times
# that samples are made before the first batch, so that it has some of several kinds. Set by hand.
_KINDS: dict[Kind, float] = {"photographs": 0.46, "grey": 0.04, "mono": 0.25, "color": 0.25}
_AT_A_TIME, _USES, _FIRST = 64, 20.0, 16.0
# Of a batch, those that processes make; how many of them are placed together, and how often as many wait for it; and
# of them those that the device does not make, clipped ones and those through wide lenses.
_OF_PROCESSES, _TOGETHER, _WAITING = 0.14, 16, 4
_OVEREXPOSED, _WIDE = 0.6, 0.2
# Samples that are kept, those of processes beside them: at least, at most, and in what share of a device's memory.
_LEAST_KEPT, _MOST_KEPT, _OF_MEMORY, _KEPT_OF_PROCESSES = 2048, 16384, 0.35, 0.25
# Planes of a sample: see `_OBSERVED`, and both layers and their parts in two views.
_N_PLANES = 43

# Brightest that layers in closed form are at (white = 1), and largest that anything is: an estimate that is far off may
# be without bounds.
_BRIGHTEST, _LARGEST = 8.0, 1e3

_OBSERVED = ("views", "view_errors", "trusted", "layers", "errors", "mixing", "step", "unexplained", "told")


class SamplePool:
    """Samples that are made where they are trained on, and some of other processes among them.

    Parameters
    ----------
    data : TrainingData
        For the conditioned form, frames of whole patterns. Its processes draw the scenes, and make samples
        of their own; with none there are only those that the device makes.
    device : str
    n_scenes : int
        As of `BatchMaker`.
    at_a_time : int
        Samples that the device makes together.
    """

    def __init__(
        self, data: TrainingData, device: str, *, n_scenes: int = N_SCENES, at_a_time: int = _AT_A_TIME
    ) -> None:
        variety = replace(data.variety, overexposed=_OVEREXPOSED, wide=_WIDE)
        self._data, self._device = data.of(variety), device
        self._maker = BatchMaker(data, device, n_scenes)
        n_kept = _kept_on(device, data.side_px)
        self._made, self._others = Kept(n_kept, device), Kept(round(_KEPT_OF_PROCESSES * n_kept), device)
        self._waiting: queue.Queue[dict[str, Tensor]] = queue.Queue(_WAITING)
        self._next, self._at_a_time = 0.0, at_a_time
        if data.workers:
            threading.Thread(target=self._take_others, daemon=True).start()

    def samples(self, numbers: Sequence[int]) -> Iterator[Sample]:
        """Those of the processes, in the order of these numbers: for tests."""
        return map(self._data.sample, numbers)

    def batch(self, step: int, size: int) -> Batch:
        """Samples for a step: not the same again, as processes take as long as they take."""
        random = np.random.default_rng([self._data.seed, 17, step])
        self._next += size / (_USES * self._at_a_time) if self._made.count else _FIRST
        while self._next >= 1:
            self._next -= 1
            kind = random.choice(len(_KINDS), p=list(_KINDS.values()))
            self._made.put(_kept_of(self._maker.make(list(_KINDS)[kind], self._at_a_time, random)))
        while not self._waiting.empty():
            waiting = self._waiting.get()
            self._others.put({name: x.to(self._device, non_blocking=True) for name, x in waiting.items()})
        n_others = random.binomial(size, _OF_PROCESSES) if self._others.count else 0
        drawn = self._made.drawn(size - n_others, random)
        if n_others:
            others = self._others.drawn(n_others, random)
            drawn = {name: torch.cat([drawn[name], others[name]]) for name in drawn}
        return batch_of(drawn)

    def _take_others(self) -> None:
        coming = map(_kept_of, self._data.samples(range(1 << 40)))
        while some := list(itertools.islice(coming, _TOGETHER)):
            joined = {name: torch.cat([each[name] for each in some]).float() for name in some[0]}
            # Of memory that stays where it is, a device takes them while it does something else.
            on_device = self._device.startswith("cuda")
            self._waiting.put({name: x.pin_memory() if on_device else x for name, x in joined.items()})


def _kept_on(device: str, side_px: int) -> int:
    """How many samples a device has room for: the more there are, the less alike are the batches of a time."""
    if not device.startswith("cuda"):
        return _LEAST_KEPT
    free = torch.cuda.mem_get_info(torch.device(device))[0]
    return int(min(_MOST_KEPT, max(_LEAST_KEPT, _OF_MEMORY * free / (4 * _N_PLANES * side_px**2))))


def _kept_of(samples: Sample | Batch) -> dict[str, Tensor]:
    """Of samples what is kept: those of processes have more than those of the device."""
    known = tensors_of(samples)
    return {name: known[name] for name in (*_OBSERVED, "truth", "parts")}


@dataclass
class Kept:
    """The newest samples, so many."""

    size: int
    device: str
    count: int = 0

    def __post_init__(self) -> None:
        self._tensors: dict[str, Tensor] = {}
        self._place = 0

    def put(self, tensors: dict[str, Tensor]) -> None:
        """Put a batch of samples in the place of the oldest; those without sense are left out."""
        # No number is none of these.
        usable = torch.stack([(x.flatten(1).abs() < _LARGEST).all(dim=1) for x in tensors.values()]).all(dim=0)
        usable &= tensors["layers"].flatten(1).abs().amax(dim=1) < _BRIGHTEST
        n = len(usable)
        if not self._tensors:
            self._tensors = {
                name: torch.zeros((self.size, *x.shape[1:]), device=self.device) for name, x in tensors.items()
            }
        # Others take their place, so that nothing waits for the device to tell how many there are.
        order = torch.argsort(~usable, stable=True)
        chosen = order[torch.arange(n, device=order.device) % usable.sum().clamp(min=1)]
        there = (self._place + np.arange(n)) % self.size
        places = torch.from_numpy(there).to(self.device)
        for name, x in tensors.items():
            self._tensors[name][places] = x[chosen].float()
        self._place = (self._place + n) % self.size
        self.count = min(self.size, self.count + n)

    def drawn(self, n: int, random: np.random.Generator) -> dict[str, Tensor]:
        """So many of them."""
        places = torch.from_numpy(random.integers(self.count, size=n)).to(self.device)
        return {name: x[places] for name, x in self._tensors.items()}
