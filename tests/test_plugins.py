"""CONTRIBUTING.md's package that plugs in is installed, and does what it says; one that is broken does no harm."""

from __future__ import annotations

import os
import re
import subprocess
import sys
import tomllib
import zipfile
from pathlib import Path

import pytest

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
assert "'broken' of the package polaropt-example cannot be used" in str(warning.message)
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
