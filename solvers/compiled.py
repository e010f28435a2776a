"""Kernels compiled by numba on their first call and kept on disk; whoever wants to know is told when that happens.

Importing a module of kernels imports numba: do it inside the function that needs them.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any, TypeVar

# All that lets loops vectorize, without "nnan" and "ninf": NaN and infinity must show.
_FAST = {"reassoc", "contract", "nsz", "arcp", "afn"}

Kernel = TypeVar("Kernel", bound=Callable[..., Any])
_told: list[Callable[[str], None]] = []
_lock = threading.Lock()
_listening = False


def compiled(function: Kernel) -> Kernel:
    """Decorate a kernel: compiled by numba without the interpreter's lock, cached on disk where that is possible.

    Sums may be reordered and products fused; division by zero gives infinity instead of an exception, so that loops
    vectorize. A kernel may call another. The cache notices changes of the kernel's own file only: keep kernels that
    call each other in one file.

    Parameters
    ----------
    function : callable
        In the part of Python that numba knows, on arrays and scalars.

    Returns
    -------
    callable
        Called like `function`; the first call with arguments of new types compiles or loads.
    """
    import numba  # half a second: only where a kernel is used

    _listen()
    options: dict[str, Any] = {"nogil": True, "fastmath": _FAST, "error_model": "numpy"}
    try:
        kernel: Kernel = numba.njit(cache=True, **options)(function)
    except RuntimeError as error:
        if "no locator available" not in str(error):
            raise
        # No folder can be written to: compiled anew in every process.
        kernel = numba.njit(cache=False, **options)(function)
    return kernel


@contextmanager
def told_of_compiling(tell: Callable[[str], None]) -> Iterator[None]:
    """Within this context `tell` is called with a kernel's name whenever its compilation starts.

    Loading from the cache tells nothing. The call comes from the thread that compiles, whoever started it. Importing
    and entering this costs nothing: numba is not imported.

    Parameters
    ----------
    tell : callable
        Takes the name of the function.
    """
    _told.append(tell)
    try:
        yield
    finally:
        _told.remove(tell)


def _listen() -> None:
    """Listen to numba's compilations, once per process."""
    global _listening
    from numba.core import event

    class Listener(event.Listener):
        def on_start(self, event: Any) -> None:
            _tell(event.data["dispatcher"].py_func.__name__)

        def on_end(self, event: Any) -> None:
            pass

    with _lock:
        if not _listening:
            event.register("numba:compile", Listener())  # type: ignore[no-untyped-call]
            _listening = True


def _tell(name: str) -> None:
    for tell in tuple(_told):
        tell(name)
