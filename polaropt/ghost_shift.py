"""Ghost shift of the pane, by the likelihood of the capture's spectra (Whittle) as a function of the shift.

Layers are taken as natural images, power ``A / |omega|^2`` with one unknown A each. The ghosts put notches across the
spectra of what each polarization shows, and turn the phase between the two; the latter tells the shift's sense.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from polaropt.fresnel import interface
from polaropt.plate_frame import Images, Matrix, PlateFrame
from polaropt.scene import SceneParameters
from polaropt.transfer import frequencies

Spectrum = NDArray[np.complex128]

_ROUNDS = 15
_HIGHEST = 2.8
_MOST_INVALID = 0.2


@dataclass(frozen=True)
class CrossSpectra:
    """Mean periodograms over tiles and colours, one entry per usable frequency.

    Attributes
    ----------
    par, perp : ndarray
        Power of I_par and I_perp.
    cross : ndarray, complex
        Their cross spectrum.
    along : ndarray
        Angular frequency along the azimuth, per pixel.
    radius2 : ndarray
        Squared angular frequency.
    multiplicity : ndarray
        1 or 2: how often a frequency stands for its mirror image, too.
    n_averaged : int
    """

    par: Matrix
    perp: Matrix
    cross: Spectrum
    along: Matrix
    radius2: Matrix
    multiplicity: Matrix
    n_averaged: int
    covariance: Matrix


def cross_spectra(frame: PlateFrame, tile: int = 64) -> CrossSpectra:
    """Welch's mean periodograms of the plate's two intensity images over half-overlapping Hann tiles."""
    from scipy.fft import rfft2

    height, width = frame.images.shape[-2:]
    side = min(tile, height, width)
    profile = np.hanning(side + 2)[1:-1]
    window = np.outer(profile, profile)
    window = (window / np.sqrt(np.sum(window**2))).astype(np.float32)
    images = _opponent(frame.images)
    sums = [np.zeros((side, side // 2 + 1)), np.zeros((side, side // 2 + 1)), np.zeros((side, side // 2 + 1), complex)]
    count = 0
    for top, left in _tile_corners(frame.valid, side):
        part = images[..., top : top + side, left : left + side]
        mean = np.sum(part * window, axis=(-2, -1), keepdims=True) / np.sum(window)
        par, perp = rfft2((part - mean) * window)
        for total, term in zip(sums, (np.abs(par) ** 2, np.abs(perp) ** 2, par * perp.conj()), strict=True):
            total += term.sum(axis=0)
        count += images.shape[1]
    return _usable(sums, count, side, frame)


def _usable(sums: list[NDArray[np.generic]], count: int, side: int, frame: PlateFrame) -> CrossSpectra:
    rows, columns = frequencies(side, side)
    azimuth = math.radians(frame.azimuth_deg)
    along = columns * math.cos(azimuth) - rows * math.sin(azimuth)
    radius2 = columns**2 + rows**2
    multiplicity = np.full(along.shape, 2.0)
    multiplicity[:, 0] = 1
    if side % 2 == 0:
        multiplicity[:, -1] = 1
    # The window leaks the lowest frequencies; bilinear interpolation spoils the highest.
    use = (radius2 > (2.5 * 2 * np.pi / side) ** 2) & (radius2 < _HIGHEST**2)
    par, perp, cross = (total[use] / count for total in sums)
    return CrossSpectra(
        par, perp, cross, along[use], radius2[use], multiplicity[use], count, frame.covariance
    )


def _tile_corners(valid: NDArray[np.bool_], side: int) -> list[tuple[int, int]]:
    """Corners of half-overlapping tiles, those left out that are mostly unknown."""
    starts = [_starts(length, side) for length in valid.shape[-2:]]
    corners = [(top, left) for top in starts[0] for left in starts[1]]
    if valid.all():
        return corners
    shares = [1 - float(valid[..., y : y + side, x : x + side].mean()) for y, x in corners]
    limit = max(_MOST_INVALID, min(shares))
    return [corner for corner, share in zip(corners, shares, strict=True) if share <= limit]


def _starts(length: int, side: int) -> list[int]:
    n = max(1, math.ceil(2 * length / side) - 1)
    return sorted({int(start) for start in np.linspace(0, length - side, n)})


def _opponent(images: Images) -> Images:
    """Colours (2, 3, h, w) to sum and differences, which are less alike; anything else unchanged."""
    if images.shape[1] != 3:
        return images
    basis = np.array([[1, 1, 1], [1, 0, -1], [1, -2, 1]]) / np.sqrt([[3], [2], [6]])
    return np.einsum("dc,ec...->ed...", basis.astype(np.float32), images)


def misfit(spectra: CrossSpectra, scene: SceneParameters, shifts: Sequence[float]) -> Matrix:
    """Minus log likelihood (up to a constant) of each ghost shift; incidence and index are the scene's.

    The level A of each layer is fitted for each shift.
    """
    noise = spectra.covariance
    reflection, transmission = _responses(spectra, scene, np.asarray(shifts, dtype=np.float64))
    levels = np.full((2, len(shifts), 1), 1e-3)
    for _ in range(_ROUNDS):
        model = _model(levels, reflection, transmission, noise)
        inverse, _ = _inverse(*model)
        sandwich = _sandwich(inverse, spectra)
        for level, response in zip(levels, (reflection, transmission), strict=True):
            gain = _trace(sandwich, response) @ spectra.multiplicity
            expected = _trace(inverse, response) @ spectra.multiplicity
            level *= np.maximum(gain / expected, 1e-3)[:, None]
    inverse, determinant = _inverse(*_model(levels, reflection, transmission, noise))
    data = (spectra.par, spectra.perp, spectra.cross)
    total: Matrix = (np.log(determinant) + _trace(inverse, data)) @ spectra.multiplicity * spectra.n_averaged
    return total


_Hermitian = tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.complex128]]
"""Diagonal entries and the upper right one of 2x2 Hermitian matrices."""


def _responses(spectra: CrossSpectra, scene: SceneParameters, shifts: Matrix) -> tuple[_Hermitian, _Hermitian]:
    """Outer products of both layers' transfer functions, times the power of natural images."""
    incidence_deg, _, _ = scene.replace(azimuth_deg=0.0, ghost_shift=0.0).values()
    z = np.exp(-1j * spectra.along * shifts[:, None])
    reflected, transmitted = [], []
    for reflectance in interface(incidence_deg, scene.refractive_index).reflection[:2]:
        series = (1 - reflectance) ** 2 / (1 - reflectance**2 * z)
        transmitted.append(series)
        reflected.append(reflectance * (1 + series * z))
    return _outer(reflected, spectra.radius2), _outer(transmitted, spectra.radius2)


