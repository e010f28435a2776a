"""How exactly each pixel is measured, in units of a pixel in the middle of the frame with all its photographs.

Clipped photographs tell nothing; near the frame's edge ghosts bring light from beyond it, which nothing else shows.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from polaropt.capture import Capture
from polaropt.forward import PSE
from polaropt.fused_misfit import kinds_of_pixels
from polaropt.local_variance import Knowledge
from polaropt.noise_model import NoiseClasses
from polaropt.varying import VaryingPSE

Images = NDArray[np.float32]
Matrix = NDArray[np.float64]

LEAST = 1e-3
"""Precision of a pixel that no photograph shows: its neighbours tell the slow changes."""
_BLUR_PX = 1.0


def local_precision(
    capture: Capture, pse: PSE | VaryingPSE, noise: float, known: Knowledge, classes: NoiseClasses | None = None
) -> Images | None:
    """Precision of every pixel of the frame, (h, w), at least `LEAST`; None where all are alike."""
    mixing = pse.mixing[:, : pse.taps.shape[2]] if isinstance(pse, PSE) else pse.analyzer
    clipped = _of_clipping(capture, mixing)
    beyond = _of_light_from_beyond(capture.shape[-2:], pse, noise, known) if isinstance(pse, PSE) else None
    of_noise = None if classes is None else np.square(noise / classes.images()).mean(axis=0)
    parts = [part for part in (clipped, beyond, of_noise) if part is not None]
    if not parts:
        return None
    return np.asarray(np.maximum(np.prod(parts, axis=0), LEAST), dtype=np.float32)


def _of_clipping(capture: Capture, mixing: Matrix) -> Images | None:
    """What the trusted photographs tell of a pixel's entries against all of them, mean over colours."""
    from scipy.ndimage import gaussian_filter

    if capture.valid.all():
        return None
    shape = (len(capture.angles_deg), -1, *capture.shape[-2:])
    patterns, kinds = kinds_of_pixels(capture.valid.reshape(shape))
    of_kind = np.array([_volume(mixing * trusted[:, None]) for trusted in patterns]) / _volume(mixing)
    precision: Images = of_kind.astype(np.float32)[kinds].mean(axis=0) if kinds.size else np.ones(shape[2:], np.float32)
    return np.asarray(gaussian_filter(precision, _BLUR_PX, mode="nearest"), dtype=np.float32)


def _volume(mixing: Matrix) -> float:
    """Geometric mean of the eigenvalues of the information on the entries."""
    return float(max(np.linalg.det(mixing.T @ mixing), 0.0) ** (1 / mixing.shape[1]))


def _of_light_from_beyond(shape: tuple[int, ...], pse: PSE, noise: float, known: Knowledge) -> Images | None:
    """Light from beyond the frame is known as far as it is like the frame's edge; the rest is noise to the entries."""
    amplitude = _unknown_light(shape, pse, known)
    if not amplitude.any():
        return None
    mixing = pse.mixing[:, : pse.taps.shape[2]]
    variance = noise**2 * np.diag(np.linalg.inv(mixing.T @ mixing)).astype(np.float32)[:, None, None]
    unknown = np.square(amplitude).sum(axis=0)
    return np.asarray(np.prod(variance / (variance + unknown), axis=0) ** (1 / len(variance)), dtype=np.float32)


def _unknown_light(shape: tuple[int, ...], pse: PSE, known: Knowledge) -> Images:
    """Standard deviation of each layer's light from beyond the frame in each entry, (2, entry, h, w)."""
    amplitude = np.zeros((2, pse.taps.shape[2], *shape), dtype=np.float32)
    for k in range(1, pse.taps.shape[1]):
        columns, rows = (_beyond(*side) for side in zip((shape[1], shape[0]), pse.displacements[k], strict=True))
        outside = np.hypot(rows[:, None], columns)
        where = np.nonzero(outside)
        if where[0].size:
            distances = np.linspace(0, float(outside.max()), 17)
            structure = np.sqrt(known.structure(distances))
            for i in (0, 1):
                apart = np.interp(outside[where], distances, structure[i])
                amplitude[i][:, *where] += np.abs(pse.taps[i, k])[:, None] * apart
    return amplitude


def _beyond(length: int, shift: float) -> NDArray[np.float64]:
    """How far from the frame each pixel of a side sees, shifted so, (length,)."""
    seen = np.arange(length) - shift
    return np.asarray(np.maximum(np.maximum(-seen, seen - (length - 1)), 0.0))
