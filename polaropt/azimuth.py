"""Azimuth of the pane, from the cloud of (s1, s2): unpolarized layers leave s2' = 0, whatever the ghosts do."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from polaropt.plate_frame import block_mean

Images = NDArray[np.float32]
Matrix = NDArray[np.float64]

_MOST_SIDE = 320
_RINGS = 256
_LOW = 0.1
_ROUNDS = 6
_LEAST = 1e-14


@dataclass(frozen=True)
class PrincipalAxis:
    """The dominant axis of the polarized light.

    Attributes
    ----------
    azimuth_deg : float
        Azimuth modulo 90, in [0, 90): the axis is that of the plane of incidence or the one across it.
    error_deg : float
        Standard error of the azimuth that the noise leads to (22.5 where there is nothing but noise).
    snr : float
        Polarized energy found, in standard errors of what noise alone would leave.
    """

    azimuth_deg: float
    error_deg: float
    snr: float


def principal_axis(polarized: Images, noise_covariance: Matrix) -> PrincipalAxis:
    """Dominant axis of Wiener-smoothed (s1, s2), by their uncentred second moment.

    Parameters
    ----------
    polarized : ndarray, shape (2, channel, h, w)
        s1 and s2 in the camera's frame, complete (no gaps).
    noise_covariance : ndarray, shape (2, 2)
        Covariance of the noise of s1 and s2 in a pixel.

    Notes
    -----
    Each frequency counts as far as it stands out of the noise: s1' of natural layers has the power ``A / |omega|^2``.
    The cosine transform has no seam at the borders, and white noise stays white in it.
    """
    from scipy.fft import dctn

    size = _thinning(max(polarized.shape[-2:]))
    noise_covariance = noise_covariance / size**2
    coefficients = dctn(block_mean(polarized, size), axes=(-2, -1), norm="ortho", overwrite_x=size > 1)
    radius2 = _squared_frequency(*coefficients.shape[-2:])
    noise = float(np.trace(noise_covariance))
    gains = np.stack(
        [_wiener_gain(np.einsum("iyx,iyx->yx", c, c), radius2, noise) for c in coefficients.swapaxes(0, 1)]
    )
    s1, s2 = coefficients * gains
    moment = np.array([[np.vdot(a, b) for b in coefficients] for a in (s1, s2)], np.float64)
    moment = moment - noise_covariance * gains.sum()
    twice = math.atan2(2 * moment[0, 1], moment[0, 0] - moment[1, 1])
    signal = math.hypot(2 * moment[0, 1], moment[0, 0] - moment[1, 1])
    of_noise = 0.5 * noise * math.sqrt(float((gains**2).sum())) + _LEAST
    # What turns the moment: noise with noise, and noise across with signal along.
    seen = sum(float(np.vdot(c * gain, c * gain)) for c, gain in zip(coefficients.swapaxes(0, 1), gains, strict=True))
    along = max(seen - noise * float((gains**2).sum()), 0.0)
    across = math.sqrt(4 * of_noise**2 + 2 * noise * along)
    error_deg = math.degrees(math.atan2(across, max(signal, _LEAST))) / 4
    return PrincipalAxis(math.degrees(twice) / 4 % 90, error_deg, signal / of_noise)


def _thinning(side: int) -> int:
    """Side of the blocks that are averaged first: polarized light shows at low frequencies."""
    return int(2 ** max(0, math.ceil(math.log2(side / _MOST_SIDE))))


def _squared_frequency(height: int, width: int) -> Images:
    rows, columns = (np.pi * np.arange(n, dtype=np.float32) / n for n in (height, width))
    radius2 = np.asarray(rows[:, None] ** 2 + columns[None, :] ** 2, np.float32)
    radius2[0, 0] = (np.pi / max(height, width)) ** 2
    return radius2


def _wiener_gain(power: Images, radius2: Images, noise: float) -> Images:
    """Share of signal in the power at each frequency, the signal's level A estimated along the way."""
    # Only the distance from zero matters: rings of frequencies do.
    ring = np.sqrt(radius2 * np.float32((_RINGS / np.pi) ** 2 / 2)).astype(np.int32).ravel()
    count = np.maximum(np.bincount(ring), 1e-9)
    signal = np.bincount(ring, (power - np.float32(noise)).ravel() * radius2.ravel())
    mean_radius2 = np.bincount(ring, radius2.ravel()) / count
    low = mean_radius2 < _LOW
    level = max(float(signal[low].sum() / count[low].sum()), _LEAST)
    for _ in range(_ROUNDS):
        gain = level / (level + noise * mean_radius2)
        level = max(float(np.sum(signal * gain**2) / np.sum(count * gain**2)), _LEAST)
    # Towards white noise (no signal) every frequency should count alike, hence the gain and not the filter itself.
    return np.asarray(level / (level + noise * radius2), np.float32)
