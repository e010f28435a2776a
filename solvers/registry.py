"""Solvers by name; a backend is imported only when it is asked for."""

from __future__ import annotations

from importlib import import_module

from solvers.base import Solver

_BACKENDS = {
    "lbfgs": ("solvers.lbfgs", "LBFGS"),
    "scipy": ("solvers.scipy_lbfgs", "ScipyLBFGSB"),
}


def solver_names() -> tuple[str, ...]:
    """Names that `get_solver` knows."""
    return tuple(sorted(_BACKENDS))


def get_solver(name: str) -> Solver:
    """The solver called `name`, with its default options.

    Raises
    ------
    ValueError
        No solver has this name; the message lists those that exist.
    """
    if name not in _BACKENDS:
        raise ValueError(f"unknown solver {name!r}; there are: {', '.join(solver_names())}")
    module, cls = _BACKENDS[name]
    solver: Solver = getattr(import_module(module), cls)()
    return solver
