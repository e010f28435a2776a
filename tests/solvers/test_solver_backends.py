"""What is particular to a solver: what it needs, what it refuses, what kinds of arrays it takes."""

from __future__ import annotations

import math
import re
import subprocess
import sys
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import solvers.registry
from polaropt import InputError, StoppingRule
from polaropt.solving import check_device, check_start
from solvers import nlopt_lbfgs
from solvers.base import (
    MissingPackage,
    NotFinite,
    SolverResult,
    Status,
    StopSolving,
    TooLarge,
    Traced,
    distance,
    euclidean,
    largest,
)
from solvers.casadi import ipopt
from solvers.registry import get_solver, ready_solver, solver_names
from tests.solvers.test_solvers import TO_THE_END, quadratic, rosenbrock

ROOT = Path(__file__).parents[2]
LIMITS = {"nlopt": nlopt_lbfgs.MOST_UNKNOWNS, "casadi": ipopt.MOST_UNKNOWNS}


@pytest.mark.parametrize("name", LIMITS)
def test_too_many_unknowns_are_refused_before_anything_runs(name):
    def never(x):
        raise AssertionError("evaluated")

    with pytest.raises(TooLarge, match=f"{LIMITS[name]};.*'lbfgs'") as caught:
        get_solver(name).minimize(never, np.broadcast_to(np.float32(0), LIMITS[name] + 1), StoppingRule())
    assert isinstance(caught.value, ValueError)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("name", "wanted"),
    [("casadi", "'polaropt[casadi]'"), ("torch", "'polaropt[torch]'"), ("lbfgs", "numba"), ("nlopt", "nlopt")],
)
def test_a_missing_package_is_named_with_the_way_to_install_it(monkeypatch, name, wanted):
    monkeypatch.setattr(solvers.registry, "find_spec", lambda package: None)
    with pytest.raises(MissingPackage) as caught:
        get_solver(name)
    assert str(caught.value).endswith(f"pip install {wanted}")
    assert "\n" not in str(caught.value)


def broken(folder: Path, package: str, raises: str) -> None:
    """Put a package that is there and cannot be imported into a folder."""
    (folder / package).mkdir()
    (folder / package / "__init__.py").write_text(raises)


@pytest.mark.parametrize("name", ["casadi", "torch"])
@pytest.mark.parametrize(
    ("raises", "reason"),
    [
        ("raise ImportError('libx.so.1: cannot open shared object file')", "libx.so.1: cannot open shared object file"),
        ("raise OSError('libx.so.1:\\nundefined symbol')", "libx.so.1: undefined symbol"),
        ("import nowhere", "No module named 'nowhere'"),
        ("raise AttributeError", "AttributeError"),
    ],
)
def test_a_package_that_is_broken_is_told_from_one_that_is_missing(monkeypatch, tmp_path, name, raises, reason):
    broken(tmp_path, name, raises)
    monkeypatch.syspath_prepend(tmp_path)
    for module in [module for module in sys.modules if module.partition(".")[0] == name]:
        monkeypatch.delitem(sys.modules, module)
    with pytest.raises(MissingPackage) as caught:
        ready_solver(name)
    assert str(caught.value) == (
        f"solver '{name}' needs the package {name}, which is installed and broken ({reason}): "
        f"pip install --force-reinstall {name}"
    )
    if name == "torch":
        with pytest.raises(InputError, match=f"device 'cpu' needs .* broken .{re.escape(reason)}"):
            check_device("cpu")
        with pytest.raises(InputError, match=f"the start 'learned' needs .* broken .{re.escape(reason)}"):
            check_start("learned")


@pytest.mark.parametrize("name", ["lbfgs", "casadi", "nlopt", "scipy", "torch"])
def test_getting_a_solver_imports_no_package(name):
    code = (
        "import sys; from solvers.registry import get_solver; "
        f"get_solver({name!r}); print(*(m for m in ('casadi', 'nlopt', 'numba', 'scipy', 'torch') if m in sys.modules))"
    )
    ran = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True)
    assert ran.stdout.split() == []


def test_casadi_says_nothing(capfd):
    rosen = np.tile([-1.2, 1.0], 4).astype(np.float32)
    for rule in (StoppingRule(3), StoppingRule(40, 1e-3), TO_THE_END):
        get_solver("casadi").minimize(rosenbrock, rosen, rule)
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize("name", solver_names())
def test_an_error_of_the_objective_reaches_the_caller(name):
    calls = 0

    def fails(x):
        nonlocal calls
        calls += 1
        if calls == 5:
            raise ZeroDivisionError("mine")
        return rosenbrock(x)

    with pytest.raises(ZeroDivisionError, match="mine"):
        get_solver(name).minimize(fails, np.tile([-1.2, 1.0], 4).astype(np.float32), TO_THE_END)
    assert calls == 5


@pytest.mark.parametrize("name", solver_names())
def test_a_gradient_of_another_length_is_an_error(name):
    with pytest.raises(ValueError, match=r"gradient of shape \(2,\) at a point of shape \(3,\)"):
        get_solver(name).minimize(lambda x: (1.0, np.ones(2, np.float32)), np.zeros(3, np.float32), StoppingRule())


