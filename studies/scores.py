"""What a separation is judged by: how near its layers and its scene come to the true ones.

Layers are (channel, h, w), or both of them (2, channel, h, w). A border is left out, since ghosts come in there from
where no photograph shows them; with a mask (h, w) only its pixels count.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from polaropt.optics import SceneParameters
from polaropt.simulation import psnr_db, similarity_map

Images = NDArray[np.float32]
Mask = NDArray[np.bool_]

LAYERS = ("transmission", "reflection")
BORDER_PX = 16
"""Left out on each side."""
DETAIL_PX = 2.0
"""Detail is what a Gaussian of this standard deviation removes: finer than about 5 px."""
GAP = 1e-3
"""A solve has arrived where so much is left of the way from the cold start's value to the lowest one that is known."""
NEAR_DB = 0.1
"""A transmission is as good as another where its PSNR lies within this."""
_LEAST = 1e-9
_INNER = (..., slice(BORDER_PX, -BORDER_PX), slice(BORDER_PX, -BORDER_PX))


def psnr(layer: Images, truth: Images, mask: Mask | None = None) -> float:
    """PSNR in dB; 0 where no pixel counts."""
    if mask is None:
        return psnr_db(layer, truth, BORDER_PX)
    errors = np.asarray(layer, dtype=np.float64)[_INNER][..., mask[_INNER]] - truth[_INNER][..., mask[_INNER]]
    return _decibels(errors) if errors.size else 0.0


def both_psnr(layers: Images, truth: Images, mask: Mask | None = None) -> tuple[float, float]:
    """PSNR in dB of transmission and reflection (2, channel, h, w)."""
    return psnr(layers[0], truth[0], mask), psnr(layers[1], truth[1], mask)


def ssim(layer: Images, truth: Images, mask: Mask | None = None) -> float:
    """Structural similarity, 1 is perfect; 0 where no pixel counts."""
    similarity = similarity_map(layer, truth)[_INNER]
    if mask is not None:
        similarity = similarity[mask[_INNER]]
    return float(similarity.mean()) if similarity.size else 0.0


def psnr_and_ssim(layers: Images, truth: Images) -> tuple[float, float, float, float]:
    """PSNR in dB of transmission and reflection, then SSIM of both."""
    return *both_psnr(layers, truth), ssim(layers[0], truth[0]), ssim(layers[1], truth[1])


def fitted_psnr(layer: Images, truth: Images, mask: Mask) -> float:
    """PSNR in dB with the gain and offset that suit the true layer best; 0 where no pixel counts."""
    inner = mask[_INNER]
    if not inner.any():
        return 0.0
    image, reference = (part[_INNER][..., inner].astype(np.float64) for part in (layer, truth))
    return _decibels(_fit_line(image, reference) - reference)


def fitted(layer: Images, truth: Images) -> Images:
    """A layer with the gain and offset that bring it closest to the true one."""
    return np.asarray(_fit_line(layer, truth), dtype=np.float32)


def _fit_line(image: NDArray[np.float64] | Images, reference: NDArray[np.float64] | Images) -> NDArray[np.float64]:
    x, y = (part.astype(np.float64) - part.mean(dtype=np.float64) for part in (image, reference))
    variance = float((x * x).sum())
    gain = float((x * y).sum()) / variance if variance > _LEAST else 0.0
    return np.asarray(gain * x + reference.mean(dtype=np.float64))


def detail_correlation(layer: Images, truth: Images, mask: Mask) -> float:
    """Correlation of what is finer than a few pixels; 0 where there is none."""
    from scipy.ndimage import gaussian_filter

    fine = [part - gaussian_filter(part, DETAIL_PX, axes=(-2, -1)) for part in (layer, truth)]
    first, second = (part[_INNER][..., mask[_INNER]].ravel().astype(np.float64) for part in fine)
    energy = float(np.sqrt((first @ first) * (second @ second)))
    return float(first @ second) / energy if energy > _LEAST else 0.0


def _decibels(error: NDArray[np.float64]) -> float:
    return float(-10 * np.log10(max(float(np.square(error).mean()), _LEAST)))


@dataclass(frozen=True)
class PaneErrors:
    """Absolute errors of a pane that was estimated: degrees, degrees modulo 180, pixels along the true azimuth."""

    incidence_deg: float
    azimuth_deg: float
    shift_px: float


def pane_errors(scene: SceneParameters, true: SceneParameters) -> PaneErrors:
    """Errors of a pane; an azimuth turned by 180 degrees together with a shift of opposite sign is the same pane."""
    incidence, azimuth, shift = scene.values()
    true_incidence, true_azimuth, true_shift = true.values()
    turn = (azimuth - true_azimuth + 90) % 360 - 90
    if turn > 90:
        turn, shift = turn - 180, -shift
    return PaneErrors(abs(incidence - true_incidence), abs(turn), abs(shift - true_shift))
