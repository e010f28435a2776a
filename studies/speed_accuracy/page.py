"""The charts of seconds against accuracy to point at: one page that needs nothing beside it (Bokeh).

Bokeh's script is 1.3 MB of the page; Plotly's would be 4.6 MB, and its smaller ones do not come with its package.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from pandas import DataFrame

from studies.kit.frames import values_of, where
from studies.scores import LAYERS
from studies.speed_accuracy.figures import STYLES, kind_of
from studies.speed_accuracy.marks import SUBJECTS, Mark, front, marks, with_ways

_SHAPES = {
    "*": "star", "s": "square", "^": "triangle", "D": "diamond", "o": "circle", "X": "hex", "P": "cross", ".": "dot",
}  # fmt: skip
_NAMES = {"default": "the defaults", "several": "several settings changed", "method": "another method"}
_SIZES = {"default": 20, "several": 9}
_SHOWN_DB = 30.0
_HOW_TO_READ = (
    "Means over scenes. Point at a mark to read what it is; a click in the legend hides its kind. White marks are told "
    "something of the truth, and are not on the front."
)
_TIPS = (
    ("way", "@way"),
    ("processor seconds", "@seconds{0.000} (@low{0.000} to @high{0.000})"),
    ("seconds by the clock", "@elapsed{0.000}"),
    ("transmission", "@transmission{0.00} dB"),
    ("reflection", "@reflection{0.00} dB"),
    ("evaluations", "@evaluations{0.0}"),
    ("memory", "@memory"),
    ("told of the truth", "@told"),
)


def write_page(frame: DataFrame, out: Path) -> None:
    """Write ``speed_accuracy.html`` into a folder: a tab for each part, subject and size, a plot for each layer."""
    from bokeh.embed import file_html
    from bokeh.layouts import row
    from bokeh.models import Div, TabPanel, Tabs
    from bokeh.resources import INLINE

    frame, tabs = with_ways(frame), []
    for part, sensor, size in values_of(frame, "part", "sensor", "size"):
        found = marks(where(frame, part=part, sensor=sensor, size=size))
        pair = row([_plot(found, layer) for layer in LAYERS], sizing_mode="stretch_width")
        tabs.append(TabPanel(child=pair, title=f"{SUBJECTS[sensor]}, {size}, {part}"))
    whole = [Div(text=_HOW_TO_READ, sizing_mode="stretch_width"), Tabs(tabs=tabs, sizing_mode="stretch_width")]
    page = file_html(whole, INLINE, "polaropt: seconds against accuracy")
    (out / "speed_accuracy.html").write_text(page, encoding="utf-8")


def _plot(found: Sequence[Mark], layer: str) -> Any:
    from bokeh.models import HoverTool, Range1d
    from bokeh.plotting import figure

    plot = figure(
        x_axis_type="log", height=560, sizing_mode="stretch_width", tools="pan,wheel_zoom,box_zoom,reset,save",
        x_axis_label="processor seconds, all threads together", y_axis_label=f"PSNR of the {layer} (dB)",
    )  # fmt: skip
    steps = front(found, layer)
    plot.step(
        [mark.seconds for mark in steps], [mark.level(layer) for mark in steps], mode="after", color="black",
        legend_label="Pareto front (of what is told nothing)",
    )  # fmt: skip
    seen = [mark for mark in found if not math.isnan(mark.level(layer))]
    points = []
    for kind, style in reversed(STYLES.items()):
        part = [mark for mark in seen if kind_of(mark) == kind]
        if part:
            marker = plot.scatter(
                "seconds", layer, source=_source(part), marker=_SHAPES[style.marker], size=_SIZES.get(kind, 11),
                line_color="black" if kind != "several" else style.color, fill_color="fill",
                legend_label=_NAMES.get(kind, f"another {kind}"),
            )  # fmt: skip
            points.append(marker)
    plot.add_tools(HoverTool(renderers=points, tooltips=list(_TIPS)))
    plot.legend.click_policy = "hide"
    plot.legend.ncols = 3
    plot.add_layout(plot.legend[0], "below")
    levels = [mark.level(layer) for mark in seen]
    plot.y_range = Range1d(max(min(levels), max(levels) - _SHOWN_DB) - 1, max(levels) + 1)
    return plot


def _source(found: Sequence[Mark]) -> Any:
    from bokeh.models import ColumnDataSource

    numbers = ("seconds", "low", "high", "elapsed", "transmission", "reflection", "evaluations")
    columns: dict[str, list[Any]] = {name: [getattr(mark, name) for mark in found] for name in numbers}
    columns["way"] = [mark.way.label for mark in found]
    columns["memory"] = ["" if math.isnan(mark.peak_mb) else f"{mark.peak_mb:.0f} MB" for mark in found]
    columns["told"] = ["nothing" if mark.way.blind else "something" for mark in found]
    columns["fill"] = [STYLES[kind_of(mark)].color if mark.way.blind else "white" for mark in found]
    return ColumnDataSource(columns)
