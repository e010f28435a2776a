"""How likely a capture's tiles are under a window: every layer has spectra of its own in every tile and colour.

Edges differ from place to place, in direction and in fineness, in each layer for itself. So in every tile of the frame
the powers of both layers are free in each cell of frequencies, a few neighbouring ones, and what is left to be told is
how the window mixes the layers: by its images' brightness and places, and by how much light of each polarization they
have. It needs no natural spectra that would pass for ghosts, and tells windows from one another far more surely than
mean spectra over all tiles do: the number of panes, tint and index. With so many powers free it says little more of the
incidence than the edges do.

References
----------
D. T. Pham, J.-F. Cardoso, Blind separation of instantaneous mixtures of nonstationary sources, IEEE TSP, 2001.
P. Whittle, The analysis of multiple stationary time series, JRSS B, 1953.
"""

from __future__ import annotations

import copy
import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from polaropt.capture import PlateFrame
from polaropt.estimation.flat.ghosts import (
    FIRST_LEVEL,
    TILE_PX,
    tile_corners,
    tile_spectra,
    usable_frequencies,
)
from polaropt.estimation.flat.windows.likelihood import Window, images_of
from polaropt.numerics import (
    Box,
    bilinear_transfer,
    blurred_power,
    frequencies,
    hann_autocorrelation,
    kept_while_alive,
    squared_blur,
)
from polaropt.optics import FARTHEST_SHIFT_PX, INCIDENCE_SEARCH_DEG
from solvers.kernels import in_blocks

Values = NDArray[np.float64]
Powers = NDArray[np.float32]
"""Of both layers in every tile and colour, reflection first, in units of natural images' power: (2, cell, tile)."""

MOST_ABSORPTION = 1.6
"""Absorption up to which tint is told: a fifth of the light passes. Set by hand."""
_BAND, _PER_CELL = 0.4, 10
"""Width of a ring of frequencies, in natural logarithm of their radius, and how many frequencies a cell of it holds:
with smooth spectra of 12 powers (3 radii, 4 directions) in the place of such cells single panes pass for several."""
HIGHEST_TILE_FREQUENCY = 1.5
"""Highest that is used, in rad per pixel: beyond, ghosts between two pixels are blurred, by the sensor and by any model
of them. Up to 2.8 a steep pane, with many ghosts, passes for two panes (4 standard errors), up to 1.7 it does not."""
FREEDOM = np.float32(16)
"""Of Student's likelihood. A cell's frequencies are much alike: with 4, as of mean spectra, windows that are told gain
less, and incidences come out a little too shallow. By trial."""
_FIRST_ROUNDS, _ROUNDS = 20, 4
"""In which the powers are fitted, and fitted again to a window near the one they were fitted to. By trial."""
_TILES_OF_A_THREAD = 48
"""Set by hand: what vectorizes, and is worth a thread."""
_LEAST_FACTOR = np.float32(0.02)
"""By which a power shrinks in a round at most. Set by hand."""
_MOST_PLACES = 32
"""Of a window's images, whose transfer functions are kept: 0.1 MB each. Set by hand."""
USUAL_TILES = 147
"""Tiles and colours of a frame of 256x256, up to which what is needed of them was found. Of 46 single clear panes at 36
to 84 degrees, with free wallpapers of 640x640, 7 were taken for tinted glass by all tiles, 2 are by these, and of 61 at
12 to 40 degrees 6 for several panes; of 256x256 one in a hundred is."""


@dataclass(frozen=True)
class TileFit:
    """A window, and minus the log likelihood of every tile and colour under it, (tile,)."""

    window: Window
    refractive_index: float
    misfits: Values

    @property
    def misfit(self) -> float:
        """That of the frame."""
        return float(self.misfits.sum())

    def gain_per_tile(self, other: TileFit) -> float:
        """Log likelihood per tile by which it is likelier than another one."""
        return (other.misfit - self.misfit) / len(self.misfits)

    def surer_than(self, other: TileFit) -> float:
        """Standard errors by which it is likelier than another one; negative where it is less likely."""
        gains = other.misfits - self.misfits
        return float(gains.sum() / max(math.sqrt(float(gains @ gains)), _NO_ERROR))

    def believed_over(self, other: TileFit, usual: int = USUAL_TILES) -> float:
        """The same, of frames with more tiles than usual as if they had as many.

        What layers are not as the likelihood takes them to be makes chance images likelier in all tiles alike: the more
        there are, the surer they are of these.
        """
        return self.surer_than(other) * min(1.0, math.sqrt(usual / len(self.misfits)))


