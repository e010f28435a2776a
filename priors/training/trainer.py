"""Training from start to end: options, the loop, and what it keeps."""

from __future__ import annotations

import csv
import io
import math
import pickle
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import Any, Protocol, runtime_checkable

import numpy as np
import torch
from torch import Tensor, nn
from torch.optim.swa_utils import AveragedModel, get_ema_multi_avg_fn

from priors.networks.blocks import constant
from priors.networks.checkpoint import write_whole
from priors.networks.critics import Discriminator
from priors.networks.fusionnet import SeparationNetwork
from priors.observation import Observation, collated, placed, turned_observation
from priors.training.engines import BatchEngine, Engine
from priors.training.losses import BORDER_PX, Critics, LossWeights, discriminator_loss, loss_terms
from priors.training.recorded import Recorded

# Steps in which the learning rate rises, and its last value in parts of the largest: set by hand.
_WARM_UP = 50
_LAST_RATE = 0.02
# Norm to which gradients are cut, and the discriminator's learning rate: set by hand.
_LONGEST_GRADIENT = 1.0
_JUDGE_RATE = 1e-4


@dataclass(frozen=True)
class Sample:
    """A batch of one capture: what is seen, both layers and both parts of every view, and the engine of its scene.

    Images may be kept in half precision: a batch of them is not.
    """

    observation: Observation
    layers: Tensor
    parts: Tensor
    engine: Engine


@dataclass(frozen=True)
class Batch:
    """Several samples; `layers` (batch, 2, 3, h, w), `parts` (batch, view, 2, 3, h, w), the engine of all of them."""

    observation: Observation
    layers: Tensor
    parts: Tensor
    engine: Engine


class SampleSource(Protocol):
    """Samples by number, always the same."""

    def samples(self, numbers: Sequence[int]) -> Iterator[Sample]:
        """Samples in the order of these numbers."""


@runtime_checkable
class BatchSource(SampleSource, Protocol):
    """Samples that are where they are trained on, a batch at a time."""

    def batch(self, step: int, size: int) -> Batch:
        """So many samples for a step."""


