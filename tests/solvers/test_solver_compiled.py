"""Compiled kernels: cached where possible, told of, true to NaN."""

from __future__ import annotations

import importlib.util
import os
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest

from solvers.kernels import compilations_reported_to, compiled
from tests.forks import Forks, forks

ROOT = Path(__file__).parents[2]
KERNEL = """
from solvers.kernels import compiled

@compiled
def doubled(x):
    return 2 * x
"""
RUN = """
import sys
sys.path.insert(0, {folder!r})
from solvers.kernels import compilations_reported_to
told = []
with compilations_reported_to(told.append):
    from kernel import doubled
    assert doubled(3) == 6
print(*told)
"""


@pytest.fixture(scope="module")
def process() -> Iterator[Forks]:
    with forks({key: value for key, value in os.environ.items() if not key.startswith("NUMBA_")}) as started:
        yield started


@pytest.fixture
def run(process: Forks) -> Callable[..., str]:
    """Names of the kernels that a new process compiles, and what else its program prints."""

    def forked(folder: Path, program: str = RUN) -> str:
        ran = process.run(program.format(folder=str(folder)))
        assert ran.code == 0, ran.err
        return ran.out.strip()

    return forked


def load(folder: Path, name: str):
    specification = importlib.util.spec_from_file_location(name, folder / "kernel.py")
    module = importlib.util.module_from_spec(specification)
    specification.loader.exec_module(module)
    return module


def test_the_second_process_loads_and_tells_nothing(tmp_path, run):
    (tmp_path / "kernel.py").write_text(KERNEL)
    assert run(tmp_path) == "doubled"
    assert run(tmp_path) == ""


BASE = """
from typing import NamedTuple
from solvers.kernels import compiled

FACTOR = 2

class Pair(NamedTuple):
    first: float
    second: float

@compiled
def scaled(x):
    return 1.0 * x
"""
MIDDLE = """
from solvers.kernels import compiled
from base import scaled

@compiled
def passed(x):
    return scaled(x)
"""
KERNEL_OF_OTHERS = """
from solvers.kernels import compiled
from base import FACTOR, Pair
from middle import passed

@compiled
def inner(pair):
    return pair.first + FACTOR * passed(pair.second)

@compiled
def outer(pair):
    return inner(pair)
"""
RUN_OF_OTHERS = """
import sys
sys.path.insert(0, {folder!r})
from solvers.kernels import compilations_reported_to
told = []
with compilations_reported_to(told.append):
    from kernel import Pair, outer
    print(outer(Pair(first=10.0, second=1.0)))
print(*told)
"""


def test_a_change_in_another_file_that_a_kernel_is_made_of_compiles_it_anew(tmp_path, run):
    for name, text in (("base.py", BASE), ("middle.py", MIDDLE), ("kernel.py", KERNEL_OF_OTHERS)):
        (tmp_path / name).write_text(text)
    assert run(tmp_path, RUN_OF_OTHERS).splitlines()[0] == "12.0"
    assert run(tmp_path, RUN_OF_OTHERS).splitlines() == ["12.0"]
    # One after the other: a process each.
    for file, old, new, value in [
        ("base.py", "1.0 * x", "5.0 * x", 20.0),
        ("base.py", "FACTOR = 2", "FACTOR = 3", 25.0),
        ("base.py", "first: float\n    second: float", "second: float\n    first: float", 25.0),
        ("middle.py", "scaled(x)", "-scaled(x)", -5.0),
    ]:
        (tmp_path / file).write_text((tmp_path / file).read_text().replace(old, new))
        told, compiled_anew = run(tmp_path, RUN_OF_OTHERS).splitlines()
        assert told == str(value)
        assert "outer" in compiled_anew
    assert run(tmp_path, RUN_OF_OTHERS).splitlines() == [str(value)]
    for name in ("base.py", "kernel.py"):
        (tmp_path / name).write_text((tmp_path / name).read_text().replace("Pair", "Couple"))
    assert run(tmp_path, RUN_OF_OTHERS.replace("Pair", "Couple")).splitlines()[0] == str(value)


def test_without_a_folder_for_the_cache_it_compiles_every_time(tmp_path, process):
    (tmp_path / "kernel.py").write_text(KERNEL)
    # A locator that serves nothing but IPython's cells: what numba finds where no folder can be written to.
    nowhere = {"NUMBA_CACHE_LOCATOR_CLASSES": "IPythonCacheLocator"}
    for _ in range(2):
        ran = process.run(RUN.format(folder=str(tmp_path)), nowhere)
        assert (ran.code, ran.out.strip()) == (0, "doubled"), ran.err
    assert not list(tmp_path.rglob("*.nbi"))


def test_only_compilations_within_the_context_are_told(tmp_path):
    (tmp_path / "kernel.py").write_text(KERNEL)
    doubled = load(tmp_path, "kernel_told").doubled
    told, before = [], []
    with compilations_reported_to(before.append):
        pass
    with compilations_reported_to(told.append):
        assert doubled(1) == 2
        assert doubled(2) == 4
    assert doubled(1.5) == 3.0
    assert (before, told) == ([], ["doubled"])


def test_other_errors_of_numba_pass_through(monkeypatch):
    import numba

    def refuses(**options):
        raise RuntimeError("something else")

    monkeypatch.setattr(numba, "njit", refuses)
    with pytest.raises(RuntimeError, match="something else"):
        compiled(lambda x: x)


def test_nan_infinity_and_division_by_zero_show():
    @compiled
    def shows(x, zero):
        return np.isfinite(x.sum()), np.isnan(x[0]), x[1] / zero

    for bad in (np.nan, np.inf):
        finite, nan, quotient = shows(np.array([bad, 1.0], np.float32), np.float32(0))
        assert (finite, nan, quotient) == (False, np.isnan(bad), np.inf)


def test_importing_this_does_not_import_numba():
    code = "import sys, solvers.kernels, solvers.kernels; print('numba' in sys.modules)"
    ran = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True)
    assert ran.stdout.strip() == "False"