_NO_ERROR = 1e-9
"""For none at all, of windows that are the same."""


class TileLikelihood:
    """Likelihood of windows given the spectra of a capture's tiles.

    Parameters
    ----------
    frame : PlateFrame
        At the azimuth of the windows.
    """

    def __init__(self, frame: PlateFrame) -> None:
        self._side = side = min(TILE_PX, *frame.images.shape[-2:])
        self._azimuth_deg = frame.azimuth_deg
        use, along, across, multiplicity = usable_frequencies(side, frame.azimuth_deg)
        every, counts, radius = use.copy(), multiplicity, np.hypot(along, across)
        coarse = radius < HIGHEST_TILE_FREQUENCY
        use[use], along, across, multiplicity = coarse, along[coarse], across[coarse], multiplicity[coarse]
        cell = frequency_cells(along, across)
        order = np.argsort(cell, kind="stable")
        self._cells = np.searchsorted(cell[order], np.arange(cell.max(initial=-1) + 2))
        rows, columns = np.broadcast_arrays(*frequencies(side, side))
        self._rows, self._columns = rows[use][order], columns[use][order]
        self._multiplicity = np.ascontiguousarray(multiplicity[order])
        (n_par, n_cross), (_, n_perp) = frame.covariance
        data, power = _products(frame, side, (use, order), 0.0)
        blur_px2 = squared_blur(power[every], float(n_par + n_perp), radius, counts)
        self._natural = natural_power(self._columns, self._rows, blur_px2)
        self._data = data if blur_px2 == 0 else _products(frame, side, (use, order), blur_px2)[0]
        self._n_colours = frame.images.shape[1]
        self._places: dict[bytes, tuple[NDArray[np.complex128], Values]] = {}
        noise = np.array([n_par, n_perp, n_cross], np.float32)
        self._noise = np.broadcast_to(noise[:, None, None], (3, self._cells.size - 1, self._data.shape[-1])).copy()

    @property
    def n_tiles(self) -> int:
        """Tiles that are looked at, in every colour."""
        return int(self._data.shape[-1])

    def powers(self, fit: TileFit) -> Powers:
        """The powers that suit a window: those near it can be compared by them at little cost, see `glanced`."""
        return self._misfits(fit.window, fit.refractive_index, self._first_powers())[1]

    def glanced(self, window: Window, refractive_index: float, powers: Powers) -> float:
        """Minus log likelihood of a window whose powers are about those given."""
        return float(self._misfits(window, refractive_index, powers, _ROUNDS)[0].sum())

    def luminance(self) -> TileLikelihood:
        """That of the colours' sum alone, which takes a third of the time."""
        return self._every(self._n_colours)

    def some(self, most: int) -> TileLikelihood:
        """That of so many tiles at most, spread over the frame."""
        return self._every(math.ceil(self._data.shape[-1] / most))

    def with_ghosts_along(self, direction_deg: float) -> TileLikelihood:
        """That of panes whose double images lie along a direction in the image that is not their azimuth's.

        So they do where the polarizer's angles start elsewhere.
        """
        other = copy.copy(self)
        other._azimuth_deg = direction_deg
        return other

    def _every(self, step: int) -> TileLikelihood:
        other = copy.copy(self)
        other._data, other._noise = (np.ascontiguousarray(part[..., ::step]) for part in (self._data, self._noise))
        return other

    def fitted(self, window: Window, refractive_index: float) -> TileFit:
        """How likely the tiles are under a window, with the powers that suit it."""
        return TileFit(window, refractive_index, self._misfits(window, refractive_index, self._first_powers())[0])

    def nearest(self, window: Window, refractive_index: float, free: tuple[str, ...] = ("incidence_deg",)) -> TileFit:
        """The likeliest window near one, as far as some of its numbers go."""
        for _ in range(_TURNS if free else 0):
            misfits, powers = self._misfits(window, refractive_index, self._first_powers())
            # A pane that hardly mirrors is told by nothing.
            if not np.all(np.isfinite(misfits)):
                break

            at, box = _numbers(window, free)
            step = box.newton(self._misfit_near(window, refractive_index, free, powers))
            window = _moved(window, free, step.point)
            if np.all(np.abs(step.point - at) < _AT_REST * box.step):
                break
        return self.fitted(window, refractive_index)

    def surer_of_side(self, fit: TileFit, free: tuple[str, ...]) -> float:
        """Standard errors by which a window with its ghosts is likelier than one with them on the other side."""
        opposite = replace(fit.window, pane_shift=-fit.window.pane_shift)
        return fit.surer_than(self.nearest(opposite, fit.refractive_index, free))

    def errors(self, fit: TileFit, free: tuple[str, ...]) -> Values:
        """Standard errors of some numbers of a likeliest window, by the curvature; infinite where it tells none."""
        window, index = fit.window, fit.refractive_index
        powers = self.powers(fit)
        curvature = _numbers(window, free)[1].curvature(self._misfit_near(window, index, free, powers))
        if not np.all(np.isfinite(curvature)) or np.linalg.eigvalsh(curvature)[0] <= 0:
            return np.full(len(free), math.inf)
        return np.sqrt(np.diag(np.linalg.inv(curvature)))

    def _misfit_near(
        self, window: Window, refractive_index: float, free: tuple[str, ...], powers: Powers
    ) -> Callable[[Values], float]:
        """Minus log likelihood by the free numbers of windows near one whose powers are given."""

        def misfit(x: Values) -> float:
            return self.glanced(_moved(window, free, x), refractive_index, powers)

        return misfit

    def _first_powers(self) -> Powers:
        return np.full((2, self._cells.size - 1, self._data.shape[-1]), FIRST_LEVEL, np.float32)

    def _misfits(
        self, window: Window, refractive_index: float, powers: Powers, rounds: int = _FIRST_ROUNDS
    ) -> tuple[Values, Powers]:
        """Minus log likelihood of each tile, and the powers, begun from others."""
        from polaropt.estimation.flat.windows.tile_kernels import tile_misfits

        response, fitted, out = self._response(window, refractive_index), powers.copy(), np.empty(powers.shape[-1])
        data = (response, self._noise, self._data, self._multiplicity, self._natural, self._cells)

        def some(start: int, stop: int) -> None:
            tile_misfits(*data, FREEDOM, _LEAST_FACTOR, rounds, fitted, out, start, stop)

        in_blocks(some, len(out), _TILES_OF_A_THREAD)
        return out, fitted

    def _response(self, window: Window, refractive_index: float) -> NDArray[np.float32]:
        """What a window makes of both layers of power 1, transmission first: Hermitian matrices, (2, 4, n)."""
        orders, images = images_of(window, refractive_index)
        degrees = np.array([window.behind_degree, window.mirrored_degree])
        # Along and across.
        images = images * ((1 + np.outer(degrees, [1, -1])) * (1 + window.exposed_along * np.array([1, -1])))[:, None]
        azimuth = math.radians(self._azimuth_deg)
        along = orders[:, 0] * window.pane_shift + orders[:, 1] * window.gap_along
        across = orders[:, 1] * window.gap_across
        right = along * math.cos(azimuth) + across * math.sin(azimuth)
        down = across * math.cos(azimuth) - along * math.sin(azimuth)
        moved, within = self._placed(right, down)
        # Of both layers, along and across: every image, and all that the others have in common with it.
        alone = np.ascontiguousarray(images.swapaxes(1, 2))[..., None] * moved
        common = (within @ alone.view(np.float64)).view(np.complex128)
        cross = (alone[:, 1].conj() * common[:, 0]).sum(axis=1)
        response = np.empty((2, 4, self._columns.size), np.float32)
        response[:, :2] = (alone.real * common.real + alone.imag * common.imag).sum(axis=2)
        response[:, 2], response[:, 3] = cross.real, cross.imag
        return response

    def _placed(self, right: Values, down: Values) -> tuple[NDArray[np.complex128], Values]:
        """Transfer functions of images so many pixels off (image, n), and what their tiles have in common.

        Of a search's windows many have their images in the same places, and differ in brightness alone.
        """
        places = right.tobytes() + down.tobytes()
        found = self._places.get(places)
        if found is None:
            within = hann_autocorrelation(np.subtract.outer(right, right) / self._side)
            within *= hann_autocorrelation(np.subtract.outer(down, down) / self._side)
            found = bilinear_transfer(right, down, self._columns, self._rows), within
            if len(self._places) >= _MOST_PLACES:
                self._places.clear()
            self._places[places] = found
        return found


