"""The study of coverage as a figure: how often the truth lies within two stated errors, over incidence.

Colours are told apart by dashes and markers as well.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from studies.kit.charts import Style, write_figures

if TYPE_CHECKING:
    from studies.coverage import Row

_LAYERS = ("transmission", "reflection")
_STYLES = (
    Style("black", "-", "o", 2.0),
    Style("#0072b2", "--", "s"),
    Style("#d55e00", ":", "^"),
    Style("#009e73", "-.", "v"),
)
# Of a normal distribution.
_WITHIN_TWO = 95.4


def draw(rows: Sequence[Row], out: Path) -> list[Path]:
    """Draw ``coverage.png`` and ``coverage.svg`` into a folder: means over pairs, bars from the least pair up."""
    return write_figures(out, {"coverage": lambda: _figure(rows)})


def _figure(rows: Sequence[Row]) -> Any:
    from matplotlib.figure import Figure

    figure = Figure(figsize=(10, 4.4), layout="constrained")
    panels = figure.subplots(1, len(_LAYERS), sharey=True)
    for panel, layer in zip(panels, _LAYERS, strict=True):
        _panel(panel, [row for row in rows if row.layer == layer], layer)
    panels[0].set_ylabel("pixels within two stated errors (%)")
    handles, names = panels[0].get_legend_handles_labels()
    figure.legend(handles, names, loc="outside lower center", ncols=3, frameon=False, handlelength=4)
    return figure


def _panel(panel: Any, rows: Sequence[Row], layer: str) -> None:
    incidences = sorted({row.incidence_deg for row in rows})
    kinds = dict.fromkeys((row.scene, row.noise) for row in rows)
    for i, (scene, noise) in enumerate(kinds):
        style = _STYLES[i % len(_STYLES)]
        part = [row for row in rows if (row.scene, row.noise) == (scene, noise)]
        shares = [[100 * row.covered for row in part if row.incidence_deg == incidence] for incidence in incidences]
        means = np.array([np.mean(share) for share in shares])
        below = means - [min(share) for share in shares]
        # Side by side, so that bars do not hide one another.
        places = np.array(incidences) + 0.7 * (i - (len(kinds) - 1) / 2)
        panel.errorbar(
            places, means, yerr=[below, 0 * below], color=style.color, linestyle=style.dashes, marker=style.marker,
            linewidth=style.width, elinewidth=0.8, capsize=2, label=f"scene {scene}, noise {noise:g}",
        )  # fmt: skip
    panel.axhline(_WITHIN_TWO, color="grey", linewidth=1, label=f"{_WITHIN_TWO:g} %: normal errors")
    panel.set_xticks(incidences, [f"{incidence:g}" for incidence in incidences])
    panel.set_xlabel("angle of incidence (deg); bars: down to the least pair")
    panel.set_title(layer)
