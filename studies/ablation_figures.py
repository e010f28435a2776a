"""Figures of the ablation: what each part gains, and crops of the layers without it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from polaropt.noise import noise_level
from polaropt.simulation import planes_last
from studies.ablation_variants import Variant
from studies.protocol import Pair, protocol_capture, protocol_scene, truth

_CROP, _INCIDENCE_DEG = 96, 60.0
_LAYERS = ("transmission", "reflection")
_TICKS_DB = (-10, -3, -1, -0.5, 0, 0.5, 1, 3, 10, 20)
_COLORS, _HATCHES = ("#0072b2", "#e69f00"), ("", "///")


def draw_differences(gains: Mapping[str, Sequence[tuple[float, float, float]]], out: Path) -> list[Path]:
    """Bars of the dB that every part gains on both layers, with their intervals.

    Parameters
    ----------
    gains : mapping
        From the part to (mean, low, high) of transmission and reflection.
    out : Path
    """
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
    files = [out / f"gained{ending}" for ending in (".png", ".svg")]
    for file in files:
        figure.savefig(file, dpi=110)
    return files


def draw_crops(pair: Pair, variants: Sequence[Variant], out: Path) -> Path:
    """Crops of both layers of one scene: the truth, the whole, and without each part.

    Parameters
    ----------
    pair : Pair
    variants : sequence of Variant
        The whole first.
    out : Path
    """
    from matplotlib.figure import Figure

    capture, true = protocol_capture(pair, _INCIDENCE_DEG), protocol_scene(pair, _INCIDENCE_DEG)
    found = variants[0].found(capture, noise_level(capture))
    shown = {"truth": truth(pair)}
    for variant in variants:
        layers = variant.solved(capture, found, true).layers
        shown[variant.change] = (planes_last(layers[0]), planes_last(layers[1]))
    columns = 8
    rows = -(-len(shown) // columns)
    figure = Figure(figsize=(2 * columns, 4.3 * rows), layout="constrained")
    grid = figure.subplots(2 * rows, columns, squeeze=False)
    for axes in grid.flat:
        axes.set_axis_off()
    for number, (label, layers) in enumerate(shown.items()):
        row, column = divmod(number, columns)
        for i in (0, 1):
            grid[2 * row + i, column].imshow(_crop(layers[i]), interpolation="nearest")
        grid[2 * row, column].set_title(label.replace("without ", "without\n").replace("with ", "with\n"), fontsize=8)
    figure.suptitle(f"Crops at {_INCIDENCE_DEG:g} deg: transmission above, reflection below", fontsize=10)
    target = out / "crops.png"
    figure.savefig(target, dpi=130)
    return target


def _crop(image: np.ndarray) -> np.ndarray:
    top, left = ((side - _CROP) // 2 for side in image.shape[:2])
    return np.clip(image[top : top + _CROP, left : left + _CROP], 0, 1)
