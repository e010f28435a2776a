"""Figures of the ablation of the losses: what every variant loses, and crops of its layers (Fig. 7)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from studies.ablation_losses_tables import Row, means
from studies.ablation_published import TABLE_3
from studies.ablation_records import Training
from studies.protocol import Pair, truth

_CROP, _COLUMNS = 96, 6


def draw(
    rows: Sequence[Row], trainings: Sequence[Training], shown: tuple[Pair, Mapping[str, np.ndarray]], out: Path
) -> list[Path]:
    """Draw both figures into a folder.

    Parameters
    ----------
    rows : sequence of Row
    trainings : sequence of Training
    shown : (Pair, mapping of str to ndarray)
        A pair, and the layers (2, 3, h, w) that each training makes of it.
    out : Path
    """
    import matplotlib

    with matplotlib.rc_context({"font.size": 9, "svg.hashsalt": "polaropt"}):
        files = [out / "ablation_losses.svg", out / "ablation_losses_crops.png"]
        _bars(rows, trainings).savefig(files[0], metadata={"Date": None})
        _crops(*shown).savefig(files[1], dpi=130)
    return files


def _bars(rows: Sequence[Row], trainings: Sequence[Training]) -> Any:
    """PSNR and SSIM of both layers, and the paper's transmission beside them."""
    from matplotlib.figure import Figure

    names = [f"{training.name}\n{training.variant}" for training in trainings]
    found = np.array([means(rows, training.name) for training in trainings])
    printed = np.array([_printed(training) for training in trainings])
    figure = Figure(figsize=(11, 0.62 * len(names) + 1.6), layout="constrained")
    places = np.arange(len(names))
    for axis, column, title in zip(figure.subplots(1, 2, sharey=True), (0, 1), ("PSNR (dB)", "SSIM"), strict=True):
        parts = (
            (found[:, column], "transmission", "#0072b2", ""),
            (found[:, column + 2], "reflection", "#e69f00", "///"),
            (printed[:, column], "the paper's transmission, other photographs", "white", "..."),
        )
        for i, (values, label, color, hatch) in enumerate(parts if np.isfinite(printed).any() else parts[:2]):
            axis.barh(
                places + 0.27 * (i - 1), np.nan_to_num(values), 0.26, color=color, hatch=hatch, edgecolor="black",
                linewidth=0.6, label=label,
            )  # fmt: skip
        axis.set_xlabel(title)
        axis.set_axisbelow(True)
        axis.grid(axis="x", alpha=0.3)
    axis.set_yticks(places, names)
    axis.invert_yaxis()
    handles, labels = axis.get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=3, frameon=False)
    return figure


def _printed(training: Training) -> tuple[float, float]:
    shipped = training.name.startswith("shipped")
    return (np.nan, np.nan) if shipped else TABLE_3.get(training.variant, (np.nan, np.nan))


def _crops(pair: Pair, layers: Mapping[str, np.ndarray]) -> Any:
    """Crops of the truth and of what every training makes of one scene, transmission above reflection."""
    from matplotlib.figure import Figure

    shown = {"truth": np.stack([np.moveaxis(layer, -1, 0) for layer in truth(pair)]), **layers}
    columns = min(_COLUMNS, len(shown))
    rows = -(-len(shown) // columns)
    figure = Figure(figsize=(2 * columns, 4.3 * rows), layout="constrained")
    grid = figure.subplots(2 * rows, columns, squeeze=False)
    for axes in grid.flat:
        axes.set_axis_off()
    for number, (label, both) in enumerate(shown.items()):
        row, column = divmod(number, columns)
        for i in (0, 1):
            grid[2 * row + i, column].imshow(_crop(np.moveaxis(both[i], 0, -1)), interpolation="nearest")
        grid[2 * row, column].set_title(label, fontsize=8)
    return figure


def _crop(image: np.ndarray) -> np.ndarray:
    top, left = ((side - _CROP) // 2 for side in image.shape[:2])
    return np.clip(image[top : top + _CROP, left : left + _CROP], 0, 1)
