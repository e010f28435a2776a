"""Noise that grows with the light: variance ``read^2 + shot * intensity``, from what the photographs say twice."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from polaropt.capture import Capture
from polaropt.noise import ROUNDED, Redundancy, noise_level, quantization_step, redundancy, robust_spread

Floats = NDArray[np.float64]

_BINS, _FEWEST, _FEWEST_BINS = 24, 200, 4
_TURNS = 4
_ENOUGH = 2**16
# Of the variance of a robust spread, in units of variance^2 / n (median absolute deviation of normal values).
_MAD_VARIANCE = 4 * 1.36
# Growth that is believed: in its standard errors, and as variance of the brightest tenth against the darkest.
_SIGNIFICANT = 6.0
_LEAST_GROWTH = 1.5
_CLASSES = 16


@dataclass(frozen=True)
class NoiseModel:
    """Variance of a photograph's noise as a function of its intensity (white = 1).

    Attributes
    ----------
    read : float
        Standard deviation without any light.
    shot : float
        Variance per unit of intensity; 0 where the noise is the same everywhere.
    """

    read: float
    shot: float = 0.0

    def variance(self, intensity: NDArray[np.float32]) -> NDArray[np.float32]:
        """Variance at each intensity; below black as at black."""
        light = np.maximum(intensity, np.float32(0))
        return np.asarray(np.float32(self.read**2) + np.float32(self.shot) * light)


@dataclass(frozen=True)
class NoiseClasses:
    """Pixels sorted into a few classes of equal noise.

    Attributes
    ----------
    sigmas : ndarray, shape (n,)
        Standard deviation of each class.
    classes : ndarray of uint8, shape (channel, h, w)
        The class of every pixel.
    """

    sigmas: NDArray[np.float64]
    classes: NDArray[np.uint8]

    @property
    def typical(self) -> float:
        """Standard deviation that tells as much as all pixels do on average (mean precision)."""
        counts = np.bincount(self.classes.ravel(), minlength=len(self.sigmas))
        return math.sqrt(counts.sum() / (counts @ self.sigmas**-2))

    def images(self) -> NDArray[np.float32]:
        """Standard deviation of every pixel, (channel, h, w)."""
        return self.sigmas.astype(np.float32)[self.classes]


def measured_noise(capture: Capture) -> tuple[float, NoiseModel]:
    """`noise_level` and `noise_model` of a capture."""
    seen = redundancy(capture) if len(capture.angles_deg) > 3 else None
    level = noise_level(capture, seen)
    return level, noise_model(capture, level, seen)


def noise_model(capture: Capture, level: float, seen: Redundancy | None = None) -> NoiseModel:
    """How the noise grows with the intensity, where that can be told.

    Parameters
    ----------
    capture : Capture
    level : float
        `noise_level` of the capture: the answer where no growth is significant.
    seen : Redundancy, optional
        That of the capture, where it is at hand.

    Notes
    -----
    The redundancy of four angles has the mean variance of its photographs, which is linear in their mean intensity:
    its robust spread in bins of intensity is fitted by a line. Three angles say nothing twice: one level is assumed.
    """
    constant = NoiseModel(level)
    if len(capture.angles_deg) == 3:
        return constant
    step = quantization_step(capture.intensities)
    if level < ROUNDED * step:
        return constant
    seen = _sample(seen or redundancy(capture))
    intensity, variance, count = _binned(seen, step / 2)
    if len(intensity) < _FEWEST_BINS:
        return constant
    dark, growth, error = _line(intensity, variance, count)
    darkest, brightest = (max(dark + growth * float(intensity[i]), 1e-12) for i in (0, -1))
    if growth < _SIGNIFICANT * error or brightest < _LEAST_GROWTH * darkest:
        return constant
    # Interpolated pixels are less noisy than raw ones, whose level is what counts.
    interpolated = capture.origin is not None and capture.origin.raw_noise is not None
    scale = level**2 / (dark + growth * float(np.median(seen.intensity))) if interpolated else 1.0
    return NoiseModel(math.sqrt(dark * scale), growth * scale)


def noise_classes(capture: Capture, model: NoiseModel) -> NoiseClasses | None:
    """Classes by the intensity around each pixel, mean over the photographs; None where the noise is constant.

    The mean of a few neighbours hardly depends on the pixel's own noise: weights that do would favour dark noise.
    """
    from scipy.ndimage import uniform_filter

    if model.shot == 0:
        return None
    photographs = capture.intensities.reshape(len(capture.angles_deg), -1, *capture.shape[-2:])
    intensity = uniform_filter(photographs.mean(axis=0), (0, 3, 3), mode="nearest")
    sigma = np.sqrt(model.variance(intensity))
    least, most = float(sigma.min()), float(sigma.max())
    steps = np.geomspace(least, max(most, least * (1 + 1e-6)), _CLASSES + 1)
    classes = np.clip(np.searchsorted(steps, sigma.ravel()) - 1, 0, _CLASSES - 1).astype(np.uint8)
    return NoiseClasses(np.sqrt(steps[1:] * steps[:-1]), classes.reshape(sigma.shape))


def _sample(seen: Redundancy) -> Redundancy:
    stride = max(1, seen.intensity.size // _ENOUGH)
    return Redundancy(seen.residual[:, ::stride], seen.intensity[::stride])


def _binned(seen: Redundancy, step: float) -> tuple[Floats, Floats, Floats]:
    """Mean intensity, robust variance and number of values of bins of as many pixels each."""
    order = np.argsort(seen.intensity)
    parts = np.array_split(order, max(1, min(_BINS, len(order) // _FEWEST)))
    intensity = [seen.intensity[part].mean(dtype=np.float64) for part in parts]
    variance = [robust_spread(seen.residual[:, part], step) ** 2 for part in parts]
    return np.array(intensity), np.array(variance), np.array([seen.residual[:, part].size for part in parts])


def _line(intensity: Floats, variance: Floats, count: Floats) -> tuple[float, float, float]:
    """Weighted line through variances, not negative at black: its value there, its slope and the slope's error."""
    from scipy.optimize import nnls

    fitted = np.full_like(variance, max(float(variance.mean()), 1e-12))
    for _ in range(_TURNS):
        root = np.sqrt(count / _MAD_VARIANCE) / fitted
        design = np.stack([root, root * intensity], axis=1)
        (dark, growth), _ = nnls(design, root * variance)
        fitted = np.maximum(dark + growth * intensity, 1e-3 * fitted.max())
    covariance = np.linalg.pinv(design.T @ design)
    return float(dark), float(growth), math.sqrt(covariance[1, 1])
