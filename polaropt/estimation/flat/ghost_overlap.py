"""The incidence once more where ghosts are strong: edge overlap of layers from which all ghosts are taken out.

The linear elimination that the search rests on leaves each layer with doubled edges, which bias the incidence by up to
half a degree from about 65 degrees on. A Wiener filter's layers have no ghosts; averaged over blocks of 4x4 pixels
its smoothing no longer matters, and pictures of half the size will do.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from polaropt.capture import PlateFrame
from polaropt.estimation.flat.overlap import PARTS
from polaropt.numerics import (
    block_mean,
    frequencies,
    grid_sums,
    left_out,
    middle_part,
    minimum_error,
    tukey_window,
    vertex,
)
from polaropt.optics import INCIDENCE_LIMITS_DEG, SceneParameters, interface, plate_of

Images = NDArray[np.float32]

Spectrum = NDArray[np.complex64]
Sums = NDArray[np.float64]

# All by trial.
STRONG_GHOSTS_DEG = 64.0
"""Incidence from which on doubled edges bias that of least overlap."""
_STEP_DEG = 0.7
_FARTHEST = 1.5
"""Steps up to which the parabola is followed."""
SIDE = 512
"""Pixels per side of the frame's middle that is looked at: enough edges, and bounded time."""
HALF, _BLOCK = 2, 2
"""Pixels in a sample of the filter, and samples in a block of the overlap, along each side."""
_FADED, _LEFT_OUT = 8, 6
"""Samples at each border over which the pictures fade out, and that do not count."""
_LEAST_SIDES = 8
"""Borders are at most this part of a side."""
_FIRST_LEVEL, _LEAST_LEVEL = 3e-3, 1e-9
"""Power of a layer times squared frequency: where the fit begins, and never falls below."""
_ROUNDS, _EVERY = 3, 2
"""Rounds in which the levels are fitted, to every so-many-th frequency."""
_NOTHING = 1e-30
"""Energy of layers without any edges, squared."""


def refined_incidence(frame: PlateFrame, scene: SceneParameters) -> tuple[float, float]:
    """Incidence in degrees near that of a complete scene at which the layers' coarse edges overlap least.

    Parameters
    ----------
    frame : PlateFrame
        The capture in the frame of the scene's azimuth.
    scene : SceneParameters
        Complete; its shift and azimuth are kept.

    Returns
    -------
    incidence_deg, error_deg : float
        With its standard error.
    """
    start, _, _ = scene.values()
    overlap = LayerOverlap(frame, scene, start)
    step = min(_STEP_DEG, (INCIDENCE_LIMITS_DEG[1] - start) / 2)
    parts = [overlap.parts(start + shift) for shift in (-step, 0.0, step)]
    before, here, after = (float(overlap_of(part.sum(axis=-1))) for part in parts)
    error = minimum_error([overlap_of(left_out(part)) for part in parts], step)
    # One parabola: a search would need four times as many inversions.
    return start + step * vertex(before, here, after, _FARTHEST), error


class LayerOverlap:
    """Edge overlap of layers without ghosts over trial incidences.

    Parameters
    ----------
    frame : PlateFrame
    scene : SceneParameters
        Complete; its shifts and azimuth hold for all trials.
    incidence_deg : float
        Where the layers' powers are fitted.
    seen : SeenCoarsely, optional
        Of the frame, where it is at hand.
    """

    def __init__(
        self, frame: PlateFrame, scene: SceneParameters, incidence_deg: float, seen: SeenCoarsely | None = None
    ) -> None:
        self._wiener = _Wiener(SeenCoarsely(frame) if seen is None else seen, scene)
        self._wiener.fit(incidence_deg)

    def at(self, incidence_deg: float) -> float:
        """The overlap, 0..1."""
        return float(overlap_of(self.parts(incidence_deg).sum(axis=-1)))

    def parts(self, incidence_deg: float) -> Sums:
        """Sums over each part of the frame, (3, part): of |grad t||grad r|, |grad t|^2 and |grad r|^2."""
        t, r = _gradients(self._wiener.layers(incidence_deg))
        return grid_sums(np.stack([np.sqrt(t * r), t, r]), PARTS)


