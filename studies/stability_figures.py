"""The stability study's figures: maps over incidence and noise, curves along every family, and the warnings.

Colours are told apart by dashes and markers as well; maps are in a scale that stays in order in grey.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from studies.kit.charts import Style, write_figures
from studies.scenes import MAP, SPECIAL
from studies.stability_rows import COMPONENTS, MINIMUM, NOTHING
from studies.stability_scores import AUTO, Judged, score

_STYLES = {
    AUTO: Style("black", "-", "o", 2.4),
    "pixelwise": Style("#0072b2", "--", "s"),
    "ghosts": Style("#d55e00", "-.", "^"),
    "perspective": Style("#009e73", ":", "v"),
    NOTHING: Style("grey", (0, (1, 1)), "+"),
    MINIMUM: Style("#e69f00", (0, (5, 1, 1, 1)), "x"),
    COMPONENTS: Style("#cc79a7", (0, (3, 2)), "d"),
}
_SAID = {
    AUTO: "model auto (chosen by the photographs)",
    NOTHING: "plain intensity (nothing done)",
    MINIMUM: "minimum over angles",
    COMPONENTS: "independent components (FastICA)",
}
_OTHERS = (Style("#56b4e9", (0, (6, 2)), "P"), Style("#8c564b", (0, (4, 1, 1, 1, 1, 1)), "*"))
_COLUMNS = 4


def draw(judged: Sequence[Judged], out: Path) -> list[Path]:
    """Draw all figures for which there are separations, as PNG and SVG.

    Parameters
    ----------
    judged : sequence of Judged
    out : Path
        Folder.
    """
    figures = {
        "stability_map": lambda: _maps(judged),
        "stability_transmission": lambda: _curves(judged, "transmission"),
        "stability_reflection": lambda: _curves(judged, "reflection"),
        "stability_warnings": lambda: _warnings(judged),
    }
    if not any(part.row.family == MAP for part in judged):
        del figures["stability_map"]
    return write_figures(out, figures)


def _maps(judged: Sequence[Judged]) -> Any:
    """Means over pairs of both layers' PSNR over incidence and noise; where any pair fails, and unannounced."""
    from matplotlib.figure import Figure

    parts = [part for part in judged if part.row.family == MAP and part.row.method == AUTO]
    incidences, noises = (sorted({getattr(part.row, name) for part in parts}) for name in ("value", "second"))
    figure = Figure(figsize=(13, 4.4), layout="constrained")
    quantities = (("transmission (dB)", "transmission"), ("reflection (dB)", "reflection"), ("gain", "gain"))
    for axis, (title, name) in zip(figure.subplots(1, 3, sharey=True), quantities, strict=True):
        values = np.full((len(noises), len(incidences)), np.nan)
        for i, noise in enumerate(noises):
            for j, incidence in enumerate(incidences):
                there = [part for part in parts if (part.row.value, part.row.second) == (incidence, noise)]
                if there:
                    values[i, j] = np.mean([part.gain if name == "gain" else getattr(part.row, name) for part in there])
                    _mark(axis, i, j, there, name)
        _heatmap(axis, values, incidences, noises)
        axis.set_title("transmission over doing nothing (dB)" if name == "gain" else title)
        axis.set_xlabel("incidence (deg)")
        if name == "transmission":
            axis.set_ylabel("noise (white = 1)")
    figure.suptitle("auto, mean over pairs; framed: a pair fails in this layer, dashed frame: and was not announced")
    return figure


def _mark(axis: Any, row: int, column: int, there: Sequence[Judged], name: str) -> None:
    """A frame around the cell of scenes that fail in the layer shown."""
    from matplotlib.patches import Rectangle

    failed = [part for part in there if (part.reflection_lost if name == "reflection" else part.worse or part.far)]
    if failed:
        dashes = "-" if all(part.announced for part in failed) else ":"
        axis.add_patch(
            Rectangle(
                (column - 0.42, row - 0.42), 0.84, 0.84, fill=False, edgecolor="red", linestyle=dashes, linewidth=2
            )
        )


def _heatmap(axis: Any, values: Any, incidences: Sequence[float], noises: Sequence[float]) -> None:
    image = axis.imshow(values, cmap="cividis", aspect="auto", origin="lower")
    middle = np.nanmean([np.nanmin(values), np.nanmax(values)]) if np.isfinite(values).any() else 0
    for (i, j), value in np.ndenumerate(values):
        if math.isfinite(value):
            axis.text(j, i, f"{value:.0f}", ha="center", va="center", color="white" if value < middle else "black")
    axis.set_xticks(range(len(incidences)), [f"{incidence:g}" for incidence in incidences])
    axis.set_yticks(range(len(noises)), [f"{noise:g}" for noise in noises])
    axis.grid(visible=False)
    axis.figure.colorbar(image, ax=axis, shrink=0.8)


