"""Ghost shift of the pane, by the likelihood of the capture's spectra (Whittle) as a function of the shift.

The ghosts put notches across the spectra of what each polarization shows, and turn the phase between the two; the
latter tells the shift's sense. The layers are independent, with smooth unknown power spectra that are fitted along.
The likelihood is Student's, so that a few frequencies full of oriented edges do not decide.

With P and Q the powers of the layers, the covariance at a frequency is ``M = P A + Q B + N``. For 2x2 matrices
``a.b = trace(adj(a) b)`` is bilinear and ``a.a = 2 det a``: so det M, the data's distance from M and their derivatives
need no more than a handful of products of A, B, N and the data, taken once for all powers that are tried.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from polaropt.capture import PlateFrame
from polaropt.numerics import (
    blurred_power,
    column_multiplicity,
    frequencies,
    hann_autocorrelation,
    hann_spectra,
    hann_tile,
    kept_while_alive,
    sharpened,
    squared_blur,
)
from polaropt.optics import GhostSeries, GhostSum, Plate, SceneParameters, ghost_sum, interface
from solvers.kernels import in_blocks

Images = NDArray[np.float32]
Mask = NDArray[np.bool_]
Matrix = NDArray[np.float64]

TILE_PX = 64
"""Side of a tile: more than twice the largest shift that is searched."""
LOWEST_CYCLES = 2.5
"""Least frequency that is used, in cycles per tile: the window leaks those below. By trial."""
HIGHEST_FREQUENCY = 2.8
"""Highest that is used, in rad per pixel (pi is the finest grid): interpolation in cameras spoils it. By trial."""
LEAST_SHIFT_PX = 0.5
"""Ghosts that are closer fall onto each other and cannot be told from none: half a pixel."""
LIKE_BLUR_PX = 2.0
"""Pixels below which ghosts look like a blur. Set by hand."""
_MOST_INVALID = 0.2
"""Share of a tile's pixels that may be unknown, if other tiles have less. Set by hand."""
_MOST_TILES = 128
"""Tiles that are looked at: enough to tell the spectra, and bounded time. Set by hand."""
_MOST_BANDS = 8
"""Bands of tiles that are left out in turn for standard errors. Set by hand."""
# Beyond this incidence in degrees single precision takes the pane for a mirror, with ghosts that never fade. By trial.
_STEEPEST_DEG = 89.5


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

    @cached_property
    def left_out(self) -> list[CrossSpectra]:
        """The same without each of the bands."""
        if self.bands is None or len(self.bands.counts) == 1:
            return []
        rest = [self.bands.without(i) for i in range(len(self.bands.counts))]
        return [replace(self, par=par, perp=perp, cross=cross, bands=None) for par, perp, cross in rest]

    def with_ghosts_along(self, direction_deg: float) -> CrossSpectra:
        """The same for ghosts along another direction in the image than the azimuth."""
        return replace(self, ghosts_deg=direction_deg)

    @cached_property
    def blur_px2(self) -> float:
        """How far the pictures are blurred, see `squared_blur`."""
        noise = float(self.covariance[0, 0] + self.covariance[1, 1])
        radius = np.hypot(self.along, self.across_azimuth)
        return squared_blur(self.par + self.perp, noise, radius, self.multiplicity)

    def shapes(self, n_radii: int, n_directions: int) -> Images:
        """What the layers' power is made of, see `spectral_shapes`: (level, frequency); not to be written to."""
        detail = n_radii, n_directions
        if detail not in self._known_shapes:
            self._known_shapes[detail] = spectral_shapes(self.along, self.across_azimuth, *detail, self.blur_px2)
        return self._known_shapes[detail]

    @cached_property
    def _known_shapes(self) -> dict[tuple[int, int], Images]:
        return {}

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
        common = hann_autocorrelation(shifts * math.cos(direction) / self.tile)
        return (common * hann_autocorrelation(shifts * math.sin(direction) / self.tile)).astype(np.float32)


def is_of_two_faces(scene: SceneParameters) -> bool:
    """Whether light bounces between two faces, and lies as far apart in both layers."""
    return not scene.single_surface and scene.n_bounces != 0 and scene.transmission_ghost_shift is None


@kept_while_alive
def cross_spectra(frame: PlateFrame) -> CrossSpectra:
    """Welch's mean periodograms over half-overlapping Hann tiles, a bounded number of them."""
    seen = _mean_spectra(frame, 0.0)
    return seen if seen.blur_px2 == 0 else _mean_spectra(frame, seen.blur_px2)


