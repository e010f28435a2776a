"""Figures of the ablation of the losses: what every variant loses, and crops of its layers (Fig. 7)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from polaropt.capture import planes_last
from studies.ablation_losses_tables import Row, means
from studies.ablation_published import TABLE_3
from studies.ablation_records import Training
from studies.kit.charts import crops, write_figures
from studies.photographs import Pair

_COLUMNS = 6


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
    pair, found = shown
    layers = {"truth": pair.frames} | {name: tuple(map(planes_last, both)) for name, both in found.items()}
    figures = {
        "ablation_losses": lambda: _bars(rows, trainings),
        "ablation_losses_crops": lambda: crops(layers, _COLUMNS),
    }
    return write_figures(out, figures)


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
        axis.grid(visible=False, axis="y")
    axis.set_yticks(places, names)
    axis.invert_yaxis()
    handles, labels = axis.get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=3, frameon=False)
    return figure


def _printed(training: Training) -> tuple[float, float]:
    shipped = training.name.startswith("shipped")
    return (np.nan, np.nan) if shipped else TABLE_3.get(training.variant, (np.nan, np.nan))
