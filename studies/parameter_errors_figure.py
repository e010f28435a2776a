"""Figure of the stated errors: how often they hold the truth, and how large they are beside the true ones."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from studies.kit.charts import write_figures

if TYPE_CHECKING:
    from studies.parameter_errors import Row

_WANTED = (90.0, 99.0)
_RATIOS = (0.3, 1.0, 3.0, 10.0)


def draw(rows: Sequence[Row], out: Path) -> list[Path]:
    """Draw the share of truths within two stated errors per kind of scene and number, as SVG and PNG."""
    return write_figures(out, {"parameter_errors": lambda: _shares(rows)})


def _shares(rows: Sequence[Row]) -> Any:
    """One row per kind and number: the share, with the interval that so few scenes leave, and the ratio of errors."""
    from matplotlib.figure import Figure

    groups = [
        (f"{kind}: {name}", [row for row in rows if (row.kind, row.parameter) == (kind, name)])
        for kind, name in dict.fromkeys((row.kind, row.parameter) for row in rows)
    ]
    figure = Figure(figsize=(9, 0.27 * len(groups) + 1.4), layout="constrained")
    shares, ratios = figure.subplots(1, 2, sharey=True)
    places = np.arange(len(groups))
    shares.axvspan(*_WANTED, color="#cccccc", label="90 to 99 %")
    intervals = np.array([_interval([row.covered for row in part]) for _, part in groups])
    held = np.array([100 * np.mean([row.covered for row in part]) for _, part in groups])
    beside = np.abs(intervals.T - held)
    shares.errorbar(held, places, xerr=beside, fmt="o", color="black", capsize=3, label="share, and 95 % interval")
    shares.set_xlabel("truths within two stated errors (%)")
    shares.set_yticks(places, [f"{name} ({len(part)})" for name, part in groups])
    shares.invert_yaxis()
    figure.legend(loc="outside lower center", ncols=2, frameon=False)
    ratios.plot([_ratio(part) for _, part in groups], places, "D", color="#0072b2")
    ratios.axvline(1, color="black", linewidth=0.8)
    ratios.set_xscale("log")
    ratios.set_xticks(_RATIOS, [f"{ratio:g}" for ratio in _RATIOS])
    ratios.minorticks_off()
    ratios.set_xlabel("stated over true error, medians\n(right of 1: stated too large)")
    return figure


def _interval(held: Sequence[bool]) -> tuple[float, float]:
    """Where the share may truly lie, in per cent (Clopper and Pearson)."""
    from scipy.stats import binomtest

    low, high = binomtest(sum(held), len(held)).proportion_ci(0.95)
    return 100 * low, 100 * high


def _ratio(part: Sequence[Row]) -> float:
    """A median of absolute normal errors is 0.674 of their standard deviation."""
    true = float(np.median([abs(row.found - row.true) for row in part]))
    return 0.674 * float(np.median([row.error for row in part])) / max(true, 1e-12)
