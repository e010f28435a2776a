"""Charts of seconds against accuracy: one for each size, one of all settings crossed, profiles, and memory.

Each way has its own number; the setting that differs from the default is told by the marker's shape.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import numpy as np
from pandas import DataFrame

from studies.kit.charts import BLUE, GREEN, ORANGE, PURPLE, SKY, VERMILION, Style, new_figure
from studies.kit.frames import values_of, where
from studies.scores import LAYERS
from studies.speed_accuracy.marks import (
    CROSSED,
    FACTORS,
    ONE,
    SOLVED_DB,
    SUBJECTS,
    Mark,
    compared,
    front,
    marks,
    ratios,
    scenes_of,
    share_within,
    with_ways,
)
from studies.ways import DEFAULT

_BROWN, _GREY, _INDIGO = "#8c564b", "#999999", "#332288"
STYLES = {
    "default": Style("black", "-", "*"),
    "solver": Style(BLUE, "--", "s"),
    "start": Style(VERMILION, "-.", "^"),
    "rung": Style(GREEN, ":", "D"),
    "tolerance": Style(PURPLE, (0, (5, 1, 1, 1)), "o"),
    "method": Style(_BROWN, (0, (1, 1)), "X"),
    "resolution": Style(ORANGE, (0, (3, 2)), "P"),
    "several": Style(_GREY, "-", "."),
}
_LINES = (
    "-", "--", "-.", ":", (0, (5, 1, 1, 1)), (0, (3, 2)), (0, (6, 2)), (0, (4, 1, 1, 1, 1, 1)), (0, (1, 1)),
    (0, (2, 4)),
)  # fmt: skip
_COLORS = ("black", BLUE, VERMILION, GREEN, PURPLE, _BROWN, ORANGE, SKY, _INDIGO, _GREY)
_MARKERS = ("o", "s", "^", "D", "v", "P", "X", "*", "d", "h")
_SECONDS = "processor seconds, all threads together"
# How much of the top the lower row shows, in dB.
_TOP_DB = {ONE: 2.0, CROSSED: 1.0}
_FARTHEST = 30.0
# From this ratio on an axis has numbers at powers of ten alone.
_WIDE = 60.0
_NUMBERS = (1.0, 1.5, 2.0, 3.0, 5.0)
# Below this ratio it has more of them.
_NARROW = 4.0
_MORE_NUMBERS = (1.0, 1.2, 1.5, 2.0, 2.5, 3.0, 4.0, 5.0, 6.0, 8.0)
# And below this one still more.
_NARROWEST = 1.8
_MOST_NUMBERS = (
    1.0, 1.1, 1.2, 1.3, 1.4, 1.5, 1.6, 1.8, 2.0, 2.2, 2.5, 2.8, 3.0, 3.5, 4.0, 4.5, 5.0, 6.0, 7.0, 8.0, 9.0,
)  # fmt: skip
# Labels, in points: distances tried from near to far, directions, height and width of a letter, half a point and star.
_REACHES = (9.0, 15.0, 22.0, 30.0, 40.0)
_DIRECTIONS = 16
_HEIGHT, _WIDTH = 9.0, 5.0
_GAP = 1.5
_POINT, _STAR = 3.5, 7.0

Box = tuple[float, float, float, float]
Limits = tuple[float, float]


def kind_of(mark: Mark) -> str:
    """Key of `STYLES`."""
    return "default" if mark.way == DEFAULT else mark.way.factor or "several"


def numbered(found: Sequence[Mark]) -> dict[Mark, int]:
    """Marks that are named on a chart, by their number: all that differ from the default in one setting."""
    named = [mark for mark in found if kind_of(mark) not in ("default", "several")]
    return {mark: number for number, mark in enumerate(named, 1)}


def figures(frame: DataFrame) -> dict[str, Callable[[], Any]]:
    """A chart of each part, subject and size; of each subject the profiles, and the memory where it was measured."""
    frame = with_ways(frame)
    charts: dict[str, Callable[[], Any]] = {}
    for part, sensor, size in values_of(frame, "part", "sensor", "size"):
        rows = where(frame, part=part, sensor=sensor, size=size)
        charts[_name(part.replace(" ", "_"), sensor, size)] = partial(_chart, rows, part, SUBJECTS[sensor], size)
    one = where(frame, part=ONE)
    for sensor in values_of(one, "sensor"):
        rows = where(one, sensor=sensor)
        charts[_name("profiles", sensor)] = partial(_profiles, rows, SUBJECTS[sensor])
        if rows.peak_mb.notna().any():
            charts[_name("memory", sensor)] = partial(_memory, rows, SUBJECTS[sensor])
    return charts


def _name(*words: str) -> str:
    return "_".join(["speed", *filter(None, words)])


def _chart(frame: DataFrame, part: str, subject: str, size: str) -> Any:
    found = marks(frame)
    numbers = numbered(found)
    figure = new_figure(13, 8.4)
    grid = figure.subplots(2, 2, sharex=False)
    panels = [(grid[row, column], layer, row == 1) for row in (0, 1) for column, layer in enumerate(LAYERS)]
    for axes, layer, top in panels:
        _scatter(axes, found, layer)
        _dress(axes, found, layer, _TOP_DB[part] if top else None)
        _draw_front(axes, found, layer)
    scenes = len(scenes_of(frame))
    figure.suptitle(
        f"Seconds against accuracy, {subject}, {size}, {f'mean of {scenes} scenes' if scenes > 1 else '1 scene'}, "
        f"{part}; above all, below the framed part"
    )
    figure.legend(*_legend(found, numbers), loc="outside right center", frameon=False, fontsize=8.5)
    figure.draw_without_rendering()
    # It is laid out; labels need no second time.
    figure.set_layout_engine("none")
    for axes, layer, top in panels:
        points = [(mark.seconds, mark.level(layer), str(number)) for mark, number in numbers.items()]
        stars = [(mark.seconds, mark.level(layer)) for mark in found if mark.way == DEFAULT]
        if not top:
            # What the picture below shows is named there.
            below = next(other for other, named, lower in panels if lower and named == layer)
            limits = below.get_xlim(), below.get_ylim()
            _frame(axes, *limits)
            points = [point for point in points if not _within(point, *limits)]
        place_labels(axes, points, stars)
    return figure


def _within(point: tuple[float, float, str], across: Limits, up: Limits) -> bool:
    return across[0] <= point[0] <= across[1] and up[0] <= point[1] <= up[1]


def _frame(axes: Any, across: Limits, up: Limits) -> None:
    """Show which part of a picture the one below enlarges."""
    (left, right), (bottom, top) = across, up
    corners = ((left, right, right, left, left), (bottom, bottom, top, top, bottom))
    axes.plot(*corners, color=_GREY, linewidth=0.9, linestyle=(0, (3, 2)), zorder=1)


def _scatter(axes: Any, found: Sequence[Mark], layer: str) -> None:
    seen = [mark for mark in found if not math.isnan(mark.level(layer))]
    # Hundreds of points at once.
    crowd, several = [mark for mark in seen if kind_of(mark) == "several"], STYLES["several"]
    axes.plot(
        [mark.seconds for mark in crowd], [mark.level(layer) for mark in crowd], several.marker, color=several.color,
        linestyle="none", markersize=4, zorder=2,
    )  # fmt: skip
    for mark in (mark for mark in seen if kind_of(mark) != "several"):
        style, kind = STYLES[kind_of(mark)], kind_of(mark)
        if mark.high > mark.low:
            axes.plot([mark.low, mark.high], [mark.level(layer)] * 2, color=style.color, linewidth=0.8, alpha=0.6)
        axes.plot(
            mark.seconds, mark.level(layer), style.marker, color=style.color, linestyle="none",
            markersize=15 if kind == "default" else 6.5, markeredgecolor="black", markeredgewidth=0.5,
            markerfacecolor=style.color if mark.way.blind else "white", zorder=6 if kind == "default" else 4,
        )  # fmt: skip


def _draw_front(axes: Any, found: Sequence[Mark], layer: str) -> None:
    """The front from below the picture to its right side, so that one of a single way is seen; limits are set."""
    steps = front(found, layer)
    limits = axes.get_xlim(), axes.get_ylim()
    seconds = [mark.seconds for mark in steps]
    levels = [mark.level(layer) for mark in steps]
    axes.step(
        [seconds[0], *seconds, max(limits[0][1], seconds[-1])], [min(limits[1][0], levels[0]), *levels, levels[-1]],
        where="post", color="black", linewidth=1.1, zorder=1,
    )  # fmt: skip
    axes.set(xlim=limits[0], ylim=limits[1])


def _dress(axes: Any, found: Sequence[Mark], layer: str, top_db: float | None) -> None:
    levels = [mark.level(layer) for mark in found if mark.way.blind and not math.isnan(mark.level(layer))]
    best = max(levels)
    axes.set_ylabel(f"PSNR of the {layer} (dB)")
    if top_db is None:
        highest = max(mark.level(layer) for mark in found if not math.isnan(mark.level(layer)))
        axes.set_ylim(max(min(levels), best - _FARTHEST) - 1.5, highest + 2.5)
        _logarithmic(axes)
        axes.set_xlabel(_SECONDS)
        return
    near = [mark for mark in found if best - top_db <= mark.level(layer) <= best + 0.1 * top_db]
    seconds = [value for mark in near for value in (mark.low, mark.high)]
    axes.set_xlim(min(seconds) / 1.25, max(seconds) * 1.25)
    axes.set_ylim(best - top_db, best + 0.1 * top_db)
    _logarithmic(axes)
    axes.set_xlabel(_SECONDS)


def _logarithmic(axes: Any) -> None:
    """A logarithmic axis with plain numbers, few enough not to touch; to be called when the limits are set."""
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

    axes.set_xscale("log")
    low, high = axes.get_xlim()
    widths = ((_WIDE, (1.0,)), (_NARROW, _NUMBERS), (_NARROWEST, _MORE_NUMBERS))
    numbers = next((numbers for width, numbers in widths if high > width * low), _MOST_NUMBERS)
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

    settings = f"{DEFAULT.solver},\n{DEFAULT.start}, {DEFAULT.rung}, {DEFAULT.relative_change:g}"
    entries = [(handle("default"), f"the defaults: {settings}")]
    entries += [(handle(kind_of(mark), mark.way.blind), f"{n}  {mark.way.label}") for mark, n in numbers.items()]
    if any(kind_of(mark) == "several" for mark in found):
        entries.append((handle("several"), "several settings changed"))
    entries.append((Line2D([], [], color="black", linewidth=1.1), "Pareto front (of what is told nothing)"))
    if any(not mark.way.blind for mark in found):
        entries.append((Line2D([], []), "white: is told something of the truth"))
        entries[-1][0].set_visible(False)
    return [entry[0] for entry in entries], [entry[1] for entry in entries]


def _profiles(frame: DataFrame, subject: str) -> Any:
    figure = new_figure(17.5, 7.6)
    panels = list(figure.subplots(2, 3).flat)
    for axes, factor in zip(panels, FACTORS, strict=False):
        ways = compared(frame, factor)
        of_scenes = ratios(frame, ways)
        # Lines along the bottom would hide one another.
        solving = [way for way in ways if np.isfinite(of_scenes[way]).any()]
        finite = [value for ratio in of_scenes.values() for value in ratio if math.isfinite(value)]
        within = np.geomspace(1, max([2.0, *finite]) * 1.3, 400)
        for i, way in enumerate(solving):
            share = share_within(of_scenes[way], within)
            axes.step(
                within, 100 * share, where="post", color=_COLORS[i % 10], linestyle=_LINES[i % 10],
                linewidth=2.4 if way == DEFAULT else 1.4, marker=_MARKERS[i % 10], markevery=(i * 8, 80), markersize=5,
                label=way.label,
            )  # fmt: skip
        if len(solving) < len(ways):
            axes.plot([], [], linestyle="none", label=f"{len(ways) - len(solving)} more solve none")
        axes.set_xlim(within[0] / 1.02, within[-1])
        _logarithmic(axes)
        axes.set_ylim(-4, 104)
        axes.set_title(f"{factor}s, {len(of_scenes[DEFAULT])} scenes")
        axes.set_xlabel("processor seconds over those of the fastest")
        axes.set_ylabel("scenes solved (%)")
        # Beside the lines: no corner is free of them in every panel.
        axes.legend(fontsize=8, loc="upper left", bbox_to_anchor=(1, 1), frameon=False)
    # In the place of the last panel.
    panels[-1].set_axis_off()
    panels[-1].text(
        0, 0.95, f"Performance profiles, {subject},\nover scenes in which all ways of a panel were tried.\n\n"
        f"A scene is solved where both layers are within {SOLVED_DB:g} dB\nof the best of the same panel.\n\n"
        "At the left end: how often a way is the fastest.\nAt the right end: how often it solves the scene at all.",
        va="top",
    )  # fmt: skip
    return figure


def _memory(frame: DataFrame, subject: str) -> Any:
    sizes = values_of(frame[frame.peak_mb.notna()], "size")
    by_size = {size: {mark.way: mark for mark in marks(where(frame, size=size))} for size in sizes}
    ways = [way for way in values_of(frame, "way") if any(way in found for found in by_size.values())]
    figure = new_figure(9, 1.6 + 0.27 * len(ways))
    axes = figure.subplots()
    for i, size in enumerate(sizes):
        known = [(by_size[size][way].peak_mb, y) for y, way in enumerate(ways) if way in by_size[size]]
        axes.plot(
            *zip(*known, strict=True), _MARKERS[i], color=_COLORS[i], markersize=6, label=size, markeredgecolor="black"
        )
    axes.set_yticks(range(len(ways)), [way.label for way in ways])
    axes.invert_yaxis()
    _logarithmic(axes)
    axes.set_title(subject)
    axes.set_xlabel("most memory above the photographs (MB)")
    figure.legend(loc="outside upper right", ncols=len(sizes), title="size of the photographs")
    return figure


# Short labels beside points, moved aside where they would cover one another.


def place_labels(
    axes: Any, points: Sequence[tuple[float, float, str]], stars: Sequence[tuple[float, float]] = ()
) -> None:
    """Write labels beside points (x, y, text), each on the nearest free place; those out of sight have none.

    Stars (x, y) are larger points without a label. The figure must have its layout.
    """
    scale = 72 / axes.figure.dpi
    (left, right), (bottom, top) = axes.get_xlim(), axes.get_ylim()
    shown = [(x, y, text) for x, y, text in points if left <= x <= right and bottom <= y <= top]

    def around(x: float, y: float, half: float) -> Box:
        across, up = np.asarray(axes.transData.transform((x, y))) * scale
        return (across - half, up - half, across + half, up + half)

    taken = [around(x, y, _POINT) for x, y, _ in shown] + [around(x, y, _STAR) for x, y in stars]
    for x, y, text in shown:
        offset, box = _free(around(x, y, 0.0)[:2], text, taken)
        taken.append(box)
        far = math.hypot(*offset) > _REACHES[0] + 1
        axes.annotate(
            text, (x, y), xytext=offset, textcoords="offset points", fontsize=7.5, ha="center", va="center", zorder=8,
            arrowprops={"arrowstyle": "-", "linewidth": 0.4, "shrinkA": 0, "shrinkB": 0} if far else None,
        )  # fmt: skip


def _free(place: tuple[float, float], text: str, taken: Sequence[Box]) -> tuple[tuple[float, float], Box]:
    """The offset of least overlap, the nearest of them, and the box it makes."""
    tried = []
    for reach in _REACHES:
        for turn in range(_DIRECTIONS):
            angle = 2 * math.pi * (turn / _DIRECTIONS + 0.25)
            offset = (reach * math.cos(angle), reach * math.sin(angle))
            x, y = place[0] + offset[0], place[1] + offset[1]
            half = _WIDTH * len(text) / 2 + _GAP
            box = (x - half, y - _HEIGHT / 2, x + half, y + _HEIGHT / 2)
            overlap = sum(_overlap(box, other) for other in taken)
            if overlap == 0:
                return offset, box
            tried.append((overlap, offset, box))
    _, offset, box = min(tried)
    return offset, box


def _overlap(first: Box, second: Box) -> float:
    width = min(first[2], second[2]) - max(first[0], second[0])
    height = min(first[3], second[3]) - max(first[1], second[1])
    return max(width, 0.0) * max(height, 0.0)
