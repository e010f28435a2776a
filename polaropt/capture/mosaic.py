"""Raw mosaics of polarization cameras: cells of polarizers, on colour sensors under a Bayer pattern of cells.

A colour sensor (IMX250MYR) has 4x4 blocks: each 2x2 polarizer cell has one colour, and the cells follow each other as
R G / G B. Sony's cell has the polarizers 90, 45 / 135, 0.

A mosaic's samples lie beside each other. Taken as one point they fake polarization at every edge. There are two ways
to bring them together, and either has its use:

- `registered_cells`: all samples through one and the same low pass, a pixel per pattern. Nothing is shrunk, so layers'
  edges keep their ratios: what a pane is estimated from.
- `wiener_photographs`: the likeliest photographs in full size if their Stokes images are natural images. What the
  samples do not tell is taken from what usually goes with it, so polarization of fine detail is that of the rest:
  right on average, and a bias of whatever is estimated from ratios of edges.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from polaropt.errors import InputError
from polaropt.numerics import (
    NATURAL_POWER_LAW,
    AliasGroups,
    Members,
    block_mean,
    explained_groups,
    natural_frequencies,
    opponent_basis,
    tukey_window,
    wiener_spectra,
)
from polaropt.optics import Sampling, analyzer_matrix

Raw = NDArray[Any]
Images = NDArray[np.float32]
Mask = NDArray[np.bool_]
Floats = NDArray[np.float64]

SONY_CELL = (90.0, 45.0, 135.0, 0.0)
"""Polarizer angles of a cell of Sony's IMX250MZR and MYR: top left, top right, bottom left, bottom right."""
WHITE_16 = 2**16 - 1
"""White in 16 bits."""
_BAYER = ((0, 1), (1, 2))
"""Colours of the cells of a block: red, green, green, blue."""
_COLOR_CONTRAST = 0.045
"""Between what mono and colour mosaics were measured to have, see `looks_color`."""
_TEST_BLOCK = (4, 8)
"""Cells that contrast is averaged over, every other row of cells."""


def check_cell_order(cell_order: Sequence[float]) -> tuple[float, ...]:
    """The four polarizer angles of a cell (top left, top right, bottom left, bottom right), in degrees."""
    try:
        cell = tuple(float(angle) for angle in cell_order)
    except (TypeError, ValueError):
        cell = ()
    wrapped = {round(angle % 180, 3) % 180 for angle in cell if np.isfinite(angle)}
    if len(cell) != 4 or len(wrapped) != 4:
        raise InputError(
            f"cell order {_listed(cell_order)} is not four different angles; "
            "give top left, top right, bottom left, bottom right, for example 90,45,135,0"
        )
    return cell


def exchanged_order(cell_order: Sequence[float], exchange: tuple[int, int]) -> tuple[float, ...]:
    """A cell's order with two of its angles exchanged, by their places among the ascending ones."""
    first, second = (sorted(cell_order)[k] for k in exchange)
    return tuple({first: second, second: first}.get(angle, angle) for angle in cell_order)


def sampling_of(color: bool, cell_order: Sequence[float] = SONY_CELL) -> tuple[Sampling, tuple[float, ...]]:
    """The pattern of a sensor, and the polarizer angles of its photographs, ascending.

    Parameters
    ----------
    color : bool
        Whether cells follow each other as R G / G B.
    cell_order : sequence of 4 floats
        Polarizer angles of a cell in degrees: top left, top right, bottom left, bottom right.
    """
    cell = check_cell_order(cell_order)
    angles = tuple(sorted(cell))
    photographs = np.array([angles.index(angle) for angle in cell]).reshape(2, 2)
    channels = np.zeros((2, 2), dtype=np.intp)
    if color:
        photographs = np.tile(photographs, (2, 2))
        channels = np.kron(_BAYER, np.ones((2, 2), dtype=np.intp))
    return Sampling(*(tuple(map(tuple, pattern.tolist())) for pattern in (photographs, channels))), angles


def looks_color(raw: Raw) -> bool:
    """Whether a raw mosaic has a Bayer pattern of cells, measured on the pixels.

    Neighbouring cells of a colour sensor alternate between two colours along every row and every column; those of a
    mono sensor do not. The alternating part of the second difference (blind to slopes) along rows and along columns is
    averaged over blocks of 4x8 cells: it cancels on mono textures and stays where scene, light or sensor have any
    colour. Its size relative to the brightness is `bayer_contrast`; above 4.5 % the mosaic counts as colour. Measured:
    0.1 to 0.4 % on real mono mosaics, up to 3.5 % on sharp mono photographs, 28 % and more on colour mosaics with the
    usual strong green, 5.7 % and more where the white balance was already applied.
    """
    return bayer_contrast(raw) > _COLOR_CONTRAST


