"""Where ways stand between seconds and accuracy: means over scenes, the Pareto front, and performance profiles."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pandas import DataFrame

from studies.kit.frames import values_of
from studies.scenes import Sensor
from studies.scores import LAYERS
from studies.ways import DEFAULT, FULL, KNOWN, Way

# What is nearer than this is as good, or as fast: repeats of the same run differ by as much.
SAME_DB = 0.01
SAME_SHARE = 0.05
SOLVED_DB = 0.25
"""A scene is solved where both layers are as near as this to the best that any way of the same profile reaches."""
FACTORS = ("solver", "start", "rung", "tolerance", "method")
ONE, CROSSED, ON_GPU = "one at a time", "crossed", "on a GPU"
"""Parts of the study."""
SUBJECTS: dict[Sensor, str] = {
    "": "four full photographs",
    "mono": "raw mosaic of a mono sensor",
    "color": "raw mosaic of a colour sensor",
}
"""What a scene is seen as, by the sensor."""


def with_ways(frame: DataFrame) -> DataFrame:
    """The rows with one more column: the way as `studies.ways` has it."""
    return frame.assign(way=[_way(row) for row in frame.itertuples()])


def _way(row: Any) -> Way:
    if row.method != FULL:
        return Way(row.method)
    settings = ("solver", "start", "rung", "relative_change", "resolution", "device")
    return replace(DEFAULT, **{name: getattr(row, name) for name in settings})


def scenes_of(frame: DataFrame) -> list[tuple[str, str, int]]:
    """Size, name and pair of each scene."""
    return values_of(frame, "size", "scene", "pair")


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


def marks(frame: DataFrame) -> list[Mark]:
    """Means of every way that ran on all scenes of these rows."""
    scenes = set(scenes_of(frame))
    by_way = frame[frame.not_run == ""].groupby("way", sort=False)
    return [_mark(way, part) for way, part in by_way if set(scenes_of(part)) == scenes]


def _mark(way: Way, part: DataFrame) -> Mark:
    columns = [part.cpu.map(np.median), part.cpu.map(min), part.cpu.map(max), part.elapsed.map(np.median),
               part.transmission, part.reflection, part.evaluations]  # fmt: skip
    return Mark(way, *(float(np.mean(column.to_numpy())) for column in columns), float(part.peak_mb.max()))


def paired(frame: DataFrame) -> list[Mark]:
    """Every way against the default on the same scenes, of all sizes: seconds over its seconds, decibels above its own.

    Seconds are geometric means, PSNR are means; of ways that ran wherever they were tried.
    """
    keys = ["size", "scene", "pair"]
    columns = [*keys, *LAYERS, "cpu", "elapsed"]
    default = frame.loc[frame.way == DEFAULT, columns]
    tried = {way: part for way, part in frame.groupby("way", sort=False) if (part.not_run == "").all()}
    return [_pair(way, part.merge(default, on=keys, suffixes=("", "_default"))) for way, part in tried.items()]


def _pair(way: Way, both: DataFrame) -> Mark:
    def ratio(name: str, of: Callable[..., Any]) -> float:
        return float(np.exp(np.mean(np.log((both[name].map(of) / both[f"{name}_default"].map(np.median)).to_numpy()))))

    seconds = [ratio("cpu", of) for of in (np.median, min, max)]
    gains = [float((both[layer] - both[f"{layer}_default"]).mean()) for layer in LAYERS]
    evaluations, peak = float(both.evaluations.mean()), float(both.peak_mb.max())
    return Mark(way, *seconds, ratio("elapsed", np.median), *gains, evaluations, peak)


def front(found: Sequence[Mark], layer: str) -> list[Mark]:
    """Ways that no other blind one beats in both seconds and PSNR of a layer, the fastest first."""
    able = [mark for mark in found if mark.way.blind and not math.isnan(mark.level(layer))]
    best, chosen = -math.inf, []
    for mark in sorted(able, key=lambda mark: (mark.seconds, -mark.level(layer))):
        if mark.level(layer) > best:
            best = mark.level(layer)
            chosen.append(mark)
    return chosen


def default_of(found: Iterable[Mark]) -> Mark:
    """The mark of the defaults."""
    return next(mark for mark in found if mark.way == DEFAULT)


def beaten_by(found: Sequence[Mark], layers: Sequence[str]) -> list[Mark]:
    """Blind ways that beat the default: no slower and no worse in any of the layers, and clearly better in one thing.

    What differs by less than `SAME_SHARE` of the seconds or `SAME_DB` is as fast, or as good.
    """
    default = default_of(found)
    return [mark for mark in found if mark.way.blind and mark is not default and _beats(mark, default, layers)]


def _beats(mark: Mark, default: Mark, layers: Sequence[str]) -> bool:
    gains = [mark.level(layer) - default.level(layer) for layer in layers]
    share = mark.seconds / default.seconds
    # A layer that is not shown is NaN, and no better than any.
    no_worse = share <= 1 + SAME_SHARE and all(gain >= -SAME_DB for gain in gains)
    return no_worse and (share < 1 - SAME_SHARE or any(gain > SAME_DB for gain in gains))


# Performance profiles (Dolan & More, Mathematical Programming 91, 2002): how often a way is how near the fastest.


def compared(frame: DataFrame, factor: str) -> list[Way]:
    """The default first, then the ways that differ from it in one setting; none that is told the scene.

    Another resolution stands among the methods.
    """
    factors = (factor, "resolution") if factor == "method" else (factor,)
    others = [way for way in values_of(frame, "way") if way.factor in factors and way.rung != KNOWN]
    return [DEFAULT, *others]


def ratios(frame: DataFrame, ways: Sequence[Way]) -> dict[Way, NDArray[np.float64]]:
    """Seconds of each way over those of the fastest that solves the scene, by scene; infinite where it is not solved.

    Scenes are told apart by size, name and pair. Of large ones, where not all of the ways were tried, nothing is said.
    """
    frame = frame[frame.way.isin(ways)]
    tried = Counter(frame[["size", "scene", "pair"]].itertuples(index=False, name=None))
    by_scene: dict[tuple[str, str, int], dict[Way, Any]] = {
        scene: {} for scene in scenes_of(frame) if tried[scene] == len(ways)
    }
    for row in frame[frame.not_run == ""].itertuples():
        if (row.size, row.scene, row.pair) in by_scene:
            by_scene[row.size, row.scene, row.pair][row.way] = row
    found = [_ratios_of(rows, ways) for rows in by_scene.values()]
    return {way: np.array([one[way] for one in found]) for way in ways}


def _ratios_of(rows: dict[Way, Any], ways: Sequence[Way]) -> dict[Way, float]:
    best = [max((getattr(row, layer) for row in rows.values()), default=math.nan) for layer in LAYERS]
    seconds = {
        way: float(np.median(row.cpu))
        for way, row in rows.items()
        if all(getattr(row, layer) >= level - SOLVED_DB for layer, level in zip(LAYERS, best, strict=True))
    }
    fastest = min(seconds.values(), default=math.inf)
    return {way: seconds[way] / fastest if way in seconds else math.inf for way in ways}


def share_within(ratio: NDArray[np.float64], factors: NDArray[np.float64]) -> NDArray[np.float64]:
    """Share of the scenes solved within these factors of the fastest way's seconds."""
    return np.asarray((ratio[None, :] <= factors[:, None]).mean(axis=1))
