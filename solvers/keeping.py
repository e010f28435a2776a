"""Where machine code is kept from one process to the next: on disk, in folders that nobody else may write to.

What numba keeps is unpickled and called: who may write it runs what they like. Importing this imports numba.
"""

from __future__ import annotations

import os
import stat
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

import numba
from numba.core.caching import FunctionCache, IndexDataCacheFile, UserWideCacheLocator

_Cache: Any = FunctionCache
_File: Any = IndexDataCacheFile
_ADMINISTRATOR = 0
# Added to the name of numba's folder in the user's own where that one is open to others.
_OURS = "-own"


class Kept(_Cache):  # type: ignore[misc]
    """What is kept of a kernel: taken as it is only where it was compiled from the same sources, by whom we trust.

    numba looks at the kernel's own file alone, although machine code of the kernels that it calls goes into its own.
    Where it cannot be read it is compiled, and where it cannot be written nothing is kept.

    Parameters
    ----------
    function : callable
        The kernel in Python.
    stamp : str
        Of all that it is compiled from.

    Raises
    ------
    RuntimeError
        There is no folder, "no locator available".
    """

    def __init__(self, function: Callable[..., Any], stamp: str) -> None:
        super().__init__(function)
        program = Path(function.__code__.co_filename)
        folder = Path(os.path.realpath(self.cache_path))
        if not is_ours(folder, program):
            folder = _own_folder(function, program)
        self._cache_path = str(folder)
        self._cache_file = _KeptFile(program, str(folder), self._impl.filename_base, stamp)

    def load_overload(self, *given: Any) -> Any:
        """As numba's; None where files cannot be read."""
        with suppress(OSError):
            return super().load_overload(*given)
        return None

    def save_overload(self, *given: Any) -> None:
        """As numba's, which may fail: on a full disk, say."""
        with suppress(OSError):
            super().save_overload(*given)


class _KeptFile(_File):  # type: ignore[misc]
    """Index and machine code of a kernel."""

    def __init__(self, program: Path, folder: str, base: str, stamp: str) -> None:
        super().__init__(cache_path=folder, filename_base=base, source_stamp=stamp)
        self._program = program
        # What another version has kept is not even unpickled: it may hold types that are no more.
        self._version: str = f"{numba.__version__}, {stamp}"

    def _load_index(self) -> Any:
        with suppress(OSError):
            if is_ours(Path(self._index_path), self._program):
                return super()._load_index()
        return {}

    def _load_data(self, name: str) -> Any:
        path = self._data_path(name)
        if not is_ours(Path(path), self._program):
            raise FileNotFoundError(path)
        return super()._load_data(name)


def is_ours(path: Path, program: Path) -> bool:
    """Whether a file or folder is ours, the administrator's or the program's owner's, and nobody else may write to it.

    Parameters
    ----------
    path : Path
    program : Path
        A file of the program: who owns it is trusted.
    """
    if not hasattr(os, "getuid"):
        return True  # Windows, where a user's folders are the user's
    trusted = {os.getuid(), _ADMINISTRATOR}
    with suppress(OSError):  # a cell of a notebook is no file
        trusted.add(program.stat().st_uid)
    try:
        found = path.lstat()
    except OSError:
        return False
    open_to_group = found.st_mode & stat.S_IWGRP and not _is_private(found.st_gid, found.st_uid)
    return found.st_uid in trusted and not open_to_group and not found.st_mode & stat.S_IWOTH


def _is_private(group: int, user: int) -> bool:
    """Whether a group is the one that many systems give each user, with the user's name and nobody else in it."""
    import grp
    import pwd

    try:
        named, of_user = grp.getgrgid(group), pwd.getpwuid(user)
    except KeyError:
        return False
    alone = named.gr_name == of_user.pw_name and set(named.gr_mem) <= {of_user.pw_name}
    return alone and of_user.pw_gid == group


def _own_folder(function: Callable[..., Any], program: Path) -> Path:
    """A folder of the user's own, which is made; RuntimeError without one."""
    with suppress(OSError):
        locator: Any = UserWideCacheLocator
        usual = Path(os.path.realpath(locator(function, str(program)).get_cache_path()))
        folder = usual.with_name(usual.name + _OURS)
        usual.parent.mkdir(parents=True, exist_ok=True)
        with suppress(FileExistsError):
            folder.mkdir(mode=0o700)
        if is_ours(folder, program) and os.access(folder, os.W_OK):
            return folder
    raise RuntimeError("no locator available: no folder that nobody else may write to")
