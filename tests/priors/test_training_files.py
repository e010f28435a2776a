"""What a training writes: whole at every moment, and one line where it cannot be written."""

from __future__ import annotations

import csv
from collections.abc import Callable
from pathlib import Path

import pytest

from polaropt import InputError
from polaropt.training import TrainingJob
from polaropt.training import run as training_run
from priors.networks.checkpoint import NotWritten, load_network, save_network
from priors.networks.fusionnet import Architecture
from priors.training.losses import DECIBEL
from priors.training.trainer import LOG, STATE, Training, TrainingOptions, WrongState
from tests.observations import Mixtures, small_network

OPTIONS = TrainingOptions(
    steps=3, batch_size=1, learning_rate=3e-3, weights=DECIBEL, window=2, averaging=0.5, test_samples=1, test_every=1
)


class Killed(BaseException):
    """Stands for a signal that nothing catches."""


def full_disk(monkeypatch: pytest.MonkeyPatch) -> None:
    """Half of what is written fits."""
    write = Path.write_bytes

    def breaks(path: Path, content: bytes) -> int:
        write(path, content[: len(content) // 2])
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(Path, "write_bytes", breaks)


WRITTEN: dict[str, Callable[[Training, Path], object]] = {
    STATE: lambda training, folder: training.save(folder / STATE),
    LOG: lambda training, folder: training.run(folder),
    "weights.safetensors": lambda training, folder: save_network(folder / "weights.safetensors", training.network),
}


@pytest.mark.parametrize("name", WRITTEN)
def test_a_file_that_cannot_be_written_leaves_the_last_one(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    write = WRITTEN[name]
    write(Training(small_network(), Mixtures(), OPTIONS), tmp_path)
    last = {file.name: file.read_bytes() for file in tmp_path.iterdir()}
    full_disk(monkeypatch)
    with pytest.raises(NotWritten, match=r"cannot be written \(No space left on device\)"):
        write(Training(small_network(seed=3), Mixtures(), OPTIONS), tmp_path)
    assert {file.name: file.read_bytes() for file in tmp_path.iterdir()} == last


@pytest.mark.parametrize("stopped_by", [STATE, LOG])
def test_a_training_that_was_killed_between_its_files_goes_on_with_all_of_its_log(
    stopped_by: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The last step's row was missing where a state was there and its log was not."""
    replace, count = Path.replace, 0

    def killed(path: Path, target: Path) -> Path:
        nonlocal count
        count += Path(target).name == stopped_by
        if count == OPTIONS.steps:
            raise Killed
        return replace(path, target)

    monkeypatch.setattr(Path, "replace", killed)
    with pytest.raises(Killed):
        Training(small_network(), Mixtures(), OPTIONS).run(tmp_path)
    monkeypatch.undo()
    again = Training(small_network(), Mixtures(), OPTIONS)
    again.resume(tmp_path / STATE)
    again.run(tmp_path)
    with (tmp_path / LOG).open(newline="") as file:
        assert [row["step"] for row in csv.DictReader(file)] == ["1", "2", "3"]
    assert sorted(file.name for file in tmp_path.iterdir()) == sorted([STATE, LOG])


@pytest.mark.parametrize("damaged", [b"step,loss\n1,33.3-8\n", b"\xff", b"step\n1,2,3\n", b"loss\n1\n"])
def test_a_damaged_log_is_told_in_a_line(damaged: bytes, tmp_path: Path) -> None:
    Training(small_network(), Mixtures(), OPTIONS).run(tmp_path)
    (tmp_path / LOG).write_bytes(damaged)
    again = Training(small_network(), Mixtures(), OPTIONS)
    again.resume(tmp_path / STATE)
    with pytest.raises(WrongState, match=r"log.csv: is damaged"):
        again.run(tmp_path)


def test_weights_and_their_record_come_together_or_not_at_all(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(training_run, "_network", lambda job: small_network())
    monkeypatch.setattr(training_run, "TrainingData", lambda *given, **more: Mixtures())
    job = TrainingJob(tmp_path, Architecture("conditioned", "compact"), OPTIONS, 32, leaves=1)
    record = training_run.train(job)
    load_network(tmp_path / "weights.safetensors", record["sha256"])
    last = {name: (tmp_path / name).read_bytes() for name in ("weights.safetensors", "record.json")}

    def breaks(path: Path, content: str, **more: object) -> int:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(Path, "write_text", breaks)
    with pytest.raises(InputError, match="cannot be written"):
        training_run.train(job)
    assert {name: (tmp_path / name).read_bytes() for name in last} == last
