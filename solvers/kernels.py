"""Kernels compiled by numba on their first call, and the threads that share their rows.

Importing a module of kernels imports numba: do it inside the function that needs them.

Made for kernels that release the interpreter's lock. numba's own parallel loops are no choice here: one of its thread
pools is not safe under threads, the other waits actively and slows down whatever shares the cores.
"""

from __future__ import annotations

import hashlib
import inspect
import os
import threading
from collections import deque
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor, wait
from contextlib import contextmanager
from numbers import Number
from pathlib import Path
from typing import Any, TypeVar

# All that lets loops vectorize, without "nnan" and "ninf": NaN and infinity must show.
_FAST = {"reassoc", "contract", "nsz", "arcp", "afn"}
# Kernels are inlined where others call them: of those that are not, machine code stands in every caller's module, with
# sums in another order each, and which of them is called depends on whether modules were compiled or loaded. Nobody
# calls them from C.
_OPTIONS: dict[str, Any] = {"nogil": True, "error_model": "numpy", "forceinline": True, "no_cfunc_wrapper": True}
# Attribute of a kernel's function in which its stamp stands, for the kernels that call it.
_STAMP = "_kernel_stamp"

Kernel = TypeVar("Kernel", bound=Callable[..., Any])
_listeners: list[Callable[[str], None]] = []
_lock = threading.Lock()
_listening = False


def compiled(function: Kernel) -> Kernel:
    """Decorate a kernel: compiled by numba without the interpreter's lock, cached on disk where that is possible.

    Sums may be reordered and products fused; division by zero gives infinity instead of an exception, so that loops
    vectorize. A kernel may call another, also of another file: what is cached counts until one of these files changes.

    Parameters
    ----------
    function : callable
        In the part of Python that numba knows, on arrays and scalars. Kernels, numbers and named tuples of other files
        are imported by name, before it.

    Returns
    -------
    callable
        Called like `function`; the first call with arguments of new types compiles or loads.
    """
    return _kernel(function, _OPTIONS)


def inlined(function: Kernel) -> Kernel:
    """Decorate a part of kernels: its statements are put where it is called before anything is compiled.

    A kernel that others call is compiled for itself as well, this is not. Where many parts become one it may run
    slower, as those of the misfit did: measure both.

    Parameters
    ----------
    function : callable
        As for `compiled`.

    Returns
    -------
    callable
        Called by kernels; called from Python it is compiled for itself.
    """
    return _kernel(function, _OPTIONS | {"inline": "always"})


def _kernel(function: Kernel, options: dict[str, Any]) -> Kernel:
    import numba  # half a second: only where a kernel is used

    from solvers.keeping import Kept

    _listen()
    stamp = _stamp(function)
    function.__dict__[_STAMP] = stamp
    kernel: Any = numba.njit(fastmath=_FAST, **options)(function)
    try:
        kernel._cache = Kept(function, stamp)
    except RuntimeError as error:
        # Without a folder to keep it in it is compiled anew in every process.
        if "no locator available" not in str(error):
            raise
    decorated: Kernel = kernel
    return decorated


def _stamp(function: Callable[..., Any]) -> str:
    """Digest of all that a kernel is compiled from: its file, the kernels, numbers and tuples that its file imports."""
    digest = hashlib.sha256(repr([*sorted(_FAST), _OPTIONS]).encode())
    path = Path(inspect.getfile(function))
    digest.update(path.read_bytes() if path.is_file() else function.__code__.co_code)
    for name, value in sorted(function.__globals__.items()):
        called: Any = getattr(value, "py_func", None)
        stamp = getattr(called, _STAMP, None)
        if stamp is not None and called.__globals__ is not function.__globals__:
            digest.update(f"{name}: {stamp}".encode())
        elif isinstance(value, Number) or (isinstance(value, tuple) and all(isinstance(v, Number) for v in value)):
            digest.update(f"{name}: {value!r}".encode())
        elif isinstance(value, type) and hasattr(value, "_fields"):
            digest.update(f"{name}: {value._fields}".encode())
    return digest.hexdigest()


def is_to_compile(kernel: Any) -> bool:
    """Whether a kernel is neither compiled in this process nor kept on disk, although it could be kept."""
    kept = getattr(kernel._cache, "_cache_file", None)
    return kept is not None and not kernel.signatures and not kept._load_index()


