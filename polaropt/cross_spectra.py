"""Mean spectra of what a pane shows in its two polarizations, for the likelihood of a ghost shift."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from polaropt.plate_frame import Images, Mask, Matrix, PlateFrame
from polaropt.transfer import frequencies

_LOWEST_CYCLES = 2.5
_HIGHEST = 2.8
_MOST_INVALID = 0.2
_MOST_TILES = 128
_MOST_BANDS = 8


@dataclass(frozen=True)
class Bands:
    """Sums of periodograms over bands of tiles, (band, frequency), and how many periodograms each holds."""

    par: Images
    perp: Images
    cross: NDArray[np.complex64]
    counts: NDArray[np.intp]

    def across(self) -> Bands:
        """The same with the two polarizations exchanged."""
        return Bands(self.perp, self.par, self.cross.conj(), self.counts)

    def without(self, band: int) -> list[Any]:
        """Mean par, perp and cross of all other bands."""
        count = np.float32(self.counts.sum() - self.counts[band])
        return [(part.sum(axis=0) - part[band]) / count for part in (self.par, self.perp, self.cross)]


@dataclass(frozen=True)
class CrossSpectra:
    """Mean periodograms over tiles and colours; all arrays have one value per usable frequency.

    Attributes
    ----------
    par, perp : ndarray of float32
        Power of I_par and I_perp.
    cross : ndarray of complex64
        Their cross spectrum.
    along, across_azimuth : ndarray
        Angular frequency along and across the azimuth, per pixel.
    multiplicity : ndarray of float32
        1 or 2: whether a frequency stands for its mirror image, too.
    covariance : ndarray, shape (2, 2)
        Power of the noise.
    tile : int
        Side of the tiles in pixels.
    azimuth_deg : float
    ghosts_deg : float, optional
        Direction in the image along which ghosts lie, where the polarizer's zero is in doubt. Default: the azimuth.
    bands : Bands, optional
        What the means are made of.
    """

    par: Images
    perp: Images
    cross: NDArray[np.complex64]
    along: Matrix
    across_azimuth: Matrix
    multiplicity: Images
    covariance: Matrix
    tile: int
    azimuth_deg: float
    ghosts_deg: float | None = None
    bands: Bands | None = None

    def across(self) -> CrossSpectra:
        """The same for a pane whose plane of incidence lies across: its two polarizations are exchanged."""
        return CrossSpectra(
            self.perp,
            self.par,
            self.cross.conj(),
            -self.across_azimuth,
            self.along,
            self.multiplicity,
            self.covariance[::-1, ::-1],
            self.tile,
            self.azimuth_deg + 90,
            self.ghosts_deg,
            None if self.bands is None else self.bands.across(),
        )

    def left_out(self) -> list[CrossSpectra]:
        """The same without each of the bands."""
        if self.bands is None or len(self.bands.counts) == 1:
            return []
        rest = [self.bands.without(i) for i in range(len(self.bands.counts))]
        return [replace(self, par=par, perp=perp, cross=cross, bands=None) for par, perp, cross in rest]

    def with_ghosts_along(self, direction_deg: float) -> CrossSpectra:
        """The same for ghosts along another direction in the image than the azimuth."""
        return replace(self, ghosts_deg=direction_deg)

    @property
    def along_ghosts(self) -> Matrix:
        """Angular frequency along the ghosts, per pixel."""
        if self.ghosts_deg is None:
            return self.along
        turn = math.radians(self.ghosts_deg - self.azimuth_deg)
        return self.along * math.cos(turn) - self.across_azimuth * math.sin(turn)

    def coherence(self, shifts: Matrix) -> Images:
        """Share of its light that a tile's window has in common with itself one ghost shift further."""
        direction = math.radians(self.azimuth_deg if self.ghosts_deg is None else self.ghosts_deg)
        common = _hann_autocorrelation(shifts * math.cos(direction) / self.tile)
        return (common * _hann_autocorrelation(shifts * math.sin(direction) / self.tile)).astype(np.float32)


