"""The work-precision chart: gap and PSNR of both layers against seconds, a line per solver, a column per size."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from studies import benchmark_solvers
from studies.benchmark_contestants import OURS, SCIPY_AUTOGRAD, TORCH_AUTOGRAD, WHITENED
from studies.benchmark_record import Record
from studies.benchmark_tables import one, places
from studies.kit.charts import Style, write_figures
from studies.scores import GAP

_ROWS = (
    ("curve: gap", "relative gap"),
    ("curve: transmission", "PSNR of the\ntransmission (dB)"),
    ("curve: reflection", "PSNR of the\nreflection (dB)"),
)
_LEAST_GAP = 3e-5
_MOST_MARKERS = 7
_TOP_DB, _SHOWN_DB = 1.0, 22.0


def draw(record: Record, case: str, path: Path) -> list[Path]:
    """Draw the chart of one scene and write it as PNG and SVG.

    Parameters
    ----------
    record : Record
    case : str
        "hard" or "easy".
    path : Path
        Without an ending.

    Returns
    -------
    list of Path
        The files; none where there are no curves.
    """
    sizes = [size for measured, size in places(record, benchmark_solvers.TABLE) if measured == case]
    if not sizes:
        return []
    return write_figures(path.parent, {path.stem: lambda: _figure(record, case, sizes)}, dpi=130)


def _figure(record: Record, case: str, sizes: list[str]) -> Any:
    from matplotlib.figure import Figure
    from matplotlib.lines import Line2D

    figure = Figure(figsize=(1.4 + 3.6 * len(sizes), 9.2) if len(sizes) > 1 else (7.0, 9.2))
    axes = figure.subplots(len(_ROWS), len(sizes), sharex="col", sharey="row", squeeze=False)
    handles: dict[str, Any] = {}
    for column, size in enumerate(sizes):
        for row, (quantity, label) in enumerate(_ROWS):
            axis = axes[row][column]
            handles |= _lines(axis, record, case, size, quantity)
            _dress(axis, row, label if column == 0 else "", size if row == 0 else "")
            if row:
                _dress_decibels(axis, record, case, size, quantity)
        axes[-1][column].set_xlabel("seconds, set-up included")
    degrees = benchmark_solvers.INCIDENCES_DEG[case]
    figure.suptitle(f"Work and precision: {case} scene ({degrees:g} degrees), colour", y=0.995)
    names = _ordered(handles)
    columns = 3 if len(sizes) > 2 else 2
    lines = math.ceil((len(names) + 1) / columns)
    shown = [*(handles[name] for name in names), Line2D([], [], color="grey", linewidth=0.8)]
    figure.legend(
        shown,
        [*names, f"gap of {GAP:g}; PSNR at the lowest value"],
        loc="lower center",
        ncols=columns,
        frameon=False,
        handlelength=4,
    )
    figure.tight_layout(rect=(0, 0.022 * lines + 0.015, 1, 1))
    return figure


def _lines(axis: Any, record: Record, case: str, size: str, quantity: str) -> dict[str, Any]:
    """Draw every solver's curve; handles for the legend by name."""
    where = {"table": benchmark_solvers.TABLE, "case": case, "size": size}
    handles = {}
    for curve in record.find(**where, quantity=quantity):
        clock = one(record, **where, subject=curve.subject, quantity="curve: wall, with set-up")
        if clock is None:
            continue
        style = style_of(curve.subject)
        (handles[curve.subject],) = axis.plot(
            clock.samples,
            curve.samples,
            color=style.color,
            linestyle=style.dashes,
            linewidth=style.width,
            marker=style.marker,
            markersize=5,
            markerfacecolor="white" if "cold" in curve.subject else style.color,
            markevery=_marked(clock.samples),
            zorder=5 if curve.subject.startswith(OURS) else 3,
        )
    return handles


def _marked(seconds: Sequence[float]) -> list[int]:
    """Which points get a marker: evenly spaced on the logarithmic axis, the first and the last among them."""
    wanted = np.geomspace(seconds[0], seconds[-1], _MOST_MARKERS)
    return sorted({min(int(i), len(seconds) - 1) for i in np.searchsorted(seconds, wanted)} | {len(seconds) - 1})


def style_of(name: str) -> Style:
    """Ours heavy and black, automatic gradients in colour, others thin; dashed where the start is cold."""
    cold = name.endswith("cold")
    families: list[tuple[Callable[[str], bool], Style]] = [
        (lambda n: n.startswith(OURS), Style("black", "--" if cold else "-", "o", 2.4)),
        (lambda n: n.startswith(SCIPY_AUTOGRAD), Style("#0072b2", "--" if cold else "-", "s")),
        (lambda n: n.startswith(TORCH_AUTOGRAD), Style("#d55e00", "--" if cold else "-", "^")),
        (lambda n: n.startswith(f"{WHITENED} scipy"), Style("#56b4e9", ":", "x")),
        (lambda n: n.startswith(f"{WHITENED} nlopt"), Style("#009e73", "-.", "v")),
        (lambda n: n.startswith(f"{WHITENED} torch on cuda"), Style("#e69f00", (0, (1, 1)), "P")),
        (lambda n: n.startswith(f"{WHITENED} torch"), Style("#e69f00", (0, (5, 1, 1, 1)), "+")),
        (lambda n: n.startswith(f"{WHITENED} casadi"), Style("#cc79a7", (0, (3, 2, 1, 2)), "d")),
    ]
    return next((style for matches, style in families if matches(name)), Style("grey", ":", "."))


def _ordered(handles: dict[str, Any]) -> list[str]:
    """Ours first, then by name."""
    return sorted(handles, key=lambda name: (not name.startswith(OURS), name.startswith(WHITENED), name))


def _dress(axis: Any, row: int, label: str, title: str) -> None:
    axis.set_xscale("log")
    if row == 0:
        axis.set_yscale("log")
        axis.set_ylim(_LEAST_GAP, 1.5)
        axis.axhline(GAP, color="grey", linewidth=0.8)
    if label:
        axis.set_ylabel(label)
    if title:
        axis.set_title(title)


def _dress_decibels(axis: Any, record: Record, case: str, size: str, quantity: str) -> None:
    """A thin line marks the PSNR at the lowest objective; what is far below it is not shown."""
    where = {"table": benchmark_solvers.TABLE, "case": case, "size": size, "subject": benchmark_solvers.REFERENCE}
    top = one(record, **where, quantity=quantity.removeprefix("curve: "))
    if top is None:
        return
    axis.axhline(top.median, color="grey", linewidth=0.8)
    bottom, upper = axis.get_ylim()
    axis.set_ylim(max(bottom, top.median - _SHOWN_DB), max(upper, top.median + _TOP_DB))
