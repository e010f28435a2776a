"""The course of a solve as a small chart (SVG) that takes its colours from the page around it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

_WIDTH, _HEIGHT = 640, 260
_LEFT, _RIGHT, _TOP, _BOTTOM = 84, 16, 14, 44
_MOST_MARKERS = 60
_TICKS = 5
# Values over more than this ratio need a logarithmic axis.
_WIDE = 20.0


@dataclass(frozen=True)
class Tick:
    """Where on the chart, and what it says there."""

    place: float
    text: str


@dataclass(frozen=True)
class Chart:
    """Values over evaluations, in the coordinates of a drawing of `width` by `height`.

    Attributes
    ----------
    points : tuple of (float, float)
        x and y of each evaluation.
    best : (float, float)
        Of the least value.
    across, up : tuple of Tick
    logarithmic : bool
    """

    points: tuple[tuple[float, float], ...]
    best: tuple[float, float]
    across: tuple[Tick, ...]
    up: tuple[Tick, ...]
    logarithmic: bool
    width: int = _WIDTH
    height: int = _HEIGHT
    left: int = _LEFT
    right: int = _WIDTH - _RIGHT
    top: int = _TOP
    bottom: int = _HEIGHT - _BOTTOM

    @property
    def line(self) -> str:
        """The points as SVG wants them."""
        return " ".join(f"{x:.1f},{y:.1f}" for x, y in self.points)

    @property
    def markers(self) -> tuple[tuple[float, float], ...]:
        """Points to mark: all where they are few."""
        return self.points if len(self.points) <= _MOST_MARKERS else ()


def convergence_chart(values: Sequence[float]) -> Chart | None:
    """Chart of the objective's values, one per evaluation; None for fewer than two.

    Parameters
    ----------
    values : sequence of float
        Finite.
    """
    if len(values) < 2:
        return None
    least, most = min(values), max(values)
    logarithmic = least > 0 and most > _WIDE * least
    of = math.log10 if logarithmic else float
    low, high = of(least), of(most)
    span = (high - low) or abs(high) or 1.0
    last = len(values) - 1

    def x(i: float) -> float:
        return _LEFT + (_WIDTH - _LEFT - _RIGHT) * i / last

    def y(value: float) -> float:
        return _HEIGHT - _BOTTOM - (_HEIGHT - _BOTTOM - _TOP) * (of(value) - low) / span

    points = tuple((x(i), y(value)) for i, value in enumerate(values))
    levels = [10**level for level in round_steps(low, high)] if logarithmic else round_steps(low, high)
    counts = [count for count in round_steps(1, len(values)) if count == int(count)]
    return Chart(
        points=points,
        best=points[list(values).index(least)],
        across=tuple(Tick(x(count - 1), f"{count:g}") for count in counts),
        up=tuple(Tick(y(level), _said(level)) for level in levels),
        logarithmic=logarithmic,
    )


def _said(level: float) -> str:
    return f"{level:,.0f}" if 1000 <= abs(level) < 1e8 else f"{level:.4g}"


def round_steps(low: float, high: float) -> list[float]:
    """About five round numbers from `low` to `high`, 1, 2 or 5 times a power of ten apart."""
    if high <= low:
        return [low]
    rough = (high - low) / _TICKS
    power = 10.0 ** math.floor(math.log10(rough))
    step = next(factor * power for factor in (1, 2, 5, 10) if factor * power >= rough * (1 - 1e-9))
    first, last = math.ceil(low / step - 1e-9), math.floor(high / step + 1e-9)
    return [k * step for k in range(first, last + 1)]
