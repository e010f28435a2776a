"""Performance profiles (Dolan & More, Mathematical Programming 91, 2002): how often a way is how near the fastest."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from studies.speed_accuracy_rows import LAYERS, Row
from studies.ways import DEFAULT, KNOWN, Way

SOLVED_DB = 0.25
"""A scene is solved where both layers are as near as this to the best that any way of the same profile reaches."""
FACTORS = ("solver", "start", "rung", "tolerance", "method")


def compared(rows: Sequence[Row], factor: str) -> list[Way]:
    """The default first, then the ways that differ from it in one setting; none that is told the scene."""
    ways = dict.fromkeys(row.way for row in rows)
    others = [way for way in ways if way.factor == factor and way.rung != KNOWN]
    return [DEFAULT, *others]


def ratios(rows: Sequence[Row], ways: Sequence[Way]) -> dict[Way, NDArray[np.float64]]:
    """Seconds of each way over those of the fastest that solves the scene, by scene; infinite where it is not solved.

    Scenes are told apart by size, name and pair.
    """
    scenes = dict.fromkeys((row.size, row.scene, row.pair) for row in rows)
    by_scene: dict[tuple[str, str, int], dict[Way, Row]] = {scene: {} for scene in scenes}
    for row in rows:
        if not row.not_run:
            by_scene[row.size, row.scene, row.pair][row.way] = row
    found = [_ratios_of({way: one[way] for way in ways if way in one}, ways) for one in by_scene.values()]
    return {way: np.array([one[way] for one in found]) for way in ways}


def _ratios_of(rows: dict[Way, Row], ways: Sequence[Way]) -> dict[Way, float]:
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
