"""Short labels beside the points of a chart, moved aside where they would cover one another."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

# Distances in points, tried from near to far.
_REACHES = (9.0, 15.0, 22.0, 30.0, 40.0)
_DIRECTIONS = 16
_HEIGHT, _WIDTH = 9.0, 5.0
_GAP = 1.5
# Half their sizes.
_POINT, _STAR = 3.5, 7.0

Box = tuple[float, float, float, float]


def place_labels(
    axes: Any, points: Sequence[tuple[float, float, str]], stars: Sequence[tuple[float, float]] = ()
) -> None:
    """Write labels beside points (x, y, text), each on the nearest free place; those out of sight have none.

    Stars (x, y) are larger points without a label.

    The figure must have its layout.
    """
    scale = 72 / axes.figure.dpi
    shown = [(x, y, text) for x, y, text in points if _visible(axes, x, y)]
    places = [tuple(np.asarray(axes.transData.transform((x, y))) * scale) for x, y, _ in shown]
    large = [tuple(np.asarray(axes.transData.transform(star)) * scale) for star in stars]
    taken = [_around(place, _POINT) for place in places] + [_around(place, _STAR) for place in large]
    for (x, y, text), place in zip(shown, places, strict=True):
        offset, box = _free(place, text, taken)
        taken.append(box)
        far = math.hypot(*offset) > _REACHES[0] + 1
        axes.annotate(
            text, (x, y), xytext=offset, textcoords="offset points", fontsize=7.5, ha="center", va="center", zorder=8,
            arrowprops={"arrowstyle": "-", "linewidth": 0.4, "shrinkA": 0, "shrinkB": 0} if far else None,
        )  # fmt: skip


def _visible(axes: Any, x: float, y: float) -> bool:
    (left, right), (bottom, top) = axes.get_xlim(), axes.get_ylim()
    return bool(left <= x <= right and bottom <= y <= top)


def _free(place: tuple[float, ...], text: str, taken: Sequence[Box]) -> tuple[tuple[float, float], Box]:
    """The offset of least overlap, the nearest of them, and the box it makes."""
    tried = []
    for reach in _REACHES:
        for turn in range(_DIRECTIONS):
            angle = 2 * math.pi * (turn / _DIRECTIONS + 0.25)
            offset = (reach * math.cos(angle), reach * math.sin(angle))
            box = _box(place, offset, text)
            overlap = sum(_overlap(box, other) for other in taken)
            if overlap == 0:
                return offset, box
            tried.append((overlap, offset, box))
    _, offset, box = min(tried)
    return offset, box


def _around(place: tuple[float, ...], half: float) -> Box:
    return (place[0] - half, place[1] - half, place[0] + half, place[1] + half)


def _box(place: tuple[float, ...], offset: tuple[float, float], text: str) -> Box:
    x, y = place[0] + offset[0], place[1] + offset[1]
    half = (_WIDTH * len(text) / 2 + _GAP, _HEIGHT / 2)
    return (x - half[0], y - half[1], x + half[0], y + half[1])


def _overlap(first: Box, second: Box) -> float:
    width = min(first[2], second[2]) - max(first[0], second[0])
    height = min(first[3], second[3]) - max(first[1], second[1])
    return max(width, 0.0) * max(height, 0.0)
