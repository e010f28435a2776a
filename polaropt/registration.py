"""How far photographs are shifted against each other."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from itertools import combinations
from typing import Any

import numpy as np
from numpy.typing import NDArray

from polaropt.capture import Capture
from polaropt.shift_fit import Images, Matrix, SmallShifts, disagreement, fit_small_shifts, products

Mask = NDArray[np.bool_]

_FINE, _COARSE = 0.7, 2.0
"""Widths of the two Gaussians of which the difference is taken: finer is noise, coarser is light and shade."""
_MARGIN = 4
_SIDE = 1024
_STEPS, _LONGEST_STEP, _AT_REST = 8, 1.5, 0.004
FEWEST = 500
BY_CHANCE = 300
"""What the best of all shifts gains on photographs of noise, times the number of pixels."""
SURE = 3.0
NEGLIGIBLE = 0.05
"""Below this, in pixels, resampling costs more than it gains."""


@dataclass(frozen=True)
class Shifts:
    """Where the photographs lie.

    Attributes
    ----------
    pixels : ndarray, shape (k, 2)
        How far down and to the right each photograph's scene lies from where it lies in the first one.
    error : float
        Standard error of one of these numbers, the largest; infinite where nothing could be measured.
    better : bool
        Whether the photographs agree better when moved back by them.
    """

    pixels: Matrix
    error: float
    better: bool

    @property
    def largest(self) -> float:
        """Largest distance between two photographs, in pixels."""
        return largest_distance(self.pixels)

    @property
    def certain(self) -> bool:
        """Whether moving the photographs is better than leaving them."""
        return self.better and self.largest > max(SURE * self.error, NEGLIGIBLE)


def measure_shifts(capture: Capture) -> Shifts:
    """Measure the shifts between all photographs, to small fractions of a pixel.

    A start comes from the correlation of all pairs, the rest from the likelihood of all photographs together
    (`polaropt.shift_fit`), resampling until nothing moves. Clipped pixels and their neighbours do not count. Of large
    captures the middle is looked at.
    """
    images, valid = luminance(capture.part(*middle(capture.shape, _SIDE)))
    bands = np.stack([band_passed(image, mask) for image, mask in zip(images, valid, strict=True)])
    inner = np.stack([far_from_invalid(mask) for mask in valid])
    start = coarse_shifts(bands)
    nowhere = np.zeros_like(start)
    # Where the start is wrong the photographs may still lie nearly on each other.
    tries = [_refined(bands, inner, first) for first in ([start, nowhere] if start.any() else [nowhere])]
    values = [_compared(bands, inner, found.pixels) for found in tries]
    best = int(np.argmin(values))
    return Shifts(tries[best].pixels, tries[best].error, values[best] < 0)


def _refined(bands: Images, inner: Mask, start: Matrix) -> SmallShifts:
    """Shifts near a start, and their error; infinite where too little is left in common."""
    shifts = start
    for _ in range(_STEPS):
        moved, common = _moved(bands, inner, shifts)
        if np.count_nonzero(common) < FEWEST:
            return SmallShifts(start, np.inf)
        step = fit_small_shifts(products(moved, common))
        shifts = shifts + np.clip(step.pixels, -_LONGEST_STEP, _LONGEST_STEP)
        if np.abs(step.pixels).max() < _AT_REST:
            return SmallShifts(shifts, step.error)
    # What does not rest is known no better than its last step.
    return SmallShifts(shifts, max(step.error, float(np.abs(step.pixels).max())))


def _compared(bands: Images, inner: Mask, shifts: Matrix) -> float:
    """How much less the photographs disagree with the shifts than without, on the same pixels; 0 if not surely less."""
    moved, common = _moved(bands, inner, shifts)
    common = common & inner.all(axis=0)
    count = np.count_nonzero(common)
    if count < FEWEST:
        return 0.0
    gain = disagreement(products(bands, common)) - disagreement(products(moved, common))
    return -gain if gain > BY_CHANCE / count else 0.0


def _moved(bands: Images, inner: Mask, shifts: Matrix) -> tuple[Images, Mask]:
    """Photographs moved back by their shifts, and where all of them hold values that count."""
    from scipy.ndimage import shift

    moved = np.stack(
        [shift(band, -offset, order=3) if offset.any() else band for band, offset in zip(bands, shifts, strict=True)]
    )
    common = np.ones(bands.shape[1:], dtype=bool)
    for mask, offset in zip(inner, shifts, strict=True):
        common &= shift(mask.astype(np.float32), -offset, order=1) > 0.999 if offset.any() else mask
    return moved, common


def coarse_shifts(bands: Images) -> Matrix:
    """Shifts (k, 2) of band-passed photographs to a tenth of a pixel: the peaks of the correlations of all pairs.

    Two photographs hold two layers in differing proportions; as both layers move together the peak stays single.
    Pairs that contradict the others count less (absolute deviations instead of squares).
    """
    from scipy.optimize import least_squares

    count = len(bands)
    pairs = list(combinations(range(count), 2))
    found = _correlation_peaks(bands, pairs)
    differences = np.zeros((len(pairs), count))
    for row, (a, b) in enumerate(pairs):
        differences[row, [a, b]] = -1, 1
    shifts = np.zeros((count, 2))
    for axis in (0, 1):
        seen = found[:, axis]

        def contradiction(unknown: Matrix, seen: Matrix = seen) -> Matrix:
            return np.asarray(differences[:, 1:] @ unknown - seen)

        shifts[1:, axis] = least_squares(contradiction, seen[: count - 1], loss="soft_l1", f_scale=0.3).x
    return shifts


def _correlation_peaks(bands: Images, pairs: list[tuple[int, int]]) -> Matrix:
    """How far each pair's second photograph lies from its first, (pair, 2)."""
    from skimage.registration import phase_cross_correlation

    height, width = bands.shape[-2:]
    # A frame's edges would correlate where they are.
    faded = bands * np.outer(np.hanning(height), np.hanning(width))
    # Without normalization: whitened phases give noise the weight of the scene (errors of 0.05 instead of 0.02 px).
    correlate: Any = partial(phase_cross_correlation, normalization=None, upsample_factor=10)
    peaks = [correlate(faded[b], faded[a])[0] for a, b in pairs]
    return np.asarray(peaks, dtype=np.float64)


