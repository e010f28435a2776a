"""README and the documentation tell the truth: their commands run, and every warning has its entry."""

from __future__ import annotations

import argparse
import re
import shlex
import shutil
import subprocess
from collections.abc import Iterator
from importlib import import_module
from pathlib import Path
from typing import Any, get_type_hints

import numpy as np
import pytest
import tifffile
from skimage import data

import polaropt
from polaropt import SeparationWarning
from polaropt.capture.files.decode import read_file
from polaropt.capture.files.write import write_png
from polaropt.cli.app import main
from tests.capture.test_camera_raw import write_dng
from tests.captured import scene_intensities
from tests.command_line import QUICK
from tests.documentation import DOCS, PAGES, ROOT, WARNINGS, Command, blocks, commands

COMMANDS = commands()
STUDY = "polaropt study "
PHOTOGRAPHS = ["glass_000.png", "glass_045.png", "glass_090.png", "glass_135.png"]
SIDE = 64
# The pane, told where a command leaves it open: how it is found is tested elsewhere.
PANE = ["--incidence", "65", "--azimuth", "0", "--shift", "4", "--panes", "1"]
# What is told beside options of the pane.
OF_PANES = {
    "relative": ["--incidence", "65", "--shift", "4", "--panes", "1"],
    "free": PANE,
    "--single-surface": PANE[:4],
    "--index": PANE[2:],
    "--panes": PANE[:6],
    "--shared-scene": PANE[2:],
    **{word: [] for word in ("--scene", "--incidence", "--model")},
}
# A real sensor's size, for which files of this test are too small.
SENSOR_SHAPE = ("2048,2448", f"{SIDE},{SIDE}")


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the files that the commands name."""
    folder = tmp_path_factory.mktemp("documentation")
    write_png(folder / "T.png", data.coffee()[150 : 150 + SIDE, 200 : 200 + SIDE])
    write_png(folder / "R.png", data.astronaut()[30 : 30 + SIDE, 160 : 160 + SIDE])
    simulate = ["simulate", str(folder / "T.png"), str(folder / "R.png"), "--incidence", "65", "--shift", "4"]
    assert main([*simulate, "-o", str(folder / "four")]) == 0
    assert main([*simulate, "--sensor", "mono", "--lens-blur", "0.7", "-o", str(folder / "one")]) == 0
    for name in PHOTOGRAPHS:
        (folder / "four" / name.replace("glass", "capture")).rename(folder / name)
    (folder / "one" / "mosaic.png").rename(folder / "raw.png")
    _write_packed(folder / "raw.raw")
    random = np.random.default_rng(0)
    for k in range(2):
        field = np.round(30000 + 300 * random.standard_normal((SIDE, SIDE)))
        write_png(folder / f"flat_{k}.png", field.astype(np.uint16))
    for name, light in zip(PHOTOGRAPHS, scene_intensities((40, 48)), strict=True):
        write_dng((folder / name).with_suffix(".dng"), light[..., None] * np.array([0.5, 0.9, 0.6]))
    _write_many(folder)
    assert main(["calibrate", *map(str, sorted(folder.glob("flat_*.png"))), "-o", str(folder / "analyzer.json")]) == 0
    return folder


def _write_many(folder: Path) -> None:
    """Captures for `polaropt batch`, frames for `polaropt sequence`."""
    for name in PHOTOGRAPHS:
        for copy in (folder / "shots" / name, folder / "input" / "scene" / name):
            copy.parent.mkdir(parents=True, exist_ok=True)
            shutil.copy(folder / name, copy)
    (folder / "captures.csv").write_text(f"name,files,incidence\nglass,{';'.join(PHOTOGRAPHS)},65\n")
    frame = read_file(folder / "raw.png").pixels
    tifffile.imwrite(folder / "film.tiff", np.stack([frame] * 2), photometric="minisblack")
    (folder / "film.raw").write_bytes(2 * (folder / "raw.raw").read_bytes())


def _write_packed(path: Path) -> None:
    """A mono mosaic without a header, Mono12p: two values in three bytes, the lowest bits first."""
    grey = data.camera()[:SIDE, :SIDE].astype(np.uint16) * 8
    first, second = grey.reshape(-1, 2).T
    packed = np.stack([first & 255, (first >> 8) | ((second & 15) << 4), second >> 4], axis=1)
    path.write_bytes(packed.astype(np.uint8).tobytes())


@pytest.mark.parametrize("command", COMMANDS, ids=lambda command: command.line)
def test_a_command_that_is_shown_runs(
    command: Command, files: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(files)
    program, *arguments = shlex.split(command.line)
    if program == "make":
        subprocess.run(["make", "--dry-run", *arguments], cwd=ROOT, check=True, capture_output=True)
        return
    arguments = [SENSOR_SHAPE[1] if word == SENSOR_SHAPE[0] else word for word in arguments]
    arguments = [
        name for word in arguments for name in (sorted(map(str, Path().glob(word))) if "*" in word else [word])
    ]
    if "-o" not in arguments and "inspect" not in arguments:
        # A sentence names the command alone.
        arguments.append("--help")
    if command.line.startswith(STUDY):
        # DIR stands for a folder of one's own.
        _parse_study(arguments[1], ["." if word == "DIR" else word for word in arguments[2:]], monkeypatch)
        return
    if any(word.endswith(".dng") for word in arguments):
        pytest.importorskip("rawpy", reason="rawpy is not installed")
    if "learned" in arguments:
        pytest.importorskip("torch", reason="torch is not installed")
    quick = {"separate": QUICK, "batch": [*QUICK, "--workers", "1"], "sequence": QUICK}
    told = next((OF_PANES[word] for word in OF_PANES if word in arguments), PANE) if arguments[0] in quick else []
    code = main([*arguments, *told, *quick.get(arguments[0], [])])
    assert code == 0, capsys.readouterr().err


class _Parsed(Exception):
    """The options are such as the study knows; it would begin now."""


def _parse_study(name: str, arguments: list[str], monkeypatch: pytest.MonkeyPatch) -> None:
    """A study takes minutes to hours: its options are read, and nothing is run."""
    pytest.importorskip("pandas", reason="the extra studies is not installed")
    parse = argparse.ArgumentParser.parse_args

    def parsed(self: argparse.ArgumentParser, *given: Any) -> None:
        parse(self, *given)
        raise _Parsed

    monkeypatch.setattr(argparse.ArgumentParser, "parse_args", parsed)
    module = import_module(f"studies.{name}")
    study = import_module(f"studies.{name}.study") if hasattr(module, "__path__") else module
    with pytest.raises((_Parsed, SystemExit)) as stopped:
        study.main(arguments)
    assert stopped.type is _Parsed or stopped.value.code == 0


@pytest.mark.parametrize("page", [page for page in PAGES if blocks(page, "python")], ids=lambda page: page.stem)
def test_python_that_is_shown_runs(page: Path, files: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(files)
    for block in blocks(page, "python"):
        exec(compile(block, page.name, "exec"), {})


def entries() -> Iterator[tuple[str, str]]:
    """Name and text of each entry of the page of warnings."""
    text = WARNINGS.read_text(encoding="utf-8")
    yield from re.findall(r"^### ([A-Z_]+)\n(.*?)(?=^#|^<a|\Z)", text, re.MULTILINE | re.DOTALL)


def test_every_warning_has_an_entry_under_its_name() -> None:
    assert sorted(name for name, _ in entries()) == sorted(SeparationWarning.__members__)
    page = WARNINGS.read_text(encoding="utf-8")
    for name, text in entries():
        assert f'<a id="{name}"></a>\n\n({name})=\n### {name}\n' in page
        # The sentence itself is put in when the page is built.
        assert f"{{{{ {name} }}}}" in text
        assert "*Do:*" in text


def test_the_page_of_the_api_has_every_public_name() -> None:
    listed = re.findall(r"^   ([A-Za-z_]+)$", (DOCS / "api" / "index.md").read_text(encoding="utf-8"), re.MULTILINE)
    assert sorted(listed) == sorted(polaropt.__all__)


@pytest.mark.parametrize("function", [polaropt.separate, polaropt.inspect, polaropt.estimate])
def test_the_attributes_of_what_is_returned_are_on_the_site(function: Any) -> None:
    kind = get_type_hints(function, vars(import_module("polaropt.api")))["return"]
    page = (DOCS / "api" / "results.md").read_text(encoding="utf-8")
    # A result of `separate` adds to those of its base what shows it.
    named = next(base for base in reversed(kind.__mro__) if base is not object)
    assert re.search(rf"^\.\. autoclass:: polaropt\.\w+\.{named.__name__}$", page, re.MULTILINE)


# What README quotes and another page does, too: each as a pattern of the numbers in both.
TOLD_TWICE = {
    WARNINGS: r"(\d+) % c[oa]me within 3 dB of the solve with the scene known,\s+(?:and )?(\d+) of the other (\d+)",
    DOCS / "capabilities" / "glass_and_water.md": (
        r"told as 1\.5, (?:came to|60 deg \| [\d.]+ \|) ([\d.]+)[^|\d]*\|? ?([\d.]+)"
    ),
    DOCS / "capabilities" / "speed.md": r"takes ([\d.]+) s on two cores, ([\d.]+) s of them .*?it takes ([\d.]+) s",
}


@pytest.mark.parametrize("page", TOLD_TWICE, ids=lambda page: page.stem)
def test_numbers_that_are_told_twice_agree(page: Path) -> None:
    # Wherever their lines break.
    texts = [" ".join(path.read_text(encoding="utf-8").split()) for path in (ROOT / "README.md", page)]
    told = [re.search(TOLD_TWICE[page], text, re.DOTALL) for text in texts]
    in_readme, in_page = (tuple(map(float, found.groups())) if found else () for found in told)
    assert in_page
    assert in_page == tuple(round(number, 1) for number in in_readme)


def test_a_page_is_in_a_table_of_contents() -> None:
    named = {
        (page.parent / line.strip().rpartition("<")[2].rstrip(">")).with_suffix(".md").resolve()
        for page in DOCS.rglob("*.md")
        for block in re.findall(
            r"^```\{toctree\}\n(.*?)^```", page.read_text(encoding="utf-8"), re.MULTILINE | re.DOTALL
        )
        for line in block.splitlines()
    }
    assert {page.resolve() for page in DOCS.rglob("*.md")} - named == {DOCS / "index.md"}
