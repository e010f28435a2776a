"""What tiles of a raw mosaic's samples tell of a flat pane: where its ghosts are, and the incidence.

A mosaic of polarizers keeps the polarized light beside two of its carriers, where fine detail of the scene lies, too:
edges along the rows beside the one, edges along the columns beside the other. On the mean over the frame both pass for
polarized light; but tile by tile mostly one of them is clean. So in every tile each carrier counts as far as the detail
beside it leaves it to, and how the pane mixes the layers is told from what is left, as
`polaropt.estimation.flat.windows.tiles` tells it from photographs.

Of a color mosaic the luminance is looked at, between the carriers of the colors.

References
----------
D. Alleysson, S. Susstrunk, J. Herault, Linear demosaicing inspired by the human visual system, IEEE TIP, 2005: a mosaic
as a picture beside carriers.
D. B. Rubin, D. T. Thayer, EM algorithms for ML factor analysis, Psychometrika, 1982.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from polaropt.capture import Capture, RawSamples
from polaropt.estimation.flat.ghosts import TILE_PX, tile_corners, usable_frequencies
from polaropt.estimation.flat.samples.edges import WindowEdges
from polaropt.estimation.flat.samples.ghosts import off_level
from polaropt.estimation.flat.samples.panes import LikelyPanes, free_numbers, likeliest_window, several_panes
from polaropt.estimation.flat.samples.single import (
    SURER_THAN_OTHERS,
    USUAL_TILES_OF_MOSAIC,
    likeliest_of_other_index,
    likeliest_panes,
    likeliest_tinted,
    tells_tint,
)
from polaropt.estimation.flat.windows.likelihood import Window
from polaropt.estimation.flat.windows.tiles import TileFit, TileLikelihood, frequency_cells, natural_power
from polaropt.numerics import hann_spectra, hann_tile
from polaropt.optics import SceneParameters

Values = NDArray[np.float64]

_HIGHEST_FREQUENCY = 1.0
"""Highest that is used, in rad per pixel: beyond, detail hides what is polarized, and colors are mixed in. By trial on
mosaics of photographs that no figure is taken of, as all below."""
_CARRIERS = ((1, 0), (0, 1), (1, 1))
"""Along rows and columns, in half turns per pixel, where a mosaic of polarizers keeps what is polarized."""
_ROUNDS = 30
"""In which the power of the detail beside the carriers is fitted."""
_OF_TILE = 20.0
"""Frequencies' worth by which detail beside a carrier is as strong as that of the whole tile makes expect, a picture's
power falling with the square of the frequency. Few frequencies of one cell alone tell too much or too little of it:
incidences by tiles come out a third closer. By trial (10 to infinity)."""
_LEAST_FACTOR = 0.02
"""By which a power shrinks in a round at most. Set by hand."""
_SURE = 2.0
"""Standard errors by which tiles must find ghosts likelier than none where edges are not asked."""
_DOUBT, _OF_SURE, _OF_SIDE, _OF_EDGES, _FEW_EDGES, _PER_PX = 4.5, 0.6, 0.8, 0.35, 0.005, 0.18
"""Log odds of ghosts that tiles find: by the standard errors by which they are likelier than none, and than the same
on the other side; by the share of edges by which the layers have fewer with them on their side, whose inverse
hyperbolic sine counts, in units of a few; and by their distance in pixels of the sensor, as what passes for ghosts is
mostly close. Fitted to 1271 mosaics of photographs that no figure is taken of, 788 without ghosts (20 to 80 degrees,
shifts of 0.5 to 20 px, noise 0.2 to 3 %, a lens blur of 0.3 to 1 px; an engine of its own, and
`studies.random_windows`, even seeds from 70000): 13 ghosts are found that are none, and 17 a pixel and more off, of 483
true ones 303 right. By the first standard errors, and edges of close ones, alone these were 40, 21 and 315."""
_SHIFT_WIDER, _LEAST_ERROR_PX = 9.0, 0.2
"""What the standard error of a shift by the curvature is multiplied by, and the least that is believed."""
_WIDER, _TINT_WIDER = 7.0, 3.5
"""What the standard errors of an incidence and of an absorption by the curvature are multiplied by: tiles overlap, and
layers are not quite what they are taken to be. Of 138 panes before unpolarized light (`studies.random_windows --sensor
mono`, even seeds 9930000 to 9930598) 82 % of the incidences of tiles and cells together lie within two errors so, 72 %
with half of it, and the median of them is 0.42 degrees off, not 0.52."""
_LEAST_TINT_ERROR = 0.09
"""The least standard error of an absorption that is believed: 7 random windows of tinted glass are so far off, root
mean square (`studies.random_windows --sensor mono`, even seeds from 80000)."""
_WIDER_BY = {"incidence_deg": (_WIDER, 0.0), "absorption": (_TINT_WIDER, _LEAST_TINT_ERROR)}
"""By what those of a window's numbers are multiplied, and the least; of all others as of shifts."""
_FIRST_ABSORPTIONS, _MOST_ABSORPTION = (0.15, 0.6), 1.5
"""Absorptions where a search begins, and up to which one is told. Set by hand."""


