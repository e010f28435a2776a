"""Files to bytes."""

from __future__ import annotations

from os import PathLike
from pathlib import Path

from polaropt.errors import InputError, one_line

AnyPath = str | PathLike[str]


def bytes_of(path: Path) -> bytes:
    try:
        return path.read_bytes()
    except FileNotFoundError:
        raise InputError(f"{path}: no such file; check the name") from None
    except IsADirectoryError:
        raise InputError(f"{path}: is a folder; give the image files in it") from None
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or one_line(error)
        raise InputError(f"{path}: cannot be opened ({reason})") from None
