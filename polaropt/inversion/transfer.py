"""The pane in the Fourier domain: each ghost is a phase, so every frequency is a small matrix of its own."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from polaropt.numerics import frequencies
from polaropt.optics import PSE, Displacements, VaryingPSE

Spectrum = NDArray[np.complex64]

# Weight of a ghost below which float32 does not tell it from nothing, whatever it is added to.
_NEGLIGIBLE = 1e-8
# Share of the light from which on an image tells anything of layers in one place. Set by hand.
_FAINT = 1e-3


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
    return ghost_transfer(pse.taps, pse.displacements, height, width)


def images_that_tell(pse: VaryingPSE, height: int, width: int) -> tuple[NDArray[np.float32], Displacements]:
    """Mixtures (3, 2, image, height, width) and places of the images that carry some light, before a pane that varies.

    Parameters
    ----------
    pse : VaryingPSE
        Made for the frame.
    height, width : int
        Size of the frame in pixels.
    """
    mixtures, places = pse.ghost_mixtures(height, width), pse.displacements(height, width)
    light = np.abs(mixtures).max(axis=(0, 1, 3, 4))
    kept = np.flatnonzero(light > _FAINT * light.max())
    if kept.size == len(places):
        return mixtures, places
    return mixtures[:, :, kept], tuple(places[k] for k in kept)


def ghost_transfer(taps: NDArray[np.float64], displacements: Displacements, height: int, width: int) -> Spectrum:
    """The same of images with weights (2, ghost, entries) at these places."""
    weights, down, across = separable(taps, displacements, height, width)
    transfer: Spectrum = (weights[:, :, None, :] * down).astype(np.complex64) @ across
    return transfer


def ghost_transfer_at(
    taps: NDArray[np.float64], displacements: Displacements, shape: tuple[int, int], sample: NDArray[np.intp]
) -> Spectrum:
    """The same at a sample of the frequencies, flat indices of (height, width // 2 + 1): (entries, 2, n)."""
    weights, down, across = separable(taps, displacements, *shape)
    rows, columns = np.divmod(sample, across.shape[1])
    transfer: Spectrum = (weights @ (down[rows].T * across[:, columns])).astype(np.complex64)
    return transfer


def separable(
    taps: NDArray[np.float64], displacements: Displacements, height: int, width: int
) -> tuple[NDArray[np.float64], NDArray[np.complex128], Spectrum]:
    """Weights (entries, 2, ghost), and what each shift does to rows' (height, ghost) and columns' frequencies.

    The transfer is the product of the three, summed over ghosts.
    """
    rows, columns = frequencies(height, width)
    # Ghosts that float32 cannot tell from nothing cost as much as the others.
    kept = np.flatnonzero(np.abs(taps).max(axis=(0, 2)) > _NEGLIGIBLE)
    shifts = [displacements[k] for k in kept]
    down = np.stack([bilinear_transfer(dy, rows[:, 0]) for _, dy in shifts], axis=1)
    across = np.stack([bilinear_transfer(dx, columns[0]) for dx, _ in shifts]).astype(np.complex64)
    return taps[:, kept].transpose(2, 0, 1), down, across