def tensors(gradient_of=quadratic):
    """An objective of numpy as one of tensors; notes what it is called with."""
    torch = pytest.importorskip("torch", reason="torch is not installed")
    kinds = set()

    def objective(x: Any) -> tuple[Any, Any]:
        kinds.add((type(x), x.dtype, x.device.type))
        value, gradient = gradient_of(x.numpy())
        return torch.tensor(value, dtype=torch.float64), torch.from_numpy(gradient)

    return torch, objective, kinds


@pytest.mark.parametrize("dtype", ["float32", "float64", "int64"])
def test_torch_calls_with_tensors_where_the_start_is_one(dtype):
    torch, objective, kinds = tensors()
    start = torch.full((30,), 4, dtype=getattr(torch, dtype))
    result = get_solver("torch").minimize(objective, start, TO_THE_END)
    assert kinds == {(torch.Tensor, torch.float32, "cpu")}
    assert isinstance(result.x, np.ndarray)
    assert result.x.dtype == np.float32
    assert result.value == pytest.approx(1, abs=1e-6)
    assert (start == 4).all()
    arrays = get_solver("torch").minimize(quadratic, np.full(30, 4, np.float32), TO_THE_END)
    np.testing.assert_array_equal(result.x, arrays.x)


def test_torch_with_tensors_stops_at_what_is_not_finite_or_small():
    torch, objective, _ = tensors(lambda x: (math.nan, x))
    result = get_solver("torch").minimize(objective, torch.ones(4), TO_THE_END)
    assert (result.status, result.x.tolist()) == (Status.NOT_FINITE, [1.0] * 4)
    _, objective, _ = tensors()
    result = get_solver("torch").minimize(objective, torch.ones(9), StoppingRule(100, 0.0, gradient_norm=1e-3))
    assert result.status is Status.SMALL_GRADIENT


@pytest.mark.parametrize("n", [0, 1, 100, 8192, 20_001])
@pytest.mark.parametrize("scale", [1e-30, 1e-18, 1.0, 1e15, 1e30])
def test_norms_agree_with_float64(n, scale):
    random = np.random.default_rng(n)
    a, b = (scale * random.standard_normal((2, n))).astype(np.float32)
    wide_a, wide_b = a.astype(np.float64), b.astype(np.float64)
    assert euclidean(a) == pytest.approx(np.linalg.norm(wide_a), rel=1e-6)
    assert distance(a, b) == pytest.approx(np.linalg.norm(wide_a - wide_b), rel=1e-12)
    assert largest(a) == np.abs(a).max(initial=0)


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
def test_norms_of_what_is_not_finite_are_not_finite(bad):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for n in (5, 20_000):
            gradient = np.ones(n, np.float32)
            gradient[n // 2] = bad
            assert not math.isfinite(euclidean(gradient))


def test_the_best_point_is_kept_without_a_copy():
    traced = Traced(quadratic, StoppingRule())
    points = [np.full(5, value, np.float32) for value in (3, 1, 2)]
    for point in points:
        traced(point)
    assert traced.best is points[1]


def test_a_tiny_gradient_is_not_zero():
    traced = Traced(lambda x: (1.0, np.full(5, 1e-30, np.float32)), StoppingRule())
    traced(np.zeros(5, np.float32))
    with pytest.raises(StopSolving):
        Traced(lambda x: (1.0, 0 * x), StoppingRule())(np.zeros(5, np.float32))
    with pytest.raises(NotFinite):
        Traced(lambda x: (math.nan, x), StoppingRule())(np.zeros(5, np.float32))


def test_the_sentence_tells_of_restarts():
    plain = SolverResult(np.zeros(0, np.float32), 0.0, 1, 1, Status.CONVERGED, 0.0)
    once, twice = (SolverResult(plain.x, 0.0, 1, 1, Status.CONVERGED, 0.0, restarts=n) for n in (1, 2))
    assert plain.sentence == Status.CONVERGED.value
    assert once.sentence.startswith(Status.CONVERGED.value)
    assert "once" in once.sentence
    assert "2 times" in twice.sentence
    assert twice.sentence.endswith(".")


def test_an_unknown_solver_lists_those_there_are() -> None:
    with pytest.raises(ValueError, match="nonsense") as caught:
        get_solver("nonsense")
    assert all(name in str(caught.value) for name in solver_names())
    assert set(solver_names()) >= {"casadi", "lbfgs", "nlopt", "scipy", "torch"}


def test_every_status_is_a_sentence() -> None:
    assert all(status.value[0].isupper() and status.value.endswith(".") for status in Status)


@pytest.mark.parametrize(
    "options",
    [
        {"max_evaluations": 0},
        {"relative_change": -1e-9},
        {"relative_change": math.nan},
        {"gradient_norm": -1.0},
        {"seconds": 0.0},
        {"seconds": math.nan},
    ],
)
def test_a_stopping_rule_that_cannot_be_is_refused(options: dict[str, Any]) -> None:
    with pytest.raises(ValueError, match=next(iter(options))):
        StoppingRule(**options)
