"""How long each stage of a separation takes, and how far it has come."""

from __future__ import annotations

import time
from collections.abc import Callable

Progress = Callable[[str, float], None]


class Stages:
    """Times the stages and tells the progress.

    Parameters
    ----------
    progress : callable, optional
        Called with what is being done and the fraction done, 0..1.

    Attributes
    ----------
    seconds, cpu_seconds : dict of str to float
        Of each stage that has ended: elapsed, and of all cores together. A stage may be begun several times.
    """

    def __init__(self, progress: Progress | None = None) -> None:
        self._progress = progress
        self._name: str | None = None
        self._since = (0.0, 0.0)
        self._at = 0.0
        self.seconds: dict[str, float] = {}
        self.cpu_seconds: dict[str, float] = {}

    def begin(self, name: str, fraction: float) -> None:
        """End the stage before and begin this one, at this fraction of the whole."""
        self.end()
        self._name, self._at = name, fraction
        self.advance(0.0)

    def advance(self, further: float) -> None:
        """Tell how much further than its begin the stage is, in parts of the whole."""
        if self._progress is not None and self._name is not None:
            self._progress(self._name, self._at + further)

    def compiling(self, kernel: str) -> None:
        """Tell that a kernel is being compiled, which happens once on a computer."""
        if self._progress is not None:
            self._progress("Compiling (first use only)", self._at)

    def end(self) -> None:
        """End the running stage."""
        now = (time.perf_counter(), time.process_time())
        if self._name is not None:
            self.seconds[self._name] = self.seconds.get(self._name, 0.0) + now[0] - self._since[0]
            self.cpu_seconds[self._name] = self.cpu_seconds.get(self._name, 0.0) + now[1] - self._since[1]
        self._since, self._name = now, None
