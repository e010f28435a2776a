"""Charts of studies: one look, told apart without colour as well, and the same bytes for the same rows."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

# The salt makes the names inside of an SVG file the same each time.
_LOOK = {
    "font.size": 9,
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.alpha": 0.3,
    "svg.hashsalt": "polaropt",
}
CROP_PX = 96

Dashes = str | tuple[int, tuple[float, ...]]

# Okabe & Ito, "Color universal design" (2008): told apart by the colour-blind.
BLUE, SKY, ORANGE, GREEN, VERMILION, PURPLE = "#0072b2", "#56b4e9", "#e69f00", "#009e73", "#d55e00", "#cc79a7"


@dataclass(frozen=True)
class Style:
    """How a line looks: told apart by colour, by dashes and by markers."""

    color: str
    dashes: Dashes
    marker: str
    width: float = 1.4

    @property
    def line(self) -> dict[str, Any]:
        """As matplotlib's `plot` takes it."""
        return {"color": self.color, "linestyle": self.dashes, "marker": self.marker, "linewidth": self.width}


@dataclass(frozen=True)
class Fill:
    """How a bar looks: told apart by colour and by hatches."""

    color: str
    hatch: str

    @property
    def bar(self) -> dict[str, Any]:
        """As matplotlib's `bar` and `barh` take it."""
        return {"color": self.color, "hatch": self.hatch, "edgecolor": "black", "linewidth": 0.6}


def new_figure(width: float, height: float) -> Any:
    """An empty matplotlib figure of this size in inches, which lays itself out."""
    from matplotlib.figure import Figure

    return Figure(figsize=(width, height), layout="constrained")


def legend_below(figure: Any, handles: Sequence[Any], labels: Sequence[str], columns: int, **more: Any) -> None:
    """One legend for all panels, below them."""
    figure.legend(handles, labels, loc="outside lower center", ncols=columns, frameon=False, **more)


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


def crops(layers: Mapping[str, Sequence[np.ndarray]], columns: int) -> Any:
    """A figure of the middles of pictures, transmission above reflection.

    Parameters
    ----------
    layers : mapping of str to two ndarrays, shape (h, w, 3)
        Both layers by their title.
    columns : int
        At most.
    """
    columns = min(columns, len(layers))
    rows = -(-len(layers) // columns)
    figure = new_figure(2 * columns, 4.3 * rows)
    grid = figure.subplots(2 * rows, columns, squeeze=False)
    for axes in grid.flat:
        axes.set_axis_off()
    for number, (title, images) in enumerate(layers.items()):
        row, column = divmod(number, columns)
        for i in (0, 1):
            grid[2 * row + i, column].imshow(_crop(images[i]), interpolation="nearest")
        grid[2 * row, column].set_title(title, fontsize=8)
    return figure


def _crop(image: np.ndarray) -> np.ndarray:
    top, left = ((side - CROP_PX) // 2 for side in image.shape[:2])
    return np.clip(image[top : top + CROP_PX, left : left + CROP_PX], 0, 1)
