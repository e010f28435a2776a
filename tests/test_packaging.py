"""What is shipped: one version, extras that exist, classifiers that were tested, no results of studies."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path

import polaropt
from studies.catalogue import PACKAGES

ROOT = Path(__file__).parent.parent
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())
EXTRAS = PROJECT["project"]["optional-dependencies"]
IMPORTED_AS = {"opencv-python-headless": "cv2", "markdown-it-py": "markdown_it", "scikit-learn": "sklearn"}


def test_the_version_stands_once() -> None:
    assert "version" in PROJECT["project"]["dynamic"]
    assert PROJECT["tool"]["hatch"]["version"]["path"] == "polaropt/__init__.py"
    assert re.search(r'^__version__ = "(.*)"$', (ROOT / "polaropt" / "__init__.py").read_text(), re.M)
    assert re.fullmatch(r"\d+\.\d+\.\d+", polaropt.__version__)


def test_results_of_studies_are_not_shipped() -> None:
    assert "studies/results" in PROJECT["tool"]["hatch"]["build"]["targets"]["wheel"]["exclude"]


def test_extras_that_are_named_exist() -> None:
    texts = [path.read_text() for path in (*ROOT.glob("*.md"), *(ROOT / "polaropt").rglob("*.py"), ROOT / "Makefile")]
    named = {
        extra
        for text in texts
        for group in re.findall(r"(?:polaropt|\.)\[([a-z,]+)\]", text)
        for extra in group.split(",")
    }
    assert named
    assert named <= EXTRAS.keys()


def test_what_a_study_looks_for_is_what_its_extra_brings() -> None:
    for extra, packages in PACKAGES.items():
        brought = [re.split(r"[><=]", requirement)[0] for requirement in EXTRAS[extra]]
        assert sorted(IMPORTED_AS.get(name, name) for name in brought) == sorted(packages)


def test_what_extras_bring_a_plain_separation_does_not_need() -> None:
    needed = {re.split(r"[><=]", requirement)[0] for requirement in PROJECT["project"]["dependencies"]}
    optional = {re.split(r"[><=]", requirement)[0] for requirements in EXTRAS.values() for requirement in requirements}
    assert not needed & optional
