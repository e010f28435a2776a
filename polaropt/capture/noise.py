"""How noisy the photographs are and how that grows with the light, from what more than three angles say twice."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from polaropt.capture.capture import Capture, RawSamples, RegisteredCells
from polaropt.capture.noise_spectrum import correlated_noise, lost_by_jpeg
from polaropt.capture.pair_gain import (
    BLOCK,
    gain_remover,
    orthogonal_pairs,
    redundancy_residual,
    trusted_blocks,
)
from polaropt.numerics import (
    ROUNDED,
    block_mean,
    kept_while_alive,
    quantization_step,
    quietest_combination,
    robust_spread,
    second_differences,
)

LEAST_NOISE = 1e-6
"""Noise of photographs without any (white = 1): weights go with its inverse square."""
_ENOUGH_SAMPLES, _FEWEST_SAMPLES = 1000, 100
"""Pixels that the noise is measured on: away from clipped ones if there are so many, else any that are not clipped."""
_PILE = 5e-4
"""Share of the values at the lowest one from which on they are clipped there; by trial."""
_BEYOND_ROUNDING = 1.0
"""Noise in steps of the grey levels, from which on neighbours are hardly equal in all photographs by chance: in four of
them with a step of noise one pixel in 160 is."""
_MOST_VALUES, _BAND = 2**18, 16
"""Values of a photograph that are enough, and rows of a band that is taken from a larger one; set by hand."""


_FLAT_BLOCK = 4
"""Side in pixels of a mosaic's blocks that are told flat from others: a colour pattern's."""
_MOST_SAMPLES, _SAMPLE_BAND = 2**20, 64
"""Samples that are enough to tell how noise grows, and rows of a band that is taken from a larger mosaic; by hand."""
_FOLDS = 3
"""How often means over a pattern follow each other: with two noise of 0.2 % comes out 5 % higher; by trial."""
_SHADES, _FLAT_SHARE = 8, 0.5
"""Classes of brightness, and the share of each that counts, the flattest: of all, sharp detail adds 10 %; by trial."""


@dataclass(frozen=True)
class Redundancy:
    """What more than three photographs say twice, of pixels that can be trusted.

    Attributes
    ----------
    residual : ndarray, shape (k - 3, n)
        As of `redundancy_residual`, after a pair gain is divided out.
    intensity : ndarray, shape (n,)
        Mean of the photographs.
    """

    residual: NDArray[np.float32]
    intensity: NDArray[np.float32]


def noise_level(capture: Capture, redundant: Redundancy | None = None) -> float:
    """Standard deviation of the noise of one photograph (white = 1), quantization included.

    From the redundancy ``I0 + I90 - I45 - I135`` (its generalization for other sets of angles), robustly, after a
    pair gain is divided out. With three angles nothing is said twice: there it comes from the finest detail of
    the combination of the photographs in which the scene cancels best, an upper bound.

    Clipped pixels and their neighbours do not count. A mosaic's is that of its samples. What JPEG has rounded away is
    the same in all photographs, so that they do not tell it: there it is that of the file's tables at least.

    Parameters
    ----------
    capture : Capture
    redundant : Redundancy, optional
        That of the capture, where it is at hand.
    """
    if capture.origin is not None and capture.origin.raw_noise is not None:
        return capture.origin.raw_noise
    step = quantization_step(capture.intensities)
    if len(capture.angles_deg) == 3:
        spread = _noise_of_three_photographs(capture, step)
    else:
        spread = robust_spread((redundant or redundancy(capture)).residual, step / 2)
    return float(max(LEAST_NOISE, spread, step / np.sqrt(12), lost_by_jpeg(capture)))


_ALIASES = 2.0
"""Noise of a mosaic's cells as an estimation is told it, in units of what they have: what aliases comes on top. By
trial on 132 simulated mosaics, where 1 finds another pane nine times and 2 five times."""


def registered_noise(capture: Capture, noise: float | None = None) -> float:
    """Noise of one of the photographs that a scene is estimated from, `Capture.registered`.

    Parameters
    ----------
    capture : Capture
    noise : float, optional
        `noise_level` of the capture, where it is at hand.
    """
    if capture.cells is None:
        return noise_level(capture) if noise is None else noise
    return _noise_of_cells(capture.registered)


@kept_while_alive
def _noise_of_cells(registered: Capture) -> float:
    """The same of a mosaic's cells: all that looks at them asks for it."""
    return _ALIASES * noise_level(registered)