_WHOLE_PX = 18.0
"""Ghost shift in pixels of the sensor up to which tiles hold double images nearly whole. Set by hand."""


class _ToldTint(NamedTuple):
    """Least absorption, and log likelihood per tile and standard errors by which a tinted pane is likelier than a clear
    one with the same ghosts."""

    least: float
    gain_per_tile: float
    sure: float


_TOLD_TINT, _TOLD_TINT_OF_FAR = _ToldTint(0.15, 0.12, 1.7), _ToldTint(0.08, 1.2, 2.8)
"""From which on tint is told. Of 55 random mosaics of clear glass whose ghosts are found (`studies.random_windows
--sensor mono`, even seeds from 9710000, 9720000 and 9760000) none is told so, of 57 of tinted glass (from 9700000 and
9750000) 18 are. Ghosts farther off than tiles hold whole are dim beside them: of 86 random windows of one clear pane
(even seeds from 80000, 160000 and 200000) none gains more than 0.93 by 0.08 and more, the most with such ghosts."""
_LEAST_TILES = 9
"""Tiles that can tell: fewer say nothing."""
_LEAST_POWER = 1e-30
"""Of what nothing is left of."""


class SampledTiles:
    """Spectra of a mosaic's tiles at low frequencies: the light, and what is beside two carriers.

    Parameters
    ----------
    samples : RawSamples
    angles_deg : tuple of float
        Of the photographs that they sample.
    noise : float
        Standard deviation of a sample's noise.
    """

    def __init__(self, samples: RawSamples, angles_deg: tuple[float, ...], noise: float) -> None:
        period = samples.sampling.period
        self.period, self.noise = period, noise
        self.side = side = min(TILE_PX, *samples.values.shape) // period * period
        use, columns, rows, multiplicity = usable_frequencies(side, 0.0)
        coarse = np.hypot(columns, rows) < _HIGHEST_FREQUENCY
        use[use], columns, rows = coarse, columns[coarse], rows[coarse]
        cell = frequency_cells(columns, rows)
        order = np.argsort(cell, kind="stable")
        self.rows, self.columns, self.cell = rows[order], columns[order], cell[order]
        self.multiplicity = multiplicity[coarse][order].astype(np.float64)
        self._of_cells = np.eye(self.cell.max(initial=-1) + 1)[self.cell] * self.multiplicity[:, None]
        carriers, self._lines = _polarized_carriers(samples, angles_deg)
        down, across = (index[order] for index in np.nonzero(use))
        places = _beside(carriers, down, across, side)
        self.detail = np.stack([self._mean(_power_of_detail(self.rows, self.columns, carrier)) for carrier in carriers])
        """Power of a picture's detail beside either carrier but for a factor, (2, cell)."""
        window = hann_tile(side, side)
        spectra: list[list[NDArray[np.complexfloating[Any, Any]]]] = []
        for top, left in tile_corners(samples.valid, side, period):
            part = (slice(top, top + side), slice(left, left + side))
            tile = off_level(samples.values[part], samples.valid[part], window, period)
            spectrum = hann_spectra(tile, period)
            spectra.append([np.where(mirrored, spectrum[place].conj(), spectrum[place]) for place, mirrored in places])
        self.spectra = np.array(spectra).reshape(-1, 3, self.cell.size)
        """(tile, 3, frequency), samples as they are; a photograph has half of the light."""

    def moments(self, first: int, second: int) -> NDArray[np.complex128]:
        """Sums over each cell of frequencies of a spectrum's conjugate times another, (tile, cell)."""
        return np.asarray((self.spectra[:, first].conj() * self.spectra[:, second]) @ self._of_cells)

    @property
    def counts(self) -> Values:
        """Frequencies in a cell."""
        return np.asarray(self._of_cells.sum(axis=0))

    def _mean(self, values: Values) -> Values:
        return np.asarray(values @ self._of_cells / self.counts)

    def shares(self, azimuth_deg: float) -> tuple[float, float]:
        """What is beside either carrier of light polarized along an azimuth, less what is polarized across."""
        twice = 2 * math.radians(azimuth_deg)
        one, other = self._lines @ np.array([math.cos(twice), math.sin(twice)])
        return float(one), float(other)


