"""Solvers by name; a backend is imported only when it is asked for."""

from __future__ import annotations

from importlib import import_module
from importlib.metadata import EntryPoint
from importlib.util import find_spec

from solvers.base import MissingPackage, Solver, check_package
from solvers.entry_points import SOLVERS, loaded, plugged

# Module, class, the package it needs and the extra that brings it ("": a dependency of polaropt itself).
BACKENDS = {
    "casadi": ("solvers.casadi.ipopt", "CasadiIPOPT", "casadi", "casadi"),
    "lbfgs": ("solvers.lbfgs", "LBFGS", "numba", ""),
    "nlopt": ("solvers.nlopt_lbfgs", "NLoptLBFGS", "nlopt", ""),
    "scipy": ("solvers.scipy_lbfgs", "ScipyLBFGSB", "scipy", ""),
    "torch": ("solvers.torch_lbfgs", "TorchLBFGS", "torch", "torch"),
}


def solver_names() -> tuple[str, ...]:
    """Names that `get_solver` knows, installed or not; those that other packages plug in among them."""
    return tuple(sorted({*BACKENDS, *_others()}))


def get_solver(name: str) -> Solver:
    """The solver called `name`.

    Raises
    ------
    ValueError
        No solver has this name; the message lists those that exist.
    MissingPackage
        The package that it needs is not installed; the message says how to install it.
    """
    if name in _others():
        plugin = loaded(SOLVERS, name)
        if plugin is None:
            raise MissingPackage(f"solver {name!r} is of another package and cannot be imported; mend or remove it")
        own: Solver = plugin()
        return own
    if name not in BACKENDS:
        raise ValueError(f"unknown solver {name!r}; there are: {', '.join(solver_names())}")
    module, cls, package, extra = BACKENDS[name]
    if find_spec(package) is None:
        wanted = f"'polaropt[{extra}]'" if extra else package
        raise MissingPackage(f"solver {name!r} needs the package {package}: pip install {wanted}", name=package)
    solver: Solver = getattr(import_module(module), cls)()
    return solver


def ready_solver(name: str) -> Solver:
    """The solver called `name`, whose package is imported where an extra brings it: now, not in the middle of a solve.

    Raises
    ------
    ValueError
        As `get_solver`.
    MissingPackage
        The package that it needs is not installed, or broken.
    """
    solver = get_solver(name)
    if name in BACKENDS and BACKENDS[name][3]:
        check_package(BACKENDS[name][2], f"solver {name!r}", f"'polaropt[{BACKENDS[name][3]}]'")
    return solver


def _others() -> dict[str, EntryPoint]:
    """Solvers that other packages plug in."""
    return plugged(SOLVERS, tuple(BACKENDS))
