"""Seconds, threads and memory of this process.

It is read in processes whose memory is measured, and loads nothing beside.
"""

from __future__ import annotations

import ctypes
import gc
import resource
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

MB = 1e6
"""Bytes."""


class Clock:
    """Elapsed and processor seconds, which stand still within `paused`."""

    def __init__(self) -> None:
        self._start = _now()

    def read(self) -> tuple[float, float]:
        """Elapsed seconds, and processor seconds of all threads."""
        now = _now()
        return now[0] - self._start[0], now[1] - self._start[1]

    @contextmanager
    def paused(self) -> Iterator[None]:
        """What happens in here takes no time."""
        before = _now()
        yield
        after = _now()
        self._start = (self._start[0] + after[0] - before[0], self._start[1] + after[1] - before[1])


def _now() -> tuple[float, float]:
    return time.perf_counter(), time.process_time()


@dataclass(frozen=True)
class Threads:
    """Threads of torch and of BLAS; None: as the library has it, which is all cores."""

    torch: int | None = None
    blas: int | None = None

    def __str__(self) -> str:
        return f"torch {self.torch or 'all'}, BLAS {self.blas or 'all'}"

    @contextmanager
    def set(self) -> Iterator[None]:
        """Within this context the libraries use so many."""
        from threadpoolctl import threadpool_limits

        with threadpool_limits(self.blas, "blas"):
            if self.torch is None:
                yield
                return
            import torch

            before = torch.get_num_threads()
            torch.set_num_threads(self.torch)
            try:
                yield
            finally:
                torch.set_num_threads(before)


def peak_above(call: Callable[[], object]) -> float:
    """Most memory (MB, 10^6 bytes) that a call takes in this process beyond what is held before it."""
    reset_peak()
    before = resident_mb()
    call()
    return max(0.0, peak_mb() - before)


def peak_mb() -> float:
    """The kernel's high-water mark of this process, in MB.

    Where Linux tells it, `VmHWM`, which unlike ``ru_maxrss`` starts anew with the program and can be set back.
    """
    peak = _status_mb("VmHWM")
    if peak is not None:
        return peak
    unit = 1 if sys.platform == "darwin" else 1024
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * unit / MB


def resident_mb() -> float:
    """What this process holds now, in MB."""
    now = _status_mb("VmRSS")
    return peak_mb() if now is None else now


def reset_peak() -> None:
    """Let the high-water mark begin at what is held now, where the system allows it."""
    gc.collect()
    _give_back()
    try:
        Path("/proc/self/clear_refs").write_text("5", encoding="ascii")
    except OSError:
        return


def _status_mb(name: str) -> float | None:
    """A line of Linux's /proc/self/status in MB, None on other systems."""
    try:
        lines = Path("/proc/self/status").read_text(encoding="utf-8").splitlines()
    except OSError:
        return None
    values = [line.split()[1] for line in lines if line.startswith(f"{name}:")]
    return int(values[0]) * 1024 / MB if values else None


def _give_back() -> None:
    """Let the C library return to the system what is free; elsewhere than with glibc nothing happens."""
    trim = getattr(ctypes.CDLL(None), "malloc_trim", None)
    if trim is not None:
        trim(0)