def luminance(capture: Capture) -> tuple[Images, Mask]:
    """Photographs (k, h, w), colours averaged, and their valid pixels."""
    if not capture.color:
        return capture.intensities, capture.valid
    return capture.intensities.mean(axis=1), np.asarray(capture.valid.all(axis=1))


def band_passed(image: Images, valid: Mask) -> Images:
    """Difference of two Gaussian means over valid pixels."""
    from scipy.ndimage import gaussian_filter

    mask = valid.astype(np.float32)
    means = []
    for width in (_FINE, _COARSE):
        weight = np.maximum(gaussian_filter(mask, width), np.float32(1e-3))
        means.append(gaussian_filter(image * mask, width) / weight)
    band: Images = (means[0] - means[1]) * mask
    return band


def far_from_invalid(valid: Mask) -> Mask:
    """Pixels more than a few steps away from invalid ones and from the frame's edge."""
    from scipy.ndimage import binary_erosion

    inner: Mask = binary_erosion(valid, iterations=_MARGIN)
    return inner


def middle(shape: tuple[int, ...], side: int) -> tuple[slice, slice]:
    """Rows and columns of the middle of a frame (..., h, w), at most `side` pixels each."""
    starts = [max(0, (whole - side) // 2) for whole in shape[-2:]]
    return slice(starts[0], starts[0] + side), slice(starts[1], starts[1] + side)


def largest_distance(pixels: Matrix) -> float:
    """Largest distance between two of the positions (k, 2)."""
    return float(max(np.hypot(*(a - b)) for a, b in combinations(pixels, 2)))
