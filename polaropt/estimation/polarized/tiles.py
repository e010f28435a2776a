"""How likely a capture's tiles are before polarized light: every layer has spectra of its own in every tile and colour.

What `polaropt.estimation.flat.windows.tiles` does with two polarizations, of light that arrives unpolarized, this does
with all three Stokes components. It tells ghosts from none, and where they lie, far more surely than mean spectra do:
of 11 random windows with ghosts the likeliest pane without any was less likely by 80 to 1,290, in minus log likelihood,
and by 2 to 6 standard errors. It does not tell which of the layers' light is polarized on which side its ghosts lie.

References
----------
D. T. Pham, J.-F. Cardoso, Blind separation of instantaneous mixtures of nonstationary sources, IEEE TSP, 2001.
"""

from __future__ import annotations

import copy
import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import lru_cache, partial

import numpy as np
from numpy.typing import NDArray

from polaropt.capture import StokesImages
from polaropt.estimation.flat.ghosts import TILE_PX, tile_corners, usable_frequencies
from polaropt.estimation.flat.windows.tiles import FREEDOM, HIGHEST_TILE_FREQUENCY, frequency_cells
from polaropt.estimation.polarized.light import (
    AZIMUTH,
    HIGHEST_DEG,
    LOWEST_DEG,
    SHIFT,
    Candidate,
    Point,
    bounded,
    coordinates_of,
    first_images,
    point_of,
    shown_light,
    stokes_of_entries,
)
from polaropt.numerics import Box, bilinear_transfer, hann_autocorrelation, hann_spectra, opponent_basis
from polaropt.optics import SceneParameters
from solvers.kernels import in_blocks

Values = NDArray[np.float64]
Against = Callable[[Point], float]
"""Minus log likelihood of a point."""
Beside = Callable[[Point], Against]
Powers = NDArray[np.float64]
"""Of both layers in every tile and colour, reflection first, in units of natural images' power: (2, cell, tile)."""

_N_IMAGES = 7
"""Direct light and the ghosts that are looked at; what is left out is 2 % of the reflection at 85 degrees."""
_FIRST_ROUNDS, _ROUNDS = 20, 4
"""In which the powers are fitted, and fitted again to a pane near the one they were fitted to. By trial."""
_LEAST_FACTOR = 0.02
"""By which a power shrinks in a round at most. Set by hand."""
_TILES_OF_A_THREAD = 48
"""Set by hand: what vectorizes, and is worth a thread."""
_MOST_TILES = 32
"""Tiles that are looked at, all over the frame: enough to tell panes from one another, and bounded time."""
_NO_ERROR = 1e-9
"""For none at all, of panes that are the same."""
# Steps and bounds of a search, in a point's numbers and in its coordinates. Set by hand.
_STEPS = np.array([1.0, 0.5, 0.1, 0.01, 0.01, 0.02, 0.02])
_SHOWN_STEPS = np.array([1.0, 0.5, 0.1, 0.005, 0.005, 0.01, 0.01])
_LOW = np.array([LOWEST_DEG, -720, -40, *4 * [-0.995]])
_HIGH = np.array([HIGHEST_DEG, 720, 40, *4 * [0.995]])
_TURNS, _TURNS_OF_CURVATURE, _AT_REST = 4, 2, 0.1
"""In which the powers are fitted to the last pane, and that share a curvature; and the move, in steps, that ends them.
Set by hand."""
_PAIRS = ((0, 1), (0, 2), (1, 2))


@dataclass(frozen=True)
class TileFit:
    """A candidate, and minus the log likelihood of every tile and colour there, (tile,)."""

    candidate: Candidate
    misfits: Values

    @property
    def misfit(self) -> float:
        """That of the frame."""
        return float(self.misfits.sum())

    def gain_over(self, other: TileFit) -> float:
        """By how much it is likelier than another one, in log likelihood."""
        return other.misfit - self.misfit

    def surer_than(self, other: TileFit) -> float:
        """Standard errors by which it is likelier than another one; negative where it is less likely."""
        gains = other.misfits - self.misfits
        return float(gains.sum() / max(math.sqrt(float(gains @ gains)), _NO_ERROR))