@kept_while_alive
def tile_likelihood(frame: PlateFrame) -> TileLikelihood:
    """Likelihood of windows given the tiles of a frame, which one step after another asks for."""
    return TileLikelihood(frame)


_MOST_DEGREE = 0.95
"""Of polarization: beyond, hardly any light is left to tell the rest. Set by hand."""
_SEARCH = {
    "incidence_deg": (0.6, *INCIDENCE_SEARCH_DEG),
    "pane_shift": (0.25, -FARTHEST_SHIFT_PX, FARTHEST_SHIFT_PX),
    "gap_along": (0.25, -FARTHEST_SHIFT_PX, FARTHEST_SHIFT_PX),
    "gap_across": (0.25, -FARTHEST_SHIFT_PX, FARTHEST_SHIFT_PX),
    "absorption": (0.1, 0.0, MOST_ABSORPTION),
    "behind_degree": (0.05, -_MOST_DEGREE, _MOST_DEGREE),
    "mirrored_degree": (0.05, -_MOST_DEGREE, _MOST_DEGREE),
    "exposed_along": (0.005, -0.1, 0.1),
}
"""Step, and least and greatest value, of what is searched. Set by hand."""
_TURNS, _AT_REST = 4, 0.1
"""In which the powers are fitted to the last window, and the move, in steps, that ends them. Set by hand."""


