"""How long a command takes and how far it has come: one honest total, a bar that moves, files of one run alone."""

from __future__ import annotations

import json
import time
from collections.abc import Iterator
from contextlib import contextmanager
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
import tifffile

from polaropt.cli import command
from polaropt.cli.app import main
from polaropt.progress import clocks
from tests.command_line import QUICK, RESULTS, UNCERTAINTY, spoken

Told = list[tuple[str, float]]
PANE = ["--incidence", "65", "--azimuth", "30", "--shift", "4", "--panes", "1"]


@pytest.fixture
def told(monkeypatch: pytest.MonkeyPatch) -> Told:
    """All that a bar on a terminal would be told."""
    calls: Told = []

    @contextmanager
    def recorded(wanted: bool = True) -> Iterator[command.Progress]:
        yield lambda stage, fraction: calls.append((stage, fraction))

    monkeypatch.setattr(command, "progress_bar", recorded)
    return calls


def test_the_total_holds_all_that_was_done(
    photographs: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    began = time.perf_counter()
    said = spoken(capsys, "separate", *photographs, *PANE[2:], "-o", str(tmp_path / "out"), *QUICK)
    elapsed = time.perf_counter() - began
    seconds = json.loads((tmp_path / "out" / "report.json").read_text())["seconds"]
    assert seconds.keys() >= {"Starting", "Reading", "Estimating the scene", "Solving", "Error maps", "Writing"}
    # What is left is the page's text, and the files' renaming.
    assert 0.8 * elapsed < sum(seconds.values()) <= elapsed
    assert f"{sum(seconds.values()):.1f} s altogether: " in said
    assert "error maps" in said


def test_the_total_counts_from_the_call_on(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """Options are read, and libraries loaded, before a command has its first stage."""
    begun: list[tuple[tuple[float, float], tuple[float, float]]] = []
    stages = command.Stages

    def noted(progress: command.Progress | None, since: tuple[float, float]) -> command.Stages:
        begun.append((since, clocks()))
        return stages(progress, since)

    monkeypatch.setattr(command, "Stages", noted)
    for _ in range(2):
        before = clocks()
        assert main(["inspect", str(tmp_path / "none.png")]) == 2
        since, made = begun[-1]
        assert all(first <= then < later for first, then, later in zip(before, since, made, strict=True))
    assert len(begun) == 2


def test_the_first_stage_lasts_from_then_on() -> None:
    elapsed, of_cores = clocks()
    course = command.Stages(None, (elapsed - 7, of_cores - 5))
    course.begin("Starting", 0.0)
    course.begin("Reading", 0.1)
    course.end()
    assert course.seconds["Starting"] >= 7
    assert course.cpu_seconds["Starting"] >= 5
    assert course.cpu_seconds["Reading"] < 5


def test_the_bar_moves_in_every_long_stage(small_photographs: list[str], tmp_path: Path, told: Told) -> None:
    assert main(["separate", *small_photographs, "--align", "--panes", "1", "-o", str(tmp_path / "out"), *QUICK]) == 0
    fractions = [fraction for _, fraction in told]
    assert all(before <= after + 1e-9 for before, after in pairwise(fractions))
    assert 0 <= fractions[0] < 0.05
    assert 0.9 < fractions[-1] <= 1
    for stage in ("Reading", "Aligning", "Estimating the scene", "Error maps", "Writing"):
        assert len({fraction for name, fraction in told if name == stage}) > 1, stage


def test_other_commands_tell_how_far_they_are(small_photographs: list[str], tmp_path: Path, told: Told) -> None:
    assert main(["inspect", *small_photographs, "--align", "-o", str(tmp_path / "look.png")]) == 0
    assert {"Reading", "Aligning", "Inspecting", "Drawing"} <= {name for name, _ in told}
    told.clear()
    pair = [str(Path(small_photographs[0]).parent / name) for name in ("behind.png", "mirrored.png")]
    assert main(["simulate", *pair, "-o", str(tmp_path)]) == 0
    assert len({fraction for _, fraction in told}) > 3


def test_a_run_leaves_nothing_of_the_one_before(small_photographs: list[str], tmp_path: Path) -> None:
    tmp_path.joinpath("mine.txt").write_text("mine")
    assert main(["separate", *small_photographs, *PANE, "-o", str(tmp_path), *QUICK]) == 0
    for stale in ("misfit.tiff", "misfit.png", "moving.png", "unglazed.png"):
        tmp_path.joinpath(stale).write_bytes(b"of an earlier capture")
    assert main(["separate", *small_photographs, *PANE, "-o", str(tmp_path), *QUICK]) == 0
    assert {path.name for path in tmp_path.iterdir()} == RESULTS | {"mine.txt"}


def test_a_simulation_leaves_nothing_of_the_one_before(small_photographs: list[str], tmp_path: Path) -> None:
    pair = [str(Path(small_photographs[0]).parent / name) for name in ("behind.png", "mirrored.png")]
    tmp_path.joinpath("capture_022.png").write_bytes(b"somebody's own")
    assert main(["simulate", *pair, "-o", str(tmp_path)]) == 0
    assert main(["simulate", *pair, "--angles", "0,60,120", "-o", str(tmp_path)]) == 0
    captures = {path.name for path in tmp_path.glob("capture_*")}
    assert captures == {"capture_000.png", "capture_022.png", "capture_060.png", "capture_120.png"}


def test_layers_can_be_all_that_is_written(small_photographs: list[str], tmp_path: Path) -> None:
    assert main(["separate", *small_photographs, *PANE, "-o", str(tmp_path), "--write", "layers", *QUICK]) == 0
    report = json.loads((tmp_path / "report.json").read_text())
    layers = {"transmission.tiff", "reflection.tiff", "transmission.png", "reflection.png"}
    assert {path.name for path in tmp_path.iterdir()} == {*layers, "report.json"} == set(report["written"])
    assert report["uncertainty"] is None


def test_the_error_maps_can_be_left_out(
    small_photographs: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    said = spoken(capsys, "separate", *small_photographs, *PANE, "-o", str(tmp_path), "--no-uncertainty", *QUICK)
    assert {path.name for path in tmp_path.iterdir()} == RESULTS - UNCERTAINTY
    assert "Error maps" not in json.loads((tmp_path / "report.json").read_text())["seconds"]
    assert "standard errors" not in said
    assert "Typical standard error" not in (tmp_path / "report.html").read_text()


def test_files_are_compressed_without_loss(photographs: list[str], tmp_path: Path) -> None:
    assert main(["separate", *photographs, *PANE, "-o", str(tmp_path), *QUICK]) == 0
    for name in ("transmission", "reflection_error"):
        with tifffile.TiffFile(tmp_path / f"{name}.tiff") as tiff:
            page = tiff.pages.first
            assert (page.compression.name, page.predictor.name) == ("ADOBE_DEFLATE", "FLOATINGPOINT")
            assert page.asarray().shape == (96, 96, 3)
    assert (tmp_path / "reflection_error.tiff").stat().st_size < 0.5 * 96 * 96 * 3 * 4
    errors = tifffile.imread(tmp_path / "reflection_error.tiff")
    assert np.isfinite(errors).all()
    assert (errors > 0).all()
