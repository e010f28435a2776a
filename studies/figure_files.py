"""Figures of studies as files: one look, and the same bytes for the same rows."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

# The salt makes the names inside of an SVG file the same each time.
_LOOK = {
    "font.size": 9,
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.alpha": 0.3,
    "svg.hashsalt": "polaropt",
}


def write_figures(out: Path, figures: Mapping[str, Callable[[], Any]], dpi: int = 120) -> list[Path]:
    """Make matplotlib figures and write each as PNG and SVG.

    Parameters
    ----------
    out : Path
        Folder.
    figures : mapping of str to callable
        By the files' name; called one after the other under the common look.
    dpi : int
        Of the PNG.

    Returns
    -------
    list of Path
        What was written.
    """
    import matplotlib

    files = []
    with matplotlib.rc_context(_LOOK):
        for name, make in figures.items():
            figure = make()
            for ending, metadata in ((".png", None), (".svg", {"Date": None})):
                files.append(out / f"{name}{ending}")
                figure.savefig(files[-1], dpi=dpi, metadata=metadata)
    return files
