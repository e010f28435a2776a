"""Tables of seconds against accuracy: whether the defaults lie on the front, what beats them, and every way."""

from __future__ import annotations

import math
from collections.abc import Sequence

from pandas import DataFrame

from studies.kit.frames import markdown, values_of, where
from studies.scores import LAYERS
from studies.speed_accuracy.marks import (
    CROSSED,
    ONE,
    SAME_DB,
    SAME_SHARE,
    SUBJECTS,
    Mark,
    beaten_by,
    default_of,
    front,
    marks,
    paired,
    scenes_of,
    with_ways,
)
from studies.ways import DEFAULT

# Of those that beat the defaults, so many are named.
_MOST = 4
_NOTE = (
    "Seconds of the processor, all threads together, mean over scenes of the medians of repeats (least to largest), "
    "torch and BLAS on one thread; those of a mosaic begin with the raw samples, those of the single-image method hold "
    "the start of an interpreter of its own. PSNR in dB; of a mosaic in all pixels of its sensor, to which layers of "
    "cells are enlarged by cubic splines. Memory: most above the photographs. Front: nothing else that is told nothing "
    "of the truth is both faster and better. A method that is told something is not on it. A rung that is asked for "
    "saves the search for it, and wins where all scenes are of its kind. Photographs are mirrored where they end, "
    "which fills the large frames."
)
_VERDICT_NOTE = (
    "The defaults are beaten by what is no slower and no worse, and clearly better in one thing: seconds within "
    f"{100 * SAME_SHARE:.0f} % are as fast, PSNR within {SAME_DB:g} dB is as good. Named is what gains most."
)
_PAIRED_NOTE = (
    "Each way is paired with the default on the scenes that it was tried on, of all sizes and one setting at a time: "
    "geometric mean of the ratios of seconds, means of the gains in dB. What failed on one of them is left out."
)
_BOTH: tuple[tuple[str, Sequence[str]], ...] = (("T", LAYERS[:1]), ("R", LAYERS[1:]), ("both", LAYERS))


def tables(frame: DataFrame) -> str:
    """Whether the defaults are on the front, then every way; a table for each part, subject and size."""
    frame = with_ways(frame)
    kinds = values_of(frame, "part", "sensor", "size")
    parts = [where(frame, part=part, sensor=sensor, size=size) for part, sensor, size in kinds]
    each = [_table(part, *kind) for part, kind in zip(parts, kinds, strict=True)]
    every = where(frame, part=ONE)
    of_subjects = [where(every, sensor=sensor) for sensor in values_of(every, "sensor")]
    together = [_paired_table(part) for part in of_subjects]
    return "\n\n".join([_NOTE, _summary(of_subjects, parts), _PAIRED_NOTE, *together, *each])


def _summary(of_subjects: Sequence[DataFrame], parts: Sequence[DataFrame]) -> str:
    lines = [_answers(part, "all sizes", paired(part)) for part in of_subjects]
    lines += [_answers(part, part.iloc[0]["size"], marks(part)) for part in parts]
    heading = ["photographs", "size", "ways", "scenes", *(f"{name}: on the front" for name, _ in _BOTH)]
    table = markdown(DataFrame(lines, columns=heading))
    return f"### Are the defaults on the front?\n\n{_VERDICT_NOTE}\n\n{table}"


def _answers(part: DataFrame, size: str, found: Sequence[Mark]) -> list[str]:
    first = part.iloc[0]
    answers = (answer(found, layers) for _, layers in _BOTH)
    return [SUBJECTS[first.sensor], size, f"{len(found)}, {first.part}", str(len(scenes_of(part))), *answers]


def _paired_table(frame: DataFrame) -> str:
    found = sorted(paired(frame), key=lambda mark: mark.seconds)
    n_scenes = frame.groupby("way", sort=False).size()
    lines = [
        [
            f"**{mark.way.label}**" if mark.way == DEFAULT else mark.way.label,
            str(n_scenes[mark.way]),
            f"{mark.seconds:.2f}",
            *(_number(mark.level(layer), "+.2f") for layer in LAYERS),
        ]
        for mark in found
    ]
    table = markdown(DataFrame(lines, columns=["way", "scenes", "times the default", "T gained", "R gained"]))
    return f"### {SUBJECTS[frame.iloc[0].sensor]}, all sizes against the defaults\n\n{table}"


