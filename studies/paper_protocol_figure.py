"""The paper's protocol as a figure: PSNR of both layers over incidence, known, blind and before any solve.

Colours are told apart by dashes and markers as well.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from studies.benchmark_chart import Style
from studies.figure_files import write_figures

if TYPE_CHECKING:
    from studies.paper_protocol import Row

_LAYERS = ("transmission", "reflection")
_LINES = {
    "blind": ("solved blind (band: all pairs)", Style("black", "-", "o", 2.4)),
    "known": ("solved, scene known", Style("#0072b2", "--", "s")),
    "start": ("closed form alone, scene known", Style("#d55e00", ":", "^")),
}
_NOTHING = ("plain intensity", Style("grey", "-.", "x"))
_KINDS = {"paper": "ghosts as far apart as the paper has them", "plate": "ghosts of a plane-parallel plate"}


def draw(rows: Sequence[Row], out: Path) -> list[Path]:
    """Draw ``paper_protocol.png`` and ``paper_protocol.svg`` into a folder, a row of panels for each kind of ghosts."""
    return write_figures(out, {"paper_protocol": lambda: _figure(rows)})


def _figure(rows: Sequence[Row]) -> Any:
    from matplotlib.figure import Figure

    kinds = list(dict.fromkeys(row.kind for row in rows))
    figure = Figure(figsize=(10, 0.8 + 3.6 * len(kinds)), layout="constrained")
    grid = figure.subplots(len(kinds), len(_LAYERS), squeeze=False, sharey="col")
    for panels, kind in zip(grid, kinds, strict=True):
        for panel, layer in zip(panels, _LAYERS, strict=True):
            _panel(panel, [row for row in rows if row.kind == kind], layer)
            panel.set_title(_KINDS.get(kind, kind))
    handles, names = grid[0, 0].get_legend_handles_labels()
    figure.legend(handles, names, loc="outside lower center", ncols=len(names), frameon=False, handlelength=4)
    return figure


def _panel(panel: Any, rows: Sequence[Row], layer: str) -> None:
    incidences = sorted({row.incidence_deg for row in rows})

    def levels(name: str) -> list[list[float]]:
        return [[getattr(row, name) for row in rows if row.incidence_deg == incidence] for incidence in incidences]

    lines = [(f"{name}_{layer}", *line) for name, line in _LINES.items()]
    if layer == "transmission":
        lines.append(("nothing", *_NOTHING))
    for name, said, style in lines:
        means = [float(np.mean(part)) for part in levels(name)]
        # What was not run is NaN, and shows no line.
        panel.plot(
            incidences, means, color=style.color, linestyle=style.dashes, marker=style.marker, linewidth=style.width,
            label=said,
        )  # fmt: skip
    of_pairs = levels(f"blind_{layer}")
    panel.fill_between(incidences, [min(part) for part in of_pairs], [max(part) for part in of_pairs], color="0.85")
    panel.set_xticks(incidences)
    panel.set_xlabel("angle of incidence (deg)")
    panel.set_ylabel(f"PSNR of the {layer} (dB)")
