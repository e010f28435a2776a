"""How unlike photographs were exposed, as they tell themselves, and their layers: by some per cent, of each colour.

A shutter, a lamp's light and a filter that is turned by hand are not the same each time. Photographs whose exposures
differ do not add up, and behind a flat pane leave light polarized across its plane of incidence, both in proportion to
all light: that tells all ratios but one, two of the three of four photographs, whatever the angles are off by. The last
one, of light polarized along that plane and across, makes the pane look as if it polarized more or less, and costs a
layer 5 to 10 dB. No pixel tells it, but how the pane mixes both layers does: tiles of the frame, which tell the
incidence, tell both together, as far as the other ratios make expect any.

Where cameras balance white in each photograph anew, colours have ratios of their own. The last ones of these differ
by what makes all colours mix the layers alike.

A polarization camera takes its photographs at once, but analyzers let through unlike shares of light: their gains are
exposures. What pixels tell of them is sure; tiles of the cells do not tell the last ratio.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import starmap
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from polaropt.capture import (
    Capture,
    Matching,
    Mistakes,
    StokesImages,
    colour_blocks,
    measured_noise,
    orthogonal_pairs,
    plate_frame,
    redundancy_residual,
    stokes_images,
)
from polaropt.estimation.flat.errors import errors_of_gains, polarized_share
from polaropt.estimation.flat.pane_by_tiles import LEAST_TILES
from polaropt.estimation.flat.windows.axis import window_of
from polaropt.estimation.flat.windows.tiles import TileFit, TileLikelihood, tile_likelihood
from polaropt.estimation.ladder import LadderResult, find_scene
from polaropt.estimation.motion import StillPhotographs
from polaropt.estimation.rung import MOST_OF_ALIASES, noise_misfit
from polaropt.estimation.wide.blocks import PolarizedBlocks
from polaropt.numerics import jackknife_error, left_out, middle_part
from polaropt.optics import INCIDENCE_SEARCH_DEG, SceneParameters, analyzer_matrix

Values = NDArray[np.float64]

_MODELS = ("auto", "pixelwise", "ghosts")
"""Models of panes that leave no light polarized between along and across."""
_MOST_UNEVEN, _MOST_UNEVEN_OF_FOUR = 0.25, 0.02
"""Part of the angles that may lie to one side of the circle, or of a quarter of it: none does of equally spaced ones.
Set by hand; of four none that was tried lies off such by more than half a degree."""
_FEWEST_BLOCKS = 100
"""Blocks of 8x8 pixels that tell a ratio. Set by hand."""
_BLOCK_PX = 8
"""Side of blocks over whose noise the share of the polarized light is told. Set by hand."""
_LOOKED_AT_PX = 1024
"""Side of the middle of a frame by which pane and last ratio are looked for. Set by hand, for time and memory."""
_ROUNDS = 2
"""In which ratios are found: products of two of them are small. Set by hand."""
_PARTS = 12
"""Parts of the frame that are left out in turn for a standard error. Set by hand."""
_SURE, _LEAST, _MOST = 5.0, 1e-3, 0.1
"""Standard errors by which photographs must not add up, and the least and greatest ratio that is looked for. Set by
hand: less costs no layer a tenth of a dB, and more has another reason."""
_SEEN = 3.0
"""Standard errors by which they must not add up where what is polarized across surely tells exposures. Set by hand."""
_MOST_ACROSS = 3.0
"""Light polarized across, in units of what does not add up, up to which exposures are the reason, by chance in 85 of
100; with more the light mostly arrives polarized. So it is where the rung for that is tried."""
_MOST_ACROSS_IF_TOLD = 10.0
"""The same where the scene is told: that nothing arrives polarized is known then, unless it was told wrongly. By chance
95 of 100 have less across."""
_LITTLE_ACROSS = 0.005
"""Share of light polarized across up to which exposures are the reason anyway: a screen, or the sky, leaves so little
only where its light stands within a degree or two of the plane of incidence, or across. Set by hand."""
_MOST_ACROSS_OF_MOSAIC = 0.025
"""The same of a mosaic whose photographs do not add up: analyzers' gains that are off by up to 2 % leave as much by
chance in 2 of 100."""
_USUAL_PAIR_GAINS = (1.0, 1.0225)
"""Gains of the 45/135 pair that say nothing of others: of Sony's sensors it is brighter, in eight captures of cameras
of theirs by 1.0205 to 1.0257."""
_MOST_LEFT = 0.15
"""Part of the light polarized across, beyond its noise, that may be left. Set by hand."""
_STEP_DEG, _REACH_DEG, _FINE_STEP_DEG = 1.0, 12.0, 0.05
"""Spacing of the incidences at which tiles are asked, how far they reach, and spacing to which is interpolated. Set by
hand."""
_STEEPEST_DEG = 78.0
"""Incidence beyond which tiles are not asked: a pane across with its layers exchanged is then nearly the same. Of four
such random windows to fit on (even seeds from 900000) three lose by what tiles tell, up to 3 dB, one gains 2."""
_FREE = ("exposed_along",)
"""Number of a window that is the last ratio."""
_MOST_TILES = 800
"""Tiles and colours that are asked. Set by hand, for the time it takes."""
_NATS = 8.0
"""Log likelihood of overlapping tiles that counts as one."""
_NOT_KNOWN = 2.0
"""What the scale of the last ratio, as so many others tell it, is not known by: their mean square is multiplied by one
and this, divided by their number. It and the last by trial on 120 captures of training photographs (25 to 78 degrees,
shifts up to 15 px, noise 0.5 %, four photographs whose exposures are off by 1 or 1.5 %, half of them with angles off by
1 degree; an engine of its own), where the factor is 2: the last ratio, 1.2 or 0.8 % then, is afterwards off by 0.6 or
0.5 % root mean square, by 0.3 % less in 45 or 32 of 100 and by as much more in 2. Half of it gains 2 more of 100, and
harms 4. Leaving tiles out in turn tells its error worse, and so does how sure tiles are of it."""
_MOST_ALONG, _MOST_BY_TOLD = 5.0, 3.0
"""In units of what is expected, beyond which a last ratio that tiles find has another reason, and where an incidence
was told, which may be wrong. Set by hand."""
_LEAST_ERROR = 0.3
"""Standard errors in units of those by exposures of which the other ratios alone tell: the least of the incidence,
and that of the azimuth. By trial."""
_WIDER = 1.5
"""What the standard error of the last ratio is multiplied by afterwards: two in three of those lie within it."""


@dataclass(frozen=True, eq=False)
class Exposures:
    """How long each photograph was exposed.

    Attributes
    ----------
    relative : ndarray, shape (photograph, colour)
        Or (photograph, 1) where all colours have the same. The product of a colour's is 1.
    incidence_error_deg : float
        Standard error of the incidence that follows from what is not known of them.
    azimuth_error_deg : float
        That of the azimuth: a filter that was turned by hand stands hardly better than exposures are.
    swamp_pane : bool
        Whether the pane polarizes no more than they are expected to differ, as seen frontally: tiles may then be sure
        of another pane.
    """

    relative: Values
    incidence_error_deg: float = 0.0
    azimuth_error_deg: float = 0.0
    swamp_pane: bool = False

    def divided_out(self, capture: Capture) -> Capture:
        """Photographs as if all had been exposed alike, and all analyzers of a mosaic had one gain."""
        if self.relative.shape[1] == 1:
            return capture.without_gains(self.relative[:, 0].tolist())
        return capture.replace(intensities=capture.intensities / self.relative.astype(np.float32)[..., None, None])

    def with_errors(self, found: LadderResult) -> LadderResult:
        """What was found of photographs that they were divided out of, with its errors by what stays open of them.

        Where they swamp the pane its incidence was as good as not found, and that counts for the layers, too.
        """
        incidence, azimuth = found.of_gains
        more = math.hypot(incidence, self.incidence_error_deg), math.hypot(azimuth, self.azimuth_error_deg)
        found, estimate = replace(found, of_gains=more), found.estimate
        if not self.swamp_pane or estimate is None or estimate.errors.incidence_deg is None:
            return found
        errors = replace(estimate.errors, incidence_deg=found.errors.incidence_deg)
        return replace(found, estimate=replace(estimate, errors=errors))

    def undone(self, still: StillPhotographs, matching: Matching) -> tuple[StillPhotographs, Matching]:
        """Photographs that were made to agree, and what stands still of them, as if all had been exposed alike.

        Nothing else is wrong with them then.
        """
        capture = self.divided_out(matching.capture)
        of_scene = capture if matching.of_scene is matching.capture else self.divided_out(matching.of_scene)
        alike = still.seen(capture)
        noise, growth = measured_noise(alike)
        still = replace(still, capture=alike, noise=noise, growth=growth, mistakes=Mistakes())
        still = still if matching.noise is None else still.with_noise(matching.noise)
        of_all, balances = self._by_photograph()
        return still, replace(matching, capture=capture, of_scene=of_scene, exposures=of_all, white_balances=balances)

    def _by_photograph(self) -> tuple[tuple[float, ...], tuple[tuple[float, ...], ...]]:
        """What all colours of a photograph share, and what is left of each; the latter empty where there is none."""
        logarithms = np.log(self.relative)
        shared = logarithms.mean(axis=1, keepdims=True)
        balances = np.exp(logarithms - shared) if logarithms.shape[1] > 1 else np.zeros((0, 0))
        return tuple(np.exp(shared[:, 0]).tolist()), tuple(tuple(each) for each in balances.tolist())


def uneven_exposures(capture: Capture, asked: SceneParameters, noise: float, model: str = "auto") -> Exposures | None:
    """Exposures of photographs that do not add up, where these and a flat pane explain all; None else.

    Parameters
    ----------
    capture : Capture
        Four photographs in two orthogonal pairs at 45 degrees, or more at angles that are spread about evenly; of
        others None is told. Those of a mosaic's cells are exposed as unlike as its analyzers' gains are.
    asked : SceneParameters
        What is known of the scene, as for `find_scene`. Where it is told whole, what is polarized across is more
        readily taken for exposures.
    noise : float
        Standard deviation of one photograph's noise.
    model : str
        Rung of the scene, as for `find_scene`.
    """
    seen = _seen(capture, told=asked.complete) if _is_of_flat_pane(asked, model) else None
    if seen is None:
        return None
    middle = capture.part(*middle_part(capture.shape, _LOOKED_AT_PX))
    looked = _Look.at(middle, seen.relative, noise)
    before, after = (_left_across(of, seen.azimuth_deg) for of in (stokes_images(middle, noise), looked.stokes))
    if after > max(0.0, _MOST_LEFT * before):
        return None
    # What aliases in a mosaic's cells passes for polarized light: a flat pane that leaves no more is one there.
    flat = "ghosts" if looked.stokes.aliased and model == "auto" else model
    scene = find_scene(looked.capture, asked, noise, flat).scene
    if scene.rung not in ("pixelwise", "ghosts") or not scene.signal:
        return None
    if seen.of_colours:
        # Colours that mix the layers each in its own way tell the ratio of all worse.
        looked = _Look.at(middle, seen.relative * _along_of_colours(looked, scene, seen), noise)
    relative = looked.relative
    share = polarized_share(looked.stokes.means(_BLOCK_PX))
    untold, turned = errors_of_gains(seen.spread_of_pane / math.sqrt(2), share, scene)
    swamp = asked.incidence_deg is None and seen.spread_of_pane > share
    # In tiles of a mosaic's cells what aliases looks like another pane.
    along = None if swamp or looked.stokes.aliased else _along(looked.stokes, scene, asked, seen)
    if along is None:
        return Exposures(relative, untold, _LEAST_ERROR * turned, swamp)
    ratio, error_deg = along
    relative = relative * _exposed(capture.angles_deg, scene.values()[1], along=ratio)
    return Exposures(relative, max(error_deg, _LEAST_ERROR * untold), _LEAST_ERROR * turned)


@dataclass(frozen=True)
class _Look:
    """Photographs that exposures (photograph, colour) were divided out of."""

    relative: Values
    capture: Capture
    stokes: StokesImages

    @classmethod
    def at(cls, capture: Capture, relative: Values, noise: float) -> _Look:
        divided = Exposures(relative).divided_out(capture)
        return cls(relative, divided, stokes_images(divided, noise))


def _is_of_flat_pane(asked: SceneParameters, model: str) -> bool:
    """Whether nothing that was asked for polarizes light in other ways."""
    return model in _MODELS and not asked.polarized and asked.focal_px is None and not asked.bent


@dataclass(frozen=True)
class _Seen:
    """Exposures as far as pixels tell them.

    Attributes
    ----------
    relative : ndarray, shape (photograph, colour)
        Or (photograph, 1) where all colours have the same.
    azimuth_deg : float
        Modulo 90, along which or across which light is polarized.
    spread : float
        Standard deviation that they make expect of the ratio that pixels do not tell, for all colours.
    spread_of_colours : float
        That of how much the ratio of a colour differs from it.
    """

    relative: Values
    azimuth_deg: float
    spread: float
    spread_of_colours: float = 0.0

    @property
    def of_colours(self) -> bool:
        """Whether colours differ in them."""
        return bool(self.relative.shape[1] > 1)

    @property
    def spread_of_pane(self) -> float:
        """Standard deviation of the mean ratio of all colours, by which the pane seems to polarize more or less."""
        return math.hypot(self.spread, self.spread_of_colours / math.sqrt(self.relative.shape[1]))


def _seen(capture: Capture, *, told: bool) -> _Seen | None:
    """What does not add up, and what is polarized across; None where photographs add up, or something else is wrong.

    A scene that is told says that no light arrives polarized.
    """
    angles = capture.angles_deg
    origin = capture.origin
    given = origin is not None and (origin.exposures_given or origin.calibrated)
    if given or not _spread_evenly(angles):
        return None
    colours = [blocks.astype(np.float64) for blocks in colour_blocks(capture.intensities, capture.mask)]
    together = np.concatenate(colours, axis=1)
    if together.shape[1] < _FEWEST_BLOCKS:
        return None
    if capture.low_passed:
        return _seen_of_mosaic(together, angles, 1.0 if origin is None else origin.pair_gain)
    most = _MOST_ACROSS_IF_TOLD if told else _MOST_ACROSS
    common = _ratios([together], angles)
    alike = [blocks / common.relative for blocks in colours]
    several = len(colours) > 1 and min(blocks.shape[1] for blocks in colours) >= _FEWEST_BLOCKS
    own = _ratios(alike, angles) if several else _NO_RATIOS
    if not (common.told or own.told) or not (common.of_exposures(most) and own.of_exposures(most)):
        return None
    if not own.told:
        return _Seen(common.relative, common.azimuth_deg, common.spread)
    relative = common.relative * own.relative
    return _Seen(relative, own.azimuth_deg, common.spread, own.spread)


def _seen_of_mosaic(blocks: Values, angles_deg: Sequence[float], pair_gain: float) -> _Seen | None:
    """The same of blocks (photograph, n) of a mosaic's cells, of which a gain of the 45/135 pair was divided out.

    Analyzers have the same gains for all colours.
    """
    divided = np.ones((len(angles_deg), 1))
    pairs = orthogonal_pairs(angles_deg)
    if pairs is not None:
        divided[list(pairs[1])] = min(
            (pair_gain / usual for usual in _USUAL_PAIR_GAINS), key=lambda gain: abs(gain - 1)
        )
    ratios = _ratios([blocks * divided], angles_deg)
    if not (ratios.told and ratios.of_analyzers):
        return None
    relative = ratios.relative / divided
    return _Seen(relative / np.exp(np.log(relative).mean()), ratios.azimuth_deg, ratios.spread)


def _spread_evenly(angles_deg: Sequence[float]) -> bool:
    """Whether more angles than three are spread so evenly that ratios of exposures tell nothing of each other."""
    turns = np.exp(2j * np.radians(angles_deg))
    uneven = max(abs(turns.mean()), abs((turns**2).mean()))
    most = _MOST_UNEVEN_OF_FOUR if len(turns) == 4 else _MOST_UNEVEN
    return len(turns) > 3 and bool(uneven <= most)


@dataclass(frozen=True)
class _Ratios:
    """What does not add up of colours, and what is polarized across, as shares of their light.

    Attributes
    ----------
    relative : ndarray, shape (photograph, colour)
        Exposures that explain both.
    apart : ndarray, shape (colour, photograph - 3)
        In units of the standard deviation of exposures that are off by chance.
    across : ndarray, shape (colour,)
    azimuth_deg : float
        As of `_Seen`.
    """

    relative: Values
    apart: Values
    across: Values
    azimuth_deg: float = 0.0

    @property
    def told(self) -> bool:
        """Whether there are any."""
        return bool(self.apart.any())

    def of_exposures(self, most_across: float) -> bool:
        """Whether nothing else is the reason for them: so much is across, at most, in units of what does not add up."""
        apart, across = self._sizes
        return self._small and across <= max(most_across * apart, _LITTLE_ACROSS)

    @property
    def of_analyzers(self) -> bool:
        """Whether gains of analyzers are the reason, and not light that arrives polarized."""
        return self._small and self._sizes[1] <= _MOST_ACROSS_OF_MOSAIC

    @property
    def _sizes(self) -> tuple[float, float]:
        """Root mean squares of what does not add up, and of what is across."""
        return math.sqrt(float(np.mean(self.apart**2))), math.sqrt(float(np.mean(self.across**2)))

    @property
    def _small(self) -> bool:
        return bool(max(np.abs(self.apart).max(), np.abs(self.across).max()) <= _MOST)

    @property
    def spread(self) -> float:
        """Standard deviation that they make expect of the last ratio."""
        # A ratio of what is polarized has all photographs to tell it.
        half, n = len(self.relative) / 2, len(self.relative) - 2
        variance = float(np.mean(np.sum(self.apart**2, axis=1) + half * self.across**2)) / n
        return math.sqrt((1 + _NOT_KNOWN / n) * variance / half)


_NO_RATIOS = _Ratios(np.ones((1, 1)), np.zeros((1, 1)), np.zeros(1))


def _ratios(colours: Sequence[Values], angles_deg: Sequence[float]) -> _Ratios:
    """Of the blocks (photograph, n) of each colour, where these surely tell any."""
    n, k = len(colours), len(angles_deg)
    ratios = _Ratios(np.ones((k, n)), np.zeros((n, k - 3)), np.zeros(n))
    # A photograph holds half of the light, and so does what it is exposed longer.
    unlike = 2 * redundancy_residual(np.eye(k), angles_deg)
    for _ in range(_ROUNDS):
        alike = [blocks / relative[:, None] for blocks, relative in zip(colours, ratios.relative.T, strict=True)]
        lights, azimuth = _polarized(alike, angles_deg)
        apart = [
            [_in_proportion(each, *light[:2]) for each in unlike @ blocks]
            for blocks, light in zip(alike, lights, strict=True)
        ]
        if not (ratios.told or any(starmap(_show, zip(apart, lights, strict=True)))):
            return ratios
        totals = ratios.apart + np.array(apart)[..., 0]
        across = ratios.across + [float(light.between @ light.total / (light.total @ light.total)) for light in lights]
        relative = np.exp(unlike.T @ totals.T / 2) * _exposed(angles_deg, azimuth, across=across)
        ratios = _Ratios(relative, totals, across, azimuth)
    return ratios


def _show(apart: Sequence[tuple[float, float]], light: _Light) -> bool:
    """Whether what of a colour does not add up, with its errors, or what is across beside it, surely does harm."""
    if any(starmap(_tell, apart)):
        return True
    seen = any(abs(ratio) > _SEEN * error for ratio, error in apart)
    return seen and _tell(*_in_proportion(light.between, *light[:2]))


def _tell(ratio: float, error: float) -> bool:
    """Whether a ratio is surely there, and does harm."""
    return abs(ratio) > max(_LEAST, _SURE * error)


class _Light(NamedTuple):
    """Light of the blocks of a colour: all, what is polarized along an azimuth, or across, and between, each (n,).

    Between lies what is in proportion to the light alone.
    """

    total: Values
    along: Values
    between: Values


def _polarized(colours: Sequence[Values], angles_deg: Sequence[float]) -> tuple[list[_Light], float]:
    """Light of the blocks (photograph, n) of each colour, and the azimuth of all, modulo 90 degrees."""
    inverse = np.linalg.pinv(analyzer_matrix(angles_deg))
    moment, stokes = np.zeros((2, 2)), [inverse @ blocks for blocks in colours]
    for light, *components in stokes:
        varies = np.array([component - component @ light / (light @ light) * light for component in components])
        moment += varies @ varies.T
    double = math.atan2(2 * moment[0, 1], moment[0, 0] - moment[1, 1]) / 2
    cosine, sine = math.cos(double), math.sin(double)
    lights = [_Light(light, s1 * cosine + s2 * sine, s2 * cosine - s1 * sine) for light, s1, s2 in stokes]
    return lights, math.degrees(double) / 2


def _in_proportion(values: Values, light: Values, polarized: Values) -> tuple[float, float]:
    """Share of the light that values have beside one of the polarized light, and its standard error."""
    columns = np.stack([light, polarized])
    parts = np.array_split(np.arange(light.size), _PARTS)
    normal = np.stack([columns[:, part] @ columns[:, part].T for part in parts], axis=-1)
    moments = np.stack([columns[:, part] @ values[part] for part in parts], axis=-1)

    def shares(normal: Values, moments: Values) -> Values:
        """By least squares, also where nothing is polarized, of sums (2, 2, n) and (2, n)."""
        inverse = np.linalg.pinv(np.moveaxis(normal, -1, 0), hermitian=True)
        return np.asarray((inverse @ moments.T[..., None])[:, 0, 0])

    (share,) = shares(normal.sum(axis=-1, keepdims=True), moments.sum(axis=-1, keepdims=True)).tolist()
    return share, jackknife_error(shares(left_out(normal), left_out(moments)))


def _exposed(
    angles_deg: Sequence[float],
    azimuth_deg: float,
    *,
    along: float | Values | Sequence[float] = 0.0,
    across: float | Values | Sequence[float] = 0.0,
) -> Values:
    """Exposures that make unpolarized light look polarized along an azimuth, and 45 degrees beside it, by shares.

    These are of each colour, or of all, (colour,); so are the exposures, (photograph, colour).
    """
    twice = 2 * np.radians(np.asarray(angles_deg) - azimuth_deg)
    return np.asarray(np.exp(np.outer(np.cos(twice), along) + np.outer(np.sin(twice), across)))


def _left_across(stokes: StokesImages, azimuth_deg: float) -> float:
    """Light polarized beside an azimuth beyond what counts as noise, in units of it."""
    blocks = PolarizedBlocks(stokes)
    return blocks.constant_misfit(azimuth_deg) - (MOST_OF_ALIASES if stokes.aliased else noise_misfit(blocks.n))


def _along(
    stokes: StokesImages, scene: SceneParameters, asked: SceneParameters, seen: _Seen
) -> tuple[float, float] | None:
    """How much longer what is polarized along the azimuth was exposed, and what of the incidence stays open by it.

    The first as a share, the second in degrees; None where tiles do not tell.
    """
    azimuth, index = scene.values()[1], scene.index
    tiles = tile_likelihood(plate_frame(stokes, azimuth)).some(_MOST_TILES)
    if tiles.n_tiles < LEAST_TILES:
        return None
    if asked.incidence_deg is not None:
        ratio, variance = _at_incidence(tiles, scene)
        ratio /= 1 + variance / seen.spread_of_pane**2
        return (ratio, 0.0) if abs(ratio) < _MOST_BY_TOLD * seen.spread_of_pane else None
    plain = tiles.nearest(window_of(scene, azimuth), index)
    if plain.window.incidence_deg > _STEEPEST_DEG:
        return None
    here = tiles.nearest(plain.window, index, _FREE)
    below, above = (_onwards(tiles, here, step) for step in (-_STEP_DEG, _STEP_DEG))
    fits = [*below[::-1], here, *above]
    numbers = [(fit.window.incidence_deg, fit.window.exposed_along, plain.misfit - fit.misfit) for fit in fits]
    if not np.all(np.isfinite(numbers)):
        return None
    angles, ratios, gains = _between(np.array(numbers).T)
    odds = gains / _NATS - np.square(ratios / seen.spread_of_pane) / 2
    chances = np.exp(odds - odds.max())
    chances /= chances.sum()
    ratio, angle = float(chances @ ratios), float(chances @ angles)
    error = math.sqrt(float(chances @ np.square(angles - angle)))
    return None if abs(ratio) > _MOST_ALONG * seen.spread_of_pane else (ratio, _WIDER * error)


def _at_incidence(tiles: TileLikelihood, scene: SceneParameters) -> tuple[float, float]:
    """The ratio of a scene's incidence, and its variance; infinite where tiles do not tell it."""
    fit = tiles.nearest(window_of(scene, scene.values()[1]), scene.index, _FREE)
    (error,) = tiles.errors(fit, _FREE)
    return fit.window.exposed_along, _NATS * error**2


