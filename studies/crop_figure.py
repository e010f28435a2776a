"""Crops of both layers of one scene, side by side under what each comes from."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

_CROP = 96


def crops(shown: Mapping[str, Sequence[np.ndarray]], columns: int) -> Any:
    """A matplotlib figure of the middles of pictures, transmission above reflection.

    Parameters
    ----------
    shown : mapping of str to two ndarrays, shape (h, w, 3)
        Both layers by their title.
    columns : int
        At most.
    """
    from matplotlib.figure import Figure

    columns = min(columns, len(shown))
    rows = -(-len(shown) // columns)
    figure = Figure(figsize=(2 * columns, 4.3 * rows), layout="constrained")
    grid = figure.subplots(2 * rows, columns, squeeze=False)
    for axes in grid.flat:
        axes.set_axis_off()
    for number, (label, layers) in enumerate(shown.items()):
        row, column = divmod(number, columns)
        for i in (0, 1):
            grid[2 * row + i, column].imshow(_crop(layers[i]), interpolation="nearest")
        grid[2 * row, column].set_title(label, fontsize=8)
    return figure


def _crop(image: np.ndarray) -> np.ndarray:
    top, left = ((side - _CROP) // 2 for side in image.shape[:2])
    return np.clip(image[top : top + _CROP, left : left + _CROP], 0, 1)
