"""What other packages plug in: names in groups of entry points, imported only when they are needed."""

from __future__ import annotations

import warnings
from functools import cache
from importlib.metadata import EntryPoint, entry_points
from typing import Any

from solvers.base import reason_of

SOLVERS, READERS, REGULARIZERS = "polaropt.solvers", "polaropt.readers", "polaropt.regularizers"


class PluginWarning(UserWarning):
    """Something that another package plugs in cannot be used; it is left out."""


@cache
def plugged(group: str, own: tuple[str, ...] = ()) -> dict[str, EntryPoint]:
    """Entry points of a group by name; of two with one name the first that is found, and none that has one of ours.

    Parameters
    ----------
    group : str
    own : tuple of str
        Names that stand for something of polaropt's own.

    Warns
    -----
    PluginWarning
        Something is left out for its name.
    """
    first = _first(group)
    for point in entry_points(group=group):
        if point.name in own:
            _warn(f"{_told(point)} is left out: polaropt has one of this name; it must have another")
        elif point != first[point.name]:
            _warn(f"{_told(point)} is left out: {_told(first[point.name])} has its name; remove one of the packages")
    return {name: point for name, point in first.items() if name not in own}


@cache
def _first(group: str) -> dict[str, EntryPoint]:
    """The first entry point of each name."""
    found: dict[str, EntryPoint] = {}
    for point in entry_points(group=group):
        found.setdefault(point.name, point)
    return found


def _told(point: EntryPoint) -> str:
    """An entry point by its name, its group and its package."""
    package = point.dist.name if point.dist is not None else point.module
    return f"{point.name!r} of the package {package} ({point.group})"


def _warn(sentence: str) -> None:
    # The place that is told is of no use: it is the package that must be mended.
    warnings.warn(sentence, PluginWarning, stacklevel=3)


@cache
def loaded(group: str, name: str) -> Any:
    """What an entry point names; None, with a warning, where it cannot be imported."""
    point = _first(group)[name]
    try:
        return point.load()
    except (Exception, SystemExit) as error:  # whatever the code of others raises
        _warn(f"{_told(point)} cannot be used ({reason_of(error)})")
        return None
