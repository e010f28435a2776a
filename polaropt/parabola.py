"""Minimum of a function of one variable that is costly and a little rough: parabolas through three points."""

from __future__ import annotations

import math
from collections.abc import Callable

_CLOSER = 0.35
_MOST_MOVES = 4


def local_minimum(
    value: Callable[[float], float], start: float, bounds: tuple[float, float], step: float, tolerance: float
) -> float:
    """Minimum near a start, from points `step` apart and then ever closer, down to `tolerance`.

    Nothing is evaluated outside the bounds, nor twice.
    """
    known: dict[float, float] = {}

    def at(x: float) -> float:
        if x not in known:
            known[x] = value(x) if bounds[0] <= x <= bounds[1] else math.inf
        return known[x]

    best, moves = min(max(start, bounds[0]), bounds[1]), 0
    while step > tolerance:
        before, here, after = (at(best + shift) for shift in (-step, 0.0, step))
        if min(before, after) < here and moves < _MOST_MOVES:
            best, moves = best + (step if after < before else -step), moves + 1
            continue
        at(best + step * vertex(before, here, after))
        best, step = min(known, key=at), step * _CLOSER
    return best


def vertex(before: float, here: float, after: float, farthest: float = 1.0) -> float:
    """Where the parabola through three equally spaced values is least, from the middle, in units of the spacing."""
    curvature = before - 2 * here + after
    if not 0 < curvature < math.inf:
        return 0.0
    return min(max((before - after) / (2 * curvature), -farthest), farthest)
