"""Memory that was freed, given back."""

from __future__ import annotations

import ctypes
from collections.abc import Iterator
from contextlib import contextmanager, suppress

# glibc's name of the size from which on memory is asked for apart, and how large that may grow by itself.
_APART, _LARGEST_OF_GLIBC = -3, 32 * 2**20
# Bytes from which on arrays lie apart; set by hand.
_ARRAY = 2**20

MUCH_VALUES = 90_000_000
"""Values of layers that are much memory themselves: 15 megapixels in colour."""


def give_back_freed() -> None:
    """Give memory that was freed back to the system, where the C library keeps it for later (glibc, on Linux)."""
    with suppress(OSError, AttributeError, TypeError):
        ctypes.CDLL(None).malloc_trim(0)


@contextmanager
def arrays_apart(needed: bool = True) -> Iterator[None]:
    """Have arrays of more than a megabyte lie apart inside, where the C library would keep them in its heap (glibc).

    There they leave holes where the next ones do not fit: beside photographs of 24 megapixels 60 to 100 MB. Apart they
    are given back at once, which costs the system a little time for each.

    Parameters
    ----------
    needed : bool
        Whether memory is scarce; else nothing changes.
    """
    if not needed:
        yield
        return
    _lie_apart_from(_ARRAY)
    try:
        yield
    finally:
        _lie_apart_from(_LARGEST_OF_GLIBC)


def _lie_apart_from(size: int) -> None:
    with suppress(OSError, AttributeError, TypeError):
        ctypes.CDLL(None).mallopt(_APART, size)
