"""``polaropt separate``, ``inspect`` and ``estimate`` on good input: what they write and say."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
import tifffile
from skimage import data

from polaropt.capture.files.decode import read_file
from polaropt.capture.files.write import write_png
from polaropt.cli.app import main
from tests.command_line import QUICK, RESULTS, spoken

PANE = ["--incidence", "65", "--azimuth", "30", "--shift", "4", "--panes", "1"]


def test_separate_writes_layers_and_a_report(
    photographs: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    pane = ["--incidence", "65", "--azimuth", "30", "--panes", "1"]
    said = spoken(capsys, "separate", *photographs, *pane, "-o", str(out), *QUICK)
    assert {path.name for path in out.iterdir()} == RESULTS
    for name in ("incidence", "azimuth", "ghost shift", "estimated", *RESULTS):
        assert name in said
    for layer in ("transmission", "reflection"):
        linear = tifffile.imread(out / f"{layer}.tiff")
        assert (linear.dtype, linear.shape) == (np.float32, (96, 96, 3))
        view = read_file(out / f"{layer}.png").pixels
        assert (view.dtype, view.shape) == (np.uint8, (96, 96, 3))


def test_the_report_tells_everything(
    photographs: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    printed = json.loads(
        spoken(capsys, "separate", *photographs, "--panes", "1", "-o", str(tmp_path), "--json", *QUICK)
    )
    report = json.loads((tmp_path / "report.json").read_text())
    assert printed == {"output": str(tmp_path), **report}
    assert report["scene"]["incidence_deg"] == pytest.approx(65, abs=5)
    assert report["scene"]["azimuth_deg"] == pytest.approx(30, abs=2)
    assert report["estimated"] == ["incidence_deg", "azimuth_deg", "ghost_shift"]
    assert {"raw", "weight"} == set(report["objective"]["misfit"])
    assert report["solver"]["n_evaluations"] <= 3
    assert report["solver"]["sentence"]
    assert sum(report["seconds"].values()) > 0
    assert report["diagnostics"]["noise"] == pytest.approx(0.005, rel=0.3)
    # So small pictures do not tell the incidence well.
    assert {warning["name"] for warning in report["diagnostics"]["warnings"]} <= {"SCENE_UNCERTAIN"}
    assert report["input"]["files"] == photographs
    assert report["seconds"].keys() == report["cpu_seconds"].keys()
    assert report["seconds"].keys() >= {"Estimating the scene", "Closed form", "Solving"}
    assert all(report["versions"][name] for name in ("polaropt", "python", "numpy", "scipy", "numba", "nlopt"))


def test_what_is_given_is_not_estimated(
    small_photographs: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    given = ["--incidence", "64", "--azimuth", "31", "--shift", "-3.5", "--index", "1.52", "--panes", "1"]
    given += ["--transmission-shift", "-1.5"]
    printed = spoken(capsys, "separate", *small_photographs, *given, "-o", str(tmp_path), "--json", *QUICK)
    report = json.loads(printed)
    scene = report["scene"]
    assert (scene["incidence_deg"], scene["azimuth_deg"], scene["ghost_shift"]) == (64, 31, -3.5)
    assert scene["transmission_ghost_shift"] == -1.5
    assert 1 <= report["n_bounces_kept"] <= 10
    assert scene["refractive_index"] == 1.52
    assert report["estimated"] == []


def test_weights_reach_the_objective(
    small_photographs: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    given = [*PANE, "--weights", "edge_independence=0,misfit=2"]
    report = json.loads(spoken(capsys, "separate", *small_photographs, *given, "-o", str(tmp_path), "--json", *QUICK))
    assert report["objective"]["edge_independence"]["weight"] == 0
    assert report["request"]["weights"]["misfit"] == 2


def test_a_thickness_ties_the_shift_to_the_incidence(
    small_photographs: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    given = [*PANE[:4], "--panes", "1", "--thickness-px", "5", "--thickness-kind", "plate"]
    report = json.loads(spoken(capsys, "separate", *small_photographs, *given, "-o", str(tmp_path), "--json", *QUICK))
    assert abs(report["scene"]["ghost_shift"]) == pytest.approx(3.2, abs=0.01)
    assert (report["request"]["thickness_px"], report["request"]["thickness_kind"]) == (5, "plate")


def test_a_single_surface_has_no_ghosts(
    small_photographs: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    water = ["--single-surface", "--index", "1.33", "--robust"]
    said = spoken(capsys, "separate", *small_photographs, *water, "-o", str(tmp_path), *QUICK)
    assert "ghost shift" not in said
    assert json.loads((tmp_path / "report.json").read_text())["scene"]["single_surface"]


def test_quiet_says_nothing(small_photographs: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert spoken(capsys, "separate", *small_photographs, *PANE, "-o", str(tmp_path), "--quiet", *QUICK) == ""


def test_what_is_warned_of_is_told_in_any_case(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    flat = _unpolarized(tmp_path)
    assert main(["separate", flat, "-o", str(tmp_path / "out"), "--quiet", *QUICK]) == 0
    said = capsys.readouterr()
    assert said.out == ""
    assert said.err.startswith("polaropt: warning: ")
    assert main(["separate", flat, "-o", str(tmp_path / "out"), "--quiet", "--strict", *QUICK]) == 1


def test_strict_does_not_mind_a_result_without_warnings(photographs: list[str], tmp_path: Path) -> None:
    assert main(["separate", *photographs, *PANE, "-o", str(tmp_path), "--strict", *QUICK]) == 0


def _unpolarized(folder: Path) -> str:
    """A stack of photographs that show no polarization."""
    image = data.coffee()[150:214, 200:264].astype(np.float64) / 255 / 2
    noise = 0.005 * np.random.default_rng(0).standard_normal((4, *image.shape))
    pages = np.clip(image + noise, 0, 1)
    tifffile.imwrite(folder / "flat.tiff", pages.astype(np.float32), photometric="rgb")
    return str(folder / "flat.tiff")


def test_an_unpolarized_scene_is_a_warning(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    image = data.coffee()[150:214, 200:264].astype(np.float64) / 255 / 2
    said = spoken(capsys, "separate", _unpolarized(tmp_path), "-o", str(tmp_path / "out"), *QUICK)
    assert "ATTENTION" in said
    transmission = tifffile.imread(tmp_path / "out" / "transmission.tiff")
    assert np.sqrt(np.mean((transmission - 2 * image) ** 2)) < 0.01


def test_a_gamma_encoded_capture_is_told(
    photographs: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    encoded = []
    for name in photographs:
        encoded.append(str(tmp_path / Path(name).name))
        linear = read_file(name).pixels / 65535
        write_png(encoded[-1], np.round(65535 * linear ** (1 / 2.2)).astype(np.uint16))
    encoded += PANE
    assert "gamma-encoded" in spoken(capsys, "separate", *encoded, "-o", str(tmp_path / "out"), *QUICK)
    decoded = [*encoded, "--gamma", "2.2"]
    assert "gamma-encoded" not in spoken(capsys, "separate", *decoded, "-o", str(tmp_path / "out"), *QUICK)


def test_a_wide_lens_is_found_and_told(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    pair = [tmp_path / name for name in ("behind.png", "mirrored.png")]
    for name, photo in zip(pair, (data.astronaut(), data.coffee()), strict=True):
        write_png(name, photo[:128, 100:228])
    pane = ["--incidence", "55", "--azimuth", "200", "--shift", "0", "--focal-px", "150"]
    spoken(capsys, "simulate", *map(str, pair), *pane, "-o", str(tmp_path))
    shots = [str(tmp_path / f"capture_{angle}.png") for angle in ("000", "045", "090", "135")]
    assert "focal" in spoken(capsys, "estimate", *shots, "--model", "perspective", "--panes", "1")
    assert "focal length" in spoken(capsys, "separate", *shots, "--panes", "1", "-o", str(tmp_path / "out"), *QUICK)
    report = json.loads((tmp_path / "out" / "report.json").read_text())
    assert report["scene"]["rung"] == "perspective"
    assert report["scene"]["focal_px"] == pytest.approx(150, rel=0.1)
    assert [rung["taken"] for rung in report["rungs"]] == [False, True]


def test_estimate(photographs: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    lines = spoken(capsys, "estimate", *photographs, "--panes", "1").splitlines()
    heads = ["incidence", "azimuth", "ghost shift", "refractive index", "rung"]
    assert [line.split("  ")[0] for line in lines] == heads
    assert all("estimated" in line for line in lines[:3])
    report = json.loads(spoken(capsys, "estimate", *photographs, "--json", "--azimuth", "30", "--panes", "1"))
    assert report["scene"]["incidence_deg"] == pytest.approx(65, abs=5)
    assert report["estimated"] == ["incidence_deg", "ghost_shift"]
    assert report["polarized"] is True


def test_inspect(photographs: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    picture = tmp_path / "new" / "look.png"
    said = spoken(capsys, "inspect", *photographs, "-o", str(picture))
    assert "96x96" in said
    assert str(picture) in said
    assert read_file(picture).pixels.dtype == np.uint8
    report = json.loads(spoken(capsys, "inspect", *photographs, "--json"))
    assert (report["width"], report["height"], report["channels"]) == (96, 96, 3)
    assert report["sentences"]
