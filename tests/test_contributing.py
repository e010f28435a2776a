"""CONTRIBUTING.md's worked examples do what they say: each is one file and one line, in a copy of the repository."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import NamedTuple

import pytest

from tests.forks import Forks, forks

ROOT = Path(__file__).parent.parent
PACKAGES = ("polaropt", "solvers", "priors", "studies")
# The caches of compiled kernels come along: they count as long as the sources are the same.
NOT_NEEDED = shutil.ignore_patterns("figures", "results", "*.tmp")
HEADINGS = ("A rung of the scene's ladder", "A regularizer", "A solver", "A capture format", "A study")
SECTION = re.compile(r"^### (.+?)\n(.*?)(?=^##|\Z)", re.MULTILINE | re.DOTALL)
BLOCK = re.compile(r"^```(\w+) ?(\S*)\n(.*?)^```$", re.MULTILINE | re.DOTALL)


class Block(NamedTuple):
    """Code of a language; of a file, if it names one."""

    language: str
    path: str
    text: str


EXAMPLES = {
    heading: [Block(*block) for block in BLOCK.findall(text)]
    for heading, text in SECTION.findall((ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8"))
}


def with_lines(text: str, change: str) -> str:
    """A file's text with the lines that have a "+" put below the line before them, which is there once."""
    lines = text.splitlines()
    place = 0
    for line in change.splitlines():
        if line.startswith("+"):
            lines.insert(place, line[1:])
            place += 1
        else:
            assert lines.count(line[1:]) == 1, f"{line[1:]!r} stands there {lines.count(line[1:])} times"
            place = lines.index(line[1:]) + 1
    return "\n".join(lines) + "\n"


def test_the_examples_are_those_that_newcomers_need() -> None:
    assert tuple(EXAMPLES) == HEADINGS


@pytest.mark.parametrize("heading", HEADINGS)
def test_an_example_is_one_file_and_one_line(heading: str) -> None:
    files = [block for block in EXAMPLES[heading] if block.path and block.language == "python"]
    changes = [block for block in EXAMPLES[heading] if block.language == "diff"]
    assert (len(files), len(changes)) == (1, 1)
    assert not (ROOT / files[0].path).exists()
    lines = [line for line in changes[0].text.splitlines() if line.startswith("+")]
    assert len([line for line in lines if not line.startswith("+from ")]) == 1


@pytest.fixture(scope="module")
def house(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A copy of the repository, one for all examples: kernels are compiled once at most."""
    copy = tmp_path_factory.mktemp("house")
    for package in PACKAGES:
        shutil.copytree(ROOT / package, copy / package, ignore=NOT_NEEDED)
    shutil.copy(ROOT / "pyproject.toml", copy)
    return copy


@pytest.fixture(scope="module")
def started(house: Path) -> Iterator[Forks]:
    """Runs programs in the copy, each in a process that has loaded nothing of it, but what takes seconds elsewhere."""
    others = ("torch", "scipy.optimize", "scipy.ndimage", "skimage.data", "pandas")
    with forks({**os.environ, "PYTHONPATH": str(house)}, *others, folder=house) as process:
        yield process


@contextmanager
def added(example: list[Block], house: Path) -> Iterator[None]:
    """Write an example's files and lines, and take them away afterwards."""
    before = {block.path: (house / block.path).read_text("utf-8") for block in example if block.language == "diff"}
    try:
        for block in example:
            if block.path:
                text = with_lines(before[block.path], block.text) if block.language == "diff" else block.text
                (house / block.path).write_text(text, encoding="utf-8")
        yield
    finally:
        for block in example:
            if block.language == "diff":
                (house / block.path).write_text(before[block.path], encoding="utf-8")
            elif block.path:
                (house / block.path).unlink()


@pytest.mark.parametrize("heading", HEADINGS)
def test_an_example_works(heading: str, house: Path, started: Forks) -> None:
    example = EXAMPLES[heading]
    files = [block.path for block in example if block.path]
    scripts = [block.text for block in example if block.language == "python" and not block.path]
    assert scripts
    with added(example, house):
        run([sys.executable, "-m", "ruff", "check", "--quiet", *files], house)
        run([sys.executable, "-m", "ruff", "format", "--check", "--quiet", *files], house)
        for script in scripts:
            ran = started.run(script)
            assert ran.code == 0, ran.out + ran.err


def run(command: list[str], folder: Path) -> None:
    ran = subprocess.run(
        command, cwd=folder, env={**os.environ, "PYTHONPATH": str(folder)}, capture_output=True, text=True, check=False
    )
    assert ran.returncode == 0, ran.stdout + ran.stderr
