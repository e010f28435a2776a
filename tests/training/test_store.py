"""Samples that are kept: those that would be made, to half precision, whoever makes them."""

from __future__ import annotations

import json
import pickle
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import torch

from polaropt.errors import InputError
from polaropt.training import Pictures, SampleStore, TrainingJob, store_samples, train
from polaropt.training.samples import TrainingData, Variety
from priors.networks.checkpoint import load_network
from priors.networks.fusionnet import Architecture
from priors.training.losses import LossWeights
from priors.training.trainer import TrainingOptions
from tests.observations import SMALL

COUNT, SIZE_PX, SEED = 5, 32, 3


@pytest.fixture(scope="module")
def pictures() -> Pictures:
    return Pictures(leaves_share=0)


@pytest.fixture(scope="module")
def folder(pictures: Pictures, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("samples")
    store_samples(folder, pictures, SIZE_PX, SEED, COUNT)
    return folder


def test_kept_samples_are_those_that_are_made(pictures: Pictures, folder: Path) -> None:
    made = TrainingData(pictures, "paper", SIZE_PX, SEED, variety=Variety(wide=0)).samples(range(COUNT))
    kept = SampleStore(folder, COUNT).on("cpu").samples(range(COUNT))
    for mine, theirs in zip(made, kept, strict=True):
        for name in ("views", "view_errors", "trusted", "shares"):
            one, other = (getattr(sample.observation, name) for sample in (mine, theirs))
            torch.testing.assert_close(other.float(), one, atol=1e-6, rtol=5e-4)
        torch.testing.assert_close(theirs.layers.float(), mine.layers, atol=1e-6, rtol=5e-4)
        torch.testing.assert_close(theirs.parts.float(), mine.parts, atol=1e-6, rtol=5e-4)
        assert torch.equal(theirs.engine(mine.layers[0]), mine.engine(mine.layers[0]))


def test_after_the_last_comes_the_first(folder: Path) -> None:
    first, again = SampleStore(folder, 3).on("cpu").samples(range(0, 4, 3))
    assert torch.equal(first.layers, again.layers)
    assert torch.equal(first.engine(first.layers[0].float()), again.engine(first.layers[0].float()))


def test_processes_keep_the_same(
    pictures: Pictures, folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """They are given what they can load; that they do the same with it is tested with the samples themselves."""

    def loaded(make: Callable[[int], Any], numbers: Sequence[int], workers: int) -> Iterator[Any]:
        assert workers == 1
        return map(pickle.loads(pickle.dumps(make)), numbers)

    monkeypatch.setattr("polaropt.training.store.in_processes", loaded)
    counts: list[int] = []
    store_samples(tmp_path, pictures, SIZE_PX, SEED, 2, workers=1, report=counts.append)
    assert counts == [1, 2]
    here, there = (SampleStore(where, 2).on("cpu") for where in (folder, tmp_path))
    assert torch.equal(here.images, there.images)


def test_what_is_there_is_not_made_again_and_what_is_other_is(pictures: Pictures, tmp_path: Path) -> None:
    def makes(count: int, seed: int = SEED) -> bool:
        counts: list[int] = []
        store_samples(tmp_path, pictures, SIZE_PX, seed, count, report=counts.append)
        return bool(counts)

    assert [makes(2), makes(1), makes(2), makes(3), makes(3, seed=4)] == [True, False, False, True, True]
    # As a run that was interrupted leaves it.
    (tmp_path / "samples.json").unlink()
    with pytest.raises(InputError, match="holds no samples"):
        SampleStore(tmp_path, 1).on("cpu")
    assert makes(3, seed=4)
    with pytest.raises(InputError, match="holds 3 samples, not 4"):
        SampleStore(tmp_path, 4).on("cpu")


def test_a_training_on_kept_samples_is_always_the_same_and_its_record_tells(folder: Path, tmp_path: Path) -> None:
    options = TrainingOptions(
        steps=2, batch_size=2, fresh=2, window=COUNT, test_samples=0, weights=LossWeights(perceptual=0)
    )
    job = TrainingJob(
        tmp_path / "a", Architecture("paper", **SMALL), options, SIZE_PX, store=SampleStore(folder, COUNT)
    )
    train(job)
    train(replace(job, folder=tmp_path / "b"))
    record = json.loads((tmp_path / "a" / "record.json").read_text())
    assert record["data"].endswith("5 samples of seed 3, none through wide lenses")
    first, second = (load_network(tmp_path / name / "weights.safetensors").state_dict() for name in "ab")
    assert all(torch.equal(weights, second[name]) for name, weights in first.items())
