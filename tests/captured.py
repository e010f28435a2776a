"""Captures for tests of files and inspection: two smooth random layers behind a pane, photographed."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from scipy.ndimage import gaussian_filter

from polaropt.capture import SONY_CELL, mosaic_capture, planes_last, write_tiff
from polaropt.capture.capture import Capture

ANGLES = (0.0, 45.0, 90.0, 135.0)


def scene_intensities(
    shape: tuple[int, ...] = (64, 64), angles_deg: Sequence[float] = ANGLES, azimuth_deg: float = 20.0, seed: int = 0
) -> np.ndarray:
    """Noise-free photographs (k, [channel,] h, w) in 0..0.95, DoLP up to about a half."""
    random = np.random.default_rng(seed)
    layers = []
    for _ in range(2):
        smooth = gaussian_filter(random.standard_normal(shape), (0,) * (len(shape) - 2) + (2, 2))
        layers.append(0.5 + 0.45 * np.tanh(2 * smooth / smooth.std()) * 0.99)
    parallel = 0.98 * layers[0] + 0.02 * layers[1]
    perpendicular = 0.6 * layers[0] + 0.4 * layers[1]
    angles = np.radians(np.asarray(angles_deg) - azimuth_deg).reshape((-1,) + (1,) * len(shape))
    return parallel * np.cos(angles) ** 2 + perpendicular * np.sin(angles) ** 2


def photographed(
    shape: tuple[int, ...] = (64, 64),
    angles_deg: Sequence[float] = ANGLES,
    noise: float = 0.005,
    bits: int | None = None,
    exposure: float = 1.0,
    seed: int = 0,
) -> Capture:
    """The same with noise, quantization and clipping."""
    clean = exposure * scene_intensities(shape, angles_deg, seed=seed)
    values = clean + noise * np.random.default_rng(seed + 1).standard_normal(clean.shape)
    if bits is not None:
        values = np.round(values * (2**bits - 1)) / (2**bits - 1)
    return Capture.of_planes(np.clip(values, -0.009, 1), angles_deg)


def mono_mosaic(images: np.ndarray) -> np.ndarray:
    """Full-size photographs at 0/45/90/135 (4, h, w) to a raw mosaic in Sony's order."""
    raw = np.empty(images.shape[1:])
    for k, (row, column) in enumerate(((1, 1), (0, 1), (0, 0), (1, 0))):
        raw[row::2, column::2] = images[k, row::2, column::2]
    return raw


def mono_capture(images: np.ndarray) -> Capture:
    """The same, in 0..1, as a camera without a gain or an encoding takes them; what is brighter clips."""
    raw = np.clip(mono_mosaic(images), 0, 1).astype(np.float32)
    return mosaic_capture(raw, sensor="mono", cell_order=SONY_CELL, pair_gain=1.0, white_level=1.0, gamma=1.0)


def color_mosaic(images: np.ndarray) -> np.ndarray:
    """Full-size photographs at 0/45/90/135 (4, 3, h, w) to a raw colour mosaic: Sony's cells in the order R G / G B."""
    raw = np.empty(images.shape[2:])
    for channel, (cell_row, cell_column) in zip((0, 1, 1, 2), ((0, 0), (0, 1), (1, 0), (1, 1)), strict=True):
        plane = mono_mosaic(images[:, channel])
        for row in (0, 1):
            for column in (0, 1):
                at = (slice(2 * cell_row + row, None, 4), slice(2 * cell_column + column, None, 4))
                raw[at] = plane[at]
    return raw


def written_photographs(capture: Capture, folder: Path) -> list[str]:
    """Files in a folder, one for each photograph, named by its angle."""
    files = [str(folder / f"p_{angle:03.0f}.tiff") for angle in capture.angles_deg]
    for file, photograph in zip(files, capture.intensities, strict=True):
        write_tiff(file, planes_last(photograph))
    return files
