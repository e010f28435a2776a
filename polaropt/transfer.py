"""The pane in the Fourier domain: each ghost is a phase, so every frequency is a small matrix of its own."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from polaropt.forward import PSE

Spectrum = NDArray[np.complex64]


def frequencies(height: int, width: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Angular frequencies per pixel of a real 2-D transform: rows (height, 1) and columns (1, width // 2 + 1)."""
    return 2 * np.pi * np.fft.fftfreq(height)[:, None], 2 * np.pi * np.fft.rfftfreq(width)[None, :]


def bilinear_transfer(distance: float, omega: NDArray[np.float64]) -> NDArray[np.complex128]:
    """What a bilinear shift along one axis does to each frequency."""
    whole = math.floor(distance)
    fraction = distance - whole
    step = np.exp(-1j * omega)
    return (1 - fraction + fraction * step) * np.exp(-1j * omega * whole)


def plate_transfer(pse: PSE, height: int, width: int) -> Spectrum:
    """Transfer functions of both layers into the plate's entries, on a periodic frame.

    Parameters
    ----------
    pse : PSE
    height, width : int
        Size of the frame in pixels.

    Returns
    -------
    ndarray of complex64, shape (entries, 2, height, width // 2 + 1)
        Entries (I_par, I_perp[, s2']); layers [0] transmission, [1] reflection.
    """
    rows, columns = frequencies(height, width)
    n_layers, n_taps, n_entries = pse.taps.shape
    total = np.zeros((n_entries, n_layers, height, columns.shape[1]), dtype=np.complex64)
    for k in range(n_taps):
        phase = (bilinear_transfer(k * pse.step[1], rows) * bilinear_transfer(k * pse.step[0], columns)).astype(
            np.complex64
        )
        total += pse.taps[:, k].T.astype(np.float32)[:, :, None, None] * phase
    return total
