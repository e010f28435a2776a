"""The next item while this one is worked on: one core reads while another separates."""

from __future__ import annotations

import threading
from collections.abc import Iterable, Iterator
from queue import SimpleQueue
from typing import TypeVar

from solvers.kernels import thread_count

Item = TypeVar("Item")


def read_ahead(items: Iterable[Item]) -> Iterator[Item]:
    """The same items in the same order; another thread takes the next one while the last one is in use.

    An error comes where its item would have come. With a single core items are taken when they are asked for.

    Parameters
    ----------
    items : iterable
        One thread takes all of them, and no more than one before it is asked for.
    """
    if thread_count() < 2:
        yield from items
        return
    taken: SimpleQueue[tuple[Item, ...] | BaseException] = SimpleQueue()
    wanted, left = threading.Semaphore(1), threading.Event()

    def take() -> None:
        source = iter(items)
        try:
            while wanted.acquire() and not left.is_set():
                taken.put((next(source),))
        except StopIteration:
            taken.put(())
        except BaseException as error:
            taken.put(error)

    # A daemon: a camera that gives no more frames keeps no process alive.
    threading.Thread(target=take, name="reads ahead", daemon=True).start()
    try:
        while True:
            told = taken.get()
            if isinstance(told, BaseException):
                raise told
            if not told:
                return
            wanted.release()
            yield told[0]
    finally:
        left.set()
        wanted.release()
