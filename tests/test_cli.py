"""The command line on good input: what it writes, what it says, and to whom."""

from __future__ import annotations

import json
import os
import pty
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tifffile
from captured import photographed
from skimage import data

from polaropt.capture_files import write_capture
from polaropt.cli import main
from polaropt.image_io import read_file, write_png
from polaropt.reader import read_capture

ROOT = Path(__file__).parent.parent
UNCERTAINTY = {"transmission_error.tiff", "reflection_error.tiff", "reflection_known.tiff", "uncertainty.png"}
RESULTS = {
    "transmission.tiff",
    "reflection.tiff",
    "transmission.png",
    "reflection.png",
    "report.json",
    "report.html",
    *UNCERTAINTY,
}
COMMANDS = ("demo", "simulate", "inspect", "estimate", "separate")
HEAVY = ("scipy", "skimage", "torch", "nlopt", "matplotlib")
QUICK = ["--max-evaluations", "3"]


@pytest.fixture(scope="module")
def photographs(tmp_path_factory: pytest.TempPathFactory) -> list[str]:
    """Four files of a small colour capture."""
    folder = tmp_path_factory.mktemp("photographs")
    write_png(folder / "behind.png", data.coffee()[150:246, 200:296])
    write_png(folder / "mirrored.png", data.astronaut()[30:126, 160:256])
    pair = [str(folder / "behind.png"), str(folder / "mirrored.png")]
    assert main(["simulate", *pair, "--incidence", "65", "--azimuth", "30", "--shift", "4", "-o", str(folder)]) == 0
    return [str(folder / f"capture_{angle}.png") for angle in ("000", "045", "090", "135")]


def spoken(capsys: pytest.CaptureFixture[str], *arguments: str) -> str:
    """What a successful command says on standard output; nothing on standard error."""
    capsys.readouterr()
    assert main(list(arguments)) == 0
    said = capsys.readouterr()
    assert said.err == ""
    return said.out


def program(*arguments: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "polaropt", *arguments]
    return subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)


# separate


