"""The work-precision chart: gap and PSNR of both layers against seconds, a line per solver, a column per size."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
from pandas import DataFrame

from studies.benchmark.race import INCIDENCES_DEG, OURS, SCIPY_AUTOGRAD, TORCH_AUTOGRAD, WHITENED
from studies.benchmark.rows import RACE
from studies.benchmark.tables import one
from studies.kit.charts import BLUE, GREEN, ORANGE, PURPLE, SKY, VERMILION, Style
from studies.kit.frames import values_of, where
from studies.scores import GAP

_ROWS = {
    "gap": "relative gap",
    "transmission": "PSNR of the\ntransmission (dB)",
    "reflection": "PSNR of the\nreflection (dB)",
}
_SHOWN_GAP = 3e-5
_MOST_MARKERS = 7
_TOP_DB, _SHOWN_DB = 1.0, 22.0
_STYLES = {
    SCIPY_AUTOGRAD: Style(BLUE, "-", "s"),
    TORCH_AUTOGRAD: Style(VERMILION, "-", "^"),
    f"{WHITENED} scipy": Style(SKY, ":", "x"),
    f"{WHITENED} nlopt": Style(GREEN, "-.", "v"),
    f"{WHITENED} torch on cuda": Style(ORANGE, (0, (1, 1)), "P"),
    f"{WHITENED} torch": Style(ORANGE, (0, (5, 1, 1, 1)), "+"),
    f"{WHITENED} casadi": Style(PURPLE, (0, (3, 2, 1, 2)), "d"),
    OURS: Style("black", "-", "o", 2.4),
}
_OTHER = Style("grey", ":", ".")


def figures(frame: DataFrame) -> dict[str, Callable[[], Any]]:
    """A chart of each scene that was raced on."""
    races = where(frame, table=RACE)
    parts = {case: where(races, case=case) for case in INCIDENCES_DEG}
    return {
        "work_precision" if case == "hard" else f"work_precision_{case}": partial(_figure, part, case)
        for case, part in parts.items()
        if len(part)
    }


def _figure(races: DataFrame, case: str) -> Any:
    from matplotlib.figure import Figure
    from matplotlib.lines import Line2D

    sizes = values_of(races, "size")
    figure = Figure(figsize=(1.4 + 3.6 * len(sizes), 9.2) if len(sizes) > 1 else (7.0, 9.2))
    axes = figure.subplots(len(_ROWS), len(sizes), sharex="col", sharey="row", squeeze=False)
    handles: dict[str, Any] = {}
    for column, size in enumerate(sizes):
        part = where(races, size=size)
        for axis, (quantity, label) in zip(axes[:, column], _ROWS.items(), strict=True):
            handles |= _lines(axis, part, quantity)
            axis.set_xscale("log")
            if quantity == "gap":
                _dress_gap(axis, size)
            if column == 0:
                axis.set_ylabel(label)
            if quantity != "gap":
                _dress_decibels(axis, part, quantity)
        axes[-1][column].set_xlabel("seconds, set-up included")
    figure.suptitle(f"Work and precision: {case} scene ({INCIDENCES_DEG[case]:g} degrees), colour", y=0.995)
    # Ours first, then by name.
    names = sorted(handles, key=lambda name: (not name.startswith(OURS), name.startswith(WHITENED), name))
    columns = 3 if len(sizes) > 2 else 2
    lines = math.ceil((len(names) + 1) / columns)
    figure.legend(
        [*(handles[name] for name in names), Line2D([], [], color="grey", linewidth=0.8)],
        [*names, f"gap of {GAP:g}; PSNR at the lowest value"],
        loc="lower center",
        ncols=columns,
        frameon=False,
        handlelength=4,
    )
    figure.tight_layout(rect=(0, 0.022 * lines + 0.015, 1, 1))
    return figure


def _lines(axis: Any, races: DataFrame, quantity: str) -> dict[str, Any]:
    """Draw every solver's curve; handles for the legend by name."""
    handles = {}
    for curve in where(races, quantity=f"curve: {quantity}").itertuples():
        name, style = curve.subject, style_of(curve.subject)
        seconds = one(races, subject=name, quantity="curve: wall, with set-up").samples
        (handles[name],) = axis.plot(
            seconds,
            curve.samples,
            **style.line,
            markersize=5,
            markerfacecolor="white" if name.endswith("cold") else style.color,
            markevery=_marked(seconds),
            zorder=5 if name.startswith(OURS) else 3,
        )
    return handles


def _marked(seconds: Sequence[float]) -> list[int]:
    """Which points get a marker: evenly spaced on the logarithmic axis, the first and the last among them."""
    wanted = np.geomspace(seconds[0], seconds[-1], _MOST_MARKERS)
    return sorted({min(int(i), len(seconds) - 1) for i in np.searchsorted(seconds, wanted)} | {len(seconds) - 1})


def style_of(name: str) -> Style:
    """Ours heavy and black, automatic gradients in colour, others thin; dashed where the start is cold."""
    style = next((style for solver, style in _STYLES.items() if name.startswith(solver)), _OTHER)
    return replace(style, dashes="--") if name.endswith("cold") else style


def _dress_gap(axis: Any, size: str) -> None:
    axis.set_yscale("log")
    axis.set_ylim(_SHOWN_GAP, 1.5)
    axis.axhline(GAP, color="grey", linewidth=0.8)
    axis.set_title(size)


def _dress_decibels(axis: Any, races: DataFrame, quantity: str) -> None:
    """A thin line marks the PSNR at the lowest objective; what is far below it is not shown."""
    top = one(races, quantity=quantity)
    axis.axhline(top.median, color="grey", linewidth=0.8)
    bottom, upper = axis.get_ylim()
    axis.set_ylim(max(bottom, top.median - _SHOWN_DB), max(upper, top.median + _TOP_DB))