def _outer(pair: list[Spectrum], radius2: Matrix) -> _Hermitian:
    par, perp = pair
    return np.abs(par) ** 2 / radius2, np.abs(perp) ** 2 / radius2, par * perp.conj() / radius2


def _model(levels: Matrix, reflection: _Hermitian, transmission: _Hermitian, noise: Matrix) -> _Hermitian:
    parts = zip(reflection, transmission, (noise[0, 0], noise[1, 1], noise[0, 1]), strict=True)
    par, perp, cross = (levels[0] * r + levels[1] * t + n for r, t, n in parts)
    return par, perp, cross


def _inverse(par: Matrix, perp: Matrix, cross: Spectrum) -> tuple[_Hermitian, Matrix]:
    determinant = par * perp - np.abs(cross) ** 2
    return (perp / determinant, par / determinant, -cross / determinant), determinant


def _sandwich(inverse: _Hermitian, spectra: CrossSpectra) -> _Hermitian:
    """Inverse times data times inverse."""
    par, perp, cross = inverse
    top_left = par * spectra.par + cross * spectra.cross.conj()
    top_right = par * spectra.cross + cross * spectra.perp
    low_left = cross.conj() * spectra.par + perp * spectra.cross.conj()
    low_right = cross.conj() * spectra.cross + perp * spectra.perp
    return (
        (top_left * par + top_right * cross.conj()).real,
        (low_left * cross + low_right * perp).real,
        top_left * cross + top_right * perp,
    )


def _trace(a: _Hermitian, b: _Hermitian) -> Matrix:
    """Trace of the product of Hermitian matrices."""
    total: Matrix = a[0] * b[0] + a[1] * b[1] + 2 * (a[2].conj() * b[2]).real
    return total
