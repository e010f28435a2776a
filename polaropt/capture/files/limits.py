"""How much a file may ask for: what its header tells is checked before anything is decoded."""

from __future__ import annotations

import logging
import math
import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

from polaropt.errors import InputError

MAX_PIXELS = 200_000_000
"""Pixels of all photographs of a file together, unless a person allows more; set by hand, four of 50 megapixels."""
_FREE_BYTES = 2**26
"""Decoded bytes that any file may have; set by hand."""
_MOST_RATIO = 1000
"""Decoded bytes per byte of the file beyond these: about what deflate makes of one value throughout."""
_BYTES_PER_PIXEL = 32
"""Bytes of a file per pixel at most, four channels of doubles."""


@dataclass(frozen=True)
class Declared:
    """What a file's header says that it holds.

    Attributes
    ----------
    pixels : int
        Of all photographs together.
    n_bytes : int
        Of their values once they are decoded, with what the decoder needs beside them.
    """

    pixels: int
    n_bytes: int


def declared(shape: Sequence[int], itemsize: int) -> Declared:
    """Of an array (h, w), (k, h, w), or with channels, whichever side of height and width they stand."""
    values = math.prod(shape)
    channels = 1 if len(shape) < 4 else max(1, shape[-1] if shape[-1] in (3, 4) and shape[1] > 4 else shape[1])
    return Declared(values // channels, values * itemsize)


def check_declared(declared: Declared, file_bytes: int, max_pixels: int = MAX_PIXELS) -> None:
    """InputError where a file asks for more pixels than allowed, or for more memory than its size can be worth."""
    if declared.pixels > max_pixels:
        raise InputError(
            f"holds {_millions(declared.pixels)} pixels, more than {_millions(max_pixels)}; "
            "give --max-pixels (max_pixels) if it is meant to"
        )
    if declared.n_bytes > free_bytes(file_bytes):
        raise InputError(
            f"has {file_bytes} bytes that are said to become {_millions(declared.n_bytes)}; "
            "no photograph can be compressed so much, copy it again"
        )


def free_bytes(file_bytes: int) -> int:
    """Decoded bytes that a file of so many bytes may have."""
    return _FREE_BYTES + _MOST_RATIO * file_bytes


def most_bytes(max_pixels: int) -> int:
    """Bytes of a file that can hold so many pixels."""
    return _FREE_BYTES + _BYTES_PER_PIXEL * max_pixels


def check_max_pixels(max_pixels: Any) -> int:
    """InputError for anything but a number of pixels."""
    if isinstance(max_pixels, bool) or not isinstance(max_pixels, int) or max_pixels < 1:
        raise InputError(f"max_pixels is {max_pixels!r}; give a whole number of pixels, such as {MAX_PIXELS}")
    return max_pixels


def _millions(number: int) -> str:
    return f"{number / 1e6:,.0f} million" if number >= 1_000_000 else str(number)


_TALKATIVE = ("imagecodecs", "tifffile", "PIL.Image", "PIL.TiffImagePlugin", "PIL.PngImagePlugin")
"""Loggers of libraries that tell what they think of a damaged file, on standard error if nobody listens."""


class _Listener(logging.Filter):
    """Keeps what a thread's libraries say while it decodes; it leaves other times, and other programs, alone."""

    def __init__(self) -> None:
        super().__init__()
        self._lock = threading.Lock()
        self._collected: dict[int, list[list[str]]] = {}

    def filter(self, record: logging.LogRecord) -> bool:
        with self._lock:
            own = self._collected.get(threading.get_ident())
            if own:
                own[-1].append(record.getMessage())
            # A thread without a list of its own is one of a library's, which decodes for one that has.
            return not self._collected

    @contextmanager
    def listening(self) -> Iterator[list[str]]:
        thread, collected = threading.get_ident(), list[str]()
        with self._lock:
            self._collected.setdefault(thread, []).append(collected)
        try:
            yield collected
        finally:
            with self._lock:
                self._collected[thread].pop()
                if not self._collected[thread]:
                    del self._collected[thread]


_LISTENER = _Listener()


@contextmanager
def complaints() -> Iterator[list[str]]:
    """Collect what libraries would print about a damaged file; our one line says what is to be said."""
    for name in _TALKATIVE:
        logging.getLogger(name).addFilter(_LISTENER)
    with _LISTENER.listening() as collected:
        yield collected
