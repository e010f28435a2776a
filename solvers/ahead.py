"""Kernels compiled before they are needed, side by side: what one process keeps, the others load.

numba compiles one kernel at a time in a process, so that other cores help in processes of their own. Importing this
does not import numba.
"""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable, Sequence
from contextlib import suppress
from importlib import import_module
from typing import Any

from solvers.kernels import is_to_compile, thread_count

Call = tuple[Any, tuple[Any, ...]]
"""A kernel and arguments of the types that it is called with."""

# Processes that share the work: with more, the longest kernel and their start are what remains. Set by hand.
_MOST_PROCESSES = 4
_PROGRAM = "import sys; from solvers.ahead import call_first; call_first(sys.argv[1:])"
_looked_at: set[tuple[str, ...]] = set()


def compile_ahead(modules: Sequence[str], begun: Callable[[], None] = lambda: None) -> None:
    """Compile what modules of kernels say that everyone needs, on all cores, unless it is kept on disk.

    Where nothing can be kept, or with one thread, nothing is done: kernels are compiled where they are first called.
    What another process fails at is compiled there, too.

    Parameters
    ----------
    modules : sequence of str
        Dotted names, the longest to compile first; each has ``first_calls() -> list[Call]``.
    begun : callable, optional
        Called before something is compiled.
    """
    asked = tuple(modules)
    if asked in _looked_at:
        return
    _looked_at.add(asked)
    n = min(thread_count(), _MOST_PROCESSES)
    if n < 2:
        return
    missing = [module for module in asked if _is_missing(module)]
    parts = [part for part in _dealt(missing, n) if part]
    if len(parts) < 2:
        return
    begun()
    others = [_started(part) for part in parts[1:]]
    try:
        call_first(parts[0])
        for other in others:
            if other is not None:
                other.wait()
    finally:
        for other in others:
            if other is not None and other.poll() is None:
                other.terminate()
                other.wait()


def call_first(modules: Sequence[str]) -> None:
    """Call kernels of modules for the first time, on next to nothing: compiles them, or loads what is kept."""
    for module in modules:
        for kernel, arguments in import_module(module).first_calls():
            kernel(*arguments)


def _dealt(modules: Sequence[str], n: int) -> list[list[str]]:
    """Modules in n parts, the longest first, there and back."""
    order = [*range(n), *reversed(range(n))]
    return [[module for i, module in enumerate(modules) if order[i % (2 * n)] == part] for part in range(n)]


def _is_missing(module: str) -> bool:
    """Whether a kernel of the module is still to compile, and will be kept."""
    return any(is_to_compile(kernel) for kernel, _ in import_module(module).first_calls())


def _started(modules: Sequence[str]) -> subprocess.Popen[bytes] | None:
    """A process that compiles modules, with the paths of this one; none where none can be started."""
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(path for path in sys.path if path)}
    silent = subprocess.DEVNULL
    with suppress(OSError):
        return subprocess.Popen(
            [sys.executable, "-c", _PROGRAM, *modules], env=environment, stdin=silent, stdout=silent, stderr=silent
        )
    return None