def test_separate_writes_layers_and_a_report(
    photographs: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    said = spoken(capsys, "separate", *photographs, "-o", str(out), *QUICK)
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
    printed = json.loads(spoken(capsys, "separate", *photographs, "-o", str(tmp_path), "--json", *QUICK))
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
    assert report["diagnostics"]["warnings"] == []
    assert report["input"]["files"] == photographs
    assert report["seconds"].keys() == report["cpu_seconds"].keys()
    assert report["seconds"].keys() >= {"Estimating the scene", "Closed form", "Solving"}
    assert all(report["versions"][name] for name in ("polaropt", "python", "numpy", "scipy", "numba", "nlopt"))


def test_what_is_given_is_not_estimated(
    photographs: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    given = ["--incidence", "64", "--azimuth", "31", "--shift", "-3.5", "--index", "1.52"]
    given += ["--transmission-shift", "-1.5"]
    printed = spoken(capsys, "separate", *photographs, *given, "-o", str(tmp_path), "--json", *QUICK)
    report = json.loads(printed)
    scene = report["scene"]
    assert (scene["incidence_deg"], scene["azimuth_deg"], scene["ghost_shift"]) == (64, 31, -3.5)
    assert scene["transmission_ghost_shift"] == -1.5
    assert 1 <= report["n_bounces_kept"] <= 10
    assert scene["refractive_index"] == 1.52
    assert report["estimated"] == []


def test_weights_reach_the_objective(
    photographs: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    given = ["--incidence", "65", "--azimuth", "30", "--shift", "4", "--weights", "edge_independence=0,misfit=2"]
    report = json.loads(spoken(capsys, "separate", *photographs, *given, "-o", str(tmp_path), "--json", *QUICK))
    assert report["objective"]["edge_independence"]["weight"] == 0
    assert report["request"]["weights"]["misfit"] == 2


def test_a_thickness_ties_the_shift_to_the_incidence(
    photographs: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    given = ["--incidence", "65", "--azimuth", "30", "--thickness-px", "5", "--thickness-kind", "plate"]
    report = json.loads(spoken(capsys, "separate", *photographs, *given, "-o", str(tmp_path), "--json", *QUICK))
    assert abs(report["scene"]["ghost_shift"]) == pytest.approx(3.2, abs=0.01)


def test_a_single_surface_has_no_ghosts(
    photographs: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    water = ["--single-surface", "--index", "1.33", "--robust"]
    said = spoken(capsys, "separate", *photographs, *water, "-o", str(tmp_path), *QUICK)
    assert "ghost shift" not in said
    assert json.loads((tmp_path / "report.json").read_text())["scene"]["single_surface"]


def test_quiet_says_nothing(photographs: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert spoken(capsys, "separate", *photographs, "-o", str(tmp_path), "--quiet", *QUICK) == ""


def test_an_unpolarized_scene_is_a_warning(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    image = data.coffee()[150:214, 200:264].astype(np.float64) / 255 / 2
    noise = 0.005 * np.random.default_rng(0).standard_normal((4, *image.shape))
    pages = np.clip(image + noise, 0, 1)
    tifffile.imwrite(tmp_path / "flat.tiff", pages.astype(np.float32), photometric="rgb")
    said = spoken(capsys, "separate", str(tmp_path / "flat.tiff"), "-o", str(tmp_path / "out"), *QUICK)
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
    assert "gamma-encoded" in spoken(capsys, "separate", *encoded, "-o", str(tmp_path / "out"), *QUICK)
    decoded = [*encoded, "--gamma", "2.2"]
    assert "gamma-encoded" not in spoken(capsys, "separate", *decoded, "-o", str(tmp_path / "out"), *QUICK)


def test_a_failing_run_leaves_the_previous_output(
    photographs: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    out.mkdir()
    (out / "transmission.png").write_text("previous")

    def interrupted(*_: object, **__: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("polaropt.separation.separate", interrupted)
    assert main(["separate", *photographs, "-o", str(out)]) == 130
    assert capsys.readouterr().err == "polaropt: interrupted; nothing was written\n"
    assert [path.name for path in out.iterdir()] == ["transmission.png"]
    assert (out / "transmission.png").read_text() == "previous"
    assert main(["separate", *photographs, "-o", str(tmp_path / "new")]) == 130
    assert [path.name for path in tmp_path.iterdir()] == ["out"]


def test_ctrl_c_leaves_the_previous_output(tmp_path: Path) -> None:
    write_capture(photographed((3, 600, 600)), tmp_path / "large.npz")
    out = tmp_path / "out"
    out.mkdir()
    (out / "report.json").write_text("previous")
    command = [sys.executable, "-m", "polaropt", "separate", str(tmp_path / "large.npz"), "-o", str(out)]
    running = subprocess.Popen(
        [*command, "--tolerance", "0", "--max-evaluations", "10000"],
        cwd=ROOT,
        stderr=subprocess.PIPE,
        text=True,
    )
    while len(list(out.iterdir())) < 2:  # its temporary folder
        time.sleep(0.05)
    time.sleep(1)
    running.send_signal(signal.SIGINT)
    _, said = running.communicate(timeout=30)
    assert (running.returncode, said) == (130, "polaropt: interrupted; nothing was written\n")
    assert [path.name for path in out.iterdir()] == ["report.json"]
    assert (out / "report.json").read_text() == "previous"


# estimate and inspect


def test_estimate(photographs: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    lines = spoken(capsys, "estimate", *photographs).splitlines()
    assert [line.split()[0] for line in lines] == ["incidence", "azimuth", "shift", "index", "rung"]
    assert all("estimated" in line for line in lines[:3])
    report = json.loads(spoken(capsys, "estimate", *photographs, "--json", "--azimuth", "30"))
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


# simulate


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


def test_simulate_takes_photographs_from_a_folder(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for number in range(3):
        write_png(tmp_path / f"{number}.png", data.camera()[: 20 + number, :30])
    arguments = ["--pairs", "1", "--photos", str(tmp_path), "--size", "24", "--single-surface", "--index", "1.33"]
    spoken(capsys, "simulate", *arguments, "-o", str(tmp_path / "out"))
    pair = json.loads((tmp_path / "out" / "manifest.json").read_text())["pairs"][0]
    assert pair["ghost_shift"] == 0
    assert len(set(pair["photographs"])) == 2


# demo


def test_demo(tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("polaropt.example.SIZE", 128)
    said = spoken(capsys, "demo", "-o", str(tmp_path))
    for name in (*RESULTS, "side-by-side.png"):
        assert (tmp_path / name).exists()
    for name in ("side-by-side.png", "transmission.png", "reflection.png", "report.json"):
        assert str(tmp_path / name) in said
    for score in json.loads((tmp_path / "scores.json").read_text()):
        assert score["separated_db"] > score["doing_nothing_db"] + 3


# speech


@pytest.mark.parametrize("command", COMMANDS)
def test_help_explains_with_an_example(command: str, capsys: pytest.CaptureFixture[str]) -> None:
    said = spoken(capsys, command, "--help")
    assert f"Example: polaropt {command}" in said
    assert "Usage" in said


def test_help_lists_the_commands(capsys: pytest.CaptureFixture[str]) -> None:
    said = spoken(capsys, "--help")
    assert all(command in said for command in COMMANDS)
    assert spoken(capsys, "--version").startswith("polaropt 0.")


def test_help_is_cheap() -> None:
    code = (
        f"import sys; from polaropt.cli import main; main(['--help']); "
        f"print(*(name for name in {HEAVY!r} if name in sys.modules), file=sys.stderr)"
    )
    ran = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True)
    assert ran.stderr.split() == []


def test_a_pipe_sees_no_progress_bar(photographs: list[str], tmp_path: Path) -> None:
    ran = program("separate", *photographs, "-o", str(tmp_path), *QUICK)
    assert (ran.returncode, ran.stderr) == (0, "")
    assert ran.stdout.startswith("Pane: ")
    assert not set("\x1b\r━") & set(ran.stdout)


def test_a_terminal_sees_a_progress_bar(photographs: list[str], tmp_path: Path) -> None:
    ours, theirs = pty.openpty()
    command = [sys.executable, "-m", "polaropt", "separate", *photographs, "-o", str(tmp_path), *QUICK]
    environment = {**os.environ, "TERM": "xterm", "COLUMNS": "100"}
    with subprocess.Popen(command, cwd=ROOT, stdout=theirs, stderr=theirs, env=environment) as running:
        os.close(theirs)
        seen = b""
        while chunk := _read(ours):
            seen += chunk
    os.close(ours)
    assert running.returncode == 0
    assert "━".encode() in seen
    assert b"Pane: " in seen


def _read(terminal: int) -> bytes:
    try:
        return os.read(terminal, 4096)
    except OSError:  # the other end is closed
        return b""


def test_a_wide_lens_is_found_and_told(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    pair = [tmp_path / name for name in ("behind.png", "mirrored.png")]
    for name, photo in zip(pair, (data.astronaut(), data.coffee()), strict=True):
        write_png(name, photo[:160, 100:260])
    pane = ["--incidence", "55", "--azimuth", "200", "--shift", "0", "--focal-px", "190"]
    spoken(capsys, "simulate", *map(str, pair), *pane, "-o", str(tmp_path))
    shots = [str(tmp_path / f"capture_{angle}.png") for angle in ("000", "045", "090", "135")]
    assert "focal" in spoken(capsys, "estimate", *shots)
    assert "focal length" in spoken(capsys, "separate", *shots, "-o", str(tmp_path / "out"), *QUICK)
    report = json.loads((tmp_path / "out" / "report.json").read_text())
    assert report["scene"]["rung"] == "perspective"
    assert report["scene"]["focal_px"] == pytest.approx(190, rel=0.1)
    assert [rung["taken"] for rung in report["rungs"]] == [False, True]
