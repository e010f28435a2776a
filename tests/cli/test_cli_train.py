"""``polaropt train``: it writes what it says, goes on where it stopped, and refuses what cannot be."""

from __future__ import annotations

import csv
import json
import signal
from contextlib import nullcontext
from pathlib import Path
from typing import get_args

import numpy as np
import pytest
import torch
from skimage import data

from polaropt.capture.files.write import write_png
from polaropt.cli.app import main
from priors.learned import WEIGHTS
from priors.networks.checkpoint import load_network
from priors.networks.fusionnet import FUSION_SIZES, FusionSize


@pytest.fixture(scope="module")
def photographs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("photographs")
    for name, image in (("a", data.astronaut()), ("b", data.coffee())):
        write_png(folder / f"{name}.png", np.ascontiguousarray(image[100:220, 150:290]))
    return folder


@pytest.fixture(autouse=True)
def few_tests(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("polaropt.cli.train._TEST_SAMPLES", 2)


def tiny(photographs: Path, output: Path, *more: str) -> list[str]:
    return [
        "train",
        "--data",
        str(photographs),
        "--leaves-share",
        "0",
        "--steps",
        "2",
        "--batch",
        "1",
        "--size",
        "32",
        "-o",
        str(output),
        *more,
    ]


@pytest.mark.parametrize("form", ["conditioned", "paper"])
def test_it_writes_weights_log_state_and_record_and_goes_on_where_it_stopped(
    photographs: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], form: str
) -> None:
    command = tiny(photographs, tmp_path, "--form", form, "--without", "perceptual", "--json")
    assert main(command) == 0
    told = json.loads(capsys.readouterr().out)
    record = json.loads((tmp_path / "record.json").read_text())
    assert told == {"output": str(tmp_path), **record}
    assert record["architecture"]["form"] == form
    assert record["options"]["weights"]["perceptual"] == 0
    assert record["steps"] == 2
    assert load_network(tmp_path / "weights.safetensors", record["sha256"]).architecture.form == form
    assert steps_logged(tmp_path) == [2]
    command[command.index("2")] = "3"
    assert main([*command, "--resume"]) == 0
    assert json.loads((tmp_path / "record.json").read_text())["steps"] == 3
    assert steps_logged(tmp_path) == [2, 3]
    # With other options the record would tell of a training that was none.
    kept = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    command[command.index("32")] = "64"
    assert main([*command, "--resume", "--rate", "0.01", "--leaves", "3"]) == 2
    told = capsys.readouterr().err
    assert f"was begun with --size 32, not 64, --rate {record['options']['learning_rate']:g}, not 0.01; give" in told
    assert told.count("\n") == 1
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == kept


def test_the_papers_form_is_trained_without_its_head(photographs: Path, tmp_path: Path) -> None:
    assert main(tiny(photographs, tmp_path, "--form", "paper", "--head", "none", "--without", "perceptual")) == 0
    record = json.loads((tmp_path / "record.json").read_text())
    assert record["architecture"]["head"] == "none"
    network = load_network(tmp_path / "weights.safetensors", record["sha256"])
    assert network.architecture.head == "none"


@pytest.mark.parametrize("size", get_args(FusionSize))
def test_the_networks_size_and_time_can_be_chosen(photographs: Path, tmp_path: Path, size: FusionSize) -> None:
    command = tiny(photographs, tmp_path, "--fusionnet", size, "--seconds", "1e-3")
    assert main(command) == 0
    record = json.loads((tmp_path / "record.json").read_text())
    assert tuple(record["architecture"]["fusion_widths"]) == FUSION_SIZES[size]["fusion_widths"]
    assert record["steps"] == 1


def test_weights_are_trained_further(photographs: Path, tmp_path: Path) -> None:
    first, second, third = (tmp_path / name for name in ("first", "second", "third"))
    hardly = ("--rate", "1e-9", "--without", "perceptual", "--form", "paper")
    assert main(tiny(photographs, first, *hardly)) == 0
    assert (
        main(tiny(photographs, second, *hardly, "--seed", "5", "--begin-with", str(first / "weights.safetensors"))) == 0
    )
    assert main(tiny(photographs, third, *hardly, "--seed", "5")) == 0
    begun, went_on, anew = (load_network(folder / "weights.safetensors") for folder in (first, second, third))
    for name, weights in begun.state_dict().items():
        assert torch.allclose(weights, went_on.state_dict()[name], atol=1e-6), name
    assert not torch.allclose(begun.polarnet.encoder._entry.weight, anew.polarnet.encoder._entry.weight, atol=1e-3)
    records = [json.loads((folder / "record.json").read_text()) for folder in (first, second)]
    assert [record["begun_with"] for record in records] == [None, records[0]["sha256"]]


