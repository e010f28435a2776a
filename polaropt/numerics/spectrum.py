"""Frequencies of real two-dimensional transforms, and how often half a spectrum stands for the whole."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from solvers.kernels import in_blocks


def frequencies(height: int, width: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Angular frequencies per pixel of a real 2-D transform: rows (height, 1) and columns (1, width // 2 + 1)."""
    rows = 2 * np.pi * np.fft.fftfreq(height).astype(np.float64)
    columns = 2 * np.pi * np.fft.rfftfreq(width).astype(np.float64)
    return rows[:, None], columns[None, :]


def squared_frequencies(height: int, width: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Eigenvalues of squared differences along rows (height,) and columns (width // 2 + 1,) of a real transform."""
    rows = 2 - 2 * np.cos(2 * np.pi * np.fft.fftfreq(height))
    columns = 2 - 2 * np.cos(2 * np.pi * np.fft.rfftfreq(width))
    return rows, columns


def each_plane(function: Callable[[tuple[int, int]], None], shape: tuple[int, ...]) -> None:
    """Call a function for every plane of images or spectra (n, channel, ...), on all cores: a plane fits the cache."""
    in_blocks(lambda i, _: function(divmod(i, shape[1])), shape[0] * shape[1], 1)


def column_multiplicity(width: int) -> NDArray[np.float64]:
    """How often a column of the half spectrum stands for itself and its conjugate."""
    twice = np.full(width // 2 + 1, 2.0)
    twice[0] = 1
    if width % 2 == 0:
        twice[-1] = 1
    return twice
