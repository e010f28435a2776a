"""A store of samples: a folder that several trainings share, whose samples are made once.

A sample of the paper's form costs more than a GPU needs to train on it, and an ablation trains on the same many times.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

import polaropt
from polaropt.errors import InputError
from polaropt.training.pictures import Pictures
from polaropt.training.samples import TrainingData, Variety, in_processes

if TYPE_CHECKING:
    from priors.training.trainer import Sample

Report = Callable[[int], None]

_IMAGES, _NUMBERS, _SETTINGS = "images.npy", "numbers.npz", "samples.json"
# Planes of a sample: four photographs, two layers, two parts of each photograph, all in colour, and what is trusted.
_VIEWS, _LAYERS, _PARTS = slice(0, 12), slice(12, 18), slice(18, 42)
_TRUSTED, _N_PLANES = slice(42, 43), 43
_PER_SAMPLE = ("view_errors", "shares")
_PER_GHOST = ("places", "weights")
# Engines of wide lenses have weights in every pixel, as large as the images.
_VARIETY = Variety(wide=0)


def store_samples(
    folder: Path,
    pictures: Pictures,
    size_px: int,
    seed: int,
    count: int,
    *,
    workers: int = 0,
    report: Report | None = None,
) -> None:
    """Make samples of the paper's form, none through wide lenses, and keep them, unless the folder holds them.

    Images are kept in half precision, which rounds by a seventh of the least noise that they have.

    Parameters
    ----------
    folder : Path
        What it holds of other samples is replaced.
    pictures : Pictures
    size_px : int
        Side of the square frames.
    seed : int
    count : int
        The first of the seed's samples.
    workers : int
        Processes that make them; 0 makes them in this one. They are the same.
    report : callable, optional
        Told how many there are.
    """
    settings = {"polaropt": polaropt.__version__, "data": pictures.source, "size_px": size_px, "seed": seed}
    if _holds(folder, settings, count):
        return
    folder.mkdir(parents=True, exist_ok=True)
    # Written last: without it the others are not whole.
    (folder / _SETTINGS).unlink(missing_ok=True)
    shape = (count, _N_PLANES, size_px, size_px)
    np.lib.format.open_memmap(folder / _IMAGES, mode="w+", dtype=np.float16, shape=shape).flush()
    make = partial(_keep, TrainingData(pictures, "paper", size_px, seed, variety=_VARIETY), folder / _IMAGES)
    numbers = range(count)
    kept = []
    for found in in_processes(make, numbers, workers) if workers else map(make, numbers):
        kept.append(found)
        if report is not None:
            report(len(kept))
    together: dict[str, Any] = {name: np.stack([found[name] for found in kept]) for name in _PER_SAMPLE}
    together |= {name: np.concatenate([found[name] for found in kept]) for name in _PER_GHOST}
    np.savez(folder / _NUMBERS, n_images=np.array([len(found["places"]) for found in kept]), **together)
    (folder / _SETTINGS).write_text(json.dumps({**settings, "count": count}, indent=2) + "\n", encoding="utf-8")


def _holds(folder: Path, settings: dict[str, Any], count: int) -> bool:
    """Whether a folder holds at least so many samples of these settings."""
    try:
        there = json.loads((folder / _SETTINGS).read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return False
    return bool({**there, "count": None} == {**settings, "count": None} and there["count"] >= count)


def _keep(source: TrainingData, path: Path, number: int) -> dict[str, NDArray[Any]]:
    """Write a sample's images to their place, and give back the numbers."""
    from priors.training.engines import ShiftedSum

    sample = source.sample(number)
    seen, engine = sample.observation, sample.engine
    if seen.shares is None or not isinstance(engine, ShiftedSum):
        raise ValueError("kept samples are those of the paper's form behind flat panes")
    images = np.load(path, mmap_mode="r+")[number]
    images[_VIEWS], images[_LAYERS] = seen.views[0].flatten(0, 1), sample.layers[0].flatten(0, 1)
    images[_PARTS], images[_TRUSTED] = sample.parts[0].flatten(0, 2), seen.trusted[0, 0]
    numbers = {"view_errors": np.asarray(seen.view_errors[0]), "shares": np.asarray(seen.shares[0])}
    return {**numbers, "places": engine.places, "weights": engine.weights}


@dataclass(frozen=True)
class SampleStore:
    """The first samples of a folder that holds them.

    Attributes
    ----------
    folder : Path
        See `store_samples`.
    count : int
        So many of them.
    """

    folder: Path
    count: int

    @property
    def data(self) -> str:
        """What they are made of, for the record."""
        there = self._settings()
        return f"{there['data']}; {self.count} samples of seed {there['seed']}, none through wide lenses"

    def on(self, device: str) -> PlacedSamples:
        """Read all of them onto a device."""
        import torch

        there = self._settings()
        if there["count"] < self.count:
            raise InputError(f"{self.folder}: holds {there['count']} samples, not {self.count}; make more of them")
        # Copy on write, since torch has no arrays that cannot be written; on the CPU it reads what is asked for.
        images = torch.from_numpy(np.load(self.folder / _IMAGES, mmap_mode="c")[: self.count]).to(device)
        with np.load(self.folder / _NUMBERS) as numbers:
            errors, shares = (torch.from_numpy(numbers[name][: self.count]).to(device) for name in _PER_SAMPLE)
            ends = np.cumsum(numbers["n_images"])[:-1]
            ghosts = [np.split(numbers[name], ends) for name in _PER_GHOST]
        return PlacedSamples(images, errors, shares, list(zip(*ghosts, strict=True)))

    def _settings(self) -> dict[str, Any]:
        try:
            there: dict[str, Any] = json.loads((self.folder / _SETTINGS).read_text(encoding="utf-8"))
        except (OSError, ValueError):
            raise InputError(f"{self.folder}: holds no samples; make them first") from None
        return there


@dataclass(frozen=True)
class PlacedSamples:
    """Samples on a device, again and again: number n is the one of n modulo how many there are.

    Attributes
    ----------
    images : Tensor, shape (sample, 43, h, w)
        In half precision.
    view_errors : Tensor, shape (sample, 4)
    shares : Tensor, shape (sample, candidate, 2)
    ghosts : list of (ndarray, ndarray)
        Places and weights of each sample's engine.
    """

    images: Any
    view_errors: Any
    shares: Any
    ghosts: list[tuple[NDArray[np.float32], NDArray[np.float32]]]

    def samples(self, numbers: Sequence[int]) -> Iterator[Sample]:
        """Samples in the order of these numbers."""
        return map(self._sample, numbers)

    def _sample(self, number: int) -> Sample:
        from priors.observation import COLORS, Observation
        from priors.training.engines import ShiftedSum
        from priors.training.trainer import Sample

        number %= len(self.images)
        here = slice(number, number + 1)
        images = self.images[here]
        seen = Observation(
            images[:, _VIEWS].unflatten(1, (-1, COLORS)),
            self.view_errors[here],
            images[:, None, _TRUSTED],
            shares=self.shares[here],
        )
        layers = images[:, _LAYERS].unflatten(1, (-1, COLORS))
        return Sample(seen, layers, images[:, _PARTS].unflatten(1, (-1, 2, COLORS)), ShiftedSum(*self.ghosts[number]))