def steps_logged(folder: Path) -> list[float]:
    with (folder / "log.csv").open(newline="") as file:
        return [float(row["step"]) for row in csv.DictReader(file)]


def test_the_perceptual_loss_compares_features_of_the_shipped_encoder(photographs: Path, tmp_path: Path) -> None:
    command = tiny(photographs, tmp_path, "--form", "paper")
    command[command.index("2")] = "1"
    assert main(command) == 0
    assert "shipped conditioned form" in json.loads((tmp_path / "record.json").read_text())["perceptual_features"]


@pytest.mark.parametrize(
    ("more", "told"),
    [
        (("--without", "nonsense"), "there is no such term"),
        (("--resume",), "no state to resume from"),
        (("--polarnet", "vgg19"), "--vgg19"),
        (("--head", "none"), "--head none is for the paper's form alone"),
        (("--leaves-share", "2"), "from 0 to 1"),
        (("--begin-with", "nowhere.safetensors"), "no such file"),
        (("--form", "paper", "--begin-with", str(WEIGHTS / "conditioned.safetensors")), "holds the conditioned form"),
        (("--polarnet", "vgg19", "--vgg19", "nowhere.pth"), "no such file"),
        (("--features", "nonsense"), "choose auto or pixels"),
        (("--device", "nonsense"), "cannot be used"),
        (("--batch", "0"), "give 1 or more"),
        (("--rate", "2"), "between 0 and 1"),
        (("--seconds", "0"), "give more than 0"),
        (("--fusionnet", "compact", "--begin-with", str(WEIGHTS / "conditioned.safetensors")), "--fusionnet"),
        (("--without", "pixelwise", "--without", "decibel"), "leaves no term"),
        (("--vgg19", "nowhere.pth"), "--vgg19 is for --polarnet vgg19"),
        (("--form", "paper", "--features", "pixels", "--vgg19", "nowhere.pth"), "--vgg19 is for --polarnet vgg19"),
        (("--size", "1000000"), "--size is 1000000; give 2048 at most"),
        (("--size", "31"), "--size is 31; give 32 or more"),
        (("--steps", "1" + 20 * "0"), "at most"),
        (("--leaves", "1" + 20 * "0"), "at most"),
        (("--workers", "100000"), "at most"),
        (("--seed", "1" + 20 * "0"), "--seed"),
        (("--device-samples",), "--device-samples needs the conditioned form and frames of"),
    ],
)
def test_what_cannot_be_is_told_in_one_line(
    photographs: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], more: tuple[str, ...], told: str
) -> None:
    assert main(tiny(photographs, tmp_path / "out", *more)) == 2
    line = capsys.readouterr().err
    assert told in line
    assert line.count("\n") == 1


def test_a_folder_that_cannot_be_written_is_told(
    photographs: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "out").write_text("a file")
    assert main(tiny(photographs, tmp_path / "out", "--without", "perceptual", "--form", "paper")) == 2
    assert "cannot be written" in capsys.readouterr().err


@pytest.mark.parametrize("error", [ValueError, RuntimeError, KeyError])
def test_a_bug_inside_a_training_keeps_its_traceback(
    photographs: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, error: type[Exception]
) -> None:
    def broken(*_: object) -> None:
        raise error("a bug")

    monkeypatch.setattr("priors.training.trainer.loss_terms", broken)
    with pytest.raises(error, match="a bug"):
        main(tiny(photographs, tmp_path, "--without", "perceptual", "--form", "paper"))


@pytest.mark.usefixtures("heard_keys")
@pytest.mark.parametrize(("after", "said"), [(1, "nothing was written"), (2, "--resume goes on")])
def test_an_interrupted_training_says_what_stays(
    photographs: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    after: int,
    said: str,
) -> None:
    # The state is written with the last step.
    def press(stage: str, fraction: float) -> None:
        if stage.startswith(f"Training, step {after}"):
            signal.raise_signal(signal.SIGINT)

    monkeypatch.setattr("polaropt.cli.train.progress_bar", lambda wanted: nullcontext(press))
    assert main(tiny(photographs, tmp_path, "--without", "perceptual", "--form", "paper")) == 130
    assert said in capsys.readouterr().err
    assert (tmp_path / "state.pt").is_file() == (after == 2)
