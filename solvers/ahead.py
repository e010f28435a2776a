"""Kernels compiled before they are needed, side by side: what one process keeps, the others load.

numba compiles one kernel at a time in a process, so that other cores help in processes of their own. They take one
module after the other, as the caller does once it has nothing else to do. Importing this does not import numba.
"""

from __future__ import annotations

import os
import subprocess
import sys
import threading
from collections import deque
from collections.abc import Callable, Sequence
from contextlib import suppress
from importlib import import_module
from typing import Any

from solvers.kernels import is_to_compile, thread_count

Call = tuple[Any, tuple[Any, ...]]
"""A kernel and arguments of the types that it is called with."""

# Processes that share the work: with more, the longest kernel and their start are what remains. Set by hand.
_MOST_PROCESSES = 4
_PROGRAM = "from solvers.ahead import compile_as_told; compile_as_told()"
_looked_at: set[str] = set()
# Modules that nobody has begun, and of all that are to compile whether they are done.
_waiting: deque[str] = deque()
_done: dict[str, threading.Event] = {}
_lock = threading.Lock()


def begin_ahead(modules: Sequence[str]) -> None:
    """Let other cores compile what modules of kernels say that is needed, and go on at once.

    Who needs them calls `compile_ahead`. With one thread nothing is done.

    Parameters
    ----------
    modules : sequence of str
        Dotted names, those that are needed first and take longest to compile first; each has
        ``first_calls() -> list[Call]``.
    """
    if thread_count() > 1:
        _hand_out(_missing(modules))


def compile_ahead(modules: Sequence[str], begun: Callable[[], None] = lambda: None) -> None:
    """Compile what modules of kernels say that everyone needs, on all cores, unless it is kept on disk.

    Where nothing can be kept, or with one thread, nothing is done: kernels are compiled where they are first called.
    What another process fails at is compiled there, too.

    Parameters
    ----------
    modules : sequence of str
        As of `begin_ahead`.
    begun : callable, optional
        Called before something is compiled or waited for.
    """
    if thread_count() < 2:
        return
    missing = _missing(modules)
    if len(missing) > 1:
        _hand_out(missing)
    open_ = [module for module in modules if module in _done and not _done[module].is_set()]
    if not open_:
        return
    begun()
    for module in open_:
        if _taken(module):
            try:
                _call_first(module)
            finally:
                _done[module].set()
    for module in open_:
        _done[module].wait()


def compile_as_told() -> None:
    """Compile the modules that are named on standard input, a line each, and say on standard output when one is."""
    for line in sys.stdin:
        _call_first(line.strip())
        print(line, end="", flush=True)


def _call_first(module: str) -> None:
    """Call a module's kernels for the first time, on next to nothing: compiles them, or loads what is kept."""
    for kernel, arguments in import_module(module).first_calls():
        kernel(*arguments)


def _missing(modules: Sequence[str]) -> list[str]:
    """Modules that nobody has asked for yet and of which a kernel is still to compile, and will be kept."""
    new = [module for module in modules if module not in _looked_at]
    _looked_at.update(new)
    return [module for module in new if any(is_to_compile(kernel) for kernel, _ in import_module(module).first_calls())]


def _hand_out(modules: Sequence[str]) -> None:
    """Put modules where helpers take them from, each helper the next longest."""
    _done.update({module: threading.Event() for module in modules})
    _waiting.extend(modules)
    for _ in range(min(len(modules), thread_count(), _MOST_PROCESSES) - 1 or len(modules)):
        with _lock:
            first = _waiting.popleft()
        threading.Thread(target=_with_helper, args=(first,), daemon=True).start()


def _taken(module: str) -> bool:
    """Whether a module still waited, and is the caller's now."""
    with _lock:
        if module not in _waiting:
            return False
        _waiting.remove(module)
        return True


def _with_helper(module: str | None) -> None:
    """Have modules compiled by another process, until none is left; it ends when this one does."""
    helper = _started()
    while module is not None:
        if helper is not None:
            assert helper.stdin is not None
            assert helper.stdout is not None
            with suppress(OSError):
                helper.stdin.write(f"{module}\n")
                helper.stdin.flush()
                helper.stdout.readline()
        _done[module].set()
        with _lock:
            module = _waiting.popleft() if _waiting else None
    if helper is not None:
        helper.communicate()


def _started() -> subprocess.Popen[str] | None:
    """A process that compiles what it is told, with the paths of this one; none where none can be started."""
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(path for path in sys.path if path)}
    pipe = subprocess.PIPE
    with suppress(OSError):
        return subprocess.Popen(
            [sys.executable, "-c", _PROGRAM],
            env=environment,
            stdin=pipe,
            stdout=pipe,
            stderr=subprocess.DEVNULL,
            text=True,
        )
    return None