def _along_of_colours(looked: _Look, scene: SceneParameters, seen: _Seen) -> Values:
    """Exposures (photograph, colour) by which colours were exposed along the azimuth more or less than all together."""
    n = looked.relative.shape[1]
    azimuth = scene.values()[1]
    ratios, precisions = np.zeros(n), np.zeros(n)
    for colour in range(n):
        tiles = tile_likelihood(plate_frame(looked.stokes.of_channel(colour), azimuth)).some(_MOST_TILES)
        if tiles.n_tiles >= LEAST_TILES:
            ratios[colour], variance = _at_incidence(tiles, scene)
            precisions[colour] = 1 / variance
    differences = ratios - precisions @ ratios / max(precisions.sum(), np.finfo(float).tiny)
    told = precisions / (precisions + 1 / seen.spread_of_colours**2)
    along = np.where(np.abs(differences) < _MOST_ALONG * seen.spread_of_colours, told * differences, 0.0)
    return _exposed(looked.capture.angles_deg, azimuth, along=along)


def _between(numbers: Values) -> Values:
    """Numbers (3, n) at equal steps of the first, finely: steep panes are told to less than a step."""
    from scipy.interpolate import CubicSpline

    angles = np.arange(numbers[0, 0], numbers[0, -1], _FINE_STEP_DEG)
    return np.asarray([angles, *CubicSpline(numbers[0], numbers[1:], axis=1)(angles)])


def _onwards(tiles: TileLikelihood, here: TileFit, step_deg: float) -> list[TileFit]:
    """Likeliest ratios at incidences ever farther from one, each begun from the one before."""
    low, high = INCIDENCE_SEARCH_DEG
    fits = list[TileFit]()
    for _ in range(round(_REACH_DEG / abs(step_deg))):
        window = (fits[-1] if fits else here).window
        angle = window.incidence_deg + step_deg
        if not low < angle < high:
            break
        fits.append(tiles.nearest(replace(window, incidence_deg=angle), here.refractive_index, _FREE))
    return fits