def noise_of_color_samples(samples: RawSamples) -> float | None:
    """Standard deviation of the noise of a colour mosaic's samples; None where too few can be trusted.

    What alternates from pixel to pixel along rows and columns alike no light gives: the sums of both pairs of a cell
    are equal in each colour, and colours alternate half as fast. It is measured on the raw samples, as narrowly as
    that asks for: sums over a pattern, three times over, leave nothing of what alternates otherwise. The cells of one
    colour, `registered_cells`, know no difference between that and detail of the scene that is half as fine.

    Parameters
    ----------
    samples : RawSamples
        Gains divided out.
    """
    fast = _fast_of_flat_blocks(samples)
    return None if fast is None else robust_spread(fast.residual, 0.0)


def _fast_of_flat_blocks(samples: RawSamples) -> Redundancy | None:
    """What alternates from pixel to pixel in a mosaic's flat blocks (pixel, block), with the mean of each (block,).

    See `noise_of_color_samples`; of mono patterns sums over two pixels do. None where too few samples can be trusted.
    """
    from scipy.ndimage import correlate1d, minimum_filter

    kernel = np.ones(1)
    for _ in range(_FOLDS):
        kernel = np.convolve(kernel, np.ones(samples.sampling.period))
    kernel *= (-1.0) ** np.arange(kernel.size) / np.sqrt(np.square(kernel).sum())
    values = samples.values
    fast = correlate1d(correlate1d(values, kernel, axis=0, mode="nearest"), kernel, axis=1, mode="nearest")
    means = block_mean(values, _FLAT_BLOCK)
    trusted = block_mean(_trusted(values[None], samples.valid[None]).astype(np.float32), _FLAT_BLOCK) == 1
    # What a block's values read lies in it and in the blocks around it.
    inner = minimum_filter(trusted, 3, mode="constant", cval=0)
    if np.count_nonzero(inner) * _FLAT_BLOCK**2 < _ENOUGH_SAMPLES:
        return None
    residual, raw = _in_blocks(fast, means.shape), _in_blocks(values, means.shape)
    step = quantization_step(values[None])
    alike = (raw == raw[..., :1, :1]).all(axis=(-2, -1))
    inner = _not_filled(inner, alike, step, lambda some: residual[some])
    flat = _flattest(means, inner)
    return Redundancy(residual[flat].reshape(-1, _FLAT_BLOCK**2).T, means[flat])


def _in_blocks(image: NDArray[np.float32], shape: tuple[int, ...]) -> NDArray[np.float32]:
    """An image by its blocks, (row, column, row in the block, column in the block)."""
    rows, columns = (_FLAT_BLOCK * side for side in shape)
    blocks = image[:rows, :columns].reshape(shape[0], _FLAT_BLOCK, shape[1], _FLAT_BLOCK)
    return blocks.transpose(0, 2, 1, 3)


def _fast_of_bands(samples: RawSamples) -> Redundancy | None:
    """The same of bands of rows all over a large mosaic."""
    size, height = samples.values.size, len(samples.values)
    if size <= _MOST_SAMPLES:
        return _fast_of_flat_blocks(samples)
    starts = _band_starts(size, height, _MOST_SAMPLES, _SAMPLE_BAND) // _FLAT_BLOCK * _FLAT_BLOCK
    bands = [samples.part(slice(start, start + _SAMPLE_BAND), slice(None)) for start in starts.tolist()]
    told = [part for part in map(_fast_of_flat_blocks, bands) if part is not None]
    if not told:
        return None
    return Redundancy(
        np.concatenate([part.residual for part in told], axis=1), np.concatenate([part.intensity for part in told])
    )