def _mean_spectra(frame: PlateFrame, blur_px2: float) -> CrossSpectra:
    side = min(TILE_PX, *frame.images.shape[-2:])
    corners = tile_corners(frame.valid, side)
    n_bands = min(_MOST_BANDS, len(corners))
    par: Images = np.zeros((n_bands, side, side // 2 + 1), np.float32)
    perp, cross, counts = par.copy(), np.zeros(par.shape, np.complex64), np.zeros(n_bands, np.intp)
    for i, (first, second) in enumerate(_tile_spectra(frame, side, corners, blur_px2)):
        band = i * n_bands // len(corners)
        par[band] += _power(first)
        perp[band] += _power(second)
        cross[band] += np.einsum("cyx,cyx->yx", first, second.conj())
        counts[band] += len(first)
    return _usable(Bands(par, perp, cross, counts), side, frame)


def _tile_spectra(
    frame: PlateFrame, side: int, corners: Sequence[tuple[int, int]], blur_px2: float
) -> Iterator[NDArray[np.complex64]]:
    """Of every tile in turn the spectra of I_par and I_perp under Hann's window, (2, channel, y, x).

    Those of `tile_spectra` are better; the thresholds of what mean spectra tell were found with these.
    """
    from scipy.fft import rfft2

    window = hann_tile(side, side).astype(np.float32)
    share = window / np.sum(window)

    def spectra(part: Images) -> NDArray[np.complex64]:
        mean = np.einsum("ecyx,yx->ec", part, share)[..., None, None]
        return np.asarray(rfft2((part - mean) * window), np.complex64)

    return _under_window(frame, side, corners, blur_px2, spectra)


def tile_spectra(
    frame: PlateFrame, side: int, corners: Sequence[tuple[int, int]], blur_px2: float = 0.0
) -> Iterator[NDArray[np.complex64]]:
    """The same by way of gradients: see `hann_spectra`; of pictures as blurred as `squared_blur` tells."""
    return _under_window(frame, side, corners, blur_px2, lambda part: np.asarray(hann_spectra(part), np.complex64))


def _under_window(
    frame: PlateFrame,
    side: int,
    corners: Sequence[tuple[int, int]],
    blur_px2: float,
    spectra: Callable[[Images], NDArray[np.complex64]],
) -> Iterator[NDArray[np.complex64]]:
    """Spectra of every tile as a window shows them; blurred pictures are sharpened before, and not after it."""
    for top, left in corners:
        part = _opponent(frame.images[..., top : top + side, left : left + side])
        if blur_px2 == 0:
            yield spectra(part)
        else:
            part, transfer = sharpened(part, blur_px2)
            yield np.asarray(spectra(part) / transfer, np.complex64)


def _power(spectra: NDArray[np.complex64]) -> Images:
    """Power of spectra (channel, ...), summed over the channels."""
    parts = spectra.view(np.float32).reshape(*spectra.shape, 2)
    power: Images = np.einsum("cyxp,cyxp->yx", parts, parts)
    return power


def _usable(sums: Bands, side: int, frame: PlateFrame) -> CrossSpectra:
    use, along, across, multiplicity = usable_frequencies(side, frame.azimuth_deg)
    bands = Bands(sums.par[:, use], sums.perp[:, use], sums.cross[:, use], sums.counts)
    count = np.float32(sums.counts.sum())
    par, perp, cross = (part.sum(axis=0) / count for part in (bands.par, bands.perp, bands.cross))
    return CrossSpectra(
        par,
        perp,
        cross,
        along,
        across,
        multiplicity,
        frame.covariance,
        side,
        frame.azimuth_deg,
        bands=bands,
    )


def usable_frequencies(side: int, azimuth_deg: float) -> tuple[Mask, Matrix, Matrix, Images]:
    """Which frequencies (y, x) of a tile are used; of these those along and across an azimuth (per pixel), and how
    often each counts, (n,)."""
    rows, columns = frequencies(side, side)
    azimuth = math.radians(azimuth_deg)
    along = columns * math.cos(azimuth) - rows * math.sin(azimuth)
    across = columns * math.sin(azimuth) + rows * math.cos(azimuth)
    multiplicity = np.broadcast_to(column_multiplicity(side).astype(np.float32), along.shape)
    radius: Matrix = np.hypot(columns, rows)
    # The window leaks the lowest frequencies; interpolation, in an eye or a computer, spoils the highest.
    use = (radius > LOWEST_CYCLES * 2 * np.pi / side) & (radius < HIGHEST_FREQUENCY)
    # The window makes neighbouring frequencies much alike: every second one, as on a chessboard, says the same.
    use &= np.add.outer(np.arange(side), np.arange(side // 2 + 1)) % 2 == 0
    return use, along[use], across[use], multiplicity[use]


def tile_corners(valid: Mask, side: int, period: int = 1) -> list[tuple[int, int]]:
    """Corners of half-overlapping tiles, without those that are mostly unknown; at multiples of a period."""
    starts = [[start // period * period for start in _starts(length, side)] for length in valid.shape[-2:]]
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


_RADIAL_KNOTS = 3
"""Radii over which the layers' spectra bend; with few a blurred scene passes for one with close ghosts. By trial."""
DEGREES_OF_FREEDOM = np.float32(4)
"""Of Student's likelihood: heavy tails, a variance of their own. By trial."""
FIRST_LEVEL = 1e-3
"""Power of a layer times squared frequency where the fit begins."""
_FIRST_ROUNDS = 12
"""Rounds of the first fit of levels. By trial."""
LEAST_FACTOR = 1e-3
"""By which a level shrinks in a round at most."""
_LEAST_DETERMINANT = np.float32(1e-6)
"""Of a covariance, as a share of the product of its diagonal: float32 tells no less."""
_TRIALS_OF_A_THREAD = 8
"""Set by hand."""
_EVERY = 8
"""Levels are first fitted for every so-many-th trial, then carried to those between."""


class _Hermitian(NamedTuple):
    """2x2 Hermitian matrices, one per trial and frequency: diagonal, and real and imaginary part of the upper right."""

    par: Images
    perp: Images
    real: Images
    imag: Images

    def flattened(self) -> _Hermitian:
        """With a single axis of trials."""
        return _Hermitian(*(part.reshape(-1, part.shape[-1]) for part in self))

    def dot(self, other: _Hermitian) -> Images:
        """Trace of the adjugate times the other."""
        diagonal = self.par * other.perp + self.perp * other.par
        product: Images = diagonal - 2 * (self.real * other.real + self.imag * other.imag)
        return product

    def determinant(self) -> Images:
        """At least what rounding leaves uncertain."""
        product: Images = self.par * self.perp
        least: Images = np.maximum(product - self.real**2 - self.imag**2, _LEAST_DETERMINANT * product)
        return least


class ShiftLikelihood:
    """Likelihood of ghost shifts given a capture's mean spectra.

    Parameters
    ----------
    spectra : CrossSpectra
    scene : SceneParameters
        Index and surfaces of the pane, and the transmission's own shift, if it has one; nothing else is used.
    detail : (int, int), optional
        Radii and directions into which the layers' spectra are split. With few of them a blurred scene passes for one
        with close ghosts; with many a comparison takes longer. Default: 3 and 2, or 3 and 4 where ghosts have a
        direction of their own.
    """

    def __init__(self, spectra: CrossSpectra, scene: SceneParameters, detail: tuple[int, int] | None = None) -> None:
        self._data = _Hermitian(spectra.par, spectra.perp, spectra.cross.real.copy(), spectra.cross.imag.copy())
        (par, cross), (_, perp) = spectra.covariance.astype(np.float32)
        self._noise = _Hermitian(par, perp, cross, np.float32(0))  # type: ignore[arg-type]
        self._along = spectra.along_ghosts.astype(np.float32)
        self._coherence = spectra.coherence
        self._multiplicity = spectra.multiplicity
        self._scene = scene
        # Directions that are compared must not differ in what pictures they expect; nor may edges pass for ghosts.
        detail = detail or (_RADIAL_KNOTS, 2 if spectra.ghosts_deg is None else 4)
        self._shapes = spectra.shapes(*detail)
        """(level, frequency): natural images' power, split over a few radii and directions."""

    def misfit(
        self,
        incidence_deg: float | Matrix,
        shifts: Sequence[float] | Matrix,
        rounds: int = 4,
        transmission_shifts: Sequence[float] | Matrix | None = None,
    ) -> Matrix:
        """Minus log likelihood per frequency of trial shifts (pixels, signed), up to a constant.

        Parameters
        ----------
        incidence_deg : float or ndarray
            One incidence or several.
        shifts : sequence of float
        rounds : int
            How closely each trial's spectra are fitted.
        transmission_shifts : sequence of float, optional
            The transmission's own, one for each of `shifts`. Default: the scene's, or the same.

        Returns
        -------
        ndarray, shape ([incidences,] shifts)
        """
        incidences = np.minimum(np.atleast_1d(incidence_deg), _STEEPEST_DEG)
        steps = np.asarray(shifts, dtype=np.float64)
        own = self._scene.transmission_ghost_shift
        if transmission_shifts is None:
            transmission_shifts = steps if own is None else np.full(steps.shape, own)
        products = self._products(incidences, steps, np.asarray(transmission_shifts))
        sparse = np.arange(0, steps.size, _EVERY)
        nearest = np.minimum((np.arange(steps.size) + _EVERY // 2) // _EVERY, sparse.size - 1)
        rows = np.arange(incidences.size * steps.size).reshape(incidences.size, -1)
        levels = np.full((incidences.size * sparse.size, 2, len(self._shapes)), FIRST_LEVEL, np.float32)
        self._fit(products[rows[:, sparse].ravel()], levels, _FIRST_ROUNDS)
        carried = np.arange(len(levels)).reshape(incidences.size, -1)[:, nearest].ravel()
        value = self._fit(products, levels[carried], rounds)
        return value.reshape(incidences.size, -1) if np.ndim(incidence_deg) else value

    def _fit(self, products: Images, levels: Images, rounds: int) -> Matrix:
        """Minus log likelihood per frequency of each trial, whose levels (trial, 2, level) are fitted in place."""
        from polaropt.estimation.flat.windows.kernels import fitted_misfits

        settings = (DEGREES_OF_FREEDOM, np.float32(LEAST_FACTOR), rounds)
        out = np.empty(len(products))

        def some(start: int, stop: int) -> None:
            fitted_misfits(products, self._shapes, self._multiplicity, *settings, levels, out, start, stop)

        in_blocks(some, len(products), _TRIALS_OF_A_THREAD)
        return out

    def _products(self, incidences: Matrix, shifts: Matrix, of_transmission: Matrix) -> Images:
        """Products of the reflection's A, the transmission's B, the noise N and the data D, (trial, 9, frequency)."""
        reflection, transmission = self._responses(incidences, shifts)
        if of_transmission is not shifts:
            transmission = self._responses(incidences, of_transmission)[1]
        noise, data = self._noise, self._data
        products = np.empty((len(reflection.par), 9, self._along.size), np.float32)
        for i, product in enumerate(
            (
                2 * reflection.determinant(),
                2 * transmission.determinant(),
                np.maximum(reflection.dot(transmission), 0),
                reflection.dot(noise),
                transmission.dot(noise),
                reflection.dot(data),
                transmission.dot(data),
                noise.dot(noise),
                noise.dot(data),
            )
        ):
            products[:, i] = product
        return products

    def _responses(self, incidences: Matrix, shifts: Matrix) -> tuple[_Hermitian, _Hermitian]:
        """Outer products of the transfer functions of reflection and transmission: incidences times shifts."""
        phase = shifts.astype(np.float32)[:, None] * self._along
        cosine, sine = np.cos(phase), np.sin(phase)
        faces = [interface(float(incidence), self._scene.index).reflection[:2] for incidence in incidences]
        rho = np.array(faces, np.float32).T[:, :, None, None]
        layers = Plate(rho, 1 - rho, self._scene.single_surface, self._scene.n_bounces).series
        ghosts = [ghost_sum(ratio, cosine, sine) for ratio in layers[0].ratio]
        coherence = self._coherence(shifts)[:, None]
        transmission, reflection = (_outer(layer, ghosts, coherence).flattened() for layer in layers)
        return reflection, transmission


def spectral_shapes(along: Matrix, across: Matrix, n_radii: int, n_directions: int, blur_px2: float = 0.0) -> Images:
    """Natural images' power at frequencies (n,), split over radii and directions: (radii * directions, n).

    Those that are blurred, see `squared_blur`, fall faster.
    """
    radius2 = along**2 + across**2
    position = np.log(radius2) / 2
    knots = np.linspace(position.min(), position.max(), n_radii)
    hats = np.maximum(0, 1 - np.abs(position - knots[:, None]) / (knots[1] - knots[0]))
    turns = np.pi * np.arange(n_directions) / n_directions
    # Squares of two directions add up to 1, fourth powers of four to a constant.
    directions = [(along * np.cos(turn) + across * np.sin(turn)) ** n_directions for turn in turns]
    shapes: Images = np.concatenate([hats * d / radius2 ** (1 + n_directions / 2) for d in directions])
    return (shapes * blurred_power(radius2, blur_px2)).astype(np.float32)


def _outer(layer: GhostSeries, ghosts: Sequence[GhostSum], coherence: Images) -> _Hermitian:
    """Outer product of direct light plus ghosts, which the window tells apart from it as far as they are shifted."""
    (d_par, d_perp), (g_par, g_perp), (par, perp) = layer.direct, layer.ghost, ghosts
    both, of_par, of_perp = g_par * g_perp, coherence * d_perp * g_par, coherence * d_par * g_perp
    return _Hermitian(
        d_par**2 + (2 * coherence * d_par * g_par) * par.real + g_par**2 * par.squared,
        d_perp**2 + (2 * coherence * d_perp * g_perp) * perp.real + g_perp**2 * perp.squared,
        d_par * d_perp + both * (par.real * perp.real + par.imag * perp.imag) + of_par * par.real + of_perp * perp.real,
        both * (par.imag * perp.real - par.real * perp.imag) + of_par * par.imag - of_perp * perp.imag,
    )
