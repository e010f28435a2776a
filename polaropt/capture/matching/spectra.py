"""Spectra of photographs where they hold detail, from windows over the frame."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from polaropt.capture.capture import Capture
from polaropt.numerics import block_mean, fill_gaps, whole_blocks
from polaropt.optics import analyzer_matrix

Floats = NDArray[np.floating[Any]]
Spectrum = NDArray[np.complexfloating[Any, Any]]

_SIDE_PX, _MOST_WINDOWS, _LEAST_PX = 256, 3, 64
"""Side of a window, windows along a side of the frame at most, and the smallest side of a frame; set by hand."""
_COARSEST_PERIODS, _FINEST = 6.0, 0.45
"""Periods per window from which on, and per pixel up to which, frequencies count: coarser ones are light and shade, and
finer ones hardly pass any lens. Set by hand."""
_LEAST_SNR, _MOST_FREQUENCIES, _FEWEST = 20.0, 4000, 200
"""Power over noise of frequencies that count, how many count, those with most detail first, and how few tell nothing.
Set by hand."""
RINGS = 32
"""Rings of frequencies, up to half a period per pixel, by which the scene's spectrum is kept."""


@dataclass(frozen=True)
class DetailSpectra:
    """Spectra of photographs in units of their noise, at the frequencies that tell most of their sharpness.

    Attributes
    ----------
    rows, columns : ndarray, shape (n,)
        Frequencies, in periods per pixel.
    values : ndarray of complex, shape (k, channel, n)
    angles_deg : tuple of float
    power : ndarray, shape (k, RINGS)
        Mean power of each photograph by rings of frequencies, noise included: noise alone has 1.
    noise : float
        Standard deviation of one photograph's noise.
    """

    rows: Floats
    columns: Floats
    values: Spectrum
    angles_deg: tuple[float, ...]
    power: Floats
    noise: float


def detail_spectra(capture: Capture, noise: float) -> DetailSpectra | None:
    """Spectra of the photographs' detail; None where they hold too little of it.

    Parameters
    ----------
    capture : Capture
        Pixels that are not valid in all photographs are filled alike.
    noise : float
        Standard deviation of one photograph's noise.
    """
    height, width = capture.shape[-2:]
    if min(height, width) < _LEAST_PX or not noise > 0:
        return None
    side = min(_SIDE_PX, height, width)
    taper = np.square(np.sin(np.pi * (np.arange(side) + 0.5) / side)).astype(np.float32)
    window = taper[:, None] * taper
    rows, columns = np.fft.fftfreq(side)[:, None], np.fft.rfftfreq(side)
    radius = np.hypot(rows, columns)
    told = (radius > _COARSEST_PERIODS / side) & (radius < _FINEST) & (columns > 0)
    ring = ring_of(rows, columns)
    members = np.bincount(ring.ravel(), minlength=RINGS)
    spectra, details, power = [], [], np.zeros((len(capture.angles_deg), RINGS))
    places = [(top, left) for top in _starts(height, side) for left in _starts(width, side)]
    for top, left in places:
        spectrum = _window_spectra(capture.part(slice(top, top + side), slice(left, left + side)), window) / noise
        squares = np.square(np.abs(spectrum)).mean(axis=1)
        power += [np.bincount(ring.ravel(), one.ravel(), RINGS) / members for one in squares]
        # The mean over photographs is less noisy by their number.
        light = np.square(np.abs(spectrum.mean(axis=0))).mean(axis=0) * len(spectrum)
        details.append(np.where(told & (light > _LEAST_SNR), light * radius**2, 0.0).ravel())
        spectra.append(spectrum.reshape(*spectrum.shape[:2], -1))
    detail = np.concatenate(details)
    chosen = np.argsort(detail)[::-1][:_MOST_FREQUENCIES]
    chosen = np.sort(chosen[detail[chosen] > 0])
    if chosen.size < _FEWEST:
        return None
    repeated = np.tile(np.broadcast_to(rows, radius.shape).ravel(), len(places))
    across = np.tile(np.broadcast_to(columns, radius.shape).ravel(), len(places))
    values = np.concatenate(spectra, axis=-1)[..., chosen]
    return DetailSpectra(
        repeated[chosen], across[chosen], values, capture.angles_deg, power / len(places), noise
    )  # fmt: skip


def ring_of(rows: Floats, columns: Floats) -> NDArray[np.intp]:
    """Ring of each frequency, in periods per pixel; those beyond half a period count to the last."""
    return np.minimum((np.hypot(rows, columns) * 2 * RINGS).astype(np.intp), RINGS - 1)


def polarized_axis(capture: Capture, block: int = 16) -> tuple[float, float]:
    """Direction in degrees of the line on which the frame's polarized light lies, and what lies beside it.

    The light of a flat pane before unpolarized scenes is polarized along one direction and across it, everywhere.

    Returns
    -------
    azimuth_deg : float
    beside : float
        Root mean square of the polarized light beside that line, as a share of that on it.
    """
    means = block_mean(capture.intensities, block)
    stokes = np.tensordot(np.linalg.pinv(analyzer_matrix(capture.angles_deg)), means, axes=1)
    polarized = stokes[1:, whole_blocks(np.asarray(capture.mask.all(axis=0)), block)].astype(np.float64)
    if polarized.shape[1] < 2:
        return 0.0, 1.0
    spread, directions = np.linalg.eigh(polarized @ polarized.T)
    if not spread[1] > 0:
        return 0.0, 1.0
    along = directions[:, 1]
    return float(np.degrees(np.arctan2(along[1], along[0]) / 2)), float(np.sqrt(max(spread[0], 0.0) / spread[1]))


def _starts(length: int, side: int) -> list[int]:
    """Where windows of a side start, evenly over a length."""
    count = min(_MOST_WINDOWS, max(1, round(length / side)))
    return [int(start) for start in np.linspace(0, length - side, count)]


def _window_spectra(part: Capture, window: NDArray[np.float32]) -> Spectrum:
    """Spectra (k, channel, h, w) of a window, of which white noise of deviation 1 has a power of 1."""
    from scipy.fft import rfft2

    k, side = len(part.angles_deg), len(window)
    images, valid = part.intensities.reshape(k, -1, side, side), part.valid_in_all
    if not valid.all():
        images = fill_gaps(images, np.broadcast_to(valid, images.shape[1:]))
    mean = (images * window).sum(axis=(-2, -1), keepdims=True) / window.sum()
    return np.asarray(rfft2((images - mean) * window) / np.sqrt(np.square(window).sum()))