def coarse_overlap(layers: Images) -> float:
    """Cosine between the gradient magnitudes of two layers (2, h, w), averaged over 2x2 samples first."""
    t, r = _gradients(layers)
    return float(overlap_of(np.stack([np.sqrt(t * r), t, r]).sum(axis=(-2, -1), dtype=np.float64)))


def overlap_of(sums: Sums) -> Sums:
    """Overlap of sums (3, ...) as of `LayerOverlap.parts`; 1 where a layer has no edges."""
    overlap: Sums = (sums[0] + math.sqrt(_NOTHING)) / np.sqrt(sums[1] * sums[2] + _NOTHING)
    return overlap


def _gradients(layers: Images) -> tuple[Images, Images]:
    """Squared gradients of both layers averaged over 2x2 samples."""
    blocks = block_mean(layers, _BLOCK)
    across, down = np.diff(blocks, axis=-1)[:, :-1], np.diff(blocks, axis=-2)[..., :-1]
    t, r = across**2 + down**2
    return t, r


def images_with_ghosts_in_place(frame: PlateFrame, scene: SceneParameters) -> Images:
    """The middle of a frame at half its size, (2, channel, h, w), as it would be with all ghosts in place.

    What a Wiener filter takes for the ghosts is moved there. The borders, where that fades out, are left out.

    Parameters
    ----------
    frame : PlateFrame
    scene : SceneParameters
        Complete, with ghosts.
    """
    images = block_mean(frame.images[..., *middle_part(frame.images.shape, SIDE)], HALF)
    for channel in range(images.shape[1]):
        images[:, channel] += _Wiener(SeenCoarsely(frame, channel), scene).moved_into_place()
    return without_borders(images)


