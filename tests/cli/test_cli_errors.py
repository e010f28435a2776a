"""Bad input and wrong options: one line on standard error, exit code 2, nothing written."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
import tifffile

from polaropt.capture.files.write import write_capture, write_png
from polaropt.cli.app import main
from tests.captured import photographed

ROOT = Path(__file__).parents[2]
OTHERS = ["glass_045.png", "glass_090.png", "glass_135.png"]
FOUR = ["glass_000.png", *OTHERS]


@pytest.fixture(scope="module")
def shelf(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder of good and bad files."""
    folder = tmp_path_factory.mktemp("shelf")
    capture = photographed((64, 64), bits=12)
    write_capture(capture, folder / "glass.png")
    write_capture(photographed((64, 48)), folder / "narrow.png")
    write_capture(photographed((64, 64), angles_deg=(0, 60, 120)), folder / "three.png")
    whole = (folder / "glass_000.png").read_bytes()
    (folder / "truncated.png").write_bytes(whole[: len(whole) // 2])
    (folder / "text.png").write_text("no image\nat all")
    (folder / "empty.png").write_bytes(b"")
    for name, value in (("black", 0), ("grey", 30000), ("white", 65535)):
        write_png(folder / f"{name}.png", np.full((64, 64), value, dtype=np.uint16))
    for name, value in (("black", 0.0), ("grey", 0.5), ("white", 1.0)):
        tifffile.imwrite(
            folder / f"{name}.tiff", np.full((4, 64, 64), value, dtype=np.float32), photometric="minisblack"
        )
    write_png(folder / "tiny.png", np.arange(64, dtype=np.uint8).reshape(8, 8))
    for name, value in (("nan", np.nan), ("negative", -0.05)):
        pages = capture.intensities.copy()
        pages[1, 5, 5] = value
        tifffile.imwrite(folder / f"{name}.tiff", pages, photometric="minisblack")
    (folder / "file").write_text("in the way")
    return folder


BAD = {
    "missing file": (["nofile.png", *OTHERS], "nofile.png: no such file"),
    "a folder": ([".", *OTHERS], "is a folder"),
    "text": (["text.png", *OTHERS], "text.png: "),
    "empty": (["empty.png", *OTHERS], "empty.png: "),
    "truncated": (["truncated.png", *OTHERS], "truncated.png: "),
    "sizes differ": (["glass_000.png", "narrow_045.png", *OTHERS[1:]], "same size"),
    "given twice": (["glass_000.png", "glass_000.png", *OTHERS[1:]], "given twice"),
    "two files": (FOUR[:2], "at least 3"),
    "two angles": ([*FOUR[:2], "--angles", "0,45"], "at least 3"),
    "two of two angles": ([*FOUR[:3], "--angles", "0,45"], "at least 3"),
    "equal angles": ([*FOUR, "--angles", "0,45,90,180"], "equal"),
    "number of angles": ([*FOUR, "--angles", "0,60,120"], "one angle each"),
    "angles of three": (["three_000.png", "three_060.png", "three_120.png"], "one angle each"),
    "angles that names tell": (["three_060.png", "three_000.png", "three_120.png"], "--angles 60,0,120"),
    "a model of a pane that is given": (
        [*FOUR, "--incidence=60", "--azimuth=20", "--shift=4", "--panes=1", "--tint=1", "--model=none"],
        "leave one of them out",
    ),
    "a lens without a place": ([*FOUR, "--model", "ghosts", "--focal-px", "100"], "leave one of them out"),
    "no angles": ([*FOUR, "--angles", "0,x,90,135"], "--angles"),
    "NaN": (["nan.tiff"], "NaN"),
    "negative": (["negative.tiff"], "black level"),
    "all black": (["black.tiff"], "black"),
    "all black mosaic": (["black.png"], "black"),
    "constant": (["grey.tiff"], "constant"),
    "all saturated": (["white.tiff"], "saturated"),
    "too small": (["tiny.png"], "16"),
    "incidence 90": ([*FOUR, "--incidence", "90"], "[0, 90)"),
    "incidence negative": ([*FOUR, "--incidence", "-1"], "[0, 90)"),
    "incidence nan": ([*FOUR, "--incidence", "nan"], "[0, 90)"),
    "incidence text": ([*FOUR, "--incidence", "steep"], "--incidence"),
    "index": ([*FOUR, "--index", "0.9"], "1 or more"),
    "no index": ([*FOUR, "--index", "glass"], "or free"),
    "free index of water": ([*FOUR, "--index", "free", "--single-surface"], "one clear, flat pane"),
    "azimuth": ([*FOUR, "--azimuth", "inf"], "finite"),
    "shift and thickness": ([*FOUR, "--shift", "3", "--thickness-px", "5"], "one of them"),
    "thickness and focal length": (
        [*FOUR, "--thickness-px", "5", "--focal-px", "300"],
        "--thickness-px and --focal-px",
    ),
    "thickness": ([*FOUR, "--thickness-px", "-1"], "--thickness-px"),
    "thickness kind": ([*FOUR, "--thickness-kind", "glass"], "'paper', 'plate'"),
    "single surface and transmission shift": (
        [*FOUR, "--single-surface", "--transmission-shift", "3"],
        "back face",
    ),
    "single surface and shift": ([*FOUR, "--single-surface", "--shift", "3"], "back face"),
    "sensor": (["glass_000.png", "--sensor", "sepia"], "auto, mono, color"),
    "cell order": (["glass_000.png", "--cell-order", "0,1"], "cell order"),
    "white level": ([*FOUR, "--black-level", "9", "--white-level", "5"], "white level"),
    "gamma": ([*FOUR, "--gamma", "kodak"], "gamma"),
    "solver": ([*FOUR, "--solver", "magic"], "scipy"),
    "init": ([*FOUR, "--init", "magic"], "closed-form"),
    "weights term": ([*FOUR, "--weights", "beauty=1"], "edge_independence"),
    "weights number": ([*FOUR, "--weights", "misfit=much"], "misfit"),
    "weights negative": ([*FOUR, "--weights", "misfit=-1"], "misfit"),
    "evaluations": ([*FOUR, "--max-evaluations", "0"], "--max-evaluations"),
    "tolerance": ([*FOUR, "--tolerance", "-1"], "--tolerance"),
    "no capture": ([], "CAPTURE"),
    "unknown option": ([*FOUR, "--frobnicate"], "--frobnicate"),
}


def refused(arguments: list[str], capsys: pytest.CaptureFixture[str]) -> str:
    """The one line that a refused command says."""
    started = time.perf_counter()
    assert main(arguments) == 2
    assert time.perf_counter() - started < 3
    said = capsys.readouterr()
    assert said.out == ""
    assert said.err.startswith("polaropt: ")
    assert said.err.count("\n") == 1
    assert said.err.endswith("\n")
    assert "Traceback" not in said.err
    assert "Usage" not in said.err
    assert not set("│╭╰─") & set(said.err)
    return said.err


@pytest.mark.parametrize("case", BAD)
def test_separate_refuses(case: str, shelf: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    arguments, expected = BAD[case]
    out = tmp_path / "out"
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(shelf)
        line = refused(["separate", *arguments, "-o", str(out)], capsys)
    assert expected in line
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("command", ["inspect", "estimate"])
@pytest.mark.parametrize("case", ["missing file", "truncated", "NaN", "gamma", "unknown option"])
def test_inspect_and_estimate_refuse(
    command: str, case: str, shelf: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    arguments, expected = BAD[case]
    monkeypatch.chdir(shelf)
    assert expected in refused([command, *arguments, "--json"], capsys)


@pytest.mark.parametrize("output", ["file", "file/deeper"])
def test_an_output_folder_that_cannot_be(
    output: str, shelf: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(shelf)
    assert "no folder" in refused(["separate", *FOUR, "-o", output], capsys)
    assert "no folder" in refused(["simulate", *FOUR[:2], "-o", output], capsys)
    assert "no folder" in refused(["demo", "-o", output], capsys)
    assert (shelf / "file").read_text() == "in the way"


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write anywhere")
def test_an_unwritable_output_folder(shelf: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    tmp_path.chmod(0o500)
    files = [str(shelf / name) for name in FOUR]
    assert "cannot be written" in refused(["separate", *files, "-o", str(tmp_path)], capsys)
    tmp_path.chmod(0o700)


def test_an_output_folder_is_asked_for(shelf: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert "--output" in refused(["separate", str(shelf / "glass_000.png")], capsys)


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        ([], "command"),
        (["frobnicate"], "frobnicate"),
        (["--frobnicate"], "--frobnicate"),
        (["inspect", *FOUR, "--angles"], "--angles"),
        (["inspect", "glass_000.png", "-o", "look.bmp"], ".png"),
        (["simulate", "glass_000.png", "-o", "out"], "two"),
        (["simulate", "glass_000.png", "nofile.png", "-o", "out"], "nofile.png"),
        (["simulate", "glass_000.png", "nan.tiff", "-o", "out"], "several"),
        (["simulate", "tiny.png", "tiny.png", "-o", "out"], "16"),
        (["simulate", *FOUR[:2], "--noise", "-1", "-o", "out"], "noise"),
        (["simulate", *FOUR[:2], "--bits", "99", "-o", "out"], "bits"),
        (["simulate", *FOUR[:2], "--seed", "-1", "-o", "out"], "--seed"),
        (["simulate", *FOUR[:2], "--format", "gif", "-o", "out"], "--format"),
        (["simulate", *FOUR[:2], "--photos", ".", "-o", "out"], "--pairs"),
        (["simulate", *FOUR[:2], "--pairs", "2", "-o", "out"], "--pairs"),
        (["simulate", "--pairs", "0", "-o", "out"], "1 or more"),
        (["simulate", "--pairs", "1", "--size", "4", "-o", "out"], "16"),
        (["simulate", "--pairs", "1", "--photos", "nofolder", "-o", "out"], "nofolder"),
        (["simulate", "--pairs", "1", "--incidence", "95", "-o", "out"], "[0, 90)"),
    ],
    ids=" ".join,
)
def test_other_commands_refuse(
    arguments: list[str],
    expected: str,
    shelf: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(shelf)
    assert expected in refused(arguments, capsys)
    assert not (shelf / "out").exists()


def test_an_error_as_a_program_is_a_line(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "polaropt", "separate", "nofile.png", "-o", str(tmp_path / "out")]
    ran = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert (ran.returncode, ran.stdout) == (2, "")
    assert ran.stderr == "polaropt: nofile.png: no such file; check the name\n"


def test_an_error_in_what_was_typed_waits_for_no_heavy_package() -> None:
    code = (
        "import sys; from polaropt.cli.app import main; assert main(['separate', 'nofile.png', '-o', 'out']) == 2; "
        "print(*(name for name in ('matplotlib', 'numba', 'scipy', 'skimage', 'torch') if name in sys.modules))"
    )
    ran = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True)
    assert ran.stdout.split() == []


def test_what_nobody_expected_is_a_traceback(shelf: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def broken(*_: object, **__: object) -> None:
        raise ZeroDivisionError

    monkeypatch.setattr("polaropt.reporting.inspect_capture", broken)
    with pytest.raises(ZeroDivisionError):
        main(["inspect", str(shelf / "glass_000.png")])


# More than any file system takes: whether it is a folder cannot even be asked.
TOO_LONG = "x" * 3000
NAMED = {
    "scene": ["estimate", *FOUR, "--scene", TOO_LONG],
    "sequence": ["sequence", TOO_LONG, "-o", "out"],
    "batch": ["batch", TOO_LONG, "-o", "out"],
    "pattern": ["batch", f"*{TOO_LONG}", "-o", "out"],
    "scheduler": ["batch", "glass_000.png", "-o", "out", "--scheduler-file", TOO_LONG],
    "photographs": ["train", "-o", "out", "--steps", "1", "--data", TOO_LONG],
}


@pytest.mark.parametrize("name", NAMED)
def test_a_name_longer_than_names_can_be_is_refused(name, shelf, monkeypatch, capsys):
    monkeypatch.chdir(shelf)
    there = set(shelf.iterdir())
    assert main(NAMED[name]) == 2
    said = capsys.readouterr()
    assert (said.out, said.err.count("\n")) == ("", 1)
    assert set(shelf.iterdir()) == there
