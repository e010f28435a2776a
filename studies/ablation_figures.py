"""Figures of the ablation: what each part gains, and crops of the layers without it at 60 degrees."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from polaropt.capture import noise_level, planes_last
from studies.camera import take
from studies.kit.charts import crops, write_figures
from studies.photographs import Pair
from studies.scenes import protocol
from studies.ways import Part

_COLUMNS, _INCIDENCE_DEG = 8, 60.0
_LAYERS = ("transmission", "reflection")
_TICKS_DB = (-10, -3, -1, -0.5, 0, 0.5, 1, 3, 10, 20)
_COLORS, _HATCHES = ("#0072b2", "#e69f00"), ("", "///")


def draw(
    gains: Mapping[str, Sequence[tuple[float, float, float]]], pair: Pair, variants: Sequence[Part], out: Path
) -> list[Path]:
    """Draw what every part gains, and crops of one scene with and without it.

    Parameters
    ----------
    gains : mapping
        From the part to (mean, low, high) of transmission and reflection in dB.
    pair : Pair
        Of the crops.
    variants : sequence of Variant
        The whole first.
    out : Path
    """
    return write_figures(
        out, {"gained": lambda: _differences(gains), "crops": lambda: crops(_solved(pair, variants), _COLUMNS)}
    )


def _differences(gains: Mapping[str, Sequence[tuple[float, float, float]]]) -> Any:
    """Bars of the dB that every part gains on both layers, with their intervals."""
    from matplotlib.figure import Figure

    names = list(gains)
    figure = Figure(figsize=(8, 0.5 * len(names) + 1.4), layout="constrained")
    axes = figure.subplots()
    places = np.arange(len(names))[::-1]
    for i, layer in enumerate(_LAYERS):
        mean, low, high = np.array([gains[name][i] for name in names]).T
        spread = np.nan_to_num(np.stack([mean - low, high - mean])).clip(0)
        axes.barh(
            places - 0.4 * i + 0.2, mean, 0.38, xerr=spread, color=_COLORS[i], hatch=_HATCHES[i], edgecolor="black",
            linewidth=0.6, error_kw={"linewidth": 1}, label=layer,
        )  # fmt: skip
    axes.set_yticks(places, names)
    axes.set_xscale("symlog", linthresh=1)
    low, high = axes.get_xlim()
    axes.set_xticks(_TICKS_DB, [f"{tick:g}" for tick in _TICKS_DB])
    axes.set_xlim(min(low, -0.5), 1.3 * high)
    axes.axvline(0, color="black", linewidth=0.8)
    axes.set_xlabel("PSNR with the part less that without it (dB; linear within 1 dB, logarithmic beyond)")
    axes.legend(loc="lower right")
    return figure


def _solved(pair: Pair, variants: Sequence[Part]) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Both layers (h, w, 3) of one scene: the truth, and what each variant makes of it."""
    sample = take(protocol(_INCIDENCE_DEG), pair)
    capture, true = sample.capture, sample.scene
    found = variants[0].estimate(capture, noise_level(capture))
    shown = {"truth": pair.frames}
    for variant in variants:
        layers = variant.solved(capture, found, true).layers
        label = variant.change.replace("without ", "without\n").replace("with ", "with\n")
        shown[label] = (planes_last(layers[0]), planes_last(layers[1]))
    return shown
