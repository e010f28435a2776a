"""Charts of what the networks reach: levels of every variant with intervals over the seeds."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from pandas import DataFrame

from studies.ablation_losses.records import Training, groups_of
from studies.ablation_losses.tables import Interval, interval_of, over_seeds, printed
from studies.kit.charts import BLUE, ORANGE, Fill, legend_below, new_figure

_BARS = (
    ("transmission", "transmission", Fill(BLUE, "")),
    ("reflection", "reflection", Fill(ORANGE, "///")),
)
_PRINTED = ("the paper's transmission, other photographs", Fill("white", "..."))


def levels(frame: DataFrame, trainings: Sequence[Training]) -> Any:
    """PSNR and SSIM of both layers with their intervals, and the paper's transmission beside them."""
    groups = groups_of(trainings)
    figure = new_figure(11, 0.62 * len(groups) + 1.6)
    places = np.arange(len(groups))
    of_paper = [printed(group) or (math.nan, math.nan) for group in groups]
    for axis, ending, title, printed_levels in zip(
        figure.subplots(1, 2, sharey=True),
        ("", "_ssim"),
        ("PSNR (dB)", "SSIM"),
        zip(*of_paper, strict=True),
        strict=True,
    ):
        bars = [(label, fill, [interval_of(over_seeds(frame, group, column + ending)) for group in groups])
                for column, label, fill in _BARS]  # fmt: skip
        if np.isfinite(printed_levels).any():
            bars.append((*_PRINTED, [Interval(level, math.nan) for level in printed_levels]))
        for i, (label, fill, found) in enumerate(bars):
            means, halves = np.nan_to_num([(each.mean, each.half) for each in found]).T
            errors = {"xerr": halves, "error_kw": {"capsize": 2}} if halves.any() else {}
            axis.barh(places + 0.27 * (i - 1), means, 0.26, label=label, **errors, **fill.bar)
        axis.set_xlabel(title)
        axis.grid(visible=False, axis="y")
    axis.set_yticks(places, [f"{group.name}\n{group.variant}" for group in groups])
    axis.invert_yaxis()
    legend_below(figure, *axis.get_legend_handles_labels(), 3)
    return figure
