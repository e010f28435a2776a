"""``polaropt train``: it writes what it says, goes on where it stopped, and refuses what cannot be."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import numpy as np
import pytest
import torch
from skimage import data

from polaropt.capture.write import write_png
from polaropt.cli.app import main
from priors.learned import WEIGHTS
from priors.networks.checkpoint import load_network


@pytest.fixture(scope="module")
def photographs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("photographs")
    for name, image in (("a", data.astronaut()), ("b", data.coffee())):
        write_png(folder / f"{name}.png", np.ascontiguousarray(image[100:220, 150:290]))
    return folder


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
        (("--leaves-share", "2"), "from 0 to 1"),
        (("--begin-with", "nowhere.safetensors"), "no such file"),
        (("--form", "paper", "--begin-with", str(WEIGHTS / "conditioned.safetensors")), "holds the conditioned form"),
        (("--polarnet", "vgg19", "--vgg19", "nowhere.pth"), "no such file"),
        (("--features", "nonsense"), "choose auto or pixels"),
        (("--device", "nonsense"), "cannot be used"),
        (("--batch", "0"), "give 1 or more"),
        (("--rate", "2"), "between 0 and 1"),
        (("--without", "pixelwise", "--without", "decibel"), "leaves no term"),
    ],
)
def test_what_cannot_be_is_told_in_one_line(
    photographs: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], more: tuple[str, ...], told: str
) -> None:
    assert main(tiny(photographs, tmp_path / "out", *more)) == 2
    line = capsys.readouterr().err
    assert told in line
    assert line.count("\n") == 1
