"""Photographs that were shifted against each other while they were taken."""

from __future__ import annotations

import numpy as np
from scipy.ndimage import fourier_shift

from polaropt.capture import MOST_NEGATIVE, Capture
from tests.blends import Blend, blend

RIM = 24


def shifted_blend(
    incidence_deg: float,
    size: int,
    shifts: np.ndarray,
    *,
    noise: float = 0.005,
    seed: int = 0,
    exposure: float = 1.0,
    **scene: object,
) -> Blend:
    """A blend whose k-th photograph holds the scene `shifts[k]` (down, right) px away from where it is in the truth.

    The true layers are those of the frame, unshifted. The scene goes on beyond the frame.
    """
    example = blend(incidence_deg, size + 2 * RIM, noise=0.0, **scene)
    clean = np.pad(
        example.capture.intensities, [(0, 0)] * (example.capture.intensities.ndim - 2) + [(16, 16)] * 2, "symmetric"
    )
    moved = np.stack([_moved(image, offset) for image, offset in zip(clean, shifts, strict=True)])
    inside = (..., slice(RIM + 16, -RIM - 16), slice(RIM + 16, -RIM - 16))
    seen = exposure * moved[inside] + noise * np.random.default_rng(seed).standard_normal(moved[inside].shape)
    capture = Capture.of_planes(np.clip(seen, 0.9 * MOST_NEGATIVE, 1), example.capture.angles_deg)
    return Blend(capture, example.scene, exposure * example.layers[..., RIM:-RIM, RIM:-RIM])


def _moved(image: np.ndarray, offset: np.ndarray) -> np.ndarray:
    whole = (0.0,) * (image.ndim - 2) + tuple(offset)
    return np.fft.ifftn(fourier_shift(np.fft.fftn(image), whole)).real