def _power_of_detail(rows: Values, columns: Values, carrier: tuple[int, int]) -> Values:
    """Of a picture that is seen beside a carrier, at frequencies off it in rad per pixel."""
    down, across = (
        math.pi - np.abs(off) if shifted else off for off, shifted in zip((rows, columns), carrier, strict=True)
    )
    return np.asarray(1 / (down * down + across * across))


def _beside(
    carriers: list[tuple[int, int]], rows: NDArray[np.intp], columns: NDArray[np.intp], side: int
) -> list[tuple[tuple[NDArray[np.intp], NDArray[np.intp]], NDArray[np.bool_]]]:
    """Where half a tile's spectrum has frequencies, at zero and beside carriers, and where it has their conjugates."""
    half, places = side // 2, []
    for y, x in ((0, 0), *carriers):
        down, across = (rows + half * y) % side, (columns + half * x) % side
        mirrored = across > half
        places.append(((np.where(mirrored, -down % side, down), np.where(mirrored, side - across, across)), mirrored))
    return places


def _polarized_carriers(
    samples: RawSamples, angles_deg: tuple[float, ...]
) -> tuple[list[tuple[int, int]], NDArray[np.float64]]:
    """The two carriers that have most of what is polarized, and what is there of both components, (2, 2)."""
    twice = 2 * np.radians(angles_deg)[np.array(samples.sampling.photographs)]
    middle = samples.sampling.period // 2
    spectra = [np.fft.fft2(component).real / (2 * component.size) for component in (np.cos(twice), np.sin(twice))]
    lines = np.array([[spectrum[middle * y, middle * x] for spectrum in spectra] for y, x in _CARRIERS])
    most = np.sort(np.argsort(-np.square(lines).sum(axis=1), kind="stable")[:2])
    return [_CARRIERS[k] for k in most], lines[most]


