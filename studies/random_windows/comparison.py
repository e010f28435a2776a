"""Two runs over the same random scenes: what a change gained and lost.

Run ``polaropt study random_windows --families panes --from 1000 -o NEW --against OLD``: scenes that both have are told.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from pandas import DataFrame

from studies.kit.frames import frame_of, markdown
from studies.kit.records import row_of
from studies.random_windows.judging import ADEQUATE_DB, judged
from studies.random_windows.separations import Row

_VERDICTS = {
    "within 3 dB of the scene known": ("failed", False),
    "failures in silence": ("silent", True),
    "worse than doing nothing in silence": ("worse_silent", True),
    "false alarms": ("false_alarm", True),
    "adequate rungs": ("adequate", True),
}
"""Columns of `judged`, and the value that is counted."""
_KEPT = "random_windows.json"


def earlier(folder: Path) -> DataFrame:
    """Rows that an earlier run has kept, in the folder it was given or in the one it made there.

    Raises
    ------
    FileNotFoundError
        No rows in either.
    """
    path = next((path for path in _kept_in(folder) if path.exists()), None)
    if path is None:
        raise FileNotFoundError(f"{folder}: no {_KEPT} of an earlier run is there; give the folder that it wrote to")
    document = json.loads(path.read_text(encoding="utf-8"))
    return frame_of(Row, [row_of(Row, row) for row in document["results"]])


def _kept_in(folder: Path) -> tuple[Path, Path]:
    return folder / _KEPT, folder / Path(_KEPT).stem / _KEPT


def changes(old: DataFrame, new: DataFrame) -> str:
    """Verdicts on the scenes that two runs share, and each scene of which a layer or a verdict changed, as Markdown."""
    before, after = (judged(frame).set_index("number") for frame in (old, new))
    shared = [number for number in after.index if number in before.index]
    before, after = before.loc[shared], after.loc[shared]
    parts = ["# What changed", f"{len(shared)} scenes that both have."]
    if shared:
        parts += [markdown(_verdicts(before, after), "lr"), markdown(_moved(before, after), "lrrrrrl")]
    return "\n\n".join(parts)


def _verdicts(before: DataFrame, after: DataFrame) -> DataFrame:
    lines = [
        [words, *((frame[column] == value).sum() for frame in (before, after))]
        for words, (column, value) in _VERDICTS.items()
    ]
    means = [
        [f"mean {name}, dB", *(f"{frame[name].mean():.2f}" for frame in (before, after))]
        for name in ("transmission", "reflection")
    ]
    return DataFrame([*lines, *means], columns=["what", "before", "now"], dtype=object)


def _moved(before: DataFrame, after: DataFrame) -> DataFrame:
    """Scenes of which a layer moved by a decibel, or a verdict changed, the largest loss first."""
    lines = []
    for number in after.index:
        was, is_ = before.loc[number], after.loc[number]
        moves = [is_[name] - was[name] for name in ("transmission", "reflection")]
        verdict = _verdict(was, is_)
        if verdict or max(map(abs, moves)) > ADEQUATE_DB:
            layers = [f"{row[name]:.1f}" for name in ("transmission", "reflection") for row in (was, is_)]
            lines.append([min(moves), number, is_["family"], *layers, verdict or "-"])
    lines.sort(key=lambda line: line[0])
    columns = ["scene", "family", "T before", "T now", "R before", "R now", "verdict"]
    return DataFrame([line[1:] for line in lines], columns=columns, dtype=object)


def _verdict(was: Any, is_: Any) -> str:
    """Verdicts that changed, in words."""
    changed = [
        f"{'now' if is_[column] == value else 'no longer'}: {words}"
        for words, (column, value) in _VERDICTS.items()
        if was[column] != is_[column]
    ]
    return "; ".join(changed)
