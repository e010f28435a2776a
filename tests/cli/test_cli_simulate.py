"""``polaropt simulate`` and ``demo``: photographs with their truth, data sets, and the way back."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tifffile
from skimage import data

from polaropt.capture.files.write import write_png
from polaropt.capture.read import read_capture
from polaropt.cli.app import main
from polaropt.optics import SceneParameters
from polaropt.reporting.notebook import scene_of_report
from tests.command_line import RESULTS, spoken


def test_simulate_writes_photographs_and_truth(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    write_png(tmp_path / "wide.png", data.coffee()[:64, :80])
    write_png(tmp_path / "high.png", data.camera()[:72, :64])
    pair = [str(tmp_path / "wide.png"), str(tmp_path / "high.png")]
    camera = ["--angles", "0,60,120", "--noise", "0", "--format", "tiff"]
    report = json.loads(spoken(capsys, "simulate", *pair, *camera, "-o", str(tmp_path / "out"), "--json"))
    assert report["scene"]["incidence_deg"] == 60
    capture = read_capture(tmp_path / "out" / "capture.tiff")
    assert capture.angles_deg == (0, 60, 120)
    assert capture.shape == (3, 64, 64)
    truth = tifffile.imread(tmp_path / "out" / "true_transmission.tiff")
    np.testing.assert_allclose(truth, data.coffee()[:64, 8:72] / np.float32(255))
    assert json.loads((tmp_path / "out" / "scene.json").read_text())["files"] == ["capture.tiff"]


def test_simulate_writes_a_data_set(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    options = ["--size", "32", "--seed", "7", "--azimuth", "20"]
    spoken(capsys, "simulate", "--pairs", "3", *options, "-o", str(tmp_path / "three"))
    manifest: dict[str, Any] = json.loads((tmp_path / "three" / "manifest.json").read_text())
    assert len(manifest["pairs"]) == 3
    assert len({pair["incidence_deg"] for pair in manifest["pairs"]}) == 3
    assert {pair["azimuth_deg"] for pair in manifest["pairs"]} == {20}
    for pair in manifest["pairs"]:
        assert read_capture(tmp_path / "three" / pair["capture"]).shape == (3, 32, 32)
        assert tifffile.imread(tmp_path / "three" / pair["reflection"]).shape == (32, 32, 3)
    # The first pairs of a larger set are those of a smaller one.
    spoken(capsys, "simulate", "--pairs", "1", *options, "-o", str(tmp_path / "one"))
    assert json.loads((tmp_path / "one" / "manifest.json").read_text())["pairs"] == manifest["pairs"][:1]
    same = [(tmp_path / name / "pair_0000_transmission.tiff").read_bytes() for name in ("one", "three")]
    assert same[0] == same[1]


@pytest.mark.parametrize(("sensor", "size"), [("mono", (66, 70)), ("color", (64, 68))])
def test_the_truth_of_a_mosaic_is_as_large_as_its_layers(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], sensor: str, size: tuple[int, int]
) -> None:
    write_png(tmp_path / "a.png", data.camera()[:67, :71])
    photographs = [str(tmp_path / "a.png")] * 2
    spoken(capsys, "simulate", *photographs, "--sensor", sensor, "-o", str(tmp_path / "out"))
    assert read_capture(tmp_path / "out" / "mosaic.png", sensor=sensor).shape[-2:] == size
    for layer in ("transmission", "reflection"):
        assert tifffile.imread(tmp_path / "out" / f"true_{layer}.tiff").shape[:2] == size


def test_simulate_takes_photographs_from_a_folder(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for number in range(3):
        write_png(tmp_path / f"{number}.png", data.camera()[: 20 + number, :30])
    arguments = ["--pairs", "1", "--photos", str(tmp_path), "--size", "24", "--single-surface", "--index", "1.33"]
    spoken(capsys, "simulate", *arguments, "-o", str(tmp_path / "out"))
    pair = json.loads((tmp_path / "out" / "manifest.json").read_text())["pairs"][0]
    assert pair["ghost_shift"] == 0
    assert len(set(pair["photographs"])) == 2


def test_demo(tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("polaropt.cli.example.SIZE", 64)
    said = spoken(capsys, "demo", "-o", str(tmp_path))
    for name in (*RESULTS, "side-by-side.png"):
        assert (tmp_path / name).exists()
    for name in ("side-by-side.png", "transmission.png", "reflection.png", "report.json"):
        assert str(tmp_path / name) in said
    for score in json.loads((tmp_path / "scores.json").read_text()):
        assert score["separated_db"] > score["doing_nothing_db"] + 3


def test_files_lie_in_the_order_of_their_angles(tmp_path: Path) -> None:
    photographs = [tmp_path / "T.png", tmp_path / "R.png"]
    for name in photographs:
        write_png(name, np.arange(32 * 32, dtype=np.uint16).reshape(32, 32))
    angles = [0.0, 22.5, 45.0, 67.5, 90.0, 112.5]
    given = ",".join(map(str, angles))
    assert main(["simulate", *map(str, photographs), "--angles", given, "-o", str(tmp_path / "out")]) == 0
    names = [path.stem for path in sorted((tmp_path / "out").glob("capture_*.png"))]
    assert [float(name.removeprefix("capture_")) for name in names] == angles


@pytest.mark.parametrize("sensor", [[], ["--sensor", "mono"]])
def test_the_true_scene_can_be_told(tmp_path: Path, sensor: list[str]) -> None:
    photographs = [tmp_path / "T.png", tmp_path / "R.png"]
    for name in photographs:
        write_png(name, np.arange(32 * 48, dtype=np.uint16).reshape(32, 48))
    out = tmp_path / "out"
    pane = ["--incidence", "50", "--shift", "3"]
    assert main(["simulate", *map(str, photographs), *pane, *sensor, "-o", str(out)]) == 0
    assert scene_of_report(out / "scene.json", (32, 48)) == SceneParameters(50.0, 0.0, 3.0)
    assert scene_of_report(out / "scene.json", (64, 96)).ghost_shift == 6