@dataclass(frozen=True)
class TrainingOptions:
    """How to train.

    Parameters
    ----------
    steps : int
        The most there are.
    batch_size : int
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
    seconds : float, optional
        Time in which the training ends, however few steps it takes: the learning rate falls with it.
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
    seconds: float | None = None

    @property
    def mixed(self) -> bool:
        """Whether products are computed in half precision."""
        return self.device.startswith("cuda") if self.half_precision is None else self.half_precision

    def newest(self, step: int) -> int:
        """How many samples have been made when a step begins."""
        return self.batch_size + int(step * self.fresh)

    def done(self, step: int, seconds: float) -> float:
        """Share of the training that is done before a step, so many seconds after it began: 0 to 1."""
        return min(1.0, max(step / self.steps, 0.0 if self.seconds is None else seconds / self.seconds))

    def rate(self, step: int, done: float) -> float:
        """Learning rate of a step before which a share of the training is done."""
        fallen = _LAST_RATE + (1 - _LAST_RATE) * 0.5 * (1 + math.cos(math.pi * done))
        return self.learning_rate * min(1.0, (step + 1) / _WARM_UP) * fallen


STATE, LOG = "state.pt", "log.csv"
# Number of the first sample that is kept for tests: no training comes that far.
_FIRST_TEST = 1 << 40
# Steps between looks whether the loss is still a number.
_LOOK_EVERY = 20
Progress = Callable[[str, float], None]
Choice = str | float | None


class NotFinite(ArithmeticError):
    """The loss became infinite or NaN; the text says at which step."""


class WrongState(ValueError):
    """A file is no state to resume a training from; the text is one line that says why and what to do."""


class Training:
    """A network that is being trained.

    Parameters
    ----------
    network : SeparationNetwork
    source : SampleSource
    options : TrainingOptions
    features : callable, optional
        For the perceptual loss; None compares raw pixels.
    course : dict of str to text or number, optional
        By its name each choice that the training's course depends on: who resumes it must have made the same.
    """

    def __init__(
        self,
        network: SeparationNetwork,
        source: SampleSource,
        options: TrainingOptions,
        features: Callable[[Tensor], Sequence[Tensor]] | None = None,
        course: Mapping[str, Choice] | None = None,
    ) -> None:
        network = network.to(options.device)
        if options.device.startswith("cuda"):
            # As the GPU's convolutions in half precision want them.
            network = network.to(memory_format=torch.channels_last)  # type: ignore[call-overload]
        self.network, self.options, self.step = network, options, 0
        self._source, self._course = source, dict(course or {})
        average: Any = get_ema_multi_avg_fn(options.averaging)  # type: ignore[no-untyped-call]
        self._averaged = AveragedModel(self.network, multi_avg_fn=average)
        trained = [parameter for parameter in network.parameters() if parameter.requires_grad]
        self._optimizer = _adam(trained, options.learning_rate, options.device)
        judge = Discriminator().to(options.device) if options.weights.adversarial else None
        self._critics = Critics(features, judge)
        self._judge_optimizer = None if judge is None else _adam(judge.parameters(), _JUDGE_RATE, options.device)
        self._recorded = self._recording() if options.device.startswith("cuda") else None
        self._kept: dict[int, Sample] = {}
        self._coming: Iterator[tuple[int, Sample]] = iter(())
        self._tests: list[Sample] = []

    @property
    def averaged(self) -> SeparationNetwork:
        """The network with averaged weights: the one to use."""
        module: Any = self._averaged.module
        return module  # type: ignore[no-any-return]

    def run(self, folder: Path, progress: Progress | None = None) -> list[dict[str, float]]:
        """Train to the end, saving states and log in a folder.

        Returns
        -------
        list of dict
            The log: step, seconds, learning rate, the terms' means and the tests' PSNR in dB.

        Raises
        ------
        NotFinite
            The loss became infinite or NaN.
        NotWritten
            A state or the log.
        """
        began, log = time.perf_counter(), _read_log(folder / LOG, self.step)
        before = log[-1]["seconds"] if log else 0.0
        sums: dict[str, Tensor] = {}
        done = self.options.done(self.step, before)
        while done < 1:
            rate = self.options.rate(self.step, done)
            for name, value in self._train_step(rate).items():
                sums[name] = sums[name] + value if name in sums else value
            self.step += 1
            seconds = before + time.perf_counter() - began
            done = self.options.done(self.step, seconds)
            logs = self.step % self.options.test_every == 0 or done == 1
            # A look at every step would have a GPU wait for it.
            if (logs or self.step % _LOOK_EVERY == 0) and not bool(torch.isfinite(sums["loss"])):
                raise NotFinite(f"the loss became infinite or NaN before step {self.step}; lower the learning rate")
            if logs:
                taken = self.step - (int(log[-1]["step"]) if log else 0)
                row = {"step": float(self.step), "seconds": seconds, "rate": rate}
                log.append({**row, **{name: float(total) / taken for name, total in sums.items()}, **self.tested()})
                sums = {}
                # The log first: of its rows those beyond the state are left out where a training goes on.
                _write_log(folder / LOG, log)
                self.save(folder / STATE)
            if progress is not None:
                progress(f"Training, step {self.step} of {self.options.steps}", done)
        return log

    def _train_step(self, rate: float) -> dict[str, Tensor]:
        batch = self.batch(self.step)
        for group in self._optimizer.param_groups:
            group["lr"] = rate
        if self._recorded is None:
            values, layers = self._gradients(batch)
        else:
            values, layers = self._recorded(tensors_of(batch))
        nn.utils.clip_grad_norm_(self.network.parameters(), _LONGEST_GRADIENT)
        self._optimizer.step()
        self._averaged.update_parameters(self.network)
        # What is recorded is written over by the next step.
        return {**{name: value.clone() for name, value in values.items()}, **self._train_judge(batch, layers)}

    def _gradients(self, batch: Batch) -> tuple[dict[str, Tensor], Tensor]:
        """Loss, its terms and the layers of a batch; the gradients are left with the parameters."""
        kind = self.options.device.partition(":")[0]
        with torch.autocast(kind, dtype=torch.bfloat16, enabled=self.options.mixed):
            found = self.network(batch.observation)
        terms = loss_terms(found, batch, self.options.weights, self._critics)
        loss = sum(terms.values(), torch.zeros((), device=self.options.device))
        self._optimizer.zero_grad()
        loss.backward()  # type: ignore[no-untyped-call]
        return {"loss": loss.detach(), **{name: term.detach() for name, term in terms.items()}}, found.layers.detach()

    def _recording(self) -> Recorded[tuple[dict[str, Tensor], Tensor]] | None:
        """The gradients of a step as a GPU repeats them; None where each step brings numbers of its own to it.

        So do the paper's losses, with their engines, kernels and critics, and the axes of the paper's form.
        """
        weights = self.options.weights
        others = (weights.perceptual, weights.pse, weights.edge_independence, weights.adversarial)
        if any(others) or self.network.architecture.form != "conditioned":
            return None
        return Recorded(lambda tensors: self._gradients(batch_of(tensors)))

    def _train_judge(self, batch: Batch, found: Tensor) -> dict[str, Tensor]:
        judge = self._critics.discriminator
        if judge is None or self._judge_optimizer is None:
            return {}
        loss = discriminator_loss(judge, batch.observation.views, found, batch.layers)
        self._judge_optimizer.zero_grad()
        loss.backward()  # type: ignore[no-untyped-call]
        self._judge_optimizer.step()
        return {"discriminator": loss.detach()}

    def batch(self, step: int) -> Batch:
        """The batch of a step, drawn from the newest samples: always the same, if its source has it always the same."""
        options = self.options
        if isinstance(self._source, BatchSource):
            whole = self._source.batch(step, options.batch_size)
            return turned(whole, _turn(np.random.default_rng([options.seed, 7, step])))
        newest = options.newest(step)
        first = max(0, newest - options.window)
        if not self._kept:
            self._begin(range(first, options.newest(options.steps)))
        while newest - 1 not in self._kept:
            number, sample = next(self._coming)
            self._kept[number] = placed_sample(sample, options.device)
            self._kept.pop(number - options.window, None)
        random = np.random.default_rng([options.seed, 7, step])
        drawn = random.integers(first, newest, size=options.batch_size)
        batch = _batch([self._kept[int(number)] for number in drawn])
        return turned(batch, _turn(random))

    def _begin(self, numbers: range) -> None:
        """Let the samples of these numbers come, those for tests before them: processes that make them start once."""
        tests = range(0) if self._tests else range(_FIRST_TEST, _FIRST_TEST + self.options.test_samples)
        coming = self._source.samples([*tests, *numbers])
        self._tests += [placed_sample(next(coming), self.options.device) for _ in tests]
        self._coming = zip(numbers, coming, strict=False)

    @torch.no_grad()
    def tested(self) -> dict[str, float]:
        """Mean PSNR of both layers on samples that are never trained on, and of the layers in closed form."""
        rows = []
        if not self._tests and self.options.test_samples:
            self._begin(range(0))
        for sample in self._tests:
            seen, truth = sample.observation, sample.layers
            row = psnr(self.averaged(seen).layers, truth)
            rows.append([*row, *(psnr(seen.layers, truth) if seen.layers is not None else ())])
        names = ("transmission_db", "reflection_db", "closed_form_transmission_db", "closed_form_reflection_db")
        return dict(zip(names, np.mean(rows, axis=0).tolist(), strict=False)) if rows else {}

    def save(self, path: Path) -> None:
        """Write all that is needed to go on as if nothing had happened."""
        critics = (self._critics.discriminator, self._judge_optimizer)
        state = {
            "step": self.step,
            "seed": self.options.seed,
            "course": self._course,
            "network": self.network.state_dict(),
            "averaged": self._averaged.state_dict(),
            "optimizer": self._optimizer.state_dict(),
            "critics": [None if critic is None else critic.state_dict() for critic in critics],
        }
        content = io.BytesIO()
        torch.save(state, content)
        write_whole(path, content.getvalue())

    def resume(self, path: Path) -> None:
        """Go on from a state.

        Raises
        ------
        WrongState
            No such file, other choices, another architecture, other losses or another seed.
        """
        if not path.is_file():
            raise WrongState(f"{path}: no state to resume from; leave --resume out to begin anew")
        try:
            state = torch.load(path, map_location=self.options.device, weights_only=True)
        except (EOFError, RuntimeError, pickle.UnpicklingError) as error:
            raise WrongState(f"{path}: cannot be read as a state; leave --resume out to begin anew") from error
        critics = (self._critics.discriminator, self._judge_optimizer)
        whole = _is_state(state)
        # States of earlier versions do not tell their choices.
        differing = _differing(state.get("course", self._course), self._course) if whole else ""
        if differing:
            raise WrongState(
                f"{path}: was begun with {differing}; give the same options, or leave --resume out to begin anew"
            )
        if not (whole and self._fits(state)):
            raise WrongState(f"{path}: is no state of this training; resume with the options it was begun with")
        if state["seed"] != self.options.seed:
            raise WrongState(f"{path}: was begun with seed {state['seed']}, not {self.options.seed}")
        try:
            self.network.load_state_dict(state["network"])
            self._averaged.load_state_dict(state["averaged"])
            self._optimizer.load_state_dict(state["optimizer"])
            for critic, saved in zip(critics, state["critics"], strict=True):
                if critic is not None:
                    critic.load_state_dict(saved)
            self.step = int(state["step"])
        except (KeyError, ValueError, RuntimeError) as error:
            raise WrongState(f"{path}: is damaged; leave --resume out to begin anew") from error

    def _fits(self, state: dict[str, Any]) -> bool:
        """Whether a state is of networks and losses like these."""
        shapes = {name: weights.shape for name, weights in self.network.state_dict().items()}
        critics = (self._critics.discriminator, self._judge_optimizer)
        return shapes == {name: weights.shape for name, weights in state["network"].items()} and [
            critic is None for critic in critics
        ] == [critic is None for critic in state["critics"]]


def _adam(parameters: Iterable[nn.Parameter], rate: float, device: str) -> torch.optim.Adam:
    """Adam; on a GPU as one operation, where each would cost more to ask for than to do."""
    return torch.optim.Adam(parameters, rate, fused=device.startswith("cuda") or None)


def _is_state(state: Any) -> bool:
    """Whether what a file holds is what `Training.save` writes."""
    if (
        not isinstance(state, dict)
        or not {"step", "seed", "network", "averaged", "optimizer", "critics"} <= state.keys()
    ):
        return False
    network, critics = state["network"], state["critics"]
    tensors = isinstance(network, dict) and all(isinstance(weights, Tensor) for weights in network.values())
    return tensors and isinstance(critics, list) and isinstance(state.get("course", {}), dict)


def _differing(before: dict[str, Choice], now: dict[str, Choice]) -> str:
    """Choices that are not what they were, in words; empty where all are."""
    names = (*now, *(name for name in before if name not in now))
    pairs = [(name, before.get(name), now.get(name)) for name in names]
    return ", ".join(f"{name} {_words(was)}, not {_words(given)}" for name, was, given in pairs if was != given)


def _words(choice: Choice) -> str:
    return f"{choice:g}" if isinstance(choice, int | float) else choice or "none"


@dataclass(frozen=True)
class Turn:
    """One of the eight ways to lay a square frame on itself: transposed, then mirrored."""

    transposes: bool = False
    left_right: bool = False
    up_down: bool = False

    @property
    def _mirrored(self) -> list[int]:
        return [axis for axis, is_mirrored in ((-1, self.left_right), (-2, self.up_down)) if is_mirrored]

    def images(self, images: Tensor) -> Tensor:
        """Images (..., h, w)."""
        return (images.mT if self.transposes else images).flip(self._mirrored)

    def images_back(self, images: Tensor) -> Tensor:
        """Inverse of `images`."""
        there = images.flip(self._mirrored)
        return there.mT if self.transposes else there

    @property
    def views(self) -> list[int]:
        """Which of the views at 0, 45, 90 and 135 degrees is the first, second, ... of the camera that is turned so."""
        first, third = (2, 0) if self.transposes else (0, 2)
        return [first, 3, third, 1] if self.left_right != self.up_down else [first, 1, third, 3]

    def vectors(self, vectors: Tensor) -> Tensor:
        """Vectors (..., 2) to the right and down."""
        signs = constant([-1.0 if self.left_right else 1.0, -1.0 if self.up_down else 1.0], vectors)
        return (vectors.flip(-1) if self.transposes else vectors) * signs


def _turn(random: np.random.Generator) -> Turn:
    return Turn(*(bool(random.integers(2)) for _ in range(3)))


@dataclass(frozen=True)
class TurnedEngine:
    """The engine of scenes that were turned.

    Attributes
    ----------
    engine : callable
    turn : Turn
    fixed_angles : bool
        Whether the views are those at 0, 45, 90 and 135 degrees, of which each becomes another one.
    """

    engine: Engine
    turn: Turn
    fixed_angles: bool = False

    def __call__(self, layers: Tensor) -> Tensor:
        """Views ([batch,] view, 3, h, w) of layers ([batch,] 2, 3, h, w)."""
        views = self.turn.images(self.engine(self.turn.images_back(layers)))
        return _ordered(views, self.turn.views, -4) if self.fixed_angles else views


def _ordered(tensor: Tensor, order: Sequence[int], axis: int) -> Tensor:
    """With what lies along an axis in another order; a list as an index would have a GPU wait."""
    return torch.stack([tensor.select(axis, i) for i in order], dim=axis)


def turned(batch: Batch, turn: Turn) -> Batch:
    """A batch of square frames as another camera would have held them.

    Views along and across a plane of incidence turn with it; of those at fixed angles each becomes another one.
    """
    if turn == Turn():
        return batch
    seen, parts = turned_observation(batch.observation, turn.images, turn.vectors), turn.images(batch.parts)
    fixed_angles = seen.step is None
    if fixed_angles:
        views, errors = (_ordered(x, turn.views, 1) for x in (seen.views, seen.view_errors))
        seen, parts = replace(seen, views=views, view_errors=errors), _ordered(parts, turn.views, 1)
    return Batch(seen, turn.images(batch.layers), parts, TurnedEngine(batch.engine, turn, fixed_angles))


def psnr(found: Tensor, truth: Tensor) -> tuple[float, float]:
    """PSNR in dB of both layers of one sample, less the border."""
    inside = (..., slice(BORDER_PX, -BORDER_PX), slice(BORDER_PX, -BORDER_PX))
    squares = (found - truth)[inside].double().square().mean(dim=(0, 2, 3, 4)).clamp(min=1e-20)
    transmission, reflection = (-10 * torch.log10(squares)).tolist()
    return transmission, reflection


def placed_sample(sample: Sample, device: str) -> Sample:
    """On a device."""
    seen = placed(sample.observation, device)
    return Sample(seen, sample.layers.to(device), sample.parts.to(device), sample.engine)


def no_engine(_: Tensor) -> Tensor:
    """In the place of the engine of a batch whose losses simulate nothing."""
    raise ValueError("this batch is for losses that simulate nothing: leave the term pse out")


def tensors_of(samples: Sample | Batch) -> dict[str, Tensor]:
    """What is known of a batch or sample, but for its engine."""
    seen = {field.name: getattr(samples.observation, field.name) for field in fields(Observation)}
    known = {name: x for name, x in seen.items() if x is not None}
    return {"truth": samples.layers, "parts": samples.parts, **known}


def batch_of(tensors: dict[str, Tensor]) -> Batch:
    """Inverse of `tensors_of`."""
    seen: dict[str, Any] = {name: x for name, x in tensors.items() if name not in ("truth", "parts")}
    return Batch(Observation(**seen), tensors["truth"], tensors["parts"], no_engine)


def _batch(samples: Sequence[Sample]) -> Batch:
    return Batch(
        collated([sample.observation for sample in samples]),
        torch.cat([sample.layers for sample in samples]).float(),
        torch.cat([sample.parts for sample in samples]).float(),
        BatchEngine(tuple(sample.engine for sample in samples)),
    )


def _read_log(path: Path, until: int) -> list[dict[str, float]]:
    """Rows of a log up to a step; none where there is no log."""
    if not path.is_file() or not until:
        return []
    try:
        with path.open(newline="", encoding="utf-8") as file:
            rows = [{name: float(value) for name, value in row.items() if value} for row in csv.DictReader(file)]
        return [row for row in rows if row["step"] <= until]
    except (ValueError, TypeError, KeyError, csv.Error):
        raise WrongState(f"{path}: is damaged; remove it, and the log begins where the training goes on") from None


def _write_log(path: Path, log: Sequence[dict[str, float]]) -> None:
    names = list(dict.fromkeys(name for row in log for name in row))
    text = io.StringIO()
    writer = csv.DictWriter(text, names)
    writer.writeheader()
    writer.writerows({name: f"{value:.6g}" for name, value in row.items()} for row in log)
    write_whole(path, text.getvalue().encode())
