"""The canvas of the solve: the photographs' frame with a margin, so that ghosts find content beyond the frame."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from polaropt.numerics import tukey_window
from polaropt.optics import PSE, VaryingPSE

Images = NDArray[np.float32]

# Pixels beyond each side of the frame: enough for the window to fall, and no more than pays. Set by hand.
LEAST_MARGIN = 12
MOST_MARGIN = 48
# Ghosts fainter than this share of the direct light, summed over both layers, need no canvas of their own. By hand.
_FAINT = 0.02
# Rad per pixel in place of frequency zero, where sinh(k t) / sinh(k d) becomes t / d.
_SLOWEST = 1e-6


@dataclass(frozen=True)
class Canvas:
    """Margins around a frame (h, w), in pixels.

    Attributes
    ----------
    top, bottom, left, right : int
    height, width : int
        Of the frame.
    """

    height: int
    width: int
    top: int
    bottom: int
    left: int
    right: int

    @property
    def shape(self) -> tuple[int, int]:
        """Height and width of the whole canvas."""
        return self.top + self.height + self.bottom, self.left + self.width + self.right

    def crop(self, images: Any) -> Any:
        """The frame within canvas images (..., H, W)."""
        return images[..., self.top : self.top + self.height, self.left : self.left + self.width]

    def extend(self, images: Images) -> Images:
        """Frame images (..., h, w), mirrored into the margins."""
        padding = [(0, 0)] * (images.ndim - 2) + [(self.top, self.bottom), (self.left, self.right)]
        return np.pad(images, padding, mode="symmetric")

    def continued(self, images: Images) -> Images:
        """Frame images (..., h, w) with the smoothest margins (harmonic) between their opposite edges.

        Nothing is known of a margin but that it is natural: where a solve starts from a mirrored one it spends
        nearly all of its evaluations on smoothing it.
        """
        canvas = np.empty((*images.shape[:-2], *self.shape), dtype=np.float32)
        self.crop(canvas)[...] = images
        # Mirrored, since the transform along a side takes it for periodic.
        last, first = (np.concatenate([side, side[..., ::-1]], axis=-1) for side in (images[..., -1], images[..., 0]))
        across = np.swapaxes(_between(last, first, self.left + self.right)[..., : self.height], -1, -2)
        rows = canvas[..., self.top : self.top + self.height, :]
        rows[..., self.left + self.width :], rows[..., : self.left] = np.split(across, [self.right], axis=-1)
        down = _between(rows[..., -1, :], rows[..., 0, :], self.top + self.bottom)
        canvas[..., self.top + self.height :, :], canvas[..., : self.top, :] = np.split(down, [self.bottom], axis=-2)
        return canvas

    def pad_zeros(self, images: Any) -> Any:
        """Frame images (..., h, w) with zeros in the margins."""
        padding = [(0, 0)] * (images.ndim - 2) + [(self.top, self.bottom), (self.left, self.right)]
        return np.pad(images, padding)

    def window(self) -> Images:
        """Weights (H, W) that fall smoothly to zero over the margins."""
        rows = tukey_window(self.height, self.top, self.bottom)
        columns = tukey_window(self.width, self.left, self.right)
        return (rows[:, None] * columns[None, :]).astype(np.float32)


def canvas_for(pse: PSE | VaryingPSE, height: int, width: int, period: int = 1) -> Canvas:
    """Canvas that holds the ghosts which show, with sides that the Fourier transform likes.

    Parameters
    ----------
    pse : PSE or VaryingPSE
    height, width : int
        Of the frame.
    period : int
        Its sides are multiples of it: that of a mosaic's pattern.
    """
    from scipy.fft import next_fast_len

    reach = _reach(pse, height, width)
    margin = min(MOST_MARGIN, max(LEAST_MARGIN, math.ceil(reach)), height // 2, width // 2)
    rows, columns = (
        period * int(next_fast_len(-(-(side + 2 * margin) // period), real=True)) for side in (height, width)
    )
    more_rows, more_columns = rows - height - 2 * margin, columns - width - 2 * margin
    if period == 1:
        more_rows, more_columns = min(more_rows, height - margin), min(more_columns, width - margin)
    return Canvas(height, width, margin, margin + more_rows, margin, margin + more_columns)


def _reach(pse: PSE | VaryingPSE, height: int, width: int) -> float:
    """Distance in pixels of the farthest ghost that shows."""
    if isinstance(pse, PSE):
        strength, displacements = np.abs(pse.taps).sum(axis=2).max(axis=0), pse.displacements
    elif pse.scene.has_ghosts:
        # What a layer of intensity 1 adds to the total intensity.
        strength = pse.ghost_mixtures(height, width)[0].max(axis=(0, -1, -2))
        displacements = pse.displacements(height, width)
    else:
        return 0.0
    shown = strength > _FAINT * strength.max()
    return float(np.hypot(*np.array(displacements)[shown].T).max())


def _between(before: Images, after: Images, n: int) -> Images:
    """Harmonic function on n lines between two lines of values (..., length), periodic along them, (..., n, length)."""
    from scipy.fft import irfft, rfft

    length = before.shape[-1]
    slowness = 2 * np.pi * np.fft.rfftfreq(length)
    slowness = np.maximum(slowness, _SLOWEST)
    steps = np.arange(1, n + 1)[:, None]
    share = _sinh_ratio(slowness, steps, n + 1)
    spectrum = rfft(before)[..., None, :] * share[::-1] + rfft(after)[..., None, :] * share
    lines: Images = irfft(spectrum, length)
    return lines


def _sinh_ratio(k: NDArray[np.float64], t: NDArray[np.int_], d: int) -> Images:
    """sinh(k t) / sinh(k d) for 0 <= t <= d, without overflow."""
    return (np.exp(k * (t - d)) * np.expm1(-2 * k * t) / np.expm1(-2 * k * d)).astype(np.float32)
