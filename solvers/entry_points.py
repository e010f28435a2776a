"""What other packages plug in: names in groups of entry points, imported only when they are needed."""

from __future__ import annotations

import warnings
from functools import cache
from importlib.metadata import EntryPoint, entry_points
from typing import Any

SOLVERS, READERS, REGULARIZERS = "polaropt.solvers", "polaropt.readers", "polaropt.regularizers"


class PluginWarning(UserWarning):
    """Something that another package plugs in cannot be used; it is left out."""


@cache
def plugged(group: str) -> dict[str, EntryPoint]:
    """Entry points of a group by name; of two with one name the first that is found."""
    found: dict[str, EntryPoint] = {}
    for point in entry_points(group=group):
        found.setdefault(point.name, point)
    return found


@cache
def loaded(group: str, name: str) -> Any:
    """What an entry point names; None, with a warning, where it cannot be imported."""
    point = plugged(group)[name]
    try:
        return point.load()
    except (Exception, SystemExit) as error:  # whatever the code of others raises
        package = point.dist.name if point.dist is not None else point.module
        told = " ".join(str(error).split())
        reason = told if told.isprintable() and told else ascii(told)[1:-1] or type(error).__name__
        # The place that is told is of no use: it is the package that must be mended.
        warnings.warn(f"{name!r} of the package {package} cannot be used ({reason})", PluginWarning, stacklevel=2)
        return None
