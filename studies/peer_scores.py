"""How near a peer's layers come to the true ones: over the pixels that no photograph clips, less a border."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from polaropt.simulation import similarity_map
from studies.protocol import EVALUATION_BORDER

Images = NDArray[np.float32]
Mask = NDArray[np.bool_]

_LEAST = 1e-9


@dataclass(frozen=True)
class Score:
    """Of one layer: PSNR in dB, SSIM, and PSNR with the gain and offset that suit the true layer best."""

    psnr: float
    ssim: float
    fitted: float


def score(layer: Images, truth: Images, seen: Mask) -> Score:
    """Score of a layer (channel, h, w); `seen` (h, w) are the pixels that count."""
    inner = slice(EVALUATION_BORDER, -EVALUATION_BORDER)
    mask = seen[inner, inner]
    if not mask.any():
        return Score(0.0, 0.0, 0.0)
    image, reference = (part[..., inner, inner][..., mask].astype(np.float64) for part in (layer, truth))
    similarity = similarity_map(layer, truth)[inner, inner][mask]
    return Score(
        _decibels(image - reference), float(similarity.mean()), _decibels(_fit_line(image, reference) - reference)
    )


def fitted(layer: Images, truth: Images) -> Images:
    """A layer with the gain and offset that bring it closest to the true one."""
    return np.asarray(_fit_line(layer, truth), dtype=np.float32)


def _fit_line(image: NDArray[np.float64] | Images, reference: NDArray[np.float64] | Images) -> NDArray[np.float64]:
    x, y = (part.astype(np.float64) - part.mean(dtype=np.float64) for part in (image, reference))
    variance = float((x * x).sum())
    gain = float((x * y).sum()) / variance if variance > _LEAST else 0.0
    return np.asarray(gain * x + reference.mean(dtype=np.float64))


def _decibels(error: NDArray[np.float64]) -> float:
    return float(-10 * np.log10(max(float(np.square(error).mean()), _LEAST)))
