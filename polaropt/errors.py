"""The one error that a person's input can cause, and how errors are told."""

from __future__ import annotations

import errno
from collections.abc import Iterable
from numbers import Real

LONGEST_LINE = 1000
"""Characters of an error; set by hand, several usual paths long."""
_LONGEST_REASON = 120
"""Characters of what a library says; set by hand."""
_LEFT_OUT = " ... "

INTERRUPTED = 130
"""Exit code after Ctrl-C, as shells have it: 128 and the signal's number."""


NO_ROOM = frozenset({errno.ENOSPC, errno.EFBIG, errno.EDQUOT, errno.EIO, errno.EROFS})
"""Numbers of a system's errors that say that a disk takes no more, whoever writes."""


class ResultWarning(UserWarning):
    """A result that is not to be trusted as it is; its text is what `SeparationWarning` says of it.

    Issued by `polaropt.separate` where its diagnostics hold warnings, and for each result of `separate_many` and
    `separate_sequence`. The command line prints these itself.

    Examples
    --------
    >>> import warnings
    >>> from polaropt import ResultWarning
    >>> with warnings.catch_warnings():
    ...     warnings.simplefilter("error", ResultWarning)  # rather stop than return what is not to be trusted
    >>> issubclass(ResultWarning, UserWarning)
    True
    """


class InputError(ValueError):
    """What came from a file or a person cannot be used; its text is one line: what is wrong, and what to do.

    The command line prints that line and ends with exit code 2. Characters that a terminal would obey are written as
    escapes, and a line of thousands of characters is shortened in its middle: names of files, and of what is in them,
    come from strangers.

    Examples
    --------
    >>> from polaropt import InputError, read_capture
    >>> try:
    ...     read_capture("nowhere.png")
    ... except InputError as error:
    ...     print(error)
    nowhere.png: no such file; check the name
    """

    def __init__(self, sentence: str) -> None:
        super().__init__(in_one_line(sentence))


def in_one_line(text: str, most: int = LONGEST_LINE) -> str:
    """A text without breaks, control characters and lone surrogates, shortened in its middle to `most` characters."""
    line = " ".join(text.split())
    if not line.isprintable():
        line = "".join(sign if sign.isprintable() else ascii(sign)[1:-1] for sign in line)
    kept = (most - len(_LEFT_OUT)) // 2
    return line if len(line) <= most else line[:kept] + _LEFT_OUT + line[-kept:]


def one_line(error: Exception) -> str:
    """An error's own words, on one short line; those of a library may be anything."""
    if isinstance(error, MemoryError):
        return "it needs more memory than there is"
    return in_one_line(str(error), _LONGEST_REASON) or type(error).__name__


def check_installed(packages: Iterable[str], asked: str, install: str) -> None:
    """InputError where one of the packages that something asks for is not installed, or broken; imports them."""
    from solvers.base import MissingPackage, check_package

    for package in packages:
        try:
            check_package(package, asked, install)
        except MissingPackage as error:
            raise InputError(str(error)) from None


def check_numbers(named: Iterable[tuple[str, object]], *, none: bool = True) -> None:
    """InputError where a value that has a name is no number, nor None where that says something."""
    for name, value in named:
        # Asked of thousands of scenes: most values are floats.
        if type(value) is float or (none and value is None):
            continue
        if isinstance(value, bool) or not isinstance(value, Real):
            raise InputError(f"{name} is {value!r}; give a number")


def check_flags(named: Iterable[tuple[str, object]]) -> None:
    """InputError where a value that has a name is neither True nor False: a text such as "no" would count as True."""
    for name, value in named:
        # numpy, which this need not import, has truth values of its own.
        if not isinstance(value, bool) and str(getattr(value, "dtype", "")) != "bool":
            raise InputError(f"{name} is {value!r}; give True or False")


def check_whole(named: Iterable[tuple[str, object]], least: int = 0) -> None:
    """InputError where a value that has a name is no whole number, or below the least."""
    for name, value in named:
        if not isinstance(value, Real) or not (float(value) >= least and float(value).is_integer()):
            raise InputError(f"{name} is {value!r}; give a whole number from {least} on")
