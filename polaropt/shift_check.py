"""Whether photographs are shifted against each other, at a glance: two milliseconds, no resampling."""

from __future__ import annotations

import numpy as np

from polaropt.capture import Capture
from polaropt.registration import Mask, far_from_invalid, largest_distance, middle
from polaropt.shift_fit import Images, fit_small_shifts, products

_SIDE = 256
_LEAST = 0.5
_SURE = 5.0
_FEWEST = 500
_WIDE = 3
_ABOUT = 0.01
_CLEARLY_HIGHER = 1.3
_ABOVE_CHANCE = 7.0


def visible_shift(capture: Capture, least_px: float = _LEAST) -> float:
    """Largest distance between two photographs in pixels, 0 where it is not surely more than `least_px`.

    A look at one colour in the middle of the frame: good to a tenth of a pixel up to about one pixel, beyond that only
    a hint of the size. `polaropt.registration.measure_shifts` measures. The cells of a mosaic do not move against each
    other: 0.
    """
    if capture.origin is not None and "mosaic" in capture.origin.layout:
        return 0.0
    block = 2 if min(capture.shape[-2:]) >= 1.5 * _SIDE else 1
    rows, columns = middle(capture.shape, block * _SIDE)
    images, valid = capture.intensities[..., rows, columns], capture.valid[..., rows, columns]
    if capture.color:
        channel = capture.shape[0] // 2
        images, valid = images[:, channel], valid[:, channel]
    trusted: Mask = np.asarray(valid.all(axis=0))
    if block > 1:
        trusted = _halved(trusted.astype(np.float32)) == 1
        images = _halved(images)
    return max(_far(images), block * _near(images, trusted, least_px / block)) if min(images.shape[-2:]) >= 16 else 0.0


def _near(images: Images, trusted: Mask, least_px: float) -> float:
    """Distances of about a pixel, from the gradients."""
    bands = _band(images)
    inside = None
    if not trusted.all():
        edge = _WIDE + 1
        inside = far_from_invalid(trusted)[edge:-edge, edge:-edge]
        if np.count_nonzero(inside) < _FEWEST:
            return 0.0
    found = fit_small_shifts(products(bands, inside, turning=True), at_rest=_ABOUT, n_motions=4)
    largest = max(largest_distance(found.pixels[:, :2]), largest_distance(found.pixels[:, 2:]))
    return largest if largest > least_px + _SURE * found.error else 0.0


def _far(images: Images) -> float:
    """Distances of several pixels, from the correlation with the first photograph."""
    from scipy.fft import irfft2, rfft2

    bands = _band(_halved(images))
    height, width = bands.shape[-2:]
    if min(height, width) < 16:
        return 0.0
    window = np.outer(np.hanning(height), np.hanning(width)).astype(np.float32)
    spectra = rfft2(bands * window)
    correlations = irfft2(spectra[1:] * spectra[0].conj(), s=(height, width))
    largest = 0.0
    for correlation in correlations:
        row, column = (int(k) for k in np.unravel_index(np.argmax(correlation), correlation.shape))
        peak = float(correlation[row, column])
        chance = _ABOVE_CHANCE * float(correlation.std())
        if peak > max(_CLEARLY_HIGHER * float(correlation[0, 0]), chance):
            largest = max(largest, 2 * float(np.hypot(min(row, height - row), min(column, width - column))))
    return largest


def _halved(images: Images) -> Images:
    """Means of 2x2 pixels; sums of slices are several times as fast as `block_means` for so small blocks."""
    rows, columns = (side // 2 * 2 for side in images.shape[-2:])
    pairs = images[..., 0:rows:2, :] + images[..., 1:rows:2, :]
    halved: Images = (pairs[..., 0:columns:2] + pairs[..., 1:columns:2]) * np.float32(0.25)
    return halved


def _band(images: Images) -> Images:
    """What is finer than about 3 px and coarser than single pixels."""
    across = images[..., :-2] + 2 * images[..., 1:-1] + images[..., 2:]
    smooth = across[..., :-2, :] + 2 * across[..., 1:-1, :] + across[..., 2:, :]
    middle = slice(_WIDE, -_WIDE)
    around = smooth[..., : -2 * _WIDE, middle] + smooth[..., 2 * _WIDE :, middle]
    around += smooth[..., middle, : -2 * _WIDE] + smooth[..., middle, 2 * _WIDE :]
    band: Images = smooth[..., middle, middle] - np.float32(0.25) * around
    return band
