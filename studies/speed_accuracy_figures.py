"""Charts of seconds against accuracy: one for each size, one of all settings crossed, profiles, and memory.

Each way has its own number; the setting that differs from the default is told by the marker's shape.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from studies.kit.charts import Style, write_figures
from studies.speed_accuracy_labels import place_labels
from studies.speed_accuracy_profiles import FACTORS, SOLVED_DB, compared, ratios, share_within
from studies.speed_accuracy_rows import LAYERS, Mark, Row, front, marks
from studies.ways import DEFAULT

STYLES = {
    "default": Style("black", "-", "*"),
    "solver": Style("#0072b2", "--", "s"),
    "start": Style("#d55e00", "-.", "^"),
    "rung": Style("#009e73", ":", "D"),
    "tolerance": Style("#cc79a7", (0, (5, 1, 1, 1)), "o"),
    "method": Style("#8c564b", (0, (1, 1)), "X"),
    "several": Style("#999999", "-", "."),
}
_LINES = (
    "-",
    "--",
    "-.",
    ":",
    (0, (5, 1, 1, 1)),
    (0, (3, 2)),
    (0, (6, 2)),
    (0, (4, 1, 1, 1, 1, 1)),
    (0, (1, 1)),
    (0, (2, 4)),
)
_COLORS = ("black", "#0072b2", "#d55e00", "#009e73", "#cc79a7", "#8c564b", "#e69f00", "#56b4e9", "#332288", "#999999")
_MARKERS = ("o", "s", "^", "D", "v", "P", "X", "*", "d", "h")
# How much of the top the lower row shows, in dB.
_TOP_DB = {"one at a time": 2.0, "crossed": 1.0}
_FARTHEST = 30.0
# From this ratio on an axis has numbers at powers of ten alone.
_WIDE = 60.0
_NUMBERS = (1.0, 1.5, 2.0, 3.0, 5.0)
# Below this ratio it has more of them.
_NARROW = 4.0
_MORE_NUMBERS = (1.0, 1.2, 1.5, 2.0, 2.5, 3.0, 4.0, 5.0, 6.0, 8.0)


def kind_of(mark: Mark) -> str:
    """Key of `STYLES`."""
    return "default" if mark.way == DEFAULT else mark.way.factor or "several"


def numbered(found: Sequence[Mark]) -> dict[Mark, int]:
    """Marks that are named on a chart, by their number: all that differ from the default in one setting."""
    named = [mark for mark in found if kind_of(mark) not in ("default", "several")]
    return {mark: number for number, mark in enumerate(named, 1)}


def draw(rows: Sequence[Row], out: Path) -> list[Path]:
    """Draw all charts as PNG and SVG.

    Parameters
    ----------
    rows : sequence of Row
    out : Path
        Folder.
    """
    figures: dict[str, Callable[[], Any]] = {
        f"speed_{part.replace(' ', '_')}_{size}": partial(_chart, rows, part, size)
        for part, size in dict.fromkeys((row.part, row.size) for row in rows)
    }
    one = [row for row in rows if row.part == "one at a time"]
    figures["speed_profiles"] = lambda: _profiles(one)
    if not all(math.isnan(row.peak_mb) for row in one):
        figures["speed_memory"] = lambda: _memory(one)
    return write_figures(out, figures)


def _chart(rows: Sequence[Row], part: str, size: str) -> Any:
    from matplotlib.figure import Figure

    rows = [row for row in rows if (row.part, row.size) == (part, size)]
    found = marks(rows)
    numbers = numbered(found)
    figure = Figure(figsize=(13, 8.4), layout="constrained")
    grid = figure.subplots(2, 2, sharex=False)
    panels = [(grid[row, column], layer, row == 1) for row in (0, 1) for column, layer in enumerate(LAYERS)]
    for axes, layer, top in panels:
        _scatter(axes, found, layer)
        _dress(axes, found, layer, _TOP_DB[part] if top else None)
    scenes = len({(row.scene, row.pair) for row in rows})
    figure.suptitle(
        f"Seconds against accuracy, {size} in colour, mean of {scenes} scene{'s' if scenes > 1 else ''}, {part}; "
        "above all, below the best"
    )
    figure.legend(*_legend(found, numbers), loc="outside right center", frameon=False, fontsize=8.5)
    figure.draw_without_rendering()
    # It is laid out; labels need no second time.
    figure.set_layout_engine("none")
    for axes, layer, _ in panels:
        points = [(mark.seconds, mark.level(layer), str(number)) for mark, number in numbers.items()]
        stars = [(mark.seconds, mark.level(layer)) for mark in found if mark.way == DEFAULT]
        place_labels(axes, points, stars)
    return figure


def _scatter(axes: Any, found: Sequence[Mark], layer: str) -> None:
    seen = [mark for mark in found if not math.isnan(mark.level(layer))]
    _crowd(axes, [(mark.seconds, mark.level(layer)) for mark in seen if kind_of(mark) == "several"])
    for mark in (mark for mark in seen if kind_of(mark) != "several"):
        style, kind = STYLES[kind_of(mark)], kind_of(mark)
        if mark.high > mark.low:
            axes.plot([mark.low, mark.high], [mark.level(layer)] * 2, color=style.color, linewidth=0.8, alpha=0.6)
        axes.plot(
            mark.seconds, mark.level(layer), style.marker, color=style.color, linestyle="none",
            markersize=15 if kind == "default" else 6.5, markeredgecolor="black", markeredgewidth=0.5,
            markerfacecolor=style.color if mark.way.blind else "white", zorder=6 if kind == "default" else 4,
        )  # fmt: skip
    steps = front(found, layer)
    axes.step(
        [mark.seconds for mark in steps], [mark.level(layer) for mark in steps], where="post", color="black",
        linewidth=1.1, zorder=1,
    )  # fmt: skip


def _crowd(axes: Any, points: Sequence[tuple[float, float]]) -> None:
    """Hundreds of points at once."""
    style = STYLES["several"]
    axes.plot(
        [x for x, _ in points], [y for _, y in points], style.marker, color=style.color, linestyle="none", markersize=4,
        zorder=2,
    )  # fmt: skip


def _dress(axes: Any, found: Sequence[Mark], layer: str, top_db: float | None) -> None:
    levels = [mark.level(layer) for mark in found if mark.way.blind and not math.isnan(mark.level(layer))]
    best = max(levels)
    axes.set_ylabel(f"PSNR of the {layer} (dB)")
    if top_db is None:
        highest = max(mark.level(layer) for mark in found if not math.isnan(mark.level(layer)))
        axes.set_ylim(max(min(levels), best - _FARTHEST) - 1.5, highest + 2.5)
        _logarithmic(axes)
        return
    near = [mark for mark in found if best - top_db <= mark.level(layer) <= best + 0.1 * top_db]
    seconds = [value for mark in near for value in (mark.low, mark.high)]
    axes.set_xlim(min(seconds) / 1.25, max(seconds) * 1.25)
    axes.set_ylim(best - top_db, best + 0.1 * top_db)
    _logarithmic(axes)
    axes.set_xlabel("processor seconds, all threads together")


def _logarithmic(axes: Any) -> None:
    """A logarithmic axis with plain numbers, few enough not to touch; to be called when the limits are set."""
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

    axes.set_xscale("log")
    low, high = axes.get_xlim()
    numbers = (1.0,) if high > _WIDE * low else _NUMBERS if high > _NARROW * low else _MORE_NUMBERS
    axes.xaxis.set_major_locator(LogLocator(subs=numbers))
    axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axes.xaxis.set_minor_formatter(NullFormatter())


def _legend(found: Sequence[Mark], numbers: dict[Mark, int]) -> tuple[list[Any], list[str]]:
    from matplotlib.lines import Line2D

    def handle(kind: str, blind: bool = True) -> Any:
        style = STYLES[kind]
        return Line2D(
            [], [], marker=style.marker, color=style.color, linestyle="none", markeredgecolor="black",
            markeredgewidth=0.5, markersize=11 if kind == "default" else 6.5,
            markerfacecolor=style.color if blind else "white",
        )  # fmt: skip

    entries = [(handle("default"), f"the defaults: {describe_default()}")]
    entries += [(handle(kind_of(mark), mark.way.blind), f"{n}  {mark.way.label}") for mark, n in numbers.items()]
    if any(kind_of(mark) == "several" for mark in found):
        entries.append((handle("several"), "several settings changed"))
    entries.append((Line2D([], [], color="black", linewidth=1.1), "Pareto front (of what is told nothing)"))
    if any(not mark.way.blind for mark in found):
        entries.append((Line2D([], []), "white: is told something of the truth"))
        entries[-1][0].set_visible(False)
    return [entry[0] for entry in entries], [entry[1] for entry in entries]


def describe_default() -> str:
    """The defaults in words."""
    return f"{DEFAULT.solver},\n{DEFAULT.start}, {DEFAULT.rung}, {DEFAULT.relative_change:g}"


def _profiles(rows: Sequence[Row]) -> Any:
    from matplotlib.figure import Figure

    figure = Figure(figsize=(17.5, 7.6), layout="constrained")
    panels = figure.subplots(2, 3).flat
    for axes, factor in zip(panels, FACTORS, strict=False):
        ways = compared(rows, factor)
        of_scenes = ratios(rows, ways)
        finite = [value for ratio in of_scenes.values() for value in ratio if math.isfinite(value)]
        within = np.geomspace(1, max([2.0, *finite]) * 1.3, 400)
        for i, way in enumerate(ways):
            share = share_within(of_scenes[way], within)
            axes.step(
                within, 100 * share, where="post", color=_COLORS[i % 10], linestyle=_LINES[i % 10],
                linewidth=2.4 if way == DEFAULT else 1.4, marker=_MARKERS[i % 10], markevery=(i * 8, 80), markersize=5,
                label=way.label,
            )  # fmt: skip
        axes.set_xlim(within[0] / 1.02, within[-1])
        _logarithmic(axes)
        axes.set_ylim(-4, 104)
        axes.set_title(f"{factor}s")
        axes.set_xlabel("processor seconds over those of the fastest")
        axes.set_ylabel("scenes solved (%)")
        # Beside the lines: no corner is free of them in every panel.
        axes.legend(fontsize=8, loc="upper left", bbox_to_anchor=(1, 1), frameon=False)
    _explain(list(figure.axes)[-1], rows)
    return figure


def _explain(axes: Any, rows: Sequence[Row]) -> None:
    """What the profiles show, in the place of the last panel."""
    axes.set_axis_off()
    scenes = len({(row.size, row.scene, row.pair) for row in rows})
    axes.text(
        0, 0.95, f"Performance profiles over {scenes} scenes of all sizes.\n\nA scene is solved where both layers are "
        f"within {SOLVED_DB:g} dB\nof the best of the same panel.\n\nAt the left end: how often a way is the fastest.\n"
        "At the right end: how often it solves the scene at all.", va="top",
    )  # fmt: skip


def _memory(rows: Sequence[Row]) -> Any:
    from matplotlib.figure import Figure

    sizes = list(dict.fromkeys(row.size for row in rows if not math.isnan(row.peak_mb)))
    by_size = {size: {m.way: m for m in marks([row for row in rows if row.size == size])} for size in sizes}
    ways = [way for way in dict.fromkeys(row.way for row in rows) if any(way in found for found in by_size.values())]
    figure = Figure(figsize=(9, 1.6 + 0.27 * len(ways)), layout="constrained")
    axes = figure.subplots()
    for i, size in enumerate(sizes):
        known = [(by_size[size][way].peak_mb, y) for y, way in enumerate(ways) if way in by_size[size]]
        axes.plot(
            *zip(*known, strict=True), _MARKERS[i], color=_COLORS[i], markersize=6, label=size, markeredgecolor="black"
        )
    axes.set_yticks(range(len(ways)), [way.label for way in ways])
    axes.invert_yaxis()
    _logarithmic(axes)
    axes.set_xlabel("most memory above the photographs (MB)")
    figure.legend(loc="outside upper right", ncols=len(sizes), title="size of the photographs")
    return figure