@contextmanager
def compilations_reported_to(report: Callable[[str], None]) -> Iterator[None]:
    """Within this context `report` is called with a kernel's name whenever its compilation starts.

    Loading from the cache tells nothing. The call comes from the thread that compiles, whoever started it. Importing
    and entering this costs nothing: numba is not imported.

    Parameters
    ----------
    report : callable
        Takes the name of the function.
    """
    _listeners.append(report)
    try:
        yield
    finally:
        _listeners.remove(report)


def _listen() -> None:
    """Listen to numba's compilations, once per process."""
    global _listening
    from numba.core import event

    class Listener(event.Listener):
        def on_start(self, event: Any) -> None:
            _report(event.data["dispatcher"].py_func.__name__)

        def on_end(self, event: Any) -> None:
            pass

    with _lock:
        if not _listening:
            event.register("numba:compile", Listener())  # type: ignore[no-untyped-call]
            _listening = True


def _report(name: str) -> None:
    for report in tuple(_listeners):
        report(name)


Result = TypeVar("Result")

_pool: ThreadPoolExecutor | None = None
_pool_of: int | None = None


def core_count() -> int:
    """Cores that this process may use; all there are where the system does not tell (macOS, Windows)."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def thread_count() -> int:
    """Threads to use: as many as this process may use cores, or OMP_NUM_THREADS where that is less."""
    available = core_count()
    # OpenMP allows a list, one number per level of nesting.
    asked = os.environ.get("OMP_NUM_THREADS", "").split(",")[0].strip()
    return max(1, min(available, int(asked))) if asked.isdigit() else available


def in_blocks(
    function: Callable[[int, int], Result], n: int, block: int, *, smallest: int = 0, threads: int | None = None
) -> list[Result]:
    """Call ``function(start, stop)`` for every block of ``range(n)``.

    The borders are multiples of `block` whatever the number of threads, so that sums of the results, added in order,
    are the same to the last bit. Blocks start in order; each must be independent of the others. Calls may be nested
    and may come from several threads: the caller works too, and waits only for blocks that have been begun.

    Parameters
    ----------
    function : callable
        Worth it where it releases the interpreter's lock and takes longer than 0.1 ms.
    n : int
    block : int
        Length of a block; the last one may be shorter.
    smallest : int
        One thread for ranges shorter than this.
    threads : int, optional
        At most so many threads; default `thread_count`.

    Returns
    -------
    list
        The results in the order of the blocks.

    Raises
    ------
    Exception
        The first that `function` raised; blocks not begun by then are left out.
    """
    if block < 1:
        raise ValueError(f"block is {block}; give 1 or more")
    starts = range(0, n, block)
    workers = min(len(starts), thread_count() if threads is None else threads)
    if workers < 2 or n < smallest:
        return [function(start, min(start + block, n)) for start in starts]
    results: dict[int, Result] = {}
    todo = deque(starts)

    def work() -> None:
        while True:
            try:
                start = todo.popleft()  # atomic
            except IndexError:
                return
            try:
                results[start] = function(start, min(start + block, n))
            except BaseException:
                todo.clear()
                raise

    _share(work, workers - 1, todo)
    return [results[start] for start in starts]


def _share(work: Callable[[], None], n_helpers: int, todo: deque[int]) -> None:
    """Let helpers and the caller work until nothing is left to do or one of them fails."""
    pool = _shared_pool()
    helpers: list[Future[None]] = [pool.submit(work) for _ in range(n_helpers)]
    try:
        work()
    finally:
        todo.clear()
        # A helper that has not begun is not needed: nobody ever waits for a thread to come free.
        begun = [helper for helper in helpers if not helper.cancel()]
        wait(begun)
    for helper in begun:
        helper.result()


def _shared_pool() -> ThreadPoolExecutor:
    """The pool of this process; a fork leaves its parent's behind."""
    global _pool, _pool_of
    if _pool is None or _pool_of != os.getpid():
        _pool, _pool_of = ThreadPoolExecutor(os.cpu_count() or 1, thread_name_prefix="blocks"), os.getpid()
    return _pool
