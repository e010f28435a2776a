"""Figure of the ladder: what each rung makes of each family of scenes, beside doing nothing."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from studies.figure_files import write_figures

if TYPE_CHECKING:
    from studies.model_ladder import Row

_STYLES = {
    "known": ("|", "black", "scene known"),
    "auto": ("o", "#0072b2", "auto"),
    "pixelwise": ("v", "#56b4e9", "pixelwise"),
    "ghosts": ("s", "#e69f00", "ghosts"),
    "perspective": ("D", "#009e73", "perspective"),
    "curved": ("X", "#cc79a7", "curved"),
    "polarized": ("*", "#d55e00", "polarized"),
    "none": ("x", "#999999", "none"),
}


def draw(rows: Sequence[Row], out: Path) -> list[Path]:
    """Draw the transmission's mean PSNR per family and model, as SVG and PNG."""
    return write_figures(out, {"model_ladder": lambda: _rungs(rows)})


def _rungs(rows: Sequence[Row]) -> Any:
    from matplotlib.figure import Figure

    families = list(dict.fromkeys(row.family for row in rows))
    figure = Figure(figsize=(10, 0.34 * len(families) + 1.6), layout="constrained")
    axis = figure.subplots()
    nothing = [float(np.mean([row.nothing for row in rows if row.family == family])) for family in families]
    places = np.arange(len(families))
    axis.barh(places, nothing, 0.8, color="#dddddd", label="doing nothing")
    for model, (marker, color, label) in _STYLES.items():
        found = [_mean(rows, family, model) for family in families]
        if np.isfinite(found).any():
            chosen = model == "auto"
            axis.plot(
                found, places, marker, color=color, label=label, zorder=3 if chosen else 4,
                markersize=11 if chosen else 6, markerfacecolor="none" if chosen else color,
                markeredgewidth=1.8 if chosen else 1,
            )  # fmt: skip
    axis.set_yticks(places, families)
    axis.invert_yaxis()
    axis.set_xlim(left=0.8 * min(nothing))
    axis.set_xlabel("PSNR of the transmission (dB), mean over the pairs")
    axis.grid(visible=False, axis="y")
    figure.legend(loc="outside lower center", ncols=5, frameon=False)
    return figure


def _mean(rows: Sequence[Row], family: str, model: str) -> float:
    part = [row.transmission for row in rows if (row.family, row.model) == (family, model)]
    return float(np.mean(part)) if part else float("nan")