class SampledTileLikelihood(TileLikelihood):
    """Likelihood of windows given the spectra of a mosaic's tiles.

    Where the base class has the light polarized along and across, this has all light, and the difference of both.

    Parameters
    ----------
    tiles : SampledTiles
    azimuth_deg : float
        Of the windows, whose shifts are in pixels of the sensor.
    """

    def __init__(self, tiles: SampledTiles, azimuth_deg: float) -> None:
        # Nothing of the base class's own is kept: it reads photographs.
        self._side, self._azimuth_deg, self._n_colours = tiles.side, azimuth_deg, 1
        self._rows, self._columns = tiles.rows, tiles.columns
        self._multiplicity = tiles.multiplicity.astype(np.float32)
        self._cells = np.searchsorted(tiles.cell, np.arange(tiles.counts.size + 1))
        self._natural = natural_power(tiles.columns, tiles.rows)
        self._places = {}
        weights, of_difference = _cleanest(tiles, azimuth_deg, tiles.noise**2)
        light = 2 * tiles.spectra[:, 0]
        difference = (weights[:, :, tiles.cell] * tiles.spectra[:, 1:].swapaxes(0, 1)).sum(axis=0)
        cross = light * difference.conj()
        data = np.stack([np.abs(light) ** 2, np.abs(difference) ** 2, cross.real, cross.imag])
        self._data = np.ascontiguousarray(data.swapaxes(1, 2), dtype=np.float32)
        of_light = np.full_like(of_difference, 4 * tiles.noise**2)
        noises = np.stack([of_light, of_difference, np.zeros_like(of_difference)])
        self._noise = np.ascontiguousarray(noises.swapaxes(1, 2), dtype=np.float32)

    def _response(self, window: Window, refractive_index: float) -> NDArray[np.float32]:
        par, perp, real, imaginary = super()._response(window, refractive_index).swapaxes(0, 1)
        both = par + perp
        return np.stack([both + 2 * real, both - 2 * real, par - perp, -2 * imaginary], axis=1)


def _cleanest(tiles: SampledTiles, azimuth_deg: float, noise_power: float) -> tuple[Values, Values]:
    """By what the two carriers are multiplied for the light polarized along less across, and the noise left in it.

    Shapes (2, tile, cell) and (tile, cell). Detail beside the carriers is noise of a power of its own there.
    """
    n, (a, b) = tiles.counts, tiles.shares(azimuth_deg)
    one, other = (tiles.moments(k, k).real / n for k in (1, 2))
    both = tiles.moments(1, 2).real / n
    beside_one, beside_other = (np.maximum(seen / 2, noise_power) for seen in (one, other))
    polarized = np.minimum(one, other) + 4 * noise_power
    # Of what is seen beside both, the part that goes together is polarized, the rest is detail.
    for _ in range(_ROUNDS):
        v, w, vw = polarized * a * a + beside_one, polarized * b * b + beside_other, polarized * a * b
        size = np.maximum(v * w - vw * vw, _LEAST_POWER)
        # Inverse covariance, and what it makes of the data on both sides.
        i, j, ij = w / size, v / size, -vw / size
        left, across, back, right = (
            i * one + ij * both,
            i * both + ij * other,
            ij * one + j * both,
            ij * both + j * other,
        )
        ii, jj, cross = left * i + across * ij, back * ij + right * j, left * ij + across * j
        found = a * a * ii + b * b * jj + 2 * a * b * cross
        polarized = polarized * np.maximum(found / (a * a * i + b * b * j + 2 * a * b * ij), _LEAST_FACTOR)
        beside_one, beside_other = (
            np.maximum(_detail(power + power * (seen - expected) * power, n, shape), noise_power)
            for power, seen, expected, shape in zip(
                (beside_one, beside_other), (ii, jj), (i, j), tiles.detail, strict=True
            )
        )
    told = np.stack([a / beside_one, b / beside_other])
    noise = 1 / (a * told[0] + b * told[1])
    return told * noise, noise


def _detail(found: Values, counts: Values, shape: Values) -> Values:
    """Power of detail that was found in cells (tile, cell), as far as those tell more of it than the whole tile."""
    of_tile = (counts * found / shape).sum(axis=1, keepdims=True) / counts.sum() * shape
    return np.asarray((counts * found + _OF_TILE * of_tile) / (counts + _OF_TILE))


def _surer_than_others(found: TileFit, other: TileFit) -> bool:
    return found.believed_over(other, USUAL_TILES_OF_MOSAIC) > SURER_THAN_OTHERS


