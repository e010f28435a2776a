"""What fails, whether it was announced, and whether an announcement is false."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from pandas import DataFrame

from studies.random_windows.windows import LEAST_SHIFT_PX, POLARIZED_FAMILIES

NEAR_DB, ADEQUATE_DB, WORSE_DB = 3.0, 1.0, 0.1
"""Below the solve with the scene known: what a separation may lose, what a lower rung may lose to be adequate; and what
counts as worse than doing nothing."""
LITTLE_GAIN_DB, LITTLE_DETAIL = 7.0, 0.5
"""Gain on doing nothing below which noise matters, and correlation below which the reflection is hardly told."""
MUCH_NOISE = 0.02
SURE = 2.0
"""Standard errors within which the truth should lie."""
NORMAL_MEDIAN = 0.674
"""Of absolute normal errors, in standard deviations."""
SAYS_NOTHING = frozenset({"POLARIZED_SOURCE", "SATURATED", "REFLECTION_NOT_IDENTIFIABLE"})
"""Warnings that alone announce no failure of the transmission."""
RUNGS = ("none", "pixelwise", "ghosts", "perspective", "curved", "polarized")
"""From the least to the most that a scene model knows."""


def facts(row: Any) -> frozenset[str]:
    """Warnings that are true of a scene, whether or not it fails."""
    gain = row.known_transmission - row.nothing
    none_of_ours = row.moving > 0 or row.gain_error > 0 or row.angle_error_deg or row.index != row.index_told
    in_place = abs(row.shift_px) < LEAST_SHIFT_PX and row.panes == 1
    true = {
        "SATURATED": row.clipped > 0,
        "NEAR_NORMAL": row.incidence_deg < 12,
        "GRAZING": row.incidence_deg > 84,
        "POLARIZED_SOURCE": row.screen > 0 or row.sky > 0,
        # Only double images tell panes before polarized light from one another.
        "POLARIZATION_DOUBTFUL": in_place and (row.screen > 0 or row.sky > 0),
        "REFLECTION_NOT_IDENTIFIABLE": row.detail < LITTLE_DETAIL,
        "NOISE_TOO_HIGH": row.noise > MUCH_NOISE or gain < LITTLE_GAIN_DB or row.known_detail < LITTLE_DETAIL,
        "UNDERSAMPLED": gain < LITTLE_GAIN_DB or row.known_detail < LITTLE_DETAIL,
        "NO_POLARIZATION": gain < ADEQUATE_DB,
        "MODEL_DOES_NOT_EXPLAIN": none_of_ours,
        "MOVING": row.moving > 0,
        "SCENE_UNCERTAIN": row.behind > ADEQUATE_DB,
        "INDEX_DOUBTFUL": row.index != row.index_told,
    }
    return frozenset(name for name, holds in true.items() if holds)


def judged(frame: DataFrame) -> DataFrame:
    """The rows with what is to be said of each.

    Returns
    -------
    DataFrame
        With these columns as well: `nothing`, the better of intensity and minimum over angles; `behind` and
        `behind_reflection`, how far below the known scene's layers (dB); `failed`, `announced`, `silent` (a failure
        that is not announced); `worse` than nothing, and `worse_silent`; `false_alarm`; `adequate`, of the rung.
    """
    frame = frame.assign(
        nothing=np.fmax(frame.intensity, frame.minimum),
        behind=frame.known_transmission - frame.transmission,
        behind_reflection=frame.known_reflection - frame.reflection,
    )
    failed, worse = frame.behind > NEAR_DB, frame.transmission < frame.nothing - WORSE_DB
    said = [frozenset(warnings) for warnings in frame.warnings]
    announced = np.array([bool(names - SAYS_NOTHING) for names in said], bool)
    untrue = np.array([bool(names - facts(row)) for names, row in zip(said, frame.itertuples(), strict=True)], bool)
    return frame.assign(
        failed=failed,
        announced=announced,
        silent=failed & ~announced,
        worse=worse,
        worse_silent=worse & ~announced,
        false_alarm=~failed & untrue,
        adequate=[_adequate(row) for row in frame.itertuples()],
    )


def _adequate(row: Any) -> bool:
    """Whether the rung taken is the one that the scene was made with, or a lower one that does."""
    if row.rung == row.made and row.panes_found == row.panes:
        return True
    lower = RUNGS.index(row.rung) <= RUNGS.index(row.made) and row.panes_found <= row.panes
    return bool(lower and row.behind <= ADEQUATE_DB)


def numbers_found(frame: DataFrame) -> DataFrame:
    """A row for each number that was found with a standard error: name, how far away, stated, and both in one."""
    lines = [
        (row.number, row.family, row.failed, row.silent, name, away, stated)
        for row in frame.itertuples()
        for name, away, stated in zip(row.parameters, row.away, row.stated, strict=True)
        if np.isfinite(away)
    ]
    names = ["number", "family", "failed", "silent", "parameter", "away", "stated"]
    found = DataFrame(lines, columns=names)
    return found.assign(sigmas=found.away / np.maximum(found.stated, 1e-12))


def held(found: DataFrame) -> float:
    """Share of the numbers that lie within two standard errors of the truth."""
    return float((found.sigmas <= SURE).mean())


def width(found: DataFrame) -> float:
    """How much wider the stated errors are than what they describe, by medians."""
    return NORMAL_MEDIAN / max(float(found.sigmas.median()), 1e-12)


@dataclass(frozen=True)
class Target:
    """A figure that is to be reached: its words, what is needed and wished for, and how it is counted.

    `counted` gives hits and the number that they are out of; `most`: not more of them than so.
    """

    words: str
    needed: float
    wished: float
    counted: Callable[[DataFrame], tuple[int, int]]
    most: bool = False

    def reached(self, frame: DataFrame) -> bool:
        """Whether the share is as needed; of nothing all is."""
        hits, n = self.counted(frame)
        share = 100 * hits / n if n else (0 if self.most else 100)
        return share <= self.needed if self.most else share >= self.needed


def _share(flags: Any) -> tuple[int, int]:
    return int(flags.sum()), len(flags)


def _of_polarized(frame: DataFrame) -> DataFrame:
    return frame[frame.family.isin(POLARIZED_FAMILIES)]


def _errors(frame: DataFrame) -> tuple[int, int]:
    return _share(numbers_found(frame).sigmas <= SURE)


TARGETS = (
    Target("T within 3 dB of the scene known", 90, 95, lambda frame: _share(~frame.failed)),
    Target("lowest adequate rung", 90, 95, lambda frame: _share(frame.adequate)),
    Target("failures announced", 95, 99, lambda frame: _share(frame.announced[frame.failed])),
    Target("false alarms among the others", 5, 2, lambda frame: _share(frame.false_alarm[~frame.failed]), most=True),
    Target("worse than doing nothing in silence", 0, 0, lambda frame: _share(frame.worse_silent), most=True),
    Target("truths within two stated errors (of 99 % they would be too wide)", 90, 90, _errors),
    Target(
        "polarized light: T within 3 dB of the scene known", 90, 90, lambda frame: _share(~_of_polarized(frame).failed)
    ),
    Target(
        "polarized light: failures announced", 100, 100,
        lambda frame: _share(_of_polarized(frame).announced[_of_polarized(frame).failed]),
    ),
)  # fmt: skip
WIDEST = 1.5
"""Times that stated errors may be wider than what they describe."""
