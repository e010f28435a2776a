"""What workers are asked to do in the tests of clusters: in a module of its own, as each new one imports it first."""

from __future__ import annotations

import os
import signal
from pathlib import Path

from polaropt.errors import InputError


def die_once(number: int, folder: str) -> int:
    """Kill the own process when first asked for 0."""
    mark = Path(folder) / "killed"
    if number == 0 and not mark.exists():
        mark.touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return number**2


def always_die(number: int) -> int:
    """Kill the own process at 1, and refuse 2."""
    if number == 1:
        os.kill(os.getpid(), signal.SIGKILL)
    if number == 2:
        raise InputError("no")
    return number**2