def _are_likely(sure: float, sure_of_side: float, fewer_edges: float, shift_px: float) -> bool:
    """Whether the odds are for ghosts that tiles find likelier than none and than on the other side, in errors."""
    edges = math.asinh(fewer_edges / _FEW_EDGES)
    return _OF_SURE * sure + _OF_SIDE * sure_of_side + _OF_EDGES * edges + _PER_PX * abs(shift_px) > _DOUBT


@dataclass(frozen=True)
class PaneOfTiles:
    """What tiles of a mosaic tell of a flat window that is seen from far, in pixels of the sensor.

    Attributes
    ----------
    tiles : SampledTiles
    azimuth_deg : float
        Of the window.
    edges : WindowEdges, optional
        Of windows of this azimuth. Default: tiles are believed, and not asked for several panes.
    """

    tiles: SampledTiles
    azimuth_deg: float
    edges: WindowEdges | None = None

    @cached_property
    def _likelihood(self) -> SampledTileLikelihood:
        return SampledTileLikelihood(self.tiles, self.azimuth_deg)

    def ghosts(self, asked: SceneParameters, incidence_deg: float) -> tuple[float, float]:
        """Where the ghosts of a single pane are, 0 for none, and the standard error of that."""
        place, best = likeliest_panes(self._likelihood, asked, incidence_deg)
        if best is place or not self._are_believed(place, best, asked):
            return 0.0, math.inf
        return best.window.pane_shift, self.errors(best, ("pane_shift",))[0]

    def _are_believed(self, place: TileFit, ghosts: TileFit, asked: SceneParameters) -> bool:
        """Whether ghosts are any, that are likelier than images in place."""
        sure, shift = ghosts.surer_than(place), ghosts.window.pane_shift
        if self.edges is None:
            return sure >= _SURE
        free = ("incidence_deg",) if asked.incidence_deg is None else ()
        sure_of_side = self._likelihood.surer_of_side(ghosts, free)
        return _are_likely(sure, sure_of_side, self.edges.fewer(ghosts.window), shift)

    def single(self, asked: SceneParameters, incidences_deg: Sequence[float]) -> TileFit:
        """The likeliest single pane near the likeliest of some incidences."""
        free = ("incidence_deg",) if asked.incidence_deg is None else ()
        starts = [Window(incidence, 0.0, absorption=asked.absorption or 0.0) for incidence in incidences_deg]
        place = min(
            (self._likelihood.nearest(start, asked.index, free) for start in starts), key=lambda fit: fit.misfit
        )
        return likeliest_panes(self._likelihood, asked, place.window.incidence_deg)[1]

    def tinted(self, asked: SceneParameters, single: TileFit) -> TileFit | None:
        """The likeliest single pane of tinted glass whose ghosts lie apart, near one; None where none is possible."""
        is_open = asked.incidence_deg is None
        free = ("incidence_deg",) if is_open else ()
        place = self._likelihood.nearest(replace(single.window, pane_shift=0.0), asked.index, free)
        return likeliest_tinted(self._likelihood, place, incidence_open=is_open)

    def tells_tint(
        self, asked: SceneParameters, found: TileFit, own: TileFit, *others: TileFit, across: bool = False
    ) -> bool:
        """Whether a tinted pane is surely likelier than the clear one of its axis, others, and what is no tint."""
        is_open, likelihood = asked.incidence_deg is None, self._likelihood
        if not tells_tint(likelihood, found, (own, *others), across=across, incidence_open=is_open):
            return False
        two = likeliest_window(likelihood, own, 2, incidence_open=is_open)
        return _surer_than_others(found, two) and self._unlike_other_index(found, incidence_open=is_open)

    def _unlike_other_index(self, found: TileFit, *, incidence_open: bool) -> bool:
        """Whether a tinted pane is surely likelier than a clear one of another index."""
        window, told = found.window, found.refractive_index
        other = likeliest_of_other_index(self._likelihood, window, told, incidence_open=incidence_open)
        return _surer_than_others(found, other)

    def several(self, asked: SceneParameters, single: TileFit, *beside: TileFit) -> LikelyPanes | None:
        """The window of several panes that may be likelier than a single one, and than others; None without."""
        if self.edges is None:
            return None
        is_open = asked.incidence_deg is None
        return several_panes(self._likelihood, single, self.edges, beside=beside, incidence_open=is_open)

    def of_panes(self, asked: SceneParameters, near: Window, incidences_deg: Sequence[float]) -> TileFit:
        """The likeliest window of as many panes as one has, near it or what mirrors as single panes do."""
        is_open = asked.incidence_deg is None
        single = self.single(asked, incidences_deg)
        found = likeliest_window(self._likelihood, single, near.n_panes, incidence_open=is_open)
        here = self._likelihood.nearest(near, asked.index, free_numbers(incidence_open=is_open))
        return min(found, here, key=lambda fit: fit.misfit)

    def errors(self, fit: TileFit, free: tuple[str, ...]) -> tuple[float, ...]:
        """Standard errors of numbers of a likeliest window that were free, degrees or pixels; infinite if untold."""
        of_curvature = self._likelihood.errors(fit, free)
        if not np.all(np.isfinite(of_curvature)):
            # Together they lie in a valley; each alone may be told.
            of_curvature = np.concatenate([self._likelihood.errors(fit, (name,)) for name in free])
        wider = (_WIDER_BY.get(name, (_SHIFT_WIDER, _LEAST_ERROR_PX)) for name in free)
        return tuple(
            math.hypot(times * float(error), least) for (times, least), error in zip(wider, of_curvature, strict=True)
        )

    def tint(self, scene: SceneParameters, *, incidence_open: bool = True) -> tuple[float, float] | None:
        """Absorption of a single pane whose ghosts are dimmer than those of clear glass, and its error; None of others.

        Parameters
        ----------
        scene : SceneParameters
            With ghosts.
        incidence_open : bool
            Whether the incidence is to be found; else it is that of the scene.
        """
        incidence, _, shift = scene.values()
        free = ("incidence_deg", "pane_shift") if incidence_open else ("pane_shift",)
        clear = self._likelihood.nearest(Window(incidence, shift), scene.index, free)
        starts = (replace(clear.window, absorption=absorption) for absorption in _FIRST_ABSORPTIONS)
        fits = (self._likelihood.nearest(start, scene.index, (*free, "absorption")) for start in starts)
        dark = min(fits, key=lambda fit: fit.misfit)
        absorption, told = dark.window.absorption, _TOLD_TINT if abs(shift) <= _WHOLE_PX else _TOLD_TINT_OF_FAR
        possible = told.least < absorption < _MOST_ABSORPTION
        sure = dark.believed_over(clear, USUAL_TILES_OF_MOSAIC) >= told.sure
        sure &= dark.gain_per_tile(clear) >= told.gain_per_tile
        if not (possible and sure and self._unlike_other_index(dark, incidence_open=incidence_open)):
            return None
        (error,) = self.errors(dark, ("absorption",))
        return absorption, error if math.isfinite(error) else absorption

    def incidence(self, scene: SceneParameters) -> tuple[float, float] | None:
        """The incidence near that of a scene, and its standard error, in degrees; None where none is told."""
        (incidence, _, shift), free = scene.values(), ("incidence_deg",)
        fit = self._likelihood.nearest(Window(incidence, shift, absorption=scene.absorption or 0.0), scene.index, free)
        (error,) = self.errors(fit, free)
        return (fit.window.incidence_deg, error) if math.isfinite(error) else None


def tiles_of_mosaic(capture: Capture, noise: float) -> SampledTiles | None:
    """Tiles of a mosaic; None of any other capture, and where there are too few.

    Parameters
    ----------
    capture : Capture
    noise : float
        Standard deviation of a sample's noise.
    """
    if capture.cells is None:
        return None
    tiles = SampledTiles(capture.cells.samples, capture.angles_deg, noise)
    return tiles if len(tiles.spectra) >= _LEAST_TILES else None
