"""The pane in the Fourier domain: each ghost is a phase, so every frequency is a small matrix of its own."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from polaropt.forward import PSE

Spectrum = NDArray[np.complex64]

_NEGLIGIBLE = 1e-8


def frequencies(height: int, width: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Angular frequencies per pixel of a real 2-D transform: rows (height, 1) and columns (1, width // 2 + 1)."""
    rows = 2 * np.pi * np.fft.fftfreq(height).astype(np.float64)
    columns = 2 * np.pi * np.fft.rfftfreq(width).astype(np.float64)
    return rows[:, None], columns[None, :]


def bilinear_transfer(distance: float, omega: NDArray[np.float64]) -> NDArray[np.complex128]:
    """What a bilinear shift along one axis does to each frequency."""
    whole = math.floor(distance)
    fraction = distance - whole
    transfer: NDArray[np.complex128] = (1 - fraction + fraction * np.exp(-1j * omega)) * np.exp(-1j * omega * whole)
    return transfer


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
    # Ghosts that float32 cannot tell from nothing cost as much as the others.
    kept = np.flatnonzero(np.abs(pse.taps).max(axis=(0, 2)) > _NEGLIGIBLE)
    shifts = [pse.displacements[k] for k in kept]
    down = np.stack([bilinear_transfer(dy, rows[:, 0]) for _, dy in shifts], axis=1)
    across = np.stack([bilinear_transfer(dx, columns[0]) for dx, _ in shifts]).astype(np.complex64)
    taps = pse.taps[:, kept].transpose(2, 0, 1)[:, :, None, :]
    transfer: Spectrum = (taps * down).astype(np.complex64) @ across
    return transfer
