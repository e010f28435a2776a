"""Memory that was freed, given back, and results that are kept as long as what they were made of."""

from __future__ import annotations

import ctypes
import weakref
from collections import OrderedDict
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from functools import wraps
from typing import Any, Concatenate, ParamSpec, TypeVar

_Of = TypeVar("_Of")
_Rest = ParamSpec("_Rest")
_Result = TypeVar("_Result")

# glibc's name of the size from which on memory is asked for apart, and how large that may grow by itself.
_APART, _LARGEST_OF_GLIBC = -3, 32 * 2**20
# Bytes from which on arrays lie apart; set by hand.
_ARRAY = 2**20

_MOST_KEPT = 4
"""Results of a function that are kept at once: of both azimuths of two scenes. Set by hand."""

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


def kept_while_alive(
    function: Callable[Concatenate[_Of, _Rest], _Result],
) -> Callable[Concatenate[_Of, _Rest], _Result]:
    """A function whose last few results are kept, each as long as the first argument that it was made of is alive.

    As of `functools.lru_cache`, but that argument is told from others by being the same object, and is not kept alive
    itself. Results are not to be written to.
    """
    kept: OrderedDict[tuple[Any, ...], tuple[weakref.ref[_Of], _Result]] = OrderedDict()

    @wraps(function)
    def asked(of: _Of, /, *rest: _Rest.args, **named: _Rest.kwargs) -> _Result:
        key = (id(of), rest, *named.items())
        known = kept.get(key)
        if known is not None and known[0]() is of:
            return known[1]
        result = function(of, *rest, **named)
        kept[key] = weakref.ref(of, lambda _: kept.pop(key, None)), result
        while len(kept) > _MOST_KEPT:
            # Another thread may have been faster.
            with suppress(KeyError):
                kept.popitem(last=False)
        return result

    return asked