def _flattest(means: NDArray[np.float32], trusted: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Of trusted blocks, in each class of brightness, those that differ least from the four around them."""
    down, across = np.abs(np.diff(means, axis=0)), np.abs(np.diff(means, axis=1))
    slope = np.pad(down, ((1, 0), (0, 0))) + np.pad(down, ((0, 1), (0, 0)))
    slope += np.pad(across, ((0, 0), (1, 0))) + np.pad(across, ((0, 0), (0, 1)))
    where = np.flatnonzero(trusted)
    flat = np.zeros(means.size, dtype=bool)
    for shade in np.array_split(where[np.argsort(means.ravel()[where])], _SHADES):
        order = np.argsort(slope.ravel()[shade])
        flat[shade[order[: math.ceil(_FLAT_SHARE * shade.size)]]] = True
    return flat.reshape(means.shape)


def redundancy(capture: Capture) -> Redundancy:
    """Residuals of more than three photographs with their intensities; of a large capture, bands of rows."""
    rows = _sampled_rows(capture.intensities[0].size, capture.shape[-2])
    intensities, valid = capture.intensities[..., rows, :], capture.mask[..., rows, :]
    trusted, alike = _trusted(intensities, valid), _like_the_next(intensities)
    step = quantization_step(capture.intensities)
    intensities = _without_gain(intensities, capture.angles_deg, valid)
    residual = redundancy_residual(intensities, capture.angles_deg)
    trusted = _not_filled(trusted, alike, step, lambda some: residual[:, some])
    return Redundancy(residual[:, trusted], intensities[:, trusted].mean(axis=0))


def noise_of_blocks(capture: Capture, noise: float) -> float:
    """Noise of a pixel, were it white, that leaves means of blocks as uncertain as they are.

    Where neighbours' noise is alike, as of photographs that were demosaicked, or where grey levels are coarser than the
    noise and neighbours' rounding errors are alike, their mean hardly falls with their number. Elsewhere this is the
    noise itself.

    Parameters
    ----------
    capture : Capture
    noise : float
        `noise_level` of the capture.
    """
    spectrum = correlated_noise(capture, noise)
    return noise_of_rounded_blocks(capture, noise) if spectrum is None else noise * spectrum.slow


def noise_of_rounded_blocks(capture: Capture, noise: float) -> float:
    """The same where neighbours have no noise in common but what rounding leaves."""
    if len(capture.angles_deg) == 3 or noise >= ROUNDED * quantization_step(capture.intensities):
        return noise
    without_gain = gain_remover(capture.intensities, capture.angles_deg, capture.mask)
    blocks = trusted_blocks(capture.intensities, capture.mask, change=without_gain)
    residual = redundancy_residual(blocks, capture.angles_deg)
    return max(noise, BLOCK * float(residual.std())) if residual.size else noise


def _without_gain(
    intensities: NDArray[np.float32], angles_deg: Sequence[float], valid: NDArray[np.bool_]
) -> NDArray[np.floating[Any]]:
    """Photographs after a plausible pair gain is divided out."""
    change = gain_remover(intensities, angles_deg, valid)
    return intensities if change is None else change(intensities)


def _sampled_rows(size: int, height: int) -> slice | NDArray[np.intp]:
    """All rows of a photograph of `size` values, or bands of neighbouring rows all over a large one."""
    starts = _band_starts(size, height, _MOST_VALUES, _BAND)
    if len(starts) * _BAND >= height:
        return slice(None)
    rows: NDArray[np.intp] = (starts[:, None] + np.arange(_BAND)).ravel()
    return rows


def _band_starts(size: int, height: int, most: int, band: int) -> NDArray[np.intp]:
    """First rows of bands, so many rows each, that hold about as many of `size` values in all, spread over an image."""
    n = min(max(1, math.floor(height * most / size / band)), math.ceil(height / band))
    return np.linspace(0, max(0, height - band), n).astype(np.intp)


def _noise_of_three_photographs(capture: Capture, step: float) -> float:
    """Robust spread of second differences, in the combination of the photographs in which they are smallest.

    Light of two unpolarized layers has no s2 in the pane's frame: three photographs are then combinations of two
    pictures, and one combination holds noise alone.
    """
    detail = second_differences(capture.intensities)
    trusted = _trusted(capture.intensities, capture.valid)[..., 1:-1, 1:-1]
    trusted = trusted if trusted.any() else np.ones_like(trusted)
    alike = _like_the_next(capture.intensities)[..., 1:-1, 1:-1]
    trusted = _not_filled(trusted, alike, step, lambda some: quietest_combination(detail[:, some]))
    return robust_spread(quietest_combination(detail[:, trusted]), step / 6)


def _trusted(intensities: NDArray[np.float32], all_valid: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Pixels ([channel,] h, w) away from anything clipped, at white or at the lowest value."""
    valid: NDArray[np.bool_] = np.asarray(all_valid.all(axis=0))
    at_lowest = intensities == intensities.min()
    if np.count_nonzero(at_lowest) > _PILE * at_lowest.size:
        valid &= ~at_lowest.any(axis=0)
    # Beside clipped pixels those survive whose noise happens to be small: a biased sample.
    inner = _eroded(valid)
    for mask, enough in ((inner, _ENOUGH_SAMPLES), (valid, _FEWEST_SAMPLES)):
        if np.count_nonzero(mask) >= enough:
            return mask
    return np.ones_like(valid)


def _not_filled(
    trusted: NDArray[np.bool_],
    alike: NDArray[np.bool_],
    step: float,
    noise_of: Callable[[NDArray[np.bool_]], NDArray[np.floating[Any]]],
) -> NDArray[np.bool_]:
    """Pixels that can be trusted without those that a program has filled, which are exactly alike.

    Where noise is finer than the grey levels pixels are alike by chance, and all are kept.

    Parameters
    ----------
    trusted, alike : ndarray of bool
    step : float
        Distance of the grey levels; 0 for none.
    noise_of : callable
        Values of the noise of some pixels.
    """
    unlike = trusted & ~alike
    if not alike.any() or np.count_nonzero(unlike) < _FEWEST_SAMPLES:
        return trusted
    return unlike if robust_spread(noise_of(unlike), 0.0) > _BEYOND_ROUNDING * step else trusted


def _like_the_next(intensities: NDArray[np.float32]) -> NDArray[np.bool_]:
    """Pixels ([channel,] h, w) that hold exactly what the one beside them does, in all photographs."""
    alike = np.zeros(intensities.shape[1:], dtype=bool)
    alike[..., 1:] = (intensities[..., 1:] == intensities[..., :-1]).all(axis=0)
    return alike


def _eroded(mask: NDArray[np.bool_]) -> NDArray[np.bool_]:
    rows = mask.copy()
    rows[..., 1:, :] &= mask[..., :-1, :]
    rows[..., :-1, :] &= mask[..., 1:, :]
    both = rows.copy()
    both[..., :, 1:] &= rows[..., :, :-1]
    both[..., :, :-1] &= rows[..., :, 1:]
    return both


Floats = NDArray[np.float64]

_BINS, _FEWEST_IN_BIN, _FEWEST_BINS = 24, 200, 4
"""Bins of intensity, the pixels that one needs at least, and the bins that a line needs; set by hand."""
_REWEIGHTINGS = 4
"""Rounds of a weighted line whose weights follow from itself; set by hand."""
_ENOUGH_PIXELS = 2**16
"""Pixels that the growth of the noise is measured on; set by hand."""
_MAD_VARIANCE = 4 * 1.36
"""Variance of a squared robust spread in units of variance^2 / n: the median absolute deviation of normal values has
an efficiency of 37 %, that is 1 / (2 * 1.36)."""
_SIGNIFICANT, _LEAST_GROWTH = 6.0, 1.5
"""Growth that is believed: in its standard errors, and the brightest bin's variance over the darkest's; by trial."""
_LEAST_READ = 0.1
"""Noise without any light as a share of the typical: a line through black would trust black pixels without end. By
hand."""
_CLASSES = 16
"""Classes of equal noise: steps of a few percent; set by hand."""


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

    def scaled(self, factor: float) -> NoiseModel:
        """That of values whose noise is so many times as large."""
        return NoiseModel(factor * self.read, factor**2 * self.shot)

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
    if capture.cells is not None:
        return _of_samples(capture, capture.cells)
    redundant = redundancy(capture) if len(capture.angles_deg) > 3 else None
    level = noise_level(capture, redundant)
    return level, noise_model(capture, level, redundant)


def _of_samples(capture: Capture, cells: RegisteredCells) -> tuple[float, NoiseModel]:
    """The noise of a mosaic's samples: its level from its cells, whose noise is a known share of it.

    How it grows the flat blocks of the samples tell: detail of the scene, which aliases in the cells, grows with the
    light as well.
    """
    if capture.origin is None:
        raw = noise_level(cells.capture) / cells.noise_share
    else:
        raw = capture.origin.raw_noise or noise_level(cells.capture)
    pattern = np.array(cells.samples.sampling.photographs)
    # What alternates along rows and columns alike is no light only where each diagonal of a cell is a pair.
    diagonal = {int(pattern[0, 0]), int(pattern[1, 1])}
    pairs = [set(pair) for pair in orthogonal_pairs(capture.angles_deg) or ()]
    levels = None if capture.origin is None else capture.origin.grey_levels
    rounds = levels is not None and raw < ROUNDED / levels
    fast = None if rounds or diagonal not in pairs else _fast_of_bands(cells.samples)
    if fast is None:
        return raw, NoiseModel(raw)
    level = max(LEAST_NOISE, robust_spread(fast.residual, 0.0))
    # Sums over a pattern are of much the same samples all over it.
    model = _grown(fast, level, 0.0, alike=pattern.size)
    return raw, NoiseModel(model.read * raw / level, model.shot * (raw / level) ** 2)


def noise_model(capture: Capture, level: float, redundant: Redundancy | None = None) -> NoiseModel:
    """How the noise grows with the intensity, where that can be told.

    Parameters
    ----------
    capture : Capture
    level : float
        `noise_level` of the capture: the answer where no growth is significant.
    redundant : Redundancy, optional
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
    return _grown(_sample(redundant or redundancy(capture)), level, step / 2)


def _grown(redundant: Redundancy, level: float, step: float, alike: int = 1) -> NoiseModel:
    """How the noise grows, as of `noise_model`, where so many values of each pixel tell as much as one."""
    constant = NoiseModel(level)
    intensity, variance, count = _binned(redundant, step)
    if len(intensity) < _FEWEST_BINS:
        return constant
    dark, growth, error = _line(intensity, variance, count / alike)
    darkest, brightest = (max(dark + growth * float(intensity[i]), 1e-12) for i in (0, -1))
    if growth < _SIGNIFICANT * error or brightest < _LEAST_GROWTH * darkest:
        return constant
    return NoiseModel(max(math.sqrt(dark), _LEAST_READ * level), growth)


def noise_classes(capture: Capture, model: NoiseModel) -> NoiseClasses | None:
    """Classes by the intensity around each pixel, mean over the photographs; None where the noise is constant.

    The mean of a few neighbours hardly depends on the pixel's own noise: weights that do would favour dark noise.
    """
    from scipy.ndimage import uniform_filter

    if model.shot == 0:
        return None
    photographs = capture.planes
    intensity = uniform_filter(photographs.mean(axis=0), (0, 3, 3), mode="nearest")
    sigma = np.sqrt(model.variance(intensity))
    least, most = float(sigma.min()), float(sigma.max())
    steps = np.geomspace(least, max(most, least * (1 + 1e-6)), _CLASSES + 1)
    classes = np.clip(np.searchsorted(steps, sigma.ravel()) - 1, 0, _CLASSES - 1).astype(np.uint8)
    return NoiseClasses(np.sqrt(steps[1:] * steps[:-1]), classes.reshape(sigma.shape))


def _sample(redundant: Redundancy) -> Redundancy:
    stride = max(1, redundant.intensity.size // _ENOUGH_PIXELS)
    return Redundancy(redundant.residual[:, ::stride], redundant.intensity[::stride])


def _binned(redundant: Redundancy, step: float) -> tuple[Floats, Floats, Floats]:
    """Mean intensity, robust variance and number of values of bins of as many pixels each."""
    order = np.argsort(redundant.intensity)
    parts = np.array_split(order, max(1, min(_BINS, len(order) // _FEWEST_IN_BIN)))
    intensity = [redundant.intensity[part].mean(dtype=np.float64) for part in parts]
    variance = [robust_spread(redundant.residual[:, part], step) ** 2 for part in parts]
    return np.array(intensity), np.array(variance), np.array([redundant.residual[:, part].size for part in parts])


def _line(intensity: Floats, variance: Floats, count: Floats) -> tuple[float, float, float]:
    """Weighted line through variances, not negative at black: its value there, its slope and the slope's error."""
    from scipy.optimize import nnls

    fitted = np.full_like(variance, max(float(variance.mean()), 1e-12))
    for _ in range(_REWEIGHTINGS):
        root = np.sqrt(count / _MAD_VARIANCE) / fitted
        design = np.stack([root, root * intensity], axis=1)
        (dark, growth), _ = nnls(design, root * variance)
        fitted = np.maximum(dark + growth * intensity, 1e-3 * fitted.max())
    covariance = np.linalg.pinv(design.T @ design)
    return float(dark), float(growth), math.sqrt(covariance[1, 1])
