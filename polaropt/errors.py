"""The one error that a person's input can cause, and how errors are told."""

from __future__ import annotations


class ResultWarning(UserWarning):
    """A result that is not to be trusted as it is; its text is what `SeparationWarning` says of it.

    Issued by `polaropt.separate` where its diagnostics hold warnings. The command line prints these itself.

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

    The command line prints that line and ends with exit code 2.

    Examples
    --------
    >>> from polaropt import InputError, read_capture
    >>> try:
    ...     read_capture("nowhere.png")
    ... except InputError as error:
    ...     print(error)
    nowhere.png: no such file; check the name
    """


def one_line(error: Exception) -> str:
    """An error's own words, on one line."""
    words = " ".join(str(error).split()) or type(error).__name__
    return words if len(words) <= 120 else words[:117] + "..."
