"""The figures of the study of starts: quality over incidence, work per regime, and the way to the minimum.

Lines are told apart by dashes and markers as well as by colour, bars by hatches.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from studies.benchmark_chart import Style
from studies.figure_files import write_figures
from studies.learned_init_runs import CLOSED_FORM, COLD, LEARNED, Row
from studies.learned_init_scenes import NOISES
from studies.learned_init_scores import LAYERS, MOMENTS, mean, of_start, regime_of
from studies.stability_scenes import MAP

_COLORS = {CLOSED_FORM: "#0072b2", LEARNED: "black", COLD: "#d55e00"}
_MARKERS = {CLOSED_FORM: "s", LEARNED: "o", COLD: "^"}
_HATCHES = {CLOSED_FORM: "///", LEARNED: "", COLD: "..."}
_FILLS = {CLOSED_FORM: "#9ecae1", LEARNED: "#555555", COLD: "#f5d0b5"}
_OTHER = ("#009e73", "D", "xx", "#b7e0d0")
_DASHES: dict[str, Any] = {"start": (0, (1, 1.5)), "stopped": "-", "converged": (0, (5, 2))}
_LOWEST_DB = -3.0
_PATHS = 3


def draw(rows: Sequence[Row], out: Path) -> list[Path]:
    """Draw all figures, as PNG and SVG, into a folder."""
    figures = {"quality": _quality, "work": _work, "paths": _paths}
    return write_figures(out, {f"learned_init_{name}": partial(make, rows) for name, make in figures.items()}, dpi=110)


def _style(start: str, moment: str = "stopped") -> Style:
    return Style(_COLORS.get(start, _OTHER[0]), _DASHES[moment], _MARKERS.get(start, _OTHER[1]))


def _shown(start: str) -> tuple[str, ...]:
    """Moments of a start in the first figure: the plain intensity is far below all others."""
    return MOMENTS[1:] if start == COLD else MOMENTS


def _quality(rows: Sequence[Row]) -> Any:
    """Start, stopped and converged over incidence, as differences to the solve from the closed form."""
    from matplotlib.figure import Figure

    noises = [noise for noise in NOISES if any(row.family == MAP and row.noise == noise for row in rows)]
    figure = Figure(figsize=(1.5 + 5.2 * len(noises), 7.2), layout="constrained")
    axes = figure.subplots(2, len(noises), squeeze=False, sharex=True)
    handles: dict[str, Any] = {}
    for column, noise in enumerate(noises):
        part = [row for row in rows if row.family == MAP and row.noise == noise]
        for row, layer in enumerate(LAYERS):
            axis = axes[row][column]
            handles |= _differences(axis, part, layer)
            axis.set_ylim(bottom=max(_LOWEST_DB, axis.get_ylim()[0]))
            axis.set_ylabel(f"{layer} (dB)" if column == 0 else "")
        axes[0][column].set_title(f"noise {noise:g}")
        axes[1][column].set_xlabel("incidence (deg)")
    figure.suptitle("PSNR against the solve from the closed form by the default rule, mean over pairs")
    figure.legend(handles.values(), handles, loc="outside lower center", ncols=3, frameon=False, handlelength=4)
    return figure


def _differences(axis: Any, rows: Sequence[Row], layer: str) -> dict[str, Any]:
    incidences = sorted({row.incidence_deg for row in rows})
    at = [[row for row in rows if row.incidence_deg == incidence] for incidence in incidences]
    base = np.array([mean(of_start(there, CLOSED_FORM), f"{layer}_stopped") for there in at])
    handles = {}
    for start in dict.fromkeys(row.start for row in rows):
        for moment in _shown(start):
            style = _style(start, moment)
            values = np.array([mean(of_start(there, start), f"{layer}_{moment}") for there in at])
            (handles[f"{start}: {moment}"],) = axis.plot(
                incidences, values - base, color=style.color, linestyle=style.dashes, marker=style.marker,
                markersize=9 if moment == "start" else 5, markerfacecolor="none" if moment == "start" else style.color,
                linewidth=2 if start == LEARNED else 1.3,
            )  # fmt: skip
    return handles


def _work(rows: Sequence[Row]) -> Any:
    """CPU seconds and evaluations until near the final transmission and until the gap, per regime."""
    from matplotlib.figure import Figure

    regimes = list(dict.fromkeys(regime_of(row) for row in rows))
    starts = list(dict.fromkeys(row.start for row in rows))
    columns = (
        ("cpu_near", "CPU seconds to 0.1 dB"),
        ("cpu_gap", "CPU seconds to the gap"),
        ("evaluations_near", "evaluations to 0.1 dB"),
        ("evaluations_gap", "evaluations to the gap"),
    )
    figure = Figure(figsize=(13, 0.5 * len(regimes) + 1.8), layout="constrained")
    axes = figure.subplots(1, len(columns), sharey=True)
    height = 0.8 / len(starts)
    for axis, (name, title) in zip(axes, columns, strict=True):
        for i, start in enumerate(starts):
            values = [mean(of_start([row for row in rows if regime_of(row) == part], start), name) for part in regimes]
            axis.barh(
                np.arange(len(regimes)) + height * (i - (len(starts) - 1) / 2), np.nan_to_num(values), height,
                color=_FILLS.get(start, _OTHER[3]), hatch=_HATCHES.get(start, _OTHER[2]), edgecolor="black",
                linewidth=0.6, label=start,
            )  # fmt: skip
        axis.set_title(title, fontsize=9)
    axes[0].set_yticks(range(len(regimes)), regimes)
    axes[0].invert_yaxis()
    handles, labels = axes[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=len(labels), frameon=False)
    return figure


def _paths(rows: Sequence[Row]) -> Any:
    """Transmission after each evaluation on the way to the minimum, for some incidences of the first pair."""
    from matplotlib.figure import Figure

    part = [row for row in rows if row.family == MAP and row.noise == NOISES[0] and row.pair == rows[0].pair]
    incidences = sorted({row.incidence_deg for row in part})
    chosen = [incidences[i] for i in np.unique(np.linspace(0, len(incidences) - 1, _PATHS).astype(int))]
    figure = Figure(figsize=(4.3 * len(chosen), 3.8), layout="constrained")
    handles: dict[str, Any] = {}
    for axis, incidence in zip(figure.subplots(1, len(chosen), squeeze=False)[0], chosen, strict=True):
        there = [row for row in part if row.incidence_deg == incidence]
        for row in there:
            style = _style(row.start)
            (handles[row.start],) = axis.plot(
                range(1, len(row.path) + 1), row.path, color=style.color, marker=style.marker, markersize=4,
                linewidth=1.3,
            )  # fmt: skip
        best = max(max(row.path) for row in there)
        ends = min(row.transmission_converged for row in there)
        axis.set_ylim(ends - 6, best + 0.5)
        axis.set_title(f"{incidence:g} deg")
        axis.set_xlabel("evaluations")
    figure.supylabel("transmission (dB)")
    figure.legend(handles.values(), handles, loc="outside lower center", ncols=len(handles), frameon=False)
    return figure
