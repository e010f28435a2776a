"""Run cases in a process of their own, which is ended and replaced where a case hangs or takes it along."""

from __future__ import annotations

import json
import os
import select
import subprocess
import sys
import time
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[2]
PATIENCE = 60.0
"""Seconds of the processor that a case may take."""
_FIRST = 240.0
"""Seconds of the first one beside these, in which kernels are compiled."""


_ASLEEP = 10
"""How many times as long it may wait for others."""


def _processor_seconds(process: int) -> float:
    fields = Path(f"/proc/{process}/stat").read_text(encoding="ascii").rpartition(")")[2].split()
    return sum(int(field) for field in fields[11:15]) / os.sysconf("SC_CLK_TCK")


@dataclass(frozen=True)
class Failure:
    """A case that did not end as it should, and how."""

    case: dict[str, Any]
    line: list[str]
    wrong: str


class Attacker:
    """A process that is given cases."""

    def __init__(self) -> None:
        self._process: subprocess.Popen[str] | None = None
        self._warm = False

    def __enter__(self) -> Attacker:
        return self

    def __exit__(self, *error: object) -> None:
        self._end()

    def _started(self) -> subprocess.Popen[str]:
        if self._process is None:
            self._process = subprocess.Popen(
                [sys.executable, "-m", "tests.fuzz.worker"],
                cwd=ROOT,
                env={**os.environ, "PYTHONPATH": str(ROOT), "OMP_NUM_THREADS": "1", "NUMBA_NUM_THREADS": "1"},
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=subprocess.DEVNULL,
                text=True,
            )
            self._warm = False
            assert self._process.stdout is not None
            if self._process.stdout.readline() != "ready\n":
                raise RuntimeError("the process that runs the cases does not start: python -m tests.fuzz.worker")
        return self._process

    def _end(self) -> None:
        if self._process is not None:
            self._process.kill()
            self._process.communicate()
            self._process = None

    def _answered(self, process: subprocess.Popen[str]) -> bool:
        """Whether a case ends in time: of the processor, as whatever else runs on the machine does not count."""
        patience = PATIENCE + (0 if self._warm else _FIRST)
        used, begun = _processor_seconds(process.pid), time.monotonic()
        while _processor_seconds(process.pid) - used < patience and time.monotonic() - begun < _ASLEEP * patience:
            if select.select([process.stdout], [], [], 1.0)[0]:
                return True
        return False

    def run(self, case: dict[str, Any]) -> Failure | None:
        """What went wrong with a case, if something did."""
        process = self._started()
        assert process.stdin is not None
        assert process.stdout is not None
        process.stdin.write(json.dumps(case) + "\n")
        process.stdin.flush()
        ready = self._answered(process)
        answer = process.stdout.readline() if ready else ""
        if not answer:
            self._end()
            return Failure(case, [], "took the process with it" if ready else f"took more than {PATIENCE:g} s")
        self._warm = True
        told = json.loads(answer)
        return Failure(case, told["line"], told["wrong"]) if told["wrong"] else None


def attack(cases: Iterable[dict[str, Any]], seconds: float | None = None) -> Iterator[Failure | None]:
    """How each case ended, until the time is over."""
    begun = time.monotonic()
    with Attacker() as attacker:
        for case in cases:
            if seconds is not None and time.monotonic() - begun > seconds:
                return
            yield attacker.run(case)
