"""Rows of the study of speed and accuracy, their means over scenes, and the Pareto front."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from studies.ways import DEFAULT, FULL, Way

LAYERS = ("transmission", "reflection")
# What is nearer than this is as good, or as fast: repeats of the same run differ by as much.
SAME_DB = 0.01
SAME_SHARE = 0.05


@dataclass(frozen=True)
class Row:
    """One way on one scene.

    Attributes
    ----------
    part : str
        "one at a time" or "crossed".
    size, scene, pair
        The frame as "256x256", the scene's name, the pair's number.
    method, solver, start, rung, relative_change
        The way, see `studies.ways.Way`.
    transmission, reflection : float
        PSNR in dB, 16 px at the border left out.
    elapsed, cpu : tuple of float
        Seconds of every run: by the clock, and of all threads together.
    evaluations : int
    taken : str
        The rung that was taken.
    peak_mb : float
        Most memory above the photographs, 10^6 bytes; NaN where it was not measured.
    not_run : str
        Why; empty if it was.
    """

    part: str
    size: str
    scene: str
    pair: int
    method: str
    solver: str
    start: str
    rung: str
    relative_change: float
    transmission: float = math.nan
    reflection: float = math.nan
    elapsed: tuple[float, ...] = ()
    cpu: tuple[float, ...] = ()
    evaluations: int = 0
    taken: str = ""
    peak_mb: float = math.nan
    not_run: str = ""

    @property
    def way(self) -> Way:
        """What was run."""
        if self.method != FULL:
            return Way(self.method)
        return replace(
            DEFAULT, solver=self.solver, start=self.start, rung=self.rung, relative_change=self.relative_change
        )


@dataclass(frozen=True)
class Mark:
    """A way's place on a chart: means over scenes.

    Attributes
    ----------
    way : Way
    seconds, low, high : float
        Processor seconds: medians of the repeats, their least and their largest, each averaged over scenes.
    elapsed : float
        The same by the clock, median.
    transmission, reflection : float
        dB; NaN where the way shows no such layer.
    evaluations : float
    peak_mb : float
        The largest that was measured.
    """

    way: Way
    seconds: float
    low: float
    high: float
    elapsed: float
    transmission: float
    reflection: float
    evaluations: float
    peak_mb: float

    def level(self, layer: str) -> float:
        """PSNR of a layer by its name."""
        return float(getattr(self, layer))


def marks(rows: Sequence[Row]) -> list[Mark]:
    """Means of every way that ran on all scenes of these rows."""
    scenes = {(row.scene, row.pair) for row in rows}
    by_way: dict[Way, list[Row]] = {}
    for row in rows:
        if not row.not_run:
            by_way.setdefault(row.way, []).append(row)
    return [_mark(way, part) for way, part in by_way.items() if {(r.scene, r.pair) for r in part} == scenes]


def _mark(way: Way, rows: Sequence[Row]) -> Mark:
    def mean(value: Callable[[Row], float]) -> float:
        return float(np.mean([value(row) for row in rows]))

    peaks = [row.peak_mb for row in rows if not math.isnan(row.peak_mb)]
    return Mark(
        way,
        mean(lambda row: float(np.median(row.cpu))),
        mean(lambda row: min(row.cpu)),
        mean(lambda row: max(row.cpu)),
        mean(lambda row: float(np.median(row.elapsed))),
        mean(lambda row: row.transmission),
        mean(lambda row: row.reflection),
        mean(lambda row: float(row.evaluations)),
        max(peaks, default=math.nan),
    )


def front(found: Sequence[Mark], layer: str) -> list[Mark]:
    """Ways that no other blind one beats in both seconds and PSNR of a layer, the fastest first."""
    able = [mark for mark in found if mark.way.blind and not math.isnan(mark.level(layer))]
    best, chosen = -math.inf, []
    for mark in sorted(able, key=lambda mark: (mark.seconds, -mark.level(layer))):
        if mark.level(layer) > best:
            best = mark.level(layer)
            chosen.append(mark)
    return chosen


def beaten_by(found: Sequence[Mark], layers: Sequence[str]) -> list[Mark]:
    """Blind ways that beat the default: no slower and no worse in any of the layers, and clearly better in one thing.

    What differs by less than `SAME_SHARE` of the seconds or `SAME_DB` is as fast, or as good.
    """
    (default,) = (mark for mark in found if mark.way == DEFAULT)
    return [mark for mark in found if mark.way.blind and mark is not default and _beats(mark, default, layers)]


def _beats(mark: Mark, default: Mark, layers: Sequence[str]) -> bool:
    gains = [mark.level(layer) - default.level(layer) for layer in layers]
    share = mark.seconds / default.seconds
    # A layer that is not shown is NaN, and no better than any.
    no_worse = share <= 1 + SAME_SHARE and all(gain >= -SAME_DB for gain in gains)
    return no_worse and (share < 1 - SAME_SHARE or any(gain > SAME_DB for gain in gains))
