"""How long each stage of a command takes, and how far it has come."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping

Progress = Callable[[str, float], None]

COMPILING = "Compiling (first use only)"


def clocks() -> tuple[float, float]:
    """Seconds elapsed, and those of all cores together, since moments of their own."""
    return time.perf_counter(), time.process_time()


class Stages:
    """Times the stages and tells the progress.

    Parameters
    ----------
    progress : callable, optional
        Called with what is being done and the fraction done, 0..1.
    since : (float, float), optional
        `clocks` when the first stage began; default: when that is told.

    Attributes
    ----------
    seconds, cpu_seconds : dict of str to float
        Of each stage that has ended: elapsed, and of all cores together. A stage may be begun several times.
    """

    def __init__(self, progress: Progress | None = None, since: tuple[float, float] | None = None) -> None:
        self._progress = progress
        self._first = since
        self._name: str | None = None
        self._since = (0.0, 0.0)
        self._at = 0.0
        self.seconds: dict[str, float] = {}
        self.cpu_seconds: dict[str, float] = {}

    def begin(self, name: str, fraction: float) -> None:
        """End the stage before and begin this one, at this fraction of the whole."""
        self.end()
        if self._first is not None:
            self._since, self._first = self._first, None
        self._name, self._at = name, fraction
        self.advance(0.0)

    def advance(self, further: float) -> None:
        """Tell how much further than its begin the stage is, in parts of the whole."""
        if self._progress is not None and self._name is not None:
            self._progress(self._name, self._at + further)

    def part(self, start: float, stop: float) -> Progress | None:
        """What a step that tells its own progress, 0..1, is to call: its stages from `start` to `stop` of the whole."""
        if self._progress is None:
            return None
        tell = self._progress

        def advanced(stage: str, fraction: float) -> None:
            tell(stage, start + (stop - start) * fraction)

        return advanced

    def include(self, seconds: Mapping[str, float], cpu_seconds: Mapping[str, float]) -> None:
        """End the running stage and take over those that a step in it has timed itself; its own time is the rest."""
        name = self._name
        self.end()
        for total, parts in ((self.seconds, seconds), (self.cpu_seconds, cpu_seconds)):
            if name is not None:
                total[name] = max(0.0, total[name] - sum(parts.values()))
            for stage, value in parts.items():
                total[stage] = total.get(stage, 0.0) + value

    def share(self, others: Stages, n: int) -> None:
        """Take over one of n equal parts of other stages' times: of what was done for n at once."""
        for total, parts in ((self.seconds, others.seconds), (self.cpu_seconds, others.cpu_seconds)):
            for stage, value in parts.items():
                total[stage] = total.get(stage, 0.0) + value / n

    def compiling(self, kernel: str) -> None:
        """Tell that a kernel is being compiled, which happens once on a computer."""
        if self._progress is not None:
            self._progress(COMPILING, self._at)

    def end(self) -> None:
        """End the running stage."""
        now = clocks()
        if self._name is not None:
            self.seconds[self._name] = self.seconds.get(self._name, 0.0) + now[0] - self._since[0]
            self.cpu_seconds[self._name] = self.cpu_seconds.get(self._name, 0.0) + now[1] - self._since[1]
        self._since, self._name = now, None
