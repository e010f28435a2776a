"""Files to bytes."""

from __future__ import annotations

import os
import stat
from os import PathLike
from pathlib import Path

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