class StokesTiles:
    """Likelihood of panes before polarized light given the spectra of a capture's tiles.

    Parameters
    ----------
    stokes : StokesImages
    asked : SceneParameters
        Index and surfaces of the pane.
    """

    def __init__(self, stokes: StokesImages, asked: SceneParameters) -> None:
        self._asked = asked
        height, width = stokes.images.shape[-2:]
        side = min(TILE_PX, height, width)
        use, columns, rows, multiplicity = usable_frequencies(side, 0.0)
        coarse = np.hypot(columns, rows) < HIGHEST_TILE_FREQUENCY
        use[use], columns, rows, multiplicity = coarse, columns[coarse], rows[coarse], multiplicity[coarse]
        cell = frequency_cells(columns, rows)
        order = np.argsort(cell, kind="stable")
        self._cells = np.searchsorted(cell[order], np.arange(cell.max(initial=-1) + 2))
        self._columns, self._rows = columns[order], rows[order]
        self._multiplicity = np.ascontiguousarray(multiplicity[order], np.float64)
        self._natural = 1 / np.maximum(self._columns**2 + self._rows**2, _NO_ERROR)
        # A Newton step asks at some forty points, which have six places of ghosts.
        self._in_common = lru_cache(maxsize=8)(partial(_ghosts_in_common, self._columns, self._rows, side))
        self._whiten = np.linalg.inv(np.linalg.cholesky(stokes.covariance))
        self._n_colours = stokes.images.shape[1]
        basis = opponent_basis(self._n_colours)
        tiles = []
        corners = tile_corners(_valid(stokes), side)
        for top, left in corners[:: math.ceil(len(corners) / _MOST_TILES)]:
            part = stokes.images[..., top : top + side, left : left + side]
            part = np.einsum("ij,dc,jcyx->diyx", self._whiten, basis, part)
            tiles.append(_products(hann_spectra(part)[..., use][..., order]))
        self._data = np.ascontiguousarray(np.concatenate(tiles).transpose(1, 2, 0))

    def luminance(self) -> StokesTiles:
        """That of the colours' sum alone, which takes a third of the time."""
        other = copy.copy(self)
        other._data = np.ascontiguousarray(self._data[..., :: self._n_colours])
        return other

    def __len__(self) -> int:
        """Tiles times colours."""
        return int(self._data.shape[-1])

    def fitted(self, candidate: Candidate) -> TileFit:
        """How likely the tiles are there, with the powers that suit it."""
        return TileFit(candidate, self._misfits(candidate.point, self._first_powers())[0])

    def nearest(
        self,
        candidate: Candidate,
        free: NDArray[np.intp],
        turns: int = _TURNS,
        *,
        beside: Beside | None = None,
        finely: float = 1.0,
    ) -> TileFit:
        """The likeliest candidate near one, as far as some of its point's numbers go.

        What the layers show in place is told best, so that steps go along it; where none does, as light is polarized
        fully, along the light's own numbers.

        Parameters
        ----------
        candidate : Candidate
        free : ndarray of int
            Which of its point's numbers may move.
        turns : int
            Steps at most.
        beside : callable, optional
            From a point to what else speaks against points near it, which is added.
        finely : float
            Steps of derivatives, in those that suit tiles alone: what is added may tell much more finely.
        """
        curvature: Values | None = None
        for turn in range(turns if free.size else 0):
            # That of a turn before does for the next ones.
            curvature = None if turn % _TURNS_OF_CURVATURE == 0 else curvature
            powers = self._misfits(candidate.point, self._first_powers())[1]
            also = None if beside is None else beside(candidate.point)

            def misfit(point: Point, powers: Powers = powers, also: Against | None = also) -> float:
                tiles = float(self._misfits(point, powers, _ROUNDS)[0].sum())
                return tiles if also is None else tiles + also(point)

            moved, step, curvature = self._moved(candidate, free, misfit, True, finely, curvature)
            if not step:
                moved, step, _ = self._moved(candidate, free, misfit, False, finely)
                curvature = None
            candidate = moved
            if step < _AT_REST:
                break
        return self.fitted(candidate)

    def _moved(
        self,
        candidate: Candidate,
        free: NDArray[np.intp],
        misfit: Against,
        by_shown: bool,
        finely: float,
        curvature: Values | None = None,
    ) -> tuple[Candidate, float, Values]:
        """A candidate after a Newton step, its length in steps of derivatives, and the curvature it was made with."""
        start = coordinates_of(candidate.point, self._asked) if by_shown else candidate.point

        def point_at(x: Values) -> Point:
            numbers = start.copy()
            numbers[free] = x
            return point_of(numbers, candidate, self._asked) if by_shown else bounded(numbers)

        all_steps = finely * (_SHOWN_STEPS if by_shown else _STEPS)
        at, steps, low, high = (part[free] for part in (start, all_steps, _LOW, _HIGH))
        box = Box(np.clip(at, low + steps, high - steps), steps, low, high)
        step = box.newton(lambda x: misfit(point_at(x)), curvature)
        length = float(np.max(np.abs(step.point - at) / steps))
        return replace(candidate, point=point_at(step.point)), length, step.curvature

    def of_shifts(self, point: Point, shifts: Values) -> Values:
        """Minus log likelihood of all tiles where the ghosts of a point lie elsewhere, (shift,)."""
        moved = np.repeat(point[None], len(shifts), axis=0)
        moved[:, SHIFT] = shifts
        return self.of_points(moved)

    def of_points(self, points: Values) -> Values:
        """Minus log likelihood of all tiles at points (n, 7) that differ in their ghosts' places, roughly, (n,)."""
        far = points[int(np.argmax(np.abs(points[:, SHIFT])))]
        # Powers fitted with ghosts far away suit all places alike.
        powers = self._misfits(far, self._first_powers())[1]
        return np.array([self._misfits(point, powers, _ROUNDS)[0].sum() for point in points])

    def _first_powers(self) -> Powers:
        return np.ones((2, self._cells.size - 1, len(self)))

    def _misfits(self, point: Point, powers: Powers, rounds: int = _FIRST_ROUNDS) -> tuple[Values, Powers]:
        """Minus log likelihood of each tile, and the powers, begun from others."""
        from polaropt.estimation.polarized.tile_kernels import stokes_tile_misfits

        response, fitted, out = self._response(point), powers.copy(), np.empty(len(self))
        data = (response, self._data, self._multiplicity, self._natural, self._cells)

        def some(start: int, stop: int) -> None:
            stokes_tile_misfits(*data, float(FREEDOM), _LEAST_FACTOR, rounds, fitted, out, start, stop)

        in_blocks(some, len(self), _TILES_OF_A_THREAD)
        return out, fitted

    def _response(self, point: Point) -> Values:
        """What a pane makes of both layers of power 1, transmission first: Hermitian matrices, (2, 9, n)."""
        mixing, shift = self._whiten @ stokes_of_entries(point), float(point[SHIFT])
        images = mixing @ first_images(shown_light(point, self._asked), _N_IMAGES)
        images /= np.linalg.norm(images.sum(axis=-1), axis=-1)[:, None, None]
        images = images if shift else images.sum(axis=-1, keepdims=True)
        one, other, real, imaginary = self._in_common(float(point[AZIMUTH]), shift)
        products = images[:, :, None, one] * images[:, None, :, other]
        even, odd = products + products.swapaxes(1, 2), products - products.swapaxes(1, 2)
        first, second = np.array(_PAIRS).T
        response = np.empty((2, 9, self._columns.size))
        response[:, :3] = even[:, range(3), range(3)] @ real
        response[:, 3::2] = even[:, first, second] @ real
        response[:, 4::2] = odd[:, first, second] @ imaginary
        return response


