"""Photographs by a camera that was turned and moved towards the scene while they were taken."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from polaropt.capture import MOST_NEGATIVE, Capture
from polaropt.capture.registration import Motions, finely_moved_back
from polaropt.optics.scene import SceneParameters
from tests.blends import blend


@dataclass(frozen=True)
class Turned:
    """A capture, how its photographs were moved, its scene and the layers as the first photograph shows them."""

    capture: Capture
    motions: Motions
    scene: SceneParameters
    layers: np.ndarray


def similarities(rotations_deg: np.ndarray, scales: np.ndarray, shifts: np.ndarray) -> Motions:
    """Motions from angles (clockwise as seen), scales and shifts (down, right)."""
    angles = np.radians(rotations_deg)
    cosine, sine = np.cos(angles), np.sin(angles)
    matrices = np.stack([np.stack([cosine, sine], -1), np.stack([-sine, cosine], -1)], -2)
    return Motions(matrices * np.reshape(scales, (-1, 1, 1)), np.asarray(shifts, dtype=float))


def turned_blend(
    incidence_deg: float,
    size: int,
    motions: Motions,
    *,
    noise: float = 0.005,
    rim: int = 32,
    seed: int = 0,
    **scene: object,
) -> Turned:
    """A blend whose photographs were moved; the scene goes on beyond the frame."""
    example = blend(incidence_deg, size + 2 * rim, noise=0.0, **scene)
    images = example.capture.intensities
    moved = np.empty_like(images)
    for k, (matrix, offset) in enumerate(zip(motions.matrices, motions.offsets, strict=True)):
        away = np.linalg.inv(matrix)
        for plane in np.ndindex(images.shape[1:-2]):
            moved[k][plane] = finely_moved_back(images[k][plane], away, -away @ offset)
    inside = (..., slice(rim, -rim), slice(rim, -rim))
    seen = moved[inside] + noise * np.random.default_rng(seed).standard_normal(moved[inside].shape)
    capture = Capture.of_planes(np.clip(seen, 0.9 * MOST_NEGATIVE, 1), example.capture.angles_deg)
    return Turned(capture, motions, example.scene, example.layers[inside])
