"""The study of speed and accuracy as Markdown: every way, and whether the defaults lie on the front."""

from __future__ import annotations

import math
from collections.abc import Sequence

from studies.speed_accuracy_rows import LAYERS, Mark, Row, beaten_by, front, marks
from studies.ways import DEFAULT

# Of those that beat the defaults, so many are named.
_MOST = 4
_NOTE = (
    "Seconds of the processor, all threads together, mean over scenes of the medians of repeats (least to largest), "
    "torch and BLAS on one thread; those of the single-image method hold the start of an interpreter of its own. "
    "Memory: most above the photographs. Front: nothing else that is told nothing of the truth is both faster and "
    "better. A method that is told something is not on it. A rung that is asked for saves the search for it, and wins "
    "where all scenes are of its kind."
)


def tables(rows: Sequence[Row]) -> str:
    """All tables, one for each size and part."""
    parts = dict.fromkeys((row.part, row.size) for row in rows)
    found = [_table([row for row in rows if (row.part, row.size) == key], *key) for key in parts]
    return "\n\n".join([_NOTE, *found])


def _table(rows: Sequence[Row], part: str, size: str) -> str:
    found = marks(rows)
    fronts = {layer: front(found, layer) for layer in LAYERS}
    # Of several hundred ways only those of interest.
    shown = (
        found if part != "crossed" else [m for m in found if m.way == DEFAULT or any(m in f for f in fronts.values())]
    )
    (default,) = (mark for mark in found if mark.way == DEFAULT)
    lines = [
        f"### {size}, {part}: {len(found)} ways, {_scenes(rows)}",
        "",
        "| way | s | times the default | T | R | evaluations | MB | on the front of |",
        "|" + "---|" * 8,
        *(_line(mark, default, fronts) for mark in sorted(shown, key=lambda mark: mark.seconds)),
        "",
        *(f"{verdict(found, layers)}" for layers in ((LAYERS[0],), (LAYERS[1],), LAYERS)),
        *_not_run(rows),
    ]
    return "\n".join(lines)


def _scenes(rows: Sequence[Row]) -> str:
    scenes = {(row.scene, row.pair) for row in rows}
    names = ", ".join(dict.fromkeys(row.scene for row in rows))
    return f"{len(scenes)} scene{'s' if len(scenes) > 1 else ''} ({names})"


def _line(mark: Mark, default: Mark, fronts: dict[str, list[Mark]]) -> str:
    on = ", ".join(layer[0].upper() for layer in LAYERS if mark in fronts[layer])
    name = f"**{mark.way.label}**" if mark is default else mark.way.label
    levels = [_number(mark.level(layer), ".2f") for layer in LAYERS]
    spread = _seconds(mark.seconds)
    if mark.high > mark.low:
        spread += f" ({_seconds(mark.low)} to {_seconds(mark.high)})"
    return (
        f"| {name} | {spread} | {mark.seconds / default.seconds:.2f} | {levels[0]} | {levels[1]} "
        f"| {_number(mark.evaluations or math.nan, '.1f')} | {_number(mark.peak_mb, '.0f')} | {on} |"
    )


def verdict(found: Sequence[Mark], layers: Sequence[str]) -> str:
    """Whether the defaults lie on the front of these layers, and if not, what beats them by how much."""
    (default,) = (mark for mark in found if mark.way == DEFAULT)
    better = sorted(beaten_by(found, layers), key=lambda mark: mark.seconds)
    what = " and ".join(layers)
    if not better:
        return f"- {what}: the defaults are on the front."
    told = "; ".join(
        f"{mark.way.label} ({100 * (mark.seconds / default.seconds - 1):+.0f} % s, "
        + ", ".join(f"{mark.level(layer) - default.level(layer):+.2f} dB" for layer in layers)
        + ")"
        for mark in better[:_MOST]
    )
    told += f" and {len(better) - _MOST} more" if len(better) > _MOST else ""
    return f"- {what}: the defaults are beaten by {told}."


def _not_run(rows: Sequence[Row]) -> list[str]:
    reasons: dict[str, list[str]] = {}
    for row in rows:
        if row.not_run and row.way.label not in reasons.setdefault(row.not_run, []):
            reasons[row.not_run].append(row.way.label)
    return [
        f"- not run: {labels[0]}{f' and {len(labels) - 1} more' if len(labels) > 1 else ''}: {reason}"
        for reason, labels in reasons.items()
    ]


def _number(value: float, form: str) -> str:
    return "" if math.isnan(value) else f"{value:{form}}"


def _seconds(value: float) -> str:
    return f"{value:.3g}"
