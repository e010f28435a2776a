"""CONTRIBUTING.md's package that plugs in is installed, and does what it says; one that is broken does no harm."""

from __future__ import annotations

import os
import re
import subprocess
import sys
import tomllib
import zipfile
from collections.abc import Callable, Iterator
from decimal import Decimal
from fractions import Fraction
from pathlib import Path

import pytest

from polaropt import InputError, Weights
from polaropt.solving import Settings, plugged_names
from solvers import entry_points
from solvers.entry_points import READERS, REGULARIZERS, SOLVERS, PluginWarning, loaded, plugged
from solvers.registry import BACKENDS, get_solver, solver_names

ROOT = Path(__file__).parent.parent
BLOCK = re.compile(r"^```(?:toml|python) example/(\S+)\n(.*?)^```$", re.MULTILINE | re.DOTALL)
USE = """
import warnings
import numpy as np
from polaropt import InputError, SceneParameters, StoppingRule, Weights, read_capture, separate, simulate
from skimage.data import astronaut, coffee
from solvers.entry_points import PluginWarning
from solvers.registry import solver_names

pane = SceneParameters(60.0, 20.0, 4.0)
capture = simulate(coffee()[150:214, 200:264], astronaut()[30:94, 160:224], pane, noise=0.01)
plain = separate(capture, pane)
assert "steepest" in solver_names()
assert separate(capture, pane, solver="steepest", stopping=StoppingRule(max_evaluations=5)).solver.n_evaluations > 1
small = separate(capture, pane, weights=Weights(plugged=(("small", 1.0),)))
assert small.terms["small"].weight == 1
assert np.square(small.reflection).sum() < np.square(plain.reflection).sum()

mosaic = np.random.default_rng(0).uniform(0.2, 0.8, (64, 64))
with open("frame.lines", "w") as file:
    print("mosaic", *mosaic.shape, *mosaic.ravel(), file=file)
assert read_capture("frame.lines", sensor="mono").shape == (64, 64)
with open("unknown.png", "w") as file:
    print("nothing that any reader knows", file=file)
with warnings.catch_warnings(record=True) as told:
    warnings.simplefilter("always")
    try:
        read_capture("unknown.png")
    except InputError:
        pass
(warning,) = (one for one in told if one.category is PluginWarning)
assert "'broken' of the package polaropt-example (polaropt.readers) cannot be used" in str(warning.message)
"""


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder into which the package is installed."""
    folder = tmp_path_factory.mktemp("plugin")
    files = dict(BLOCK.findall((ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")))
    install = [sys.executable, "-m", "pip", "install", "--quiet", "--no-deps", "--no-index"]
    subprocess.run([*install, "--target", str(folder / "site"), str(wheel(folder, files))], check=True)
    return folder / "site"


def wheel(folder: Path, files: dict[str, str]) -> Path:
    """What hatchling makes of the package; it would have to be fetched first."""
    project = tomllib.loads(files.pop("pyproject.toml"))["project"]
    name = f"{project['name'].replace('-', '_')}-{project['version']}"
    points = {group: "\n".join(f"{key} = {value}" for key, value in names.items())
              for group, names in project["entry-points"].items()}  # fmt: skip
    about = {
        "METADATA": f"Metadata-Version: 2.1\nName: {project['name']}\nVersion: {project['version']}\n",
        "WHEEL": "Wheel-Version: 1.0\nGenerator: test\nRoot-Is-Purelib: true\nTag: py3-none-any\n",
        "entry_points.txt": "\n".join(f"[{group}]\n{text}\n" for group, text in points.items()),
    }
    files |= {f"{name}.dist-info/{part}": text for part, text in about.items()}
    record = f"{name}.dist-info/RECORD"
    files[record] = "".join(f"{part},,\n" for part in (*files, record))
    path = folder / f"{name}-py3-none-any.whl"
    with zipfile.ZipFile(path, "w") as archive:
        for part, text in files.items():
            archive.writestr(part, text)
    return path


def test_a_package_plugs_in(site: Path, tmp_path: Path) -> None:
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join((str(ROOT), str(site)))}
    ran = subprocess.run([sys.executable, "-c", USE], env=environment, cwd=tmp_path, capture_output=True, text=True)
    assert ran.returncode == 0, ran.stderr
    command = [sys.executable, "-m", "polaropt", "inspect", "unknown.png"]
    told = subprocess.run(command, env=environment, cwd=tmp_path, capture_output=True, text=True)
    assert [line.startswith("polaropt: ") for line in told.stderr.splitlines()] == [True, True]
    command = [sys.executable, "-m", "polaropt", "separate", "a.png", "-o", "out", "--weights", "large=1"]
    refused = subprocess.run(command, env=environment, cwd=tmp_path, capture_output=True, text=True)
    assert refused.returncode == 2
    assert "natural_image, small" in refused.stderr


@pytest.fixture
def installed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[[str, str, str], None]]:
    """Lets a package plug in something: its name, the group and the entry point."""
    kept = (entry_points.plugged, entry_points._first, entry_points.loaded)
    monkeypatch.syspath_prepend(tmp_path)

    def install(package: str, group: str, point: str) -> None:
        about = tmp_path / f"{package}-1.0.dist-info"
        about.mkdir()
        (about / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {package}\nVersion: 1.0\n")
        (about / "entry_points.txt").write_text(f"[{group}]\n{point}\n")
        for cached in kept:
            cached.cache_clear()

    yield install
    for cached in kept:
        cached.cache_clear()


def test_a_name_of_polaropts_own_is_left_out_and_told(installed: Callable[[str, str, str], None]) -> None:
    installed("rival", SOLVERS, "lbfgs = fractions:Fraction")
    told = r"'lbfgs' of the package rival \(polaropt.solvers\) is left out: polaropt has one of this name"
    with pytest.warns(PluginWarning, match=told):
        assert not isinstance(get_solver("lbfgs"), Fraction)
    assert set(solver_names()) == set(BACKENDS)
    installed("penalist", REGULARIZERS, "misfit = fractions:Fraction")
    with pytest.warns(PluginWarning, match="'misfit' of the package penalist"):
        assert plugged_names() == ()


@pytest.mark.parametrize("group", [SOLVERS, READERS, REGULARIZERS])
def test_of_two_packages_with_one_name_the_second_is_told(
    installed: Callable[[str, str, str], None], group: str
) -> None:
    installed("early", group, "same = fractions:Fraction")
    installed("late", group, "same = decimal:Decimal")
    with pytest.warns(PluginWarning, match=r"'same' of the package .*'same' of the package .* has its name") as warned:
        assert set(plugged(group)) == {"same"}
    assert len(warned) == 1
    assert loaded(group, "same") in (Fraction, Decimal)


def test_a_plugged_term_is_named_once_and_known_before_anything_is_worked_out() -> None:
    with pytest.raises(InputError, match="the weight misfit is in `plugged` and has a factor already"):
        Weights(plugged=(("misfit", 1.0),))
    with pytest.raises(InputError, match="the weight small is in `plugged` and has a factor already"):
        Weights(plugged=(("small", 1.0), ("small", 2.0)))
    with pytest.raises(InputError, match="there is no term 'nowhere'"):
        Settings(weights=Weights(plugged=(("nowhere", 1.0),)))
