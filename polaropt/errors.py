"""The one error that a person's input can cause."""

from __future__ import annotations


class InputError(ValueError):
    """What came from a file or a person cannot be used; its text is one line: what is wrong, and what to do.

    The command line prints that line and ends with exit code 2.
    """