def cross_spectra(frame: PlateFrame, tile: int = 64) -> CrossSpectra:
    """Welch's mean periodograms over half-overlapping Hann tiles of `tile` pixels, a bounded number of them."""
    from scipy.fft import rfft2

    side = min(tile, *frame.images.shape[-2:])
    profile = np.hanning(side + 2)[1:-1]
    window = np.outer(profile, profile)
    window = (window / np.sqrt(np.sum(window**2))).astype(np.float32)
    share = window / np.sum(window)
    corners = _tile_corners(frame.valid, side)
    n_bands = min(_MOST_BANDS, len(corners))
    par: Images = np.zeros((n_bands, side, side // 2 + 1), np.float32)
    perp, cross, counts = par.copy(), np.zeros(par.shape, np.complex64), np.zeros(n_bands, np.intp)
    for i, (top, left) in enumerate(corners):
        part = _opponent(frame.images[..., top : top + side, left : left + side])
        mean = np.einsum("ecyx,yx->ec", part, share)[..., None, None]
        first, second = rfft2((part - mean) * window)
        band = i * n_bands // len(corners)
        par[band] += _power(first)
        perp[band] += _power(second)
        cross[band] += np.einsum("cyx,cyx->yx", first, second.conj())
        counts[band] += part.shape[1]
    return _usable(Bands(par, perp, cross, counts), side, frame)


def _hann_autocorrelation(lag: Matrix) -> Matrix:
    """Normalized autocorrelation of a Hann window at a lag in units of its length."""
    lag = np.minimum(np.abs(lag), 1)
    bulk: Matrix = (1 - lag) * (2 + np.cos(2 * np.pi * lag)) / 3
    return bulk + np.sin(2 * np.pi * lag) / (2 * np.pi)


def _power(spectra: NDArray[np.complex64]) -> Images:
    """Power of spectra (channel, ...), summed over the channels."""
    parts = spectra.view(np.float32).reshape(*spectra.shape, 2)
    power: Images = np.einsum("cyxp,cyxp->yx", parts, parts)
    return power


def _usable(sums: Bands, side: int, frame: PlateFrame) -> CrossSpectra:
    rows, columns = frequencies(side, side)
    azimuth = math.radians(frame.azimuth_deg)
    along = columns * math.cos(azimuth) - rows * math.sin(azimuth)
    across = columns * math.sin(azimuth) + rows * math.cos(azimuth)
    multiplicity = np.full(along.shape, 2, np.float32)
    multiplicity[:, 0] = 1
    if side % 2 == 0:
        multiplicity[:, -1] = 1
    radius: Matrix = np.hypot(columns, rows)
    # The window leaks the lowest frequencies; interpolation, in an eye or a computer, spoils the highest.
    use = (radius > _LOWEST_CYCLES * 2 * np.pi / side) & (radius < _HIGHEST)
    # The window makes neighbouring frequencies much alike: every second one, as on a chessboard, says the same.
    use &= np.add.outer(np.arange(side), np.arange(side // 2 + 1)) % 2 == 0
    bands = Bands(sums.par[:, use], sums.perp[:, use], sums.cross[:, use], sums.counts)
    count = np.float32(sums.counts.sum())
    par, perp, cross = (part.sum(axis=0) / count for part in (bands.par, bands.perp, bands.cross))
    return CrossSpectra(
        par,
        perp,
        cross,
        along[use],
        across[use],
        multiplicity[use],
        frame.covariance,
        side,
        frame.azimuth_deg,
        bands=bands,
    )


def _tile_corners(valid: Mask, side: int) -> list[tuple[int, int]]:
    """Corners of half-overlapping tiles, without those that are mostly unknown."""
    starts = [_starts(length, side) for length in valid.shape[-2:]]
    corners = [(top, left) for top in starts[0] for left in starts[1]]
    corners = corners[:: math.ceil(len(corners) / _MOST_TILES)]
    if valid.all():
        return corners
    shares = [1 - float(valid[..., y : y + side, x : x + side].mean()) for y, x in corners]
    limit = max(_MOST_INVALID, min(shares))
    return [corner for corner, share in zip(corners, shares, strict=True) if share <= limit]


def _starts(length: int, side: int) -> list[int]:
    n = max(1, math.ceil(2 * length / side) - 1)
    return sorted({int(start) for start in np.linspace(0, length - side, n)})


def _opponent(images: Images) -> Images:
    """Colours (2, 3, h, w) to their sum and differences, which are less alike; anything else unchanged."""
    if images.shape[1] != 3:
        return images
    basis = np.array([[1, 1, 1], [1, 0, -1], [1, -2, 1]]) / np.sqrt([[3], [2], [6]])
    turned: Images = np.einsum("dc,ec...->ed...", basis.astype(np.float32), images)
    return turned
