"""Files to bytes."""

from __future__ import annotations

import json
import os
import stat
from os import PathLike
from pathlib import Path
from typing import Any

from polaropt.errors import InputError, one_line

AnyPath = str | PathLike[str]


def bytes_of(path: Path, most: int) -> bytes:
    """All bytes of a regular file, of which there may be so many."""
    try:
        # Without waiting for the other end of a pipe.
        with open(path, "rb", opener=lambda name, flags: os.open(name, flags | getattr(os, "O_NONBLOCK", 0))) as file:
            told = os.fstat(file.fileno())
            if not stat.S_ISREG(told.st_mode):
                raise InputError(f"{path}: is no file but a device or a pipe; give a file")
            if told.st_size > most:
                raise InputError(f"{path}: has {told.st_size} bytes, more than {most}; give --max-pixels if it is one")
            return file.read()
    except FileNotFoundError:
        raise InputError(f"{path}: no such file; check the name") from None
    except IsADirectoryError:
        raise InputError(f"{path}: is a folder; give the image files in it") from None
    except InputError:
        raise
    except (OSError, ValueError, MemoryError) as error:
        reason = getattr(error, "strerror", None) or one_line(error)
        raise InputError(f"{path}: cannot be opened ({reason})") from None


_LONGEST_TEXT = 2**26
"""Bytes of a text such as a report or a calibration; set by hand."""


def read_json(path: Path) -> Any:
    """What a JSON file says.

    Raises
    ------
    InputError
        It cannot be opened.
    ValueError
        It is no JSON, or nested deeper than anything of ours.
    """
    return parsed_json(bytes_of(path, _LONGEST_TEXT))


def parsed_json(data: bytes) -> Any:
    """What JSON says; ValueError for what is none, or nested deeper than anything of ours."""
    try:
        return json.loads(data.decode("utf-8"))
    except RecursionError:
        raise ValueError("nested too deeply") from None
