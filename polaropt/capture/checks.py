"""What the photographs themselves tell about mistakes: gamma encoding, swapped files, movement.

``I0 + I90 = I45 + I135`` (its generalization for other angles) holds for any light at all, however it is polarized.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from polaropt.capture.capture import Capture
from polaropt.capture.files.encoding import GAMMA_RANGE
from polaropt.capture.pair_gain import Floats, orthogonal_pairs, redundancy_residual, trusted_blocks
from polaropt.capture.registration import (
    FEWEST_PIXELS,
    SHIFTS_AND_TURNS,
    Images,
    Mask,
    far_from_invalid,
    fit_small_motions,
    largest_distance,
    measure_shifts,
    products,
)
from polaropt.numerics import MAD_TO_SIGMA, AnyMask, block_mean, middle_part

# All of these by trial.
_FEWEST_BLOCKS, _ENOUGH_BLOCKS = 50, 3000
"""Blocks of 8x8 pixels: fewer tell nothing, more only cost time."""
_CERTAIN = 0.15
"""Standard error of an exponent that means something, relative to it."""
_SURE_GAMMA, _LIKELY_GAMMA = 8.0, 6.0
"""Standard errors from 1 at which an exponent accuses: blocks are no independent samples, three are far too few. Of 300
linear captures of training photographs (25 to 78 degrees, noise 0.5 and 2 %, exposures off by 1 %, angles by 1 and 2
degrees) none lies beyond 6, of 60 encoded ones 51 beyond 8."""
_EXPOSURES = (0.02, 0.02)
"""Differences in exposure between the photographs of a pair that may be expected, as logarithms."""
_LINEAR = (0.75, 1.3)
"""Exponents of linear photographs: encodings in use begin at 1.8."""
_BRIGHT = 0.4
"""Blocks that count for an exponent: at least so bright, relative to the median."""
_PAIR_ROUNDS, _AT_REST = 8, (1e-3, 0.2)
"""Most rounds of a fit of the exponent, and the change that ends it: itself, or in standard errors."""
_OUTLIERS = 3.0
"""Robust deviations from which on a block does not count."""
_MUCH_BETTER, _AS_GOOD = 0.5, 1.1
"""Misfit with two photographs exchanged, relative to the one as given, that accuses; relative to the best: as good."""
_NO_WORSE = 0.85
"""Misfit with one photograph's gain taken out, relative to the best exchange's, below which that is what is wrong: of
photographs that scikit-image ships it is 0.95 and more where two are exchanged, up to 0.74 where one is 0.5 to 1.25
times as bright and an exchange would be accused."""
_ABOVE_NOISE = 0.003
"""Misfit relative to the intensity that may be noise."""


@dataclass(frozen=True)
class GammaFit:
    """Exponent that makes the photographs linear: 1 for linear data, about 2.2 for sRGB.

    Attributes
    ----------
    exponent : float
    standard_error : float
        Large where the light is hardly polarized.
    """

    exponent: float
    standard_error: float

    @property
    def certain(self) -> bool:
        """Whether the exponent means anything."""
        return self.standard_error < _CERTAIN * self.exponent

    @property
    def encoded(self) -> bool:
        """Whether the photographs are surely not linear."""
        return self._differs(_SURE_GAMMA)

    @property
    def linear(self) -> bool:
        """Whether the photographs are surely linear, as far as an exponent tells."""
        return self.certain and _LINEAR[0] <= self.exponent <= _LINEAR[1]

    @property
    def likely_encoded(self) -> bool:
        """Whether they are not linear, if something else tells that the pairs do not add up."""
        return self._differs(_LIKELY_GAMMA)

    def _differs(self, deviations: float) -> bool:
        beyond = abs(np.log(self.exponent)) * self.exponent > deviations * self.standard_error
        return bool(self.certain and beyond and not _LINEAR[0] <= self.exponent <= _LINEAR[1])


def checked_blocks(capture: Capture) -> Floats:
    """Means (k, n) of 8x8 blocks that are valid throughout, evenly chosen where there are many."""
    return blocks_of(capture.intensities, capture.mask)


def blocks_of(intensities: Images, valid: AnyMask) -> Floats:
    """The same of photographs (k, [channel,] h, w)."""
    blocks = trusted_blocks(intensities, valid)
    return blocks[:, :: max(1, blocks.shape[1] // _ENOUGH_BLOCKS)]


def fit_gamma(capture: Capture, blocks: Floats | None = None) -> GammaFit | None:
    """How the photographs are encoded, from sums of orthogonal pairs.

    If values are ``v = I^(1/gamma)``, the sum of an orthogonal pair depends on how strongly the light is polarized
    along it: ``log((v45 + v135) / (v0 + v90))`` has the slope ``(gamma - 1)/2`` against ``d0^2 - d45^2``, where d0 and
    d45 are the contrasts of the two pairs. That is the first order in their squares; it is repeated on the linearized
    values. A gain of one pair or of one photograph does not matter.

    Parameters
    ----------
    capture : Capture
    blocks : ndarray, shape (k, n), optional
        `checked_blocks` of the capture, if they are at hand.

    Returns
    -------
    GammaFit or None
        None where the angles are no two orthogonal pairs, or too few 8x8 blocks are unclipped.
    """
    pairs = orthogonal_pairs(capture.angles_deg)
    if pairs is None:
        return None
    blocks = checked_blocks(capture).astype(np.float64) if blocks is None else blocks.astype(np.float64)
    if blocks.shape[1] < _FEWEST_BLOCKS:
        return None
    exponent, error = 1.0, 0.0
    for _ in range(_PAIR_ROUNDS):
        slope, error = _pair_slope(blocks**exponent, pairs)
        factor = float(np.clip(1 + 2 * slope, 0.5, 2))
        exponent = float(np.clip(exponent * factor, *GAMMA_RANGE))
        # Much below the error further rounds tell nothing.
        if abs(factor - 1) < max(_AT_REST[0], _AT_REST[1] * error):
            break
    return GammaFit(exponent, 2 * error * exponent)


def _pair_slope(blocks: Floats, pairs: tuple[tuple[int, int], tuple[int, int]]) -> tuple[float, float]:
    """Slope of the logarithmic ratio of the pair sums against d0^2 - d45^2, and its standard error."""
    sums = [blocks[a] + blocks[b] for a, b in pairs]
    # Dark blocks: noise makes both contrasts and ratio large together, which looks like an exponent.
    bright = sums[0] + sums[1] > _BRIGHT * np.median(sums[0] + sums[1])
    sums, blocks = [total[bright] for total in sums], blocks[:, bright]
    first, second = ((blocks[a] - blocks[b]) / total for (a, b), total in zip(pairs, sums, strict=True))
    # An exposure of its own in each photograph makes the ratio follow the contrasts themselves.
    columns = np.stack([first**2 - second**2, first, second, np.ones_like(first)], axis=1)
    # The same noise is in the sums and in the contrasts: where both pairs are about as strongly polarized, that alone
    # makes the ratio follow.
    shared = np.stack([first**2 + second**2, first / 2, -second / 2, np.zeros_like(first)], axis=1)
    ratios = np.log(sums[1] / sums[0])
    weights, error = _robust_regression(columns, ratios, (np.inf, *_EXPOSURES, np.inf), shared)
    return float(weights[0]), error


def _robust_regression(
    columns: Floats, values: Floats, expected: tuple[float, ...], shared: Floats
) -> tuple[Floats, float]:
    """Least squares without outliers beyond 3 robust deviations, and the first coefficient's standard error.

    Parameters
    ----------
    columns : ndarray, shape (n, k)
    values : ndarray, shape (n,)
    expected : tuple of k floats
        How large each coefficient may be expected to be (a Gaussian prior).
    shared : ndarray, shape (n, k)
        Covariance of the noise of values and columns, in units of the variance of the values' noise.
    """
    kept = np.ones(values.shape, dtype=bool)
    weights: Floats = np.zeros(columns.shape[1])
    error = np.inf
    variance = float(np.var(values))
    squares = np.zeros_like(values)
    for _ in range(5):
        used = columns[kept]
        normal = used.T @ used / max(variance, 1e-12) + np.diag([size**-2 for size in expected])
        if np.linalg.cond(normal) > 1e12:
            return weights, np.inf
        of_noise = shared[kept].T @ squares[kept]
        weights = np.linalg.solve(normal, (used.T @ values[kept] - of_noise) / max(variance, 1e-12))
        error = float(np.sqrt(np.linalg.inv(normal)[0, 0]))
        residual = values - columns @ weights
        squares = residual**2
        variance = float(np.mean(squares[kept]))
        kept = np.abs(residual) <= _OUTLIERS * max(MAD_TO_SIGMA * float(np.median(np.abs(residual))), 1e-9)
    return weights, error


def swapped_photographs(capture: Capture, blocks: Floats | None = None) -> tuple[tuple[int, int], ...]:
    """Pairs of photographs of which one looks swapped, by their indices; empty if the order looks right.

    A wrong order breaks ``I0 + I90 = I45 + I135`` (its generalization for other angles). Each exchange of two
    photographs is tried; those are named with which the identity holds at least twice as well. Where several serve
    equally all are named: exchanging 45 and 90 or 0 and 135, of four, forms the same pairs. Three angles tell nothing.

    `blocks` are the capture's `checked_blocks`, if they are at hand.
    """
    return swapped_blocks(checked_blocks(capture) if blocks is None else blocks, capture.angles_deg)


def swapped_blocks(
    blocks: Floats, angles_deg: Sequence[float], *, beyond_doubt: bool = False
) -> tuple[tuple[int, int], ...]:
    """The same of means (k, n) of blocks.

    `beyond_doubt`: only where no other exchange makes the identity hold nearly as well. Light polarized between two of
    four angles lets it hold in two of the three ways to form pairs.
    """
    count = len(angles_deg)
    if count < 4 or blocks.shape[1] < _FEWEST_BLOCKS:
        return ()
    given = _misfit(blocks, angles_deg)
    exchanges = list(combinations(range(count), 2))
    misfits = np.array([_misfit(_exchanged(blocks, a, b), angles_deg) for a, b in exchanges])
    best = float(misfits.min())
    if given < _ABOVE_NOISE or best > _MUCH_BETTER * given:
        return ()
    # One photograph that was exposed unlike the others breaks the identity, too, and its gain mends it.
    if _misfit_of_gain(blocks, angles_deg) < _NO_WORSE * best:
        return ()
    # Of four, the exchange of the other two forms the same pairs, those of one of both with another form others.
    found = set(exchanges[int(misfits.argmin())])
    rivals = [misfit for pair, misfit in zip(exchanges, misfits, strict=True) if len(found & set(pair)) == 1]
    if beyond_doubt and best > _MUCH_BETTER * min(rivals):
        return ()
    return tuple(exchanges[k] for k in np.flatnonzero(misfits <= _AS_GOOD * best + 1e-6))


def _exchanged(blocks: Floats, first: int, second: int) -> Floats:
    order = np.arange(blocks.shape[0])
    order[[first, second]] = second, first
    return blocks[order]


def _misfit_of_gain(blocks: Floats, angles_deg: Sequence[float]) -> float:
    """The least misfit with a gain of one photograph taken out."""
    total = _relative_residual(blocks, angles_deg, blocks)
    misfits = []
    for k, photograph in enumerate(blocks):
        alone = np.zeros_like(blocks)
        alone[k] = photograph
        part = _relative_residual(alone, angles_deg, blocks)
        gain = float(np.vdot(part, total)) / max(float(np.vdot(part, part)), float(np.finfo(np.float32).tiny))
        misfits.append(_misfit(blocks - gain * alone, angles_deg))
    return min(misfits)


def _relative_residual(blocks: Floats, angles_deg: Sequence[float], light: Floats) -> Floats:
    """What no Stokes vector explains, relative to the mean of some light, a constant gain apart."""
    residual: Floats = redundancy_residual(blocks, angles_deg) / light.mean(axis=0)
    return residual - np.median(residual, axis=-1, keepdims=True)


def _misfit(blocks: Floats, angles_deg: Sequence[float]) -> float:
    """Size of what no Stokes vector explains, relative to the intensity, a constant gain apart."""
    return float(np.mean(np.abs(_relative_residual(blocks, angles_deg, blocks))))


# All of these by trial.
_LOOKED_AT_PX = 256
"""Side of the middle of a frame that is looked at, after halving where there is enough of it."""
_VISIBLE_PX, _BLIND_PX = 0.5, 0.3
"""Shifts that are worth a warning; those that mislead the search for the pane."""
_SURE_SHIFT = 5.0
"""Standard errors by which a shift must be larger than that."""
_WIDE_PX = 3
"""Distance of the pixels whose mean is taken off: coarser is light and shade."""
_AT_REST_PX = 0.01
"""A look needs no more than this."""
_CLEARLY_HIGHER, _ABOVE_CHANCE = 1.3, 7.0
"""Peak of a correlation: times its value without shift, and times its standard deviation."""


def visible_shift(capture: Capture, least_px: float = _VISIBLE_PX) -> float:
    """Largest distance between two photographs in pixels, 0 where it is not surely more than `least_px`.

    A look at one colour in the middle of the frame: good to a tenth of a pixel up to about one pixel, beyond that only
    a hint of the size. `polaropt.capture.registration.measure_shifts` measures. The cells of a mosaic do not move
    against each other: 0.
    """
    if capture.of_mosaic:
        return 0.0
    block = 2 if min(capture.shape[-2:]) >= 1.5 * _LOOKED_AT_PX else 1
    rows, columns = middle_part(capture.shape, block * _LOOKED_AT_PX)
    images, valid = capture.intensities[..., rows, columns], capture.mask[..., rows, columns]
    if capture.color:
        channel = capture.shape[0] // 2
        images, valid = images[:, channel], valid[:, channel]
    trusted: Mask = np.asarray(valid.all(axis=0))
    if block > 1:
        trusted = block_mean(trusted.astype(np.float32), 2) == 1
        images = block_mean(images, 2)
    return max(_far(images), block * _near(images, trusted, least_px / block)) if min(images.shape[-2:]) >= 16 else 0.0


def _near(images: Images, trusted: Mask, least_px: float) -> float:
    """Distances of about a pixel, from the gradients."""
    bands = _band(images)
    inside = None
    if not trusted.all():
        edge = _WIDE_PX + 1
        inside = far_from_invalid(trusted)[edge:-edge, edge:-edge]
        if np.count_nonzero(inside) < FEWEST_PIXELS:
            return 0.0
    motions = fit_small_motions(
        products(bands, inside, SHIFTS_AND_TURNS), at_rest=_AT_REST_PX, n_motions=SHIFTS_AND_TURNS
    )
    largest = max(largest_distance(motions.pixels[:, :2]), largest_distance(motions.pixels[:, 2:]))
    return largest if largest > least_px + _SURE_SHIFT * motions.error else 0.0


def _far(images: Images) -> float:
    """Distances of several pixels, from the correlation with the first photograph."""
    from scipy.fft import irfft2, rfft2

    bands = _band(block_mean(images, 2))
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


def _band(images: Images) -> Images:
    """What is finer than about 3 px and coarser than single pixels."""
    across = images[..., :-2] + 2 * images[..., 1:-1] + images[..., 2:]
    smooth = across[..., :-2, :] + 2 * across[..., 1:-1, :] + across[..., 2:, :]
    middle = slice(_WIDE_PX, -_WIDE_PX)
    around = smooth[..., : -2 * _WIDE_PX, middle] + smooth[..., 2 * _WIDE_PX :, middle]
    around += smooth[..., middle, : -2 * _WIDE_PX] + smooth[..., middle, 2 * _WIDE_PX :]
    band: Images = smooth[..., middle, middle] - np.float32(0.25) * around
    return band


_ENOUGH_SAMPLES = 2**15
"""Values of a photograph that the spread is measured on."""
_HARDLY_BROKEN, _BROKEN = 1.02, 1.15
"""Spread of the residual over its robust spread: 1 for noise, more where edges or bright places break the identity; by
trial."""


@dataclass(frozen=True)
class Mistakes:
    """What is surely wrong with photographs.

    Attributes
    ----------
    swapped : bool
        Whether they look as if they were given in a wrong order.
    shift_px : float
        How far they are shifted against each other, about; 0 where that is not surely more than 0.3 px.
    gamma : float
        Exponent that makes them linear; 1 where they do not look encoded beyond doubt.
    """

    swapped: bool = False
    shift_px: float = 0.0
    gamma: float = 1.0

    @property
    def moved(self) -> bool:
        """Whether they are shifted by more than half a pixel."""
        return self.shift_px > _VISIBLE_PX

    @property
    def encoded(self) -> bool:
        """Whether they look encoded."""
        return self.gamma != 1.0


def find_mistakes(capture: Capture) -> Mistakes:
    """Look for a wrong order, movement and encoding; what explains the others goes first."""
    blocks = checked_blocks(capture)
    swapped = bool(swapped_photographs(capture, blocks))
    ratio = identity_ratio(capture)
    # Unlike the order, movement can be seen beside a wrong order.
    shift = visible_shift(capture, _BLIND_PX)
    if not shift and ratio > _BROKEN and not swapped:
        shift = _measured_shift(capture)
    if swapped or shift:
        return Mistakes(swapped, shift)
    return Mistakes(gamma=_gamma(capture, blocks, ratio))


def identity_ratio(capture: Capture) -> float:
    """Spread of what no Stokes vector explains over its robust spread; 1 for three angles, where nothing is left."""
    if len(capture.angles_deg) < 4:
        return 1.0
    step = max(1, capture.intensities[0].size // _ENOUGH_SAMPLES)
    valid = np.asarray(capture.mask.all(axis=0)).reshape(-1)[::step]
    samples = capture.intensities.reshape(len(capture.angles_deg), -1)[:, ::step][:, valid]
    if samples.shape[1] < 2:
        return 1.0
    residual = redundancy_residual(samples, capture.angles_deg)
    residual = residual - np.median(residual, axis=-1, keepdims=True)
    robust = MAD_TO_SIGMA * float(np.median(np.abs(residual)))
    return float(np.sqrt(np.mean(np.square(residual, dtype=np.float64)))) / robust if robust > 0 else 1.0


def _measured_shift(capture: Capture) -> float:
    """The same by the slower but sharper look."""
    if capture.of_mosaic:
        return 0.0
    shifts = measure_shifts(capture)
    return shifts.largest if shifts.certain and shifts.largest > _BLIND_PX else 0.0


def _gamma(capture: Capture, blocks: Floats, ratio: float) -> float:
    fit: GammaFit | None = fit_gamma(capture, blocks)
    # However strongly light is polarized, it keeps the identity.
    if fit is None or not np.isfinite(fit.exponent) or ratio < _HARDLY_BROKEN:
        return 1.0
    return fit.exponent if fit.encoded or (ratio > _BROKEN and fit.likely_encoded) else 1.0