def answer(found: Sequence[Mark], layers: Sequence[str]) -> str:
    """Whether the defaults lie on the front of these layers, and if not, which way gains most."""
    default = default_of(found)
    better = beaten_by(found, layers)
    if not better:
        return "yes"
    best = max(better, key=lambda mark: sum(mark.level(layer) - default.level(layer) for layer in layers))
    return f"no: {_gain(best, default, layers)}" + (f" and {len(better) - 1} more" if len(better) > 1 else "")


def _gain(mark: Mark, default: Mark, layers: Sequence[str]) -> str:
    decibels = ", ".join(f"{mark.level(layer) - default.level(layer):+.2f} dB" for layer in layers)
    return f"{mark.way.label} ({100 * (mark.seconds / default.seconds - 1):+.0f} % s, {decibels})"


def _table(frame: DataFrame, part: str, sensor: str, size: str) -> str:
    found = marks(frame)
    fronts = {layer: front(found, layer) for layer in LAYERS}
    default = default_of(found)
    # Of several hundred ways only those of interest.
    shown = [m for m in found if part != CROSSED or m is default or any(m in each for each in fronts.values())]
    names = ("way", "s", "times the default", "T", "R", "evaluations", "MB", "on the front of")
    lines = [_line(mark, default, fronts) for mark in sorted(shown, key=lambda mark: mark.seconds)]
    n_scenes = len(scenes_of(frame))
    scenes = f"{n_scenes} scene{'s' if n_scenes > 1 else ''} ({', '.join(values_of(frame, 'scene'))})"
    remarks = [*(verdict(found, layers) for _, layers in _BOTH), *_not_run(frame)]
    heading = f"### {SUBJECTS[sensor]}, {size}, {part}: {len(found)} ways, {scenes}"
    return "\n".join([heading, "", markdown(DataFrame(lines, columns=list(names))), "", *remarks])


def _line(mark: Mark, default: Mark, fronts: dict[str, list[Mark]]) -> list[str]:
    seconds = f"{mark.seconds:.3g}" + (f" ({mark.low:.3g} to {mark.high:.3g})" if mark.high > mark.low else "")
    return [
        f"**{mark.way.label}**" if mark is default else mark.way.label,
        seconds,
        f"{mark.seconds / default.seconds:.2f}",
        *(_number(mark.level(layer), ".2f") for layer in LAYERS),
        _number(mark.evaluations or math.nan, ".1f"),
        _number(mark.peak_mb, ".0f"),
        ", ".join(layer[0].upper() for layer in LAYERS if mark in fronts[layer]),
    ]


def _number(value: float, form: str) -> str:
    return "" if math.isnan(value) else f"{value:{form}}"


def verdict(found: Sequence[Mark], layers: Sequence[str]) -> str:
    """Whether the defaults lie on the front of these layers, and if not, what beats them by how much."""
    default = default_of(found)
    better = sorted(beaten_by(found, layers), key=lambda mark: mark.seconds)
    what = " and ".join(layers)
    if not better:
        return f"- {what}: the defaults are on the front."
    by = "; ".join(_gain(mark, default, layers) for mark in better[:_MOST])
    more = f" and {len(better) - _MOST} more" if len(better) > _MOST else ""
    return f"- {what}: the defaults are beaten by {by}{more}."


def _not_run(frame: DataFrame) -> list[str]:
    lines = []
    for reason, part in frame[frame.not_run != ""].groupby("not_run", sort=False):
        labels = list(dict.fromkeys(way.label for way in part.way))
        lines.append(f"- not run: {labels[0]}{f' and {len(labels) - 1} more' if len(labels) > 1 else ''}: {reason}")
    return lines
