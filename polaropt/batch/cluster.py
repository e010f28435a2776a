"""Where jobs run: this process, processes of its own, or the workers of a Dask cluster."""

from __future__ import annotations

import json
import logging
import math
import os
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import Any, TypeVar

from polaropt.errors import InputError, one_line

Work = Callable[..., Any]
Item = TypeVar("Item")

_PACKAGES = ("distributed", "cryptography")
EXTRA = "pip install 'polaropt[batch]'"
_MEMORY_SHARE = 0.8
"""Part of the machine's free memory that processes of ours may use together; set by hand."""
_AHEAD = 3
"""Jobs for each thread that the scheduler holds at a time: enough that none waits, and no more than it must keep."""
_FEWEST = 4
"""Jobs that it holds where it has no workers yet."""
_ASK_SECONDS = 5.0
"""How often the scheduler is asked for its workers; set by hand."""
_REPLACED_WITHIN = "1 hour"
"""How long a process that replaces a dead one may take to begin; set by hand."""
_CONNECT_SECONDS = 20
"""How long a scheduler may take to answer; set by hand."""


class WorkerDied(Exception):
    """The processes that worked on a job died, several one after another."""


class ClusterLost(Exception):
    """The scheduler does not answer any more."""


@dataclass(frozen=True)
class Place:
    """Who works.

    Attributes
    ----------
    workers : int
        Processes of this machine; 1: this process itself.
    threads : int
        Of each of them.
    scheduler, scheduler_file : str or None
        Address of a Dask scheduler whose workers do it instead, or the file that tells it.
    dashboard : bool
        Whether Dask's page of the cluster is served, for this machine alone.
    """

    workers: int = 1
    threads: int = 1
    scheduler: str | None = None
    scheduler_file: str | None = None
    dashboard: bool = False

    @property
    def elsewhere(self) -> bool:
        """Whether the workers are those of somebody else's cluster."""
        return self.scheduler is not None or self.scheduler_file is not None

    @property
    def memory(self) -> int | None:
        """Bytes for each process of ours; None for this process and for those of a cluster."""
        if self.elsewhere or self.workers == 1:
            return None
        return int(_MEMORY_SHARE * free_memory() / self.workers)