def bayer_contrast(raw: Raw) -> float:
    """Alternating contrast between neighbouring cells, relative to the brightness: median over blocks."""
    even = raw[: raw.shape[0] // 2 * 2, : raw.shape[1] // 2 * 2].astype(np.float32)
    cells = (even[::2, ::2] + even[::2, 1::2] + even[1::2, ::2] + even[1::2, 1::2]) / np.float32(4)
    contrasts = [_alternation(cells[start::2]) for start in (0, 1)]
    contrasts += [_alternation(cells.T[start::2]) for start in (0, 1)]
    return max(contrasts)


def _alternation(rows: NDArray[np.floating[Any]]) -> float:
    """Alternation along rows, over blocks; the typical one of those that are bright enough."""
    second = rows[:, 1:-1] - (rows[:, :-2] + rows[:, 2:]) / 2
    second[:, ::2] *= -1
    brightness = block_mean(rows[:, 1:-1], _TEST_BLOCK)
    if not brightness.size:
        return 0.0
    bright = brightness >= max(float(np.quantile(brightness, 0.25)), 1e-9)
    return (
        float(np.median(np.abs(block_mean(second, _TEST_BLOCK)[bright]) / brightness[bright])) / 2
        if bright.any()
        else 0.0
    )


def _listed(values: Any) -> str:
    try:
        return ",".join(f"{value:g}" if isinstance(value, int | float) else str(value) for value in values)
    except TypeError:
        return str(values)


_WIDTH = 0.57
"""Standard deviation of the low pass in patterns. By trial: with less, estimates of the incidence are spoilt by what
aliases, with more by what is lost; a Gaussian of half a pattern averaged over the pattern has as much."""
_REACH = 4
"""Patterns on each side that the low pass reads: 7 standard deviations."""
_TRUSTED = 0.99
"""Share of the weights that trusted samples must have in a pixel that is trusted. Set by hand."""


def registered_cells(raw: Images, valid: Mask, sampling: Sampling, n_photographs: int) -> tuple[Images, Mask]:
    """Photographs of one pixel per pattern, all referred to its middle.

    Parameters
    ----------
    raw : ndarray of float32, shape (h, w)
        Whole patterns.
    valid : ndarray of bool, shape (h, w)
        Samples that can be trusted.
    sampling : Sampling
    n_photographs : int

    Returns
    -------
    photographs : ndarray of float32, shape (k, channel, h / period, w / period)
    valid : ndarray of bool, same shape
        False where samples without trust have part; what is clipped counts as it is.
    """
    period = sampling.period
    shape = (n_photographs, sampling.n_channels, raw.shape[0] // period, raw.shape[1] // period)
    sums, weights = np.zeros(shape, np.float32), np.zeros(shape, np.float32)
    count = np.zeros(shape[:2])
    trusted = valid.all()
    for photograph, channel, row, column in sampling.places:
        here = (slice(row, None, period), slice(column, None, period))
        kernels = (low_pass(row, period), low_pass(column, period))
        sums[photograph, channel] += _filtered(raw[here], kernels)
        weights[photograph, channel] += 1 if trusted else _filtered(valid[here].astype(np.float32), kernels)
        count[photograph, channel] += 1
    weights /= count[..., None, None]
    sums /= count[..., None, None]
    return sums, weights > _TRUSTED


def share_of_noise(sampling: Sampling) -> float:
    """Standard deviation of the noise of `registered_cells` in units of a sample's, root of the mean square."""
    period = sampling.period
    variance = np.zeros((1 + max(map(max, sampling.photographs)), sampling.n_channels))
    count = np.zeros_like(variance)
    for photograph, channel, row, column in sampling.places:
        squares = [float(np.square(low_pass(offset, period)).sum()) for offset in (row, column)]
        variance[photograph, channel] += squares[0] * squares[1]
        count[photograph, channel] += 1
    return math.sqrt(float((variance / count**2).mean()))


def low_pass(offset: int, period: int) -> Floats:
    """Weights of samples at `offset` in their patterns for the middle of a pattern, by the patterns' distance.

    A Gaussian whose sum, mean and variance are exact whatever the offset: sampled as it is, it would move the samples
    of different offsets against each other.
    """
    distance = period * np.arange(-_REACH, _REACH + 1) + offset - (period - 1) / 2
    width = _WIDTH * period
    gauss = np.exp(-0.5 * (distance / width) ** 2)
    powers = (distance / width) ** np.arange(3)[:, None]
    return np.asarray(gauss * (np.linalg.solve(powers * gauss @ powers.T, [1.0, 0.0, 1.0]) @ powers))


def _filtered(images: Images, kernels: tuple[Floats, Floats]) -> Images:
    from scipy.ndimage import correlate1d

    down = correlate1d(images, kernels[0], axis=0, mode="nearest")
    return np.asarray(correlate1d(down, kernels[1], axis=1, mode="nearest"), dtype=np.float32)


MIRRORED_PX = 16
"""Pixels around a frame in which its mirror image fades: a multiple of all periods. Set by hand."""
STOKES_TURNS = 6
"""Turns of expectation maximization; more hardly change the photographs."""
STOKES_SAMPLED = 6144
"""Frequencies that the Stokes images' covariance is fitted to: one changes no figure. As many as for the layers."""
STOKES_START = (1.0, 0.5, 0.5)
"""Power of s0, s1 and s2 that the fit starts from, in units of the intensity's. Set by hand."""
LEAST_STOKES_POWER = 1e-12
"""Gradient power of photographs without any edges. Set by hand."""


def wiener_photographs(
    raw: Images,
    valid: Mask,
    sampling: Sampling,
    angles_deg: tuple[float, ...],
    noise: float,
    expected: Images,
    analyzer: Floats | None = None,
) -> Images:
    """The likeliest photographs (k, channel, h, w) of a mosaic whose Stokes images are natural images.

    Their covariance, of s0, s1 and s2 for each colour of an opponent basis, is fitted by expectation maximization.

    Parameters
    ----------
    raw : ndarray of float32, shape (h, w)
        Whole patterns.
    valid : ndarray of bool, shape (h, w)
    sampling : Sampling
    angles_deg : tuple of float
        Polarizer angle of each photograph.
    noise : float
        Standard deviation of a sample's noise.
    expected : ndarray, shape (k, channel, h / period, w / period)
        Photographs of `registered_cells`: what stands where samples cannot be trusted.
    analyzer : ndarray, shape (k, 3), optional
        Rows of the analyzers that the samples were taken by. Default: ideal ones at the angles, as which the
        photographs are shown.
    """
    from scipy.fft import irfft2

    shown = analyzer_matrix(angles_deg)
    analyzer = shown if analyzer is None else analyzer
    level = np.linalg.pinv(analyzer) @ expected.mean(axis=(-1, -2), dtype=np.float64)
    samples = filled_samples(raw, valid, sampling, expected)
    framed = framed_samples(samples, sampling, analyzer @ level)
    prior = fitted_prior(framed, sampling, noise, expected, analyzer)
    colors, basis = sampling.n_channels, prior.basis

    def system(members: Members) -> tuple[NDArray[Any], Callable[[NDArray[Any]], NDArray[Any]]]:
        of_law = members.of(prior.law)

        def stokes(mean: NDArray[Any]) -> NDArray[Any]:
            return np.asarray(
                np.einsum("bst,btag,ag->bsag", prior.powers.astype(np.float32), mean, of_law, optimize=True)
            )

        return prior.covariance(of_law), stokes

    spectra = wiener_spectra(prior.groups, prior.combs, system, noise**2, prior.data, 3)
    images = np.empty((colors, 3, *raw.shape), np.float32)
    for where in np.ndindex(colors, 3):
        whole = irfft2(spectra[where], s=framed.shape, norm="ortho", overwrite_x=True)
        images[where] = whole[MIRRORED_PX : MIRRORED_PX + raw.shape[0], MIRRORED_PX : MIRRORED_PX + raw.shape[1]]
    del spectra
    images += (basis @ level.T)[..., None, None].astype(np.float32)
    photographs = np.empty((len(angles_deg), colors, *raw.shape), np.float32)
    for k, c in np.ndindex(photographs.shape[:2]):
        weights = np.outer(basis[:, c], shown[k]).astype(np.float32)
        np.einsum("bs,bshw->hw", weights, images, out=photographs[k, c])
    return photographs


@dataclass(frozen=True)
class StokesPrior:
    """What is expected of the Stokes images of a mosaic's frame, fitted to it.

    Attributes
    ----------
    groups : AliasGroups
    combs : ndarray of complex64, shape (color, 3, alias, alias)
    basis : ndarray, shape (color, channel)
        The colour basis.
    law : ndarray, shape (H, W // 2 + 1)
        How power falls with frequency.
    powers : ndarray, shape (color, 3, 3)
        Covariance of s0, s1 and s2 per unit of the law.
    data : ndarray of complex64, shape (H, W // 2 + 1)
        Spectrum of the samples that it was fitted to.
    """

    groups: AliasGroups
    combs: NDArray[Any]
    basis: Floats
    law: Images
    powers: Floats
    data: NDArray[np.complex64]

    def covariance(self, of_law: NDArray[Any]) -> NDArray[np.complex64]:
        """Of the Stokes images (color, 3, 3, alias, group) at members with this power law (alias, group)."""
        return np.asarray(np.multiply.outer(self.powers, of_law), dtype=np.complex64)


def fitted_prior(framed: Images, sampling: Sampling, noise: float, expected: Images, analyzer: Floats) -> StokesPrior:
    """The covariance of Stokes images under which samples of a whole frame are likeliest.

    Parameters
    ----------
    framed : ndarray, shape (H, W)
        Samples off their level, mirrored around the frame and fading there.
    sampling : Sampling
    noise : float
    expected : ndarray, shape (k, channel, h / period, w / period)
        Photographs of `registered_cells`: where the fit starts.
    analyzer : ndarray, shape (k, 3)
    """
    from scipy.fft import rfft2

    data = np.asarray(rfft2(framed, norm="ortho"), dtype=np.complex64)
    basis = opponent_basis(sampling.n_channels)
    groups = AliasGroups(framed.shape[0], framed.shape[1], sampling.period)
    combs = groups.combs(sampling.weights(analyzer, basis))
    law = natural_law(*framed.shape)
    powers = _fitted_powers(groups, combs, law, data, noise, _initial_powers(expected, analyzer, basis))
    return StokesPrior(groups, combs, basis, law, powers, data)


def filled_samples(raw: Images, valid: Mask, sampling: Sampling, expected: Images) -> Images:
    """Samples (h, w), and what is expected (k, channel, h / period, w / period) where they cannot be trusted."""
    return raw if valid.all() else np.where(valid | (raw >= 1), raw, sampling.laid_out(expected, raw.shape))


def framed_samples(samples: Images, sampling: Sampling, level: Floats) -> Images:
    """Samples less the level (k, channel) of their photographs, mirrored around the frame and fading there."""
    period, inside = sampling.period, np.arange(sampling.period)
    rows, columns = (
        (mirrored_patterns(side // period, period)[:, None] * period + inside).ravel() for side in samples.shape
    )
    off_level = samples - sampling.laid_out(level, samples.shape)
    window = np.outer(*frame_sides(samples.shape, (rows.size, columns.size))).astype(np.float32)
    return np.asarray(off_level[rows][:, columns] * window)


def frame_sides(shape: tuple[int, ...], framed: tuple[int, ...]) -> list[Floats]:
    """Weights of a frame's rows and of its columns within what is mirrored around it."""
    return [
        tukey_window(side, MIRRORED_PX, whole - side - MIRRORED_PX) for side, whole in zip(shape, framed, strict=True)
    ]


def mirrored_patterns(n: int, period: int) -> NDArray[np.intp]:
    """The n patterns of a side with mirrored ones beyond its ends, as many as the Fourier transform likes."""
    from scipy.fft import next_fast_len

    patterns = next_fast_len(n + 2 * MIRRORED_PX // period, real=True)
    folded = (np.arange(patterns) - MIRRORED_PX // period) % (2 * n)
    return np.asarray(np.where(folded < n, folded, 2 * n - 1 - folded))


def natural_law(height: int, width: int) -> Images:
    return np.asarray(natural_frequencies(height, width) ** (-NATURAL_POWER_LAW / 2), dtype=np.float32)


def _initial_powers(expected: Images, analyzer: Floats, basis: Floats) -> Floats:
    """Covariance of the Stokes images (color, 3, 3) per unit of the law, where the fit starts."""
    intensity = np.tensordot(np.linalg.pinv(analyzer)[:1], expected, axes=1)[0]
    own = np.tensordot(basis, intensity, axes=1)
    power = sum(np.square(np.diff(own, axis=axis)).mean(axis=(-1, -2)) for axis in (-1, -2)) + LEAST_STOKES_POWER
    return np.asarray(power)[:, None, None] * np.diag(STOKES_START)


def _fitted_powers(
    groups: AliasGroups, combs: NDArray[Any], law: Images, data: NDArray[Any], noise: float, powers: Floats
) -> Floats:
    """Covariance of the Stokes images (color, 3, 3) per unit of the law, under which the samples are likeliest."""
    members, counts = groups.sample(STOKES_SAMPLED // groups.period**2)
    of_law, samples = members.of(law), members.of(data)
    share = counts / (counts.sum() * len(of_law))
    for _ in range(STOKES_TURNS):
        power = np.multiply.outer(powers, of_law).astype(np.complex64)
        found = explained_groups(combs, power, noise**2, samples, information=True)
        mean = np.einsum("bst,btag->bsag", powers, found.mean)
        told = np.einsum("bsuag,ag,g->bsu", found.information, of_law, share, optimize=True).real
        seen = np.einsum("bsag,buag,ag,g->bsu", mean, mean.conj(), of_law, share, optimize=True).real
        powers = seen + powers - powers @ told @ powers
        powers = (powers + powers.swapaxes(-1, -2)) / 2
    return powers