def _ghosts_in_common(
    columns: Values, rows: Values, side: int, azimuth_deg: float, shift: float
) -> tuple[NDArray[np.intp], NDArray[np.intp], Values, Values]:
    """What every two images of a layer, each of them interpolated, have in common in a tile; not to be written to.

    Returns
    -------
    one, other : ndarray of int, shape (pair,)
        The images of each pair.
    real, imaginary : ndarray, shape (pair, n)
        Cross spectra of images of a layer of power 1; half of it for an image and itself, as each pair stands for two.
    """
    azimuth = math.radians(azimuth_deg)
    steps = np.arange(_N_IMAGES if shift else 1)
    right, down = steps * (shift * math.cos(azimuth)), -steps * (shift * math.sin(azimuth))
    moved = bilinear_transfer(right, down, columns, rows)
    one, other = np.tril_indices(steps.size)
    within = hann_autocorrelation((right[one] - right[other]) / side)
    within *= hann_autocorrelation((down[one] - down[other]) / side)
    common = np.where(one == other, 0.5, within)[:, None] * moved[one] * moved[other].conj()
    found = one, other, np.ascontiguousarray(common.real), np.ascontiguousarray(common.imag)
    for part in found:
        part.flags.writeable = False
    return found


def _valid(stokes: StokesImages) -> NDArray[np.bool_]:
    """Pixels at which all components and colours are known."""
    return np.asarray(stokes.valid.reshape(-1, *stokes.valid.shape[-2:]).all(axis=0), bool)


def _products(spectra: NDArray[np.complex64]) -> Values:
    """Of spectra (colour, 3, n) what `stokes_tile_misfits` takes for data, (colour, 9, n)."""
    products = [np.abs(spectra[:, i]) ** 2 for i in range(3)]
    for i, j in _PAIRS:
        cross = 2 * spectra[:, i].conj() * spectra[:, j]
        products += [cross.real, -cross.imag]
    return np.stack(products, axis=1).astype(np.float64)