def _numbers(window: Window, free: tuple[str, ...]) -> tuple[Values, Box]:
    """Some numbers of a window, and where near them a search may go."""
    at = np.array([getattr(window, name) for name in free])
    steps, low, high = np.array([_SEARCH[name] for name in free]).T
    return at, Box(np.clip(at, low + steps, high - steps), steps, low, high)


def _moved(window: Window, free: tuple[str, ...], x: Values) -> Window:
    """A window with other numbers."""
    return replace(window, **dict(zip(free, x.tolist(), strict=True)))


def _products(
    frame: PlateFrame, side: int, places: tuple[NDArray[np.bool_], NDArray[np.intp]], blur_px2: float
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """What the likelihood is shown of tiles, (4, n, tile), and the mean power of both polarizations together, (y, x).

    `places` are the frequencies that are used (y, x), and the order in which these stand.
    """
    use, order = places
    tiles, power = [], np.zeros(use.shape, np.float32)
    for spectra in tile_spectra(frame, side, tile_corners(frame.valid, side), blur_px2):
        power += (spectra.real**2 + spectra.imag**2).sum(axis=(0, 1))
        par, perp = spectra[..., use][..., order]
        cross = par * perp.conj()
        tiles.append(np.stack([np.abs(par) ** 2, np.abs(perp) ** 2, cross.real, cross.imag]))
    data = np.concatenate(tiles, axis=1)
    return np.ascontiguousarray(data.swapaxes(1, 2), dtype=np.float32), power / np.float32(data.shape[1])


def natural_power(columns: Values, rows: Values, blur_px2: float = 0.0) -> NDArray[np.float32]:
    """Power of natural images at angular frequencies per pixel, up to a factor, as far as they are blurred."""
    squared = columns**2 + rows**2
    return np.asarray(blurred_power(squared, blur_px2) / np.maximum(squared, _NO_ERROR), np.float32)


def frequency_cells(along: Values, across: Values) -> NDArray[np.intp]:
    """Number of the cell that each frequency is in: rings, split into as many directions as have enough of them."""
    radius, direction = np.hypot(along, across), np.arctan2(across, along) % np.pi / np.pi
    ring = np.floor(np.log(radius / radius.min(initial=math.inf)) / _BAND).astype(np.intp)
    cell, first = np.empty(ring.shape, np.intp), 0
    for here in (ring == k for k in np.unique(ring)):
        n = max(1, int(np.count_nonzero(here)) // _PER_CELL)
        cell[here] = first + np.minimum((direction[here] * n).astype(np.intp), n - 1)
        first += n
    # A direction without any frequency is no cell.
    return np.asarray(np.unique(cell, return_inverse=True)[1], np.intp)
