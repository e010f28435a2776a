"""Results to disk, whole or not at all.

A run writes into a temporary folder on the same file system and renames what it made when everything is there. A run
that fails or is interrupted leaves the previous output as it was and nothing of its own.
"""

from __future__ import annotations

import os
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from polaropt.errors import InputError

_PREFIX = ".polaropt-"


@contextmanager
def result_folder(target: Path) -> Iterator[Path]:
    """Folder to write results into; they appear in `target` together when the block ends without an error.

    Parameters
    ----------
    target : Path
        Made if it does not exist. In an existing folder files of the same names are replaced, all others stay.

    Yields
    ------
    Path
        A temporary folder, made at once: a place that cannot be written is an error before any work is done.

    Raises
    ------
    InputError
        `target` is a file, or cannot be written.
    """
    work = _temporary_folder(target)
    try:
        yield work
        with _failures_of(target):
            _publish(work, target)
    finally:
        shutil.rmtree(work, ignore_errors=True)


@contextmanager
def result_file(target: Path) -> Iterator[Path]:
    """As `result_folder` for one file: yields a temporary path with the same suffix."""
    if target.is_dir():
        raise InputError(f"{target}: is a folder; give the name of a file")
    with result_folder(target.absolute().parent) as work:
        yield work / target.name


def _temporary_folder(target: Path) -> Path:
    """In `target` if it exists, else in the nearest folder above it that does: the same file system either way."""
    place = target.absolute()
    while not os.path.lexists(place):
        place = place.parent
    if not place.is_dir():
        what = "is no folder" if place == target.absolute() else f"cannot be made, {place} is no folder"
        raise InputError(f"{target}: {what}; choose another output folder")
    with _failures_of(target):
        return Path(tempfile.mkdtemp(prefix=_PREFIX, dir=place))


@contextmanager
def _failures_of(target: Path) -> Iterator[None]:
    try:
        yield
    except OSError as error:
        reason = error.strerror or type(error).__name__
        raise InputError(f"{target}: cannot be written ({reason}); choose another output folder") from None


def _publish(work: Path, target: Path) -> None:
    if target.exists():
        _replace_files(work, target)
        return
    target.absolute().parent.mkdir(parents=True, exist_ok=True)
    # Temporary folders are private; results are as open as any new folder.
    mask = os.umask(0)
    os.umask(mask)
    work.chmod(0o777 & ~mask)
    work.rename(target)


def _replace_files(work: Path, target: Path) -> None:
    """Exchange file by file, and undo everything if one of them fails."""
    names = [path.name for path in work.iterdir()]
    previous = Path(tempfile.mkdtemp(prefix="previous-", dir=work))
    try:
        for name in names:
            if (target / name).is_dir():
                raise InputError(f"{target / name}: is a folder where a file must go; choose another output folder")
            if (target / name).exists():
                (target / name).rename(previous / name)
            (work / name).rename(target / name)
    except BaseException:
        for name in names:
            if not (work / name).exists():
                (target / name).unlink(missing_ok=True)
            if (previous / name).exists():
                (previous / name).rename(target / name)
        raise