def without_borders(images: Images) -> Images:
    """Images (..., h, w) at half size without the samples over which they fade out."""
    edge = min(_LEFT_OUT, min(images.shape[-2:]) // _LEAST_SIDES)
    return images[..., edge:-edge, edge:-edge] if edge else images


class SeenCoarsely:
    """Spectra of a frame's luminance at half its size, whatever the pane; or of one of its colours.

    Parameters
    ----------
    frame : PlateFrame
    channel : int, optional
        Number of the colour.
    """

    def __init__(self, frame: PlateFrame, channel: int | None = None) -> None:
        from scipy.fft import rfft2

        middle = frame.images[..., *middle_part(frame.images.shape, SIDE)]
        images = block_mean(middle.mean(axis=1) if channel is None else middle[:, channel], HALF)
        self.shape: tuple[int, int] = images.shape[-2:]
        images -= images.mean(axis=(-2, -1), keepdims=True)
        images *= np.outer(*(fading(side) for side in self.shape))
        self.spectrum: Spectrum = rfft2(images, norm="ortho")
        self._rows, self._columns = frequencies(*self.shape)
        self.radius2 = (self._rows**2 + self._columns**2).astype(np.float32)
        self.radius2[0, 0] = (2 * np.pi / max(self.shape)) ** 2
        n_colors = frame.images.shape[1] if channel is None else 1
        self.noise = (frame.covariance / (HALF**2 * n_colors)).astype(np.float32)
        self.azimuth_deg = frame.azimuth_deg

    def turned(self, shift: float, azimuth_deg: float) -> Spectrum:
        """What a shift in pixels along an azimuth does to each frequency."""
        azimuth = math.radians(azimuth_deg)
        along = self._columns * math.cos(azimuth) - self._rows * math.sin(azimuth)
        return np.asarray(np.exp(-1j * along * shift / HALF), np.complex64)


class _Wiener:
    """Wiener filter for the luminance of both layers: in the Fourier domain each ghost is a phase.

    Power of the layers is ``level / |omega|^2``.
    """

    def __init__(self, coarse: SeenCoarsely, scene: SceneParameters) -> None:
        self._shape, self._seen = coarse.shape, coarse.spectrum
        self._radius2, self._noise = coarse.radius2, coarse.noise
        shift, own = scene.values()[2], scene.transmission_ghost_shift
        self._z_r = coarse.turned(shift, coarse.azimuth_deg)
        self._z_t = self._z_r if own is None else coarse.turned(own, coarse.azimuth_deg)
        gap_deg = scene.values()[1] if scene.gap_azimuth_deg is None else scene.gap_azimuth_deg
        self._z_gap = None if not scene.stacked else coarse.turned(scene.gap_shift or 0.0, gap_deg)
        self._levels: Images = np.full(2, _FIRST_LEVEL, np.float32)
        self._scene = scene

    def fit(self, incidence_deg: float) -> None:
        """Fit the levels of both layers at an incidence."""
        for _ in range(_ROUNDS):
            power = _squared(self._spectra(incidence_deg, _EVERY)) * self._radius2[::_EVERY, ::_EVERY]
            self._levels = np.maximum(power.mean(axis=(-2, -1)), np.float32(_LEAST_LEVEL))

    def layers(self, incidence_deg: float) -> Images:
        """Transmission and reflection (2, h, w) of a pane at an incidence, without the borders."""
        from scipy.fft import irfft2

        layers: Images = irfft2(self._spectra(incidence_deg), s=self._shape, norm="ortho", overwrite_x=True)
        return without_borders(layers)

    def moved_into_place(self) -> Images:
        """What is added to both polarizations (2, h, w) when the ghosts of the scene's pane lie in place."""
        from scipy.fft import irfft2

        incidence = self._scene.values()[0]
        self.fit(incidence)
        layers = self._spectra(incidence)
        here = np.ones((1, 1), np.complex64)
        shown = _transfer(incidence, self._scene, self._z_t, self._z_r, self._z_gap)
        in_place = _transfer(incidence, self._scene, here, here, None if self._z_gap is None else here)
        added = ((in_place - shown) * layers).sum(axis=1)
        return np.asarray(irfft2(added, s=self._shape, norm="ortho"), np.float32)

    def _spectra(self, incidence_deg: float, every: int = 1) -> Spectrum:
        """Spectra of the layers: ``P H^* (H P H^* + N)^-1`` times what is seen, H the pane, P the layers' powers."""
        part = (..., slice(None, None, every), slice(None, None, every))
        (seen_par, seen_perp), radius2 = self._seen[part], self._radius2[part]
        z_r = self._z_r[part]
        z_t = z_r if self._z_t is self._z_r else self._z_t[part]
        z_gap = None if self._z_gap is None else self._z_gap[part]
        par, perp = _transfer(incidence_deg, self._scene, z_t, z_r, z_gap)
        p = self._levels[:, None, None]
        (n_par, n_cross), (_, n_perp) = self._noise
        # Everything in units of 1 / |omega|^2.
        power_par = (p * _squared(par)).sum(axis=0) + n_par * radius2
        power_perp = (p * _squared(perp)).sum(axis=0) + n_perp * radius2
        cross = (p * par * perp.conj()).sum(axis=0) + n_cross * radius2
        determinant = power_par * power_perp - _squared(cross)
        white_par = (power_perp * seen_par - cross * seen_perp) / determinant
        white_perp = (power_par * seen_perp - cross.conj() * seen_par) / determinant
        found: Spectrum = p * (par.conj() * white_par + perp.conj() * white_perp)
        return found


def _transfer(
    incidence_deg: float, scene: SceneParameters, z_t: Spectrum, z_r: Spectrum, z_gap: Spectrum | None
) -> Spectrum:
    """What the pane passes and mirrors, (entry, layer, h, w): a polarizer takes half of each."""
    rho = np.array(interface(incidence_deg, scene.index).reflection[:2], np.float32)[:, None, None]
    plate = plate_of(rho, 1 - rho, scene)
    gap = 1.0 if z_gap is None else z_gap
    transmitted, reflected = plate.at(z_r, gap)
    if z_t is not z_r:
        transmitted, _ = plate.at(z_t, gap)
    return np.asarray(np.stack([transmitted, reflected], axis=1) / 2, np.complex64)


def _squared(values: Spectrum) -> Images:
    squared: Images = values.real**2 + values.imag**2
    return squared


def fading(side: int) -> Images:
    """One inside, falling to zero at both ends."""
    reach = min(_FADED, max(1, side // _LEAST_SIDES))
    return tukey_window(side - 2 * reach, reach, reach).astype(np.float32)
