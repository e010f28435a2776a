"""Tables and figures of the random scenes."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise
from typing import Any

import numpy as np
from pandas import DataFrame, concat

from studies.kit.charts import BLUE, GREEN, ORANGE, VERMILION, legend_below, new_figure
from studies.kit.frames import Cell, markdown, mean, summary, values_of, where
from studies.random_windows.judging import (
    NEAR_DB,
    SURE,
    TARGETS,
    WIDEST,
    Target,
    held,
    judged,
    numbers_found,
    width,
)
from studies.random_windows.windows import HALVES

ALL = "all"


def tables(frame: DataFrame) -> str:
    """Targets, what came out by family, stated errors by number, and each scene that something is wrong with."""
    rows = judged(frame)
    halves = ", ".join(f"{(rows.number % 2 == i).sum()} to {half}" for i, half in enumerate(HALVES))
    return "\n\n".join([
        "# Random windows",
        f"{len(rows)} scenes ({halves}).",
        markdown(_targets(rows), "lrrr"),
        "By family; T and R in dB, blind, with the scene known, and of doing nothing. Shares in per cent; silent: "
        "failures that nothing announces, worse: than doing nothing, in silence; errors: numbers of the scene within "
        "two stated errors, and how much wider these are than what they describe; T, R covered: pixels within two "
        "stated errors.",
        markdown(_by_family(rows), "lr"),
        "Stated errors by number; right: only of separations within 3 dB of the scene known.",
        markdown(_by_number(rows), "lr"),
        "Chance that stated errors cost the transmission more than 3 dB, and how many scenes did lose so much.",
        markdown(_by_chance(rows)),
        "All that went wrong, the worst first.",
        markdown(_wrong(rows), "rlrrllrrl"),
    ])  # fmt: skip


def _targets(rows: DataFrame) -> DataFrame:
    lines = [[target.words, *_goal(target), _measured(target, rows)] for target in TARGETS]
    found = numbers_found(rows)
    widths = f"{width(found):.2f} times" if len(found) else "-"
    mark = "" if not len(found) or width(found) <= WIDEST else " (missed)"
    lines.append(["width of the stated errors, at most", f"{WIDEST:g} times", f"{WIDEST:g} times", widths + mark])
    return DataFrame(lines, columns=["what", "needed", "wished for", "measured"], dtype=object)


def _goal(target: Target) -> tuple[str, str]:
    sign = "<=" if target.most else ">="
    return f"{sign} {target.needed:g} %", f"{sign} {target.wished:g} %"


def _measured(target: Target, rows: DataFrame) -> str:
    hits, n = target.counted(rows)
    share = f"{100 * hits / n:.1f} %" if n else "-"
    return f"{share} ({hits} of {n})" + ("" if target.reached(rows) else " (missed)")


def _by_family(rows: DataFrame) -> DataFrame:
    cells: dict[str, Cell] = {
        "scenes": lambda part: str(len(part)),
        "T": mean("transmission", ".1f"),
        "known": mean("known_transmission", ".1f"),
        "nothing": mean("nothing", ".1f"),
        "R": mean("reflection", ".1f"),
        "known R": mean("known_reflection", ".1f"),
        "within 3 dB": lambda part: _per_cent(~part.failed),
        "adequate rung": lambda part: _per_cent(part.adequate),
        "announced": lambda part: f"{(part.failed & part.announced).sum()} of {part.failed.sum()}",
        "silent": lambda part: str(part.silent.sum()),
        "worse": lambda part: str(part.worse_silent.sum()),
        "false alarms": lambda part: str(part.false_alarm.sum()),
        "errors": _errors,
        "T covered": lambda part: f"{100 * part.covered_transmission.mean():.0f}",
        "R covered": lambda part: f"{100 * part.covered_reflection.mean():.0f}",
        "s": mean("seconds", ".1f"),
    }
    both = concat([rows, rows.assign(family=ALL)])
    return summary(both, {"family": "family"}, cells)


def _errors(part: DataFrame) -> str:
    found = numbers_found(part)
    return f"{100 * held(found):.0f}, {width(found):.1f} x" if len(found) else "-"


def _per_cent(flags: Any) -> str:
    return f"{100 * flags.mean():.0f}"


def _by_number(rows: DataFrame) -> DataFrame:
    found = numbers_found(rows)
    right = found[~found.failed.astype(bool)]
    lines = [
        [
            name,
            len(of_name),
            f"{100 * held(of_name):.0f}",
            f"{width(of_name):.2f}",
            f"{100 * held(of_right):.0f}" if len(of_right) else "-",
            f"{width(of_right):.2f}" if len(of_right) else "-",
            f"{of_name.stated.median():.3g}",
            f"{of_name.away.median():.3g}",
        ]
        for name in values_of(found, "parameter")
        for of_name, of_right in [(where(found, parameter=name), where(right, parameter=name))]
    ]
    heads = ["number", "n", "within two (%)", "width", "right: within two", "width", "stated, median", "true, median"]
    return DataFrame(lines, columns=heads, dtype=object)


_CHANCES = (0.0, 0.02, 0.2, 0.5, 0.8, 1.0)
"""Between which scenes are counted together."""


def _by_chance(rows: DataFrame) -> DataFrame:
    """Scenes by the chance of a failure that is stated, how many that makes, and how many there are."""
    lines = []
    for low, high in pairwise(_CHANCES):
        part = rows[(rows.chance >= low) & ((rows.chance < high) | (high == _CHANCES[-1]))]
        lines.append([f"{low:g} to {high:g}", len(part), f"{part.chance.sum():.1f}", int(part.failed.sum())])
    return DataFrame(lines, columns=["chance", "scenes", "failures by it", "failures"], dtype=object)


def _wrong(rows: DataFrame) -> DataFrame:
    """Failures, what is worse than nothing, false alarms and inadequate rungs, scene by scene."""
    wrong = rows[rows.failed | rows.worse | rows.false_alarm | ~rows.adequate.astype(bool)]
    order = np.lexsort((-wrong.behind, ~wrong.worse_silent.astype(bool), ~wrong.silent.astype(bool)))
    lines = [
        [
            row.number,
            row.family,
            f"{row.transmission:.1f}",
            f"{row.known_transmission:.1f} / {row.nothing:.1f}",
            f"{row.made} -> {row.rung}" + (f" ({row.panes} -> {row.panes_found})" if row.panes > 1 else ""),
            what_is_wrong(row),
            f"{row.incidence_deg:.1f} -> {row.found_incidence_deg:.1f}",
            f"{row.turned_deg:.0f}",
            ", ".join(row.warnings) or "-",
        ]
        for row in wrong.iloc[order].itertuples()
    ]
    heads = ["scene", "family", "T", "known / nothing", "rung", "what", "theta", "azimuth off", "told"]
    return DataFrame(lines, columns=heads, dtype=object)


def what_is_wrong(row: Any) -> str:
    """In a few words."""
    words = (
        ("worse than nothing", row.worse),
        ("fails", row.failed),
        ("in silence", row.silent or row.worse_silent),
        ("false alarm", row.false_alarm),
        ("rung", not row.adequate),
    )
    return ", ".join(word for word, holds in words if holds)


_KINDS = (
    ("within 3 dB, nothing false", "o", BLUE, lambda rows: ~rows.failed & ~rows.false_alarm),
    ("within 3 dB, false alarm", "s", ORANGE, lambda rows: ~rows.failed & rows.false_alarm),
    ("fails, announced", "^", GREEN, lambda rows: rows.failed & rows.announced),
    ("fails in silence", "X", VERMILION, lambda rows: rows.silent),
)
_MOST_BEHIND_DB = 25.0
_SPREAD = 0.3
"""How far marks of a family are spread across, so that they do not hide one another."""
_DRAWN = {
    "incidence_deg": "incidence (deg)",
    "azimuth_deg": "azimuth (deg)",
    "ghost_shift": "ghost shift (px)",
}


def figures(frame: DataFrame) -> dict[str, Callable[[], Any]]:
    """How far each scene is behind the known one, and stated beside true errors."""
    rows = judged(frame)
    return {
        "random_windows": lambda: _behind(rows),
        "random_windows_errors": lambda: _stated(rows),
    }


def _behind(rows: DataFrame) -> Any:
    """A mark for each scene, by family."""
    families = values_of(rows, "family")
    figure = new_figure(9.5, 0.42 * len(families) + 1.8)
    axis = figure.subplots()
    behind = rows.behind.clip(-1, _MOST_BEHIND_DB)
    order = rows.groupby("family").cumcount() / np.maximum(rows.groupby("family").family.transform("size") - 1, 1)
    places = rows.family.map(families.index) + _SPREAD * (2 * order - 1)
    handles = []
    for words, marker, color, holds in _KINDS:
        of_kind = holds(rows).astype(bool)
        handles.append(
            axis.scatter(
                behind[of_kind], places[of_kind], s=34, marker=marker, color=color, edgecolor="black", linewidth=0.4,
                label=words, zorder=3,
            )
        )  # fmt: skip
    worse = rows.worse.astype(bool)
    handles.append(
        axis.scatter(
            behind[worse], places[worse], s=110, marker="o", facecolor="none", edgecolor="red", linewidth=1.3,
            label="worse than doing nothing", zorder=4,
        )
    )  # fmt: skip
    axis.axvline(NEAR_DB, color="black", linewidth=1)
    axis.set_yticks(range(len(families)), [_said(where(rows, family=family), family) for family in families])
    axis.set_ylim(len(families) - 0.5, -0.5)
    axis.grid(visible=False, axis="y")
    for place in range(1, len(families)):
        axis.axhline(place - 0.5, color="#dddddd", linewidth=0.6, zorder=0)
    axis.set_xlabel("transmission: dB behind the solve with the scene known (line: 3 dB; right end: 25 dB or more)")
    legend_below(figure, handles, [handle.get_label() for handle in handles], 3)
    return figure


def _said(part: DataFrame, family: str) -> str:
    return f"{family}: {(~part.failed).sum()} of {len(part)}"


def _stated(rows: DataFrame) -> Any:
    """True over stated errors of each scene, on logarithmic axes."""
    found = numbers_found(rows)
    figure = new_figure(12, 4.6)
    handles: dict[str, Any] = {}
    for axis, (name, words) in zip(figure.subplots(1, len(_DRAWN)), _DRAWN.items(), strict=True):
        of_name = where(found, parameter=name)
        least = max(1e-4, float(of_name.stated.min())) / 30 if len(of_name) else 1e-4
        for failed, label, marker, color in (
            (False, "within 3 dB", "o", BLUE),
            (True, "fails", "X", VERMILION),
        ):
            part = of_name[of_name.failed.astype(bool) == failed]
            handles[label] = axis.scatter(
                part.stated,
                part.away.clip(lower=least),
                s=22,
                marker=marker,
                color=color,
                edgecolor="black",
                linewidth=0.3,
            )
        ends = np.array([least, 1e2])
        (handles["the same"],) = axis.plot(ends, ends, color="black", linewidth=0.9)
        (handles[f"{SURE:g} stated errors"],) = axis.plot(ends, SURE * ends, "--", color="black", linewidth=0.9)
        axis.set_xscale("log")
        axis.set_yscale("log")
        axis.minorticks_off()
        axis.set_xlabel(f"stated error of the {words}")
        axis.set_ylabel("true error")
    legend_below(figure, list(handles.values()), list(handles), 4)
    return figure
