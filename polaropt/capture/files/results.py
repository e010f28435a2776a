"""Results that appear all together or not at all.

A run writes into a temporary folder on the same file system and renames what it made when everything is there. A run
that fails or is interrupted leaves the previous output as it was and nothing of its own. What a killed run has left is
found by the next one in the same place, as nobody holds its lock any more: an exchange of files that had begun is
finished, so that all files are of one run, and the folder is removed.
"""

from __future__ import annotations

import errno
import json
import os
import secrets
import shutil
import stat
import tempfile
import time
from collections.abc import Collection, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from polaropt.capture.files.opening import read_json
from polaropt.errors import NO_ROOM, InputError

_PREFIX, _NAME_BYTES = ".polaropt-", 8
"""Of the names of temporary folders, and the random bytes behind it, so many that no two runs take the same."""
_PREVIOUS = "previous-"
_EXCHANGE = "polaropt-exchange.json"
"""File of a temporary folder that names what is exchanged, from when all of it is there."""
_FOLDERS = (".zarr",)
"""Endings of results that are folders."""
_NOTHING_FREE = 2**20
"""Bytes of a disk that is as good as full; set by hand."""
_SETTLED_SECONDS = 10.0
"""How old a folder is before it can count as left: its run has long taken its lock. Set by hand."""


@contextmanager
def result_folder(target: Path, owned: Collection[str] = ()) -> Iterator[Path]:
    """Folder to write results into; they appear in `target` together when the block ends without an error.

    Parameters
    ----------
    target : Path
        Made if it does not exist. In an existing folder files of the same names are replaced, all others stay.
    owned : collection of str
        Names that belong to the results as a whole, folders included: those that an earlier run has left and this one
        does not write are removed.

    Yields
    ------
    Path
        A temporary folder, made at once: a place that cannot be written is an error before any work is done.

    Raises
    ------
    InputError
        `target` is a file, or cannot be written.
    """
    work, lock = _temporary_place(target), None
    # Made inside: a signal may end the run between any two lines.
    try:
        with _failures_of(target):
            work.mkdir(mode=0o700)
        lock = _locked(work)
        with _full(target, work):
            yield work
        with _failures_of(target):
            _publish(work, target, owned)
    finally:
        shutil.rmtree(work, ignore_errors=True)
        if lock is not None:
            os.close(lock)


@contextmanager
def result_file(target: Path) -> Iterator[Path]:
    """As `result_folder` for one file: yields a temporary path with the same suffix."""
    if target.is_dir():
        raise InputError(f"{target}: is a folder; give the name of a file")
    with result_folder(target.absolute().parent) as work:
        yield work / target.name


def _temporary_place(target: Path) -> Path:
    """Of a new folder in `target` if it exists, else in the nearest one above: on the same file system either way."""
    place = target.absolute()
    while not os.path.lexists(place):
        place = place.parent
    if not place.is_dir():
        what = "is no folder" if place == target.absolute() else f"cannot be made, {place} is no folder"
        raise InputError(f"{target}: {what}; choose another output folder")
    _clear(place)
    return place / f"{_PREFIX}{secrets.token_hex(_NAME_BYTES)}"


@contextmanager
def _full(target: Path, work: Path) -> Iterator[None]:
    """InputError where what is written into a folder finds no place."""
    try:
        yield
    except OSError as error:
        # Some libraries say only how much of it was written.
        if error.errno not in NO_ROOM and (error.errno is not None or shutil.disk_usage(work).free > _NOTHING_FREE):
            raise
        reason = error.strerror or os.strerror(errno.ENOSPC)
        raise InputError(
            f"{target}: cannot be written ({reason}); make room, or choose another output folder"
        ) from None


@contextmanager
def _failures_of(target: Path) -> Iterator[None]:
    try:
        yield
    except OSError as error:
        reason = error.strerror or type(error).__name__
        raise InputError(f"{target}: cannot be written ({reason}); choose another output folder") from None


def _publish(work: Path, target: Path, owned: Collection[str]) -> None:
    if target.exists():
        _replace_files(work, target, owned)
        return
    target.absolute().parent.mkdir(parents=True, exist_ok=True)
    # Temporary folders are private; results are as open as any new folder.
    mask = os.umask(0)
    os.umask(mask)
    work.chmod(0o777 & ~mask)
    work.rename(target)


def _locked(work: Path) -> int | None:
    """Lock a folder; None where another process has, or where there are no locks."""
    try:
        import fcntl

        place = os.open(work, os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW)
    except (ImportError, OSError):  # Windows, or gone
        return None
    try:
        fcntl.flock(place, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        os.close(place)
        return None
    return place


def _clear(place: Path) -> None:
    """Finish and remove what runs of ours left in a folder when they were killed."""
    with suppress(OSError):
        for left in [entry for entry in os.scandir(place) if entry.name.startswith(_PREFIX)]:
            told = left.stat(follow_symlinks=False)
            young = time.time() - told.st_ctime < _SETTLED_SECONDS
            if young or not stat.S_ISDIR(told.st_mode) or not _is_mine(told.st_uid):
                continue
            lock = _locked(Path(left.path))
            if lock is None:
                continue
            try:
                _finish(Path(left.path), place)
                shutil.rmtree(left.path, ignore_errors=True)
            finally:
                os.close(lock)


def _is_mine(user: int) -> bool:
    return not hasattr(os, "geteuid") or user == os.geteuid()


def _finish(work: Path, target: Path) -> None:
    """Go on with an exchange that was broken off; nothing where it had not begun."""
    try:
        exchange = read_json(work / _EXCHANGE)
        names, stale = ([str(name) for name in exchange[key]] for key in ("names", "stale"))
    except (ValueError, KeyError, TypeError):
        return
    if any(Path(name).name != name for name in (*names, *stale)):
        return
    previous = Path(tempfile.mkdtemp(prefix=_PREVIOUS, dir=work))
    for name in names:
        if os.path.lexists(work / name):
            _exchange(work / name, target / name, previous / name)
    for name in stale:
        if os.path.lexists(target / name):
            (target / name).rename(previous / name)


def _exchange(new: Path, old: Path, previous: Path) -> None:
    """Put a file or folder in the place of another, which is kept; a file is there at every moment."""
    if os.path.lexists(old):
        try:
            os.link(old, previous, follow_symlinks=False)
        except OSError:  # a folder, or a file system without links
            old.rename(previous)
    new.rename(old)


def _replace_files(work: Path, target: Path, owned: Collection[str]) -> None:
    """Exchange file by file, and undo everything if one of them fails."""
    names = [path.name for path in work.iterdir()]
    # A folder of a file's name is somebody else's.
    gone = (target / name for name in owned if name not in names)
    stale = [path.name for path in gone if path.exists() and (path.suffix in _FOLDERS or not path.is_dir())]
    for name in names:
        if (target / name).is_dir() and not (name in owned and (work / name).is_dir()):
            raise InputError(f"{target / name}: is a folder where a file must go; choose another output folder")
    previous = Path(tempfile.mkdtemp(prefix=_PREVIOUS, dir=work))
    begun = work / f"{_EXCHANGE}.part"
    begun.write_text(json.dumps({"names": names, "stale": stale}), encoding="utf-8")
    begun.rename(work / _EXCHANGE)
    try:
        for name in names:
            _exchange(work / name, target / name, previous / name)
        for name in stale:
            (target / name).rename(previous / name)
    except BaseException:
        for name in stale:
            if (previous / name).exists():
                (previous / name).rename(target / name)
        for name in names:
            if not (work / name).exists():
                (target / name).rename(work / name)
            if (previous / name).exists():
                (previous / name).rename(target / name)
        raise
