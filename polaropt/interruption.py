"""Requests to end a program, which interrupt it as Ctrl-C does, and the programs that it has started."""

from __future__ import annotations

import signal
import subprocess
import threading
from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def terminations() -> Iterator[list[int]]:
    """Take a request to end (SIGTERM, or a terminal that closes) as an interruption: what is half done is removed.

    Yields
    ------
    list of int
        The signals that came; empty where Ctrl-C interrupts.
    """
    received: list[int] = []

    def interrupt(number: int, frame: object) -> None:
        received.append(number)
        # Who is asked twice, by the system and by what started it, writes what it has in peace.
        if len(received) == 1:
            raise KeyboardInterrupt(number)

    numbers = [getattr(signal, name) for name in ("SIGTERM", "SIGHUP") if hasattr(signal, name)]
    # Whoever runs this in a program of their own, or told the system to ignore one, has decided already.
    free = threading.current_thread() is threading.main_thread()
    before = {number: signal.signal(number, interrupt) for number in numbers if free and _is_default(number)}
    try:
        yield received
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def _is_default(number: int) -> bool:
    return signal.getsignal(number) is signal.SIG_DFL


def waited_for(process: subprocess.Popen[bytes]) -> int:
    """Exit code of a program that this one has started; who asks this one to end (SIGTERM) asks that, too.

    Raises
    ------
    KeyboardInterrupt
        This one was interrupted; the other has ended.
    """
    try:
        return process.wait()
    except KeyboardInterrupt as request:
        # A terminal interrupts both.
        if request.args == (signal.SIGTERM,):
            process.terminate()
        process.wait()
        raise