def place_for(workers: int | None, scheduler: str | None, scheduler_file: str | None, dashboard: bool) -> Place:
    """Who works, as asked for: by default as many processes as there are cores, each with one thread.

    Raises
    ------
    InputError
        A package is missing, or two options contradict each other.
    """
    elsewhere = scheduler is not None or scheduler_file is not None
    if scheduler is not None and scheduler_file is not None:
        raise InputError("--scheduler and --scheduler-file both name a scheduler; give one of them")
    if elsewhere and workers is not None:
        raise InputError("--workers is for processes of this machine; leave it or the scheduler out")
    if elsewhere and dashboard:
        raise InputError("--dashboard is for processes of this machine; a cluster has its own")
    cores = count_cores()
    if workers is not None and not 1 <= workers <= 4 * cores:
        raise InputError(f"--workers is {workers}; give 1 to {4 * cores}")
    missing = [name for name in _PACKAGES if find_spec(name) is None]
    asked = "--scheduler" if elsewhere else "--dashboard" if dashboard else "--workers" if (workers or 1) > 1 else ""
    if missing and asked:
        raise InputError(f"{asked} needs the package {missing[0]}; install it with: {EXTRA}")
    count = 1 if missing else workers or cores
    return Place(count, max(1, cores // count), scheduler, scheduler_file, dashboard)


def count_cores() -> int:
    """Cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def free_memory() -> int:
    """Bytes that new processes may use, on this machine and in the container that this is."""
    import psutil
    from distributed.system import memory_limit

    return int(min(memory_limit(), psutil.virtual_memory().available))


def done(
    work: Work, items: Sequence[Item], client: Any = None, *, at_once: int | None = None
) -> Iterator[tuple[Item, Any]]:
    """Items with what `work` made of them, in the order in which they end.

    A scheduler holds a few for each of its workers at a time. What a worker that died was at is done again, by Dask,
    at most a few times.

    Parameters
    ----------
    work : callable
        Of an item; a function of a module, so that other processes find it.
    items : sequence
    client : distributed.Client, optional
        Default: this process works.
    at_once : int, optional
        Items that the scheduler holds at a time. Default: some for each thread of its workers. Those that wait at a
        worker that dies are suspected as much as the one that it was at.

    Yields
    ------
    item, result
        The result is an exception where `work` raised one or its workers died (`WorkerDied`).

    Raises
    ------
    ClusterLost
        The scheduler does not answer any more.
    """
    if client is None:
        for item in items:
            yield item, _result(lambda item=item: work(item))  # type: ignore[misc]
        return
    from distributed import as_completed

    left = iter(items)
    running: dict[Any, Item] = {}

    def start(count: int) -> list[Any]:
        futures = []
        for _, item in zip(range(count), left, strict=False):
            futures.append(client.submit(work, item, pure=False))
            running[futures[-1]] = item
        return futures

    window = _Window(client, at_once)
    ended = as_completed(start(window.size()), loop=client.loop)
    for future in ended:
        item = running.pop(future)
        result = _result(future.result)
        if client.status != "running" or (future.cancelled() and not _answers(client)):
            raise ClusterLost
        yield item, result
        # Held no longer than needed: the scheduler forgets what nobody holds.
        del future
        # Workers may have come or gone.
        for new in start(max(0, window.size() - len(running))):
            ended.add(new)


class _Window:
    """How many jobs the scheduler holds at a time: some for each thread of its workers, which come and go."""

    def __init__(self, client: Any, at_once: int | None) -> None:
        self._client, self._fixed = client, at_once
        self._asked, self._size = -math.inf, _FEWEST

    def size(self) -> int:
        """Jobs; asked of the scheduler now and then."""
        if self._fixed is not None:
            return self._fixed
        if time.monotonic() - self._asked > _ASK_SECONDS and _answers(self._client):
            self._asked = time.monotonic()
            self._size = max(_FEWEST, _AHEAD * sum(self._client.nthreads().values()))
        return self._size


def _answers(client: Any) -> bool:
    try:
        client.nthreads()
    except Exception:  # whatever a lost connection raises
        return False
    return True


def _result(call: Callable[[], Any]) -> Any:
    from concurrent.futures import CancelledError

    try:
        return call()
    except Exception as error:
        if type(error).__name__ == "KilledWorker" or isinstance(error, CancelledError):
            return WorkerDied(str(error))
        return error


@contextmanager
def connected(place: Place) -> Iterator[Any]:
    """A client of those who work; None where this process does.

    A cluster of our own is reached with temporary certificates (TLS) alone: nobody else who uses the machine can run
    code in its processes.
    """
    if not place.elsewhere and place.workers == 1:
        yield None
        return
    if place.elsewhere:
        with _of_others(place) as client:
            yield client
        return
    with local_cluster(place.workers, place.threads, place.memory, dashboard=place.dashboard) as client:
        if place.dashboard:
            print(f"Dashboard: {client.dashboard_link}", file=sys.stderr)
        yield client


@contextmanager
def _of_others(place: Place) -> Iterator[Any]:
    from distributed import Client

    name = place.scheduler or place.scheduler_file
    if place.scheduler_file is not None:
        _check_file(place.scheduler_file)
    try:
        client = Client(place.scheduler, scheduler_file=place.scheduler_file, timeout=_CONNECT_SECONDS)
    except (OSError, ValueError, TypeError, RuntimeError) as error:
        raise InputError(f"{name}: no Dask scheduler answers there ({one_line(error)}); check the address") from None
    with _calm_client(), client:
        _check_versions(client, str(name))
        if not client.nthreads():
            print(f"polaropt: {name}: the scheduler has no workers yet; waiting for them", file=sys.stderr)
        yield client


@contextmanager
def _calm_client() -> Iterator[None]:
    """Within this context Dask's client prints no traceback where its scheduler ends: `ClusterLost` says so."""
    logger = logging.getLogger("distributed.client")
    level = logger.level
    logger.setLevel(logging.CRITICAL)
    try:
        yield
    finally:
        logger.setLevel(level)


def _check_file(name: str) -> None:
    """InputError for another file than a scheduler writes."""
    try:
        told = json.loads(Path(name).read_bytes())
    except (OSError, ValueError, RecursionError):
        told = None
    if not isinstance(told, dict) or not isinstance(told.get("address"), str):
        raise InputError(f"{name}: tells no address of a scheduler; give the file that dask scheduler writes")


def _check_versions(client: Any, name: str) -> None:
    """InputError where a worker lacks polaropt, or has another version."""
    import polaropt

    def installed() -> str | None:
        # A function of a module would be looked for in a polaropt that may not be there.
        try:
            import polaropt as theirs
        except ImportError:
            return None
        return theirs.__version__

    for worker, version in client.run(installed).items():
        if version != polaropt.__version__:
            what = "has no polaropt" if version is None else f"has polaropt {version}"
            raise InputError(f"{name}: its worker {worker} {what}; install polaropt {polaropt.__version__} there")


# How often processes look at their own loop, memory and load: set by hand. What grows by a GB a second is still seen in
# time.
_LOOKED_AFTER = {
    "distributed.admin.tick.interval": "500ms",
    "distributed.worker.memory.monitor-interval": "500ms",
    "distributed.admin.system-monitor.interval": "2s",
    "distributed.admin.system-monitor.disk": False,
}


@contextmanager
def local_cluster(workers: int, threads: int, memory: int | None, *, dashboard: bool = False) -> Iterator[Any]:
    """A client of processes of this machine, each at one job at a time, with so many threads and bytes of memory."""
    import dask
    from distributed import Client, LocalCluster

    settings: dict[str, Any] = {
        f"distributed.nanny.pre-spawn-environ.{name}": threads for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS")
    }
    # A job holds its memory to its end: waiting for less would be waiting forever.
    settings |= {f"distributed.worker.memory.{what}": False for what in ("target", "spill", "pause")}
    # On a busy machine the process that replaces a dead one may take longer to begin than the usual 15 s, after which
    # it would be given up for good, and with the last one all that is left.
    settings["distributed.deploy.lost-worker-timeout"] = _REPLACED_WITHIN
    # Looking after themselves twenty times to a hundred times a second, idle processes took a tenth of a core.
    settings |= _LOOKED_AFTER
    if not dashboard:
        # Each has a server of pages, whether or not there is a dashboard, and an eye on what its thread does.
        settings |= {f"distributed.{who}.http.routes": [] for who in ("scheduler", "worker", "nanny")}
        settings["distributed.worker.profile.enabled"] = False
    with dask.config.set(settings), ExitStack() as stack:
        with _interruptions_later():
            cluster = stack.enter_context(
                LocalCluster(
                    n_workers=workers,
                    threads_per_worker=1,
                    memory_limit=memory or 0,
                    security=True,
                    host="127.0.0.1",
                    dashboard_address="127.0.0.1:0",
                    silence_logs=logging.CRITICAL,
                )
            )
            client = stack.enter_context(Client(cluster, set_as_default=False))
            _leave_interruptions(client)
        yield client


@contextmanager
def _interruptions_later() -> Iterator[None]:
    """Interruptions from the keyboard wait for the end of this, and processes that start here never see them.

    One that comes while workers start would end in their tracebacks, and in a cluster that cannot be closed.
    """
    import signal
    import threading

    if threading.current_thread() is not threading.main_thread() or not hasattr(signal, "pthread_sigmask"):
        yield
        return
    from multiprocessing import resource_tracker

    # Where it starts it leaves the thread open to interruptions.
    resource_tracker.ensure_running()
    came: list[int] = []
    handler = signal.signal(signal.SIGINT, lambda number, _: came.append(number))
    # Threads that start here keep the mask, and so do the processes that these start.
    mask = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, mask)
        signal.signal(signal.SIGINT, handler)
    if came:
        signal.raise_signal(signal.SIGINT)


def _leave_interruptions(client: Any) -> None:
    """Let the process that started the workers mind interruptions from the keyboard: it ends them."""
    from distributed import WorkerPlugin

    class Calm(WorkerPlugin):  # type: ignore[misc]
        """Of each worker that comes, also of one that replaces another."""

        def setup(self, worker: Any) -> None:
            import contextlib
            import signal

            # Only a main thread may say so.
            with contextlib.suppress(ValueError):
                signal.signal(signal.SIGINT, signal.SIG_IGN)

    client.register_plugin(Calm(), name="polaropt-calm")
