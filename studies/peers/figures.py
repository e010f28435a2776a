"""The peers' study as a figure: PSNR of both layers over incidence, a line per method.

Colours are told apart by dashes and markers as well.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from studies.kit.charts import Style, write_figures
from studies.peers.rows import PROTOCOL, Row
from studies.peers.tables import mean, of
from studies.ways import METHODS

_STYLES = (
    Style("grey", (0, (1, 1)), "+"),
    Style("#e69f00", (0, (5, 1, 1, 1)), "x"),
    Style("#cc79a7", (0, (3, 2)), "d"),
    Style("#009e73", ":", "v"),
    Style("#0072b2", "--", "s"),
    Style("#d55e00", "-.", "^"),
    Style("#8c564b", (0, (4, 1, 1, 1, 1, 1)), "*"),
    Style("#56b4e9", (0, (6, 2)), "P"),
    Style("#332288", (0, (2, 1)), "X"),
    Style("black", "-", "o", 2.6),
)
_LAYERS = ("transmission", "reflection")


def draw(rows: Sequence[Row], out: Path) -> list[Path]:
    """Draw the paper's protocol as ``peers.png`` and ``peers.svg`` into a folder; nothing where there are no rows."""
    shown = of(rows, group=PROTOCOL)
    if not shown:
        return []
    return write_figures(out, {"peers": lambda: _figure(shown)}, dpi=130)


def _figure(rows: Sequence[Row]) -> Any:
    from matplotlib.figure import Figure

    figure = Figure(figsize=(10, 5.2), layout="constrained")
    panels = figure.subplots(1, len(_LAYERS))
    scenes = list(dict.fromkeys(row.scene for row in rows))
    for panel, layer in zip(panels, _LAYERS, strict=True):
        for method, style in zip(METHODS.values(), _STYLES, strict=True):
            levels = [mean(of(rows, method=method.name, scene=scene), layer) for scene in scenes]
            if not all(map(math.isnan, levels)):
                panel.plot(
                    range(len(scenes)), levels, color=style.color, linestyle=style.dashes, marker=style.marker,
                    linewidth=style.width, label=method.name,
                )  # fmt: skip
        panel.set_xticks(range(len(scenes)), scenes)
        panel.set_xlabel("angle of incidence (deg)")
        panel.set_ylabel(f"PSNR of the {layer} (dB)")
    handles, names = panels[0].get_legend_handles_labels()
    figure.legend(handles, names, loc="outside lower center", ncols=4)
    return figure