def _curves(judged: Sequence[Judged], layer: str) -> Any:
    """PSNR of a layer along every family, a line per method; crosses where `auto` is worse than doing nothing."""
    from matplotlib.figure import Figure

    families = [family for family in dict.fromkeys(part.row.family for part in judged) if family != MAP]
    names = list(dict.fromkeys(part.row.method for part in judged))
    others = iter(_OTHERS * len(names))
    styles = {name: _STYLES.get(name) or next(others) for name in names}
    rows = max(1, math.ceil(len(families) / _COLUMNS))
    figure = Figure(figsize=(4.0 * _COLUMNS, 3.0 * rows + 0.6), layout="constrained")
    axes = figure.subplots(rows, _COLUMNS, squeeze=False).ravel()
    handles: dict[str, Any] = {}
    for axis, family in zip(axes, families, strict=False):
        parts = [part for part in judged if part.row.family == family]
        for name in names:
            handles[name] = _curve(axis, [part for part in parts if part.row.method == name], layer, styles[name])
        _dress(axis, family, parts)
    for axis in axes[len(families) :]:
        axis.set_visible(False)
    figure.supylabel(f"PSNR of the {layer} (dB), mean over pairs")
    said = [_SAID.get(name, f"model {name}") for name in handles]
    figure.legend(
        handles.values(), said, loc="outside lower center", ncols=min(5, len(names)), frameon=False, handlelength=4
    )
    if layer == "transmission":
        figure.suptitle("large crosses: auto is worse than the plain intensity by more than 0.1 dB on a pair")
    return figure


def _curve(axis: Any, parts: Sequence[Judged], layer: str, style: Style) -> Any:
    values = sorted({part.row.value for part in parts})
    at = {value: [part for part in parts if part.row.value == value] for value in values}
    means = [float(np.mean([getattr(part.row, layer) for part in at[value]])) for value in values]
    (line,) = axis.plot(
        range(len(values)), means, color=style.color, linestyle=style.dashes, marker=style.marker, markersize=4,
        linewidth=style.width, zorder=5 if style.width > 2 else 3,
    )  # fmt: skip
    if layer == "transmission" and parts and parts[0].row.method == AUTO:
        worse = [i for i, value in enumerate(values) if any(part.worse for part in at[value])]
        axis.plot(worse, [means[i] for i in worse], "x", color="red", markersize=11, markeredgewidth=2.5, zorder=6)
    return line


def _dress(axis: Any, family: str, parts: Sequence[Judged]) -> None:
    """Values evenly spaced, as they were chosen; special cases by their names."""
    labels = {part.row.value: part.row.case.removeprefix(f"{family}: ") for part in parts}
    values = sorted(labels)
    special = family == SPECIAL
    axis.set_xticks(
        range(len(values)),
        [labels[value].replace(", ", ",\n") if special else f"{value:g}" for value in values],
        rotation=30 if special else 0,
        ha="right" if special else "center",
        fontsize=8,
    )
    axis.set_title(family, fontsize=10)


def _warnings(judged: Sequence[Judged]) -> Any:
    """Per family: separations without failure, failures announced and not, false alarms."""
    from matplotlib.figure import Figure

    auto = [part for part in judged if part.row.method == AUTO]
    families = list(dict.fromkeys(part.row.family for part in auto))
    scores = [score([part for part in auto if part.row.family == family]) for family in families]
    bars = (
        ("no failure, nothing said", [s.n - s.failed - s.false_alarms for s in scores], "#dddddd", ""),
        ("no failure, false alarm", [s.false_alarms for s in scores], "#e69f00", "//"),
        ("failure, announced", [s.announced for s in scores], "#56b4e9", ".."),
        ("failure, not announced", [s.failed - s.announced for s in scores], "#a01010", "xx"),
    )
    figure = Figure(figsize=(9, 0.35 * len(families) + 1.6), layout="constrained")
    axis = figure.subplots()
    left = np.zeros(len(families))
    for label, counts, color, hatch in bars:
        axis.barh(families, counts, left=left, label=label, color=color, hatch=hatch, edgecolor="black", linewidth=0.5)
        left += counts
    axis.invert_yaxis()
    axis.set_xlabel("separations by auto")
    figure.legend(loc="outside upper center", ncols=2, frameon=False)
    return figure
