"""Standard errors of both layers in every pixel, and where the reflection's detail is known.

Per number and pixel the layers move together by half the difference of the two closed forms; their squares add up. The
incidence is moved by two errors, as two are to cover the truth: towards frontal glass what follows from it soars.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import groupby
from typing import Any

import numpy as np
from numpy.typing import NDArray

from polaropt.capture import Capture, NoiseModel, NoiseSpectrum, noise_classes
from polaropt.inversion import FEWEST_TOLD, SCALES, Knowledge, filled_smoothly, variance_table, worth_filling
from polaropt.judging.precision import LEAST, local_precision
from polaropt.numerics import enlarged, give_back_freed, middle_part, strips
from polaropt.optics import FIELDS, Field, Rival, SceneErrors, SceneParameters, VaryingPSE
from polaropt.solving import Piece, Problem, Tile, Weights
from priors.base import CHROMA_WEIGHT
from solvers.kernels import in_blocks

Images = NDArray[np.float32]

# Errors beyond these, by unit, count as these: the layers change no more in proportion, and the engine's ranges end.
# Set by hand.
_LARGEST = {"deg": 20.0, "px": 8.0, "": 0.5}
# Share of a tile's time that what the noise leaves takes, for the progress alone: set by hand.
_NOISE_SHARE = 0.4
# Standard errors by which the incidence is moved: two are to cover the truth, and towards frontal glass what follows
# from it soars.
_COVERING = 2.0
# Shorter side in pixels from which what the scene's errors do is found on blocks, the sides of these, of a mosaic whole
# patterns, and of the part of the frame that tells their level. Set by hand.
_LEAST_COARSE, _BLOCK, _BLOCK_OF_MOSAIC, _COMPARED = 384, 3, 4, 192
# Ratios of levels that are believed, and a variance that is none.
_LEVELS, _NO_VARIANCE = (0.25, 16.0), 1e-20


@dataclass(frozen=True)
class Doubt:
    """A scene on both sides of the one found, in one number, and how many standard errors it is moved each way.

    `number` is the name of the field; rivals, which differ in several, are told by their incidence.
    """

    number: str
    below: SceneParameters
    above: SceneParameters
    n_errors: float


def doubts(scene: SceneParameters, errors: SceneErrors, rivals: Sequence[Rival] = ()) -> tuple[Doubt, ...]:
    """Moved scenes for every number of a complete scene that was estimated, and its rivals.

    Parameters
    ----------
    scene : SceneParameters
    errors : SceneErrors
        What is None in it adds nothing; nor does the azimuth of a flat pane that is seen from far, as polarization
        falls with the cosine of its error.
    rivals : sequence of Rival
        Scenes that the errors do not reach.
    """
    # Ghosts hardly matter to how slow changes answer, and before a wide lens they cost many times as much.
    base = scene.replace(ghost_shift=0.0, transmission_ghost_shift=None, gap_shift=0.0) if scene.varies else scene
    # Half of what the layers move by from below to above, per error, is what chance makes of the whole.
    far = (Doubt("incidence_deg", base, rival.scene, 0.5 / math.sqrt(rival.chance)) for rival in rivals)
    return (*_moved(base, errors), *far)


def scene_variance(
    capture: Capture,
    noise: float,
    doubtful: tuple[Doubt, ...],
    center: tuple[float, float] | None = None,
    growth: NoiseModel | None = None,
) -> Images:
    """Variance of the layers for the scene's errors alone, (2, channel, h, w).

    Errors of different numbers count as independent.

    Parameters
    ----------
    capture : Capture
        The frame, or a tile of it.
    noise : float
    doubtful : tuple of Doubt
        At least one.
    center : (float, float), optional
    growth : NoiseModel, optional
        Both as for `polaropt.solving.problem.Problem`.
    """

    def layers(scene: SceneParameters) -> Images:
        problem = Problem(capture, scene, noise, Weights(), center=center, growth=growth)
        return np.asarray(problem.canvas.crop(problem.closed_form().layers))

    def variance(doubt: Doubt) -> Images:
        change = layers(doubt.above)
        change -= layers(doubt.below)
        change *= np.float32(0.5 / doubt.n_errors)
        return np.asarray(np.square(change, out=change))

    total = variance(doubtful[0])
    for doubt in doubtful[1:]:
        total += variance(doubt)
    return total


def _moved(scene: SceneParameters, errors: SceneErrors) -> Iterator[Doubt]:
    """A doubt for each number that was estimated."""
    yield from _of_light(scene, errors)
    for field in FIELDS:
        if not field.estimable or len(field.components) > 1:
            continue
        value, reach = getattr(scene, field.name), _reach(field, scene)
        error = min(getattr(errors, field.name) or 0.0, reach.largest)
        if value is not None and min(error, reach.farthest) > 0:
            step = min(reach.n_errors * error, reach.farthest)
            below, above = (scene.replace(**{field.name: value + sign * step}) for sign in (-1, 1))
            yield Doubt(field.name, below, above, step / error)
    for i, error in enumerate(errors.bend_deg_per_px or ()):
        if 0 < error < math.inf:
            below, above = (scene.replace(bend_deg_per_px=_bent(scene, i, sign * error)) for sign in (-1, 1))
            yield Doubt("bend_deg_per_px", below, above, 1.0)


def _of_light(scene: SceneParameters, errors: SceneErrors) -> Iterator[Doubt]:
    """Doubts of the degrees and angles of polarization of the layers' light, as far as these can be.

    Where all images lie in place they move with the pane, as its rivals tell.
    """
    if not scene.has_ghosts:
        return
    for name in ("transmission_polarization", "reflection_polarization"):
        (degree, angle), stated = getattr(scene, name), getattr(errors, name)
        if stated is None or not degree:
            continue
        most_degree, most_angle = (min(error, _LARGEST[unit]) for error, unit in zip(stated, ("", "deg"), strict=True))
        below, above = max(0.0, degree - most_degree), min(1.0, degree + most_degree)
        pairs = [((below, angle), (above, angle)), ((degree, angle - most_angle), (degree, angle + most_angle))]
        # What is fully polarized cannot be more so.
        widths = ((above - below) / 2 / most_degree if most_degree else 0.0, float(most_angle > 0))
        for (low, high), width in zip(pairs, widths, strict=True):
            if width > 0:
                yield Doubt(name, scene.replace(**{name: low}), scene.replace(**{name: high}), width)


@dataclass(frozen=True)
class _Reach:
    """The largest error of a number that counts, how many of them it is moved by, and how far at most."""

    largest: float
    n_errors: float
    farthest: float


def _reach(field: Field, scene: SceneParameters) -> _Reach:
    largest = _LARGEST[field.component.unit]
    if field.name == "incidence_deg":
        incidence = scene.values()[0]
        return _Reach(largest, _COVERING, min(incidence, 90 - incidence) / 2)
    if field.name == "azimuth_deg" and not scene.varies:
        return _Reach(0.0, 1.0, largest)
    if field.name == "focal_px":
        focal = scene.focal_px or 0.0
        return _Reach(focal, 1.0, focal / 2)
    if field.name == "absorption":
        # Glass does not brighten what is seen through it.
        return _Reach(largest, 1.0, min(largest, scene.absorption or 0.0))
    return _Reach(largest, 1.0, largest)


def _bent(scene: SceneParameters, i: int, more: float) -> tuple[float, ...]:
    """The scene's bend with more of one of its numbers."""
    return tuple(part + more * (i == j) for j, part in enumerate(scene.bend_deg_per_px))


# Width of the Gaussian over which a pixel's gradient energy is averaged, in pixels: set by hand.
_BLUR_PX = 1.5
# Share of what the photographs do not tell of a gradient's energy that is still to be added where the layers were
# expected in each place. Of 30 scenes (three pairs, 10 to 85 degrees, noise 0.5 and 2 %) the stated root mean squares
# are, with all of it, 1.1 to 2.3 times the true ones; with half 1.1 to 1.7 times, and 94 to 99 % lie within two errors;
# with a quarter only 88 % do at 10 degrees.
_STILL_OPEN = 0.5
# Rows that a thread takes at a time; changes nothing.
_ROWS = 32
# Precisions of a table, between which is interpolated: set by hand.
_N_PRECISIONS = 6
_N_DISTANCES = 17
"""Distances between which a layer's differences are interpolated."""


_OF_FILTERED = 1.3
"""Noise of photographs that a filter made of a mosaic's samples, in units of what it leaves in them, at least. By trial
on 48 films' frames of training photographs (`studies.sequences`, mono and colour sensors, 25 to 75 degrees, noise 0.25
to 4 %)."""


@dataclass(frozen=True)
class Uncertainty:
    """How well the layers of a separation are known.

    Attributes
    ----------
    standard_error : ndarray of float32, shape (2, [channel,] h, w)
        Of the transmission and the reflection, in the layers' units, with what the scene's own errors add. 90 to 99 %
        of true values lie within two of them where the scene is known (``python -m studies.coverage``); of pixels that
        all photographs clip, fewer: nothing says how much brighter than white they are.
    reflection_known : ndarray of float32, shape (h, w)
        Share of the reflection's detail (gradient energy) that the photographs tell, 0..1. Where it is low the
        reflection fades to its slow changes.
    """

    standard_error: Images
    reflection_known: Images


@dataclass(frozen=True)
class UncertaintyStrip:
    """Some rows of the frame with their `Uncertainty`."""

    rows: slice
    uncertainty: Uncertainty


def estimate_uncertainty(
    capture: Capture,
    layers: Images,
    noise: float,
    pieces: Sequence[Piece],
    growth: NoiseModel | None = None,
    *,
    correlated: NoiseSpectrum | None = None,
    of_scene: SceneErrors = SceneErrors(),  # noqa: B008 (frozen)
    rivals: Sequence[Rival] = (),
    tell: Callable[[float], None] | None = None,
) -> Iterator[UncertaintyStrip]:
    """Standard errors from the variance that each place's photographs and spectra leave, and from the scene's errors.

    From top to bottom, a row of tiles at a time: of a large frame they are as much as its layers.

    Parameters
    ----------
    capture : Capture
    layers : ndarray of float32, shape (2, channel, h, w)
    noise : float
    pieces : sequence of Piece
        Row by row of tiles; their weights add up to 1 in every pixel.
    growth : NoiseModel, optional
        How the noise grows with the light. Default: it is the same everywhere.
    correlated : NoiseSpectrum, optional
        Of noise that neighbours or colours have in common. Default: they have none.
    of_scene : SceneErrors
        Of what was estimated of the scene. Default: it is known.
    rivals : sequence of Rival
        Other scenes that the true one may be.
    tell : callable, optional
        Called with the fraction done, 0..1.
    """
    colors, (height, width) = layers.shape[1], layers.shape[-2:]
    pieces = _as_told_by_noise(capture, noise, pieces, correlated)
    doubtful = doubts(pieces[0].pse.scene, of_scene, rivals)
    blocks = _Blocks.of(capture, noise, doubtful, growth) if doubtful else None
    done = 0.0

    def advance(share: float) -> None:
        nonlocal done
        done += share / len(pieces)
        if tell is not None:
            tell(done)

    bands = [list(band) for _, band in groupby(pieces, key=lambda piece: piece.tile.rows.start)]
    ends = [*(band[0].tile.rows.start for band in bands[1:]), height]
    # What the band above has left in the rows that both cover.
    total = (2 * colors + 1) * [np.empty((0, width), dtype=np.float32)]
    for band, end in zip(bands, ends, strict=True):
        top, bottom = band[0].tile.rows.start, band[0].tile.rows.stop
        total = [_continued(plane, bottom - top) for plane in total]
        for piece in band:
            found = _of_noise(capture.part(*piece.tile.where), layers, noise, piece, growth)
            advance(_NOISE_SHARE)
            if doubtful:
                np.hypot(found[:-1], _of_scene(capture, noise, piece.tile, doubtful, growth, blocks), out=found[:-1])
            _blend(total, piece.tile, found)
            advance(1 - _NOISE_SHARE)
            del found
            if len(pieces) > 1:
                # The next tile needs the memory in one piece.
                give_back_freed()
        for rows in strips(end - top, len(total) * width):
            errors, known = np.stack([plane[rows] for plane in total[:-1]]), 1 - np.clip(total[-1][rows], 0, 1)
            uncertainty = Uncertainty(errors.reshape(2, *capture.shape[:-2], *known.shape), known)
            yield UncertaintyStrip(slice(top + rows.start, top + rows.stop), uncertainty)
        total = [plane[end - top :] for plane in total]


def _as_told_by_noise(
    capture: Capture, noise: float, pieces: Sequence[Piece], correlated: NoiseSpectrum | None
) -> Sequence[Piece]:
    """Pieces whose layers are known as well as samples of this noise, or photographs of such noise, tell them.

    The photographs that a filter makes of a mosaic's samples have less noise, but what is slow, of which most of the
    layers' errors are, has that of the samples. Where detail that aliases is most of it, it is found at edges.

    Where neighbours' noise is alike, slow changes are less well known than the solve takes them to be, and fine detail
    no better: it is smoothed for noise that it does not have.
    """
    if correlated is not None:
        return [replace(piece, known=piece.known.told_by(_precision(correlated, piece.known))) for piece in pieces]
    filtered = None if capture.origin is None else capture.origin.filtered_noise
    if filtered is None:
        return pieces
    precision = min(filtered / noise, 1 / _OF_FILTERED) ** 2
    return [replace(piece, known=piece.known.told_by(precision)) for piece in pieces]


def _precision(spectrum: NoiseSpectrum, known: Knowledge) -> Images:
    """What photographs with such noise tell at each frequency, in units of what layers were solved for."""
    beyond = np.maximum(1, spectrum.at(known.squared_frequency / 4) / spectrum.of_layers)
    return np.asarray(1 / beyond**2, dtype=np.float32)


def _continued(rows: Images, n: int) -> Images:
    """Rows (rows, w) with zeros below, n in all."""
    plane = np.zeros((n, rows.shape[-1]), dtype=np.float32)
    plane[: len(rows)] = rows
    return plane


def _blend(band: list[Images], tile: Tile, found: Images) -> None:
    """Add what was found in a tile to the planes of its rows."""
    weights = tile.weights
    for plane, values in zip(band, found, strict=True):
        plane[:, tile.columns] += weights * values


def _of_noise(part: Capture, layers: Images, noise: float, piece: Piece, growth: NoiseModel | None) -> Images:
    """What the noise leaves in a tile, and what it does not tell of the reflection, (2 channel + 1, h, w)."""
    classes = None if growth is None else noise_classes(part, growth)
    usual = noise if classes is None else classes.typical
    precision = local_precision(part, piece.pse, usual, piece.known, classes)
    known, exact = piece.known, None if precision is None else precision[None]
    if isinstance(piece.pse, VaryingPSE):
        known, exact = _by_pixel(piece.pse, known, usual, part.shape[-2:])
        exact = exact if precision is None else exact * precision
    still_open = _STILL_OPEN if piece.expected else 1.0
    found = _looked_up(layers[..., piece.tile.rows, piece.tile.columns], known, exact, still_open)
    return _beside_untold(found, part, piece.known)


def _beside_untold(found: Images, part: Capture, known: Knowledge) -> Images:
    """The same where hardly any photograph is left, as far as a layer differs over the distance to what is told."""
    from scipy.ndimage import distance_transform_edt

    if part.samples is not None:
        return found
    trusted = part.valid.reshape(len(part.angles_deg), -1, *part.shape[-2:])
    untold = np.count_nonzero(trusted, axis=0) < FEWEST_TOLD
    if not untold.any():
        return found
    for color, where in enumerate(untold):
        if not where.any():
            continue
        away = distance_transform_edt(where)[where]
        grid = np.linspace(0, float(away.max()), _N_DISTANCES)
        for layer, differs in enumerate(np.sqrt(known.structure(grid))):
            errors = found[layer * len(untold) + color]
            errors[where] = np.hypot(errors[where], np.interp(away, grid, differs))
    found[-1] = np.maximum(found[-1], untold.mean(axis=0))
    return found


def _of_scene(
    capture: Capture,
    noise: float,
    tile: Tile,
    doubtful: tuple[Doubt, ...],
    growth: NoiseModel | None,
    blocks: _Blocks | None,
) -> Images:
    """Standard errors that the scene's own leave in a tile, (2 channel, h, w)."""
    height, width = capture.shape[-2:]
    center = ((width - 1) / 2 - tile.columns.start, (height - 1) / 2 - tile.rows.start)
    part = capture.part(*tile.where)
    if blocks is None:
        variance = scene_variance(part, noise, doubtful, center, growth)
    else:
        variance = blocks.variance(part, noise, doubtful, center, growth)
    return np.sqrt(variance, out=variance).reshape(-1, *variance.shape[-2:])


@dataclass(frozen=True)
class _Blocks:
    """Means of blocks on which what a scene's errors do is found, and what brings it to the level of every pixel's.

    What a scene's errors do to the layers is as fine as these, but how large it is changes slowly.
    """

    side: int
    level: Images

    @classmethod
    def of(
        cls, capture: Capture, noise: float, doubtful: tuple[Doubt, ...], growth: NoiseModel | None
    ) -> _Blocks | None:
        """Those of a large frame; None where every pixel is looked at."""
        if min(capture.shape[-2:]) < _LEAST_COARSE:
            return None
        side = _BLOCK if capture.samples is None else _BLOCK_OF_MOSAIC
        rows, columns = middle_part(capture.shape, _COMPARED)
        height, width = capture.shape[-2:]
        center = ((width - 1) / 2 - columns.start, (height - 1) / 2 - rows.start)
        part = capture.part(rows, columns)
        fine = scene_variance(part, noise, doubtful, center, growth).mean(axis=(-1, -2), keepdims=True)
        coarse = cls(side, np.ones_like(fine)).variance(part, noise, doubtful, center, growth)
        level = fine / np.maximum(coarse.mean(axis=(-1, -2), keepdims=True), _NO_VARIANCE)
        return cls(side, np.asarray(np.clip(level, *_LEVELS), dtype=np.float32))

    def variance(
        self,
        part: Capture,
        noise: float,
        doubtful: tuple[Doubt, ...],
        center: tuple[float, float],
        growth: NoiseModel | None,
    ) -> Images:
        """As `scene_variance`."""
        side = self.side
        moved = tuple(
            replace(doubt, below=doubt.below.scaled(1 / side), above=doubt.above.scaled(1 / side)) for doubt in doubtful
        )
        middle = ((center[0] + 0.5) / side - 0.5, (center[1] + 0.5) / side - 0.5)
        averaged = None if growth is None else NoiseModel(growth.read / side, growth.shot / side**2)
        small = part.in_blocks(side)
        # Filled once, not with what each of the scenes expects: it is what these differ in that counts.
        small = filled_smoothly(small) if worth_filling(small) else small
        variance = scene_variance(small, noise / side, moved, middle, averaged)
        return enlarged(variance * self.level, side, part.shape[-2:])


def uncertainty_without_polarization(
    capture: Capture, noise: float, tell: Callable[[float], None] | None = None
) -> Iterator[UncertaintyStrip]:
    """Of a capture that shows no polarization: its intensity holds both layers, so that each may be all of it."""
    for rows, part in capture.intensity_strips():
        error = np.abs(part) + np.float32(noise)
        known = np.zeros(part.shape[-2:], np.float32)
        yield UncertaintyStrip(rows, Uncertainty(np.stack([error, error]), known))


def assembled(strips: Iterable[UncertaintyStrip], layers: Images) -> Uncertainty:
    """Strips of a frame as one, for layers (2, [channel,] h, w)."""
    errors = np.empty(layers.shape, dtype=np.float32)
    known = np.empty(layers.shape[-2:], dtype=np.float32)
    for strip in strips:
        errors[..., strip.rows, :] = strip.uncertainty.standard_error
        known[strip.rows] = strip.uncertainty.reflection_known
    return Uncertainty(errors, known)


def _looked_up(layers: Images, known: Knowledge, precision: Images | None, still_open: float) -> Images:
    """Standard errors (2 channel planes) and the untold share of the reflection's detail of a tile.

    Precisions (1 or 2, h, w) are of both layers, or of each; `still_open` as `_STILL_OPEN`.
    """
    from polaropt.judging.kernels import interpolated

    precisions = np.ones(1)
    if precision is not None:
        most = max(1.0, float(precision.max()))
        precisions = np.geomspace(min(max(LEAST, float(precision.min())), most / 2), most, _N_PRECISIONS)
    table = variance_table(known.allowed(), precisions)
    measured, not_told = _local_scales(layers, known, precision, precisions)
    colors = layers.shape[1]
    exact: Sequence[Images | None] = (None,) if precision is None else tuple(precision)

    def found(values: slice, scales: Images, of_layer: Images | None) -> Images:
        positions = np.zeros((3, *layers.shape[-2:]), dtype=np.float32)
        if of_layer is not None:
            positions[0] = _position(of_layer, precisions)
        for i, scale in enumerate(scales):
            positions[1 + i] = _position(scale, SCALES)
        part = np.ascontiguousarray(table[..., values])
        out = np.empty((part.shape[-1], *layers.shape[-2:]), dtype=np.float32)
        in_blocks(partial(interpolated, part, positions, out), out.shape[1], _ROWS)
        return out

    # How much of the detail is told is asked of all that may be there.
    scales, whole = measured + np.float32(still_open) * not_told, measured + not_told
    both = [slice(2 * colors)] if len(exact) == 1 else [slice(colors), slice(colors, 2 * colors)]
    errors = [found(values, scales, of_layer) for values, of_layer in zip(both, exact, strict=True)]
    return np.concatenate([*errors, found(slice(-1, None), whole, exact[-1])])


def _position(values: Images, grid: NDArray[np.float64]) -> Images:
    """Where values lie in a grid of equal ratios."""
    step = np.float32(np.log(grid[1] / grid[0]))
    return np.asarray(np.log(np.maximum(values, np.float32(grid[0])) / np.float32(grid[0])) / step, dtype=np.float32)


def _local_scales(
    layers: Images, known: Knowledge, precision: Images | None, precisions: NDArray[np.float64]
) -> tuple[Images, Images]:
    """Gradient energy around a pixel, and what is not told of it, in units of the layer's, both (2, h, w)."""
    from scipy.ndimage import gaussian_filter

    from polaropt.solving import Frame, energies

    height, width = layers.shape[-2:]
    energy = np.empty((2, height, width), dtype=np.float32)
    not_told = np.empty_like(energy)
    planes = np.ascontiguousarray(layers)
    chroma = np.float32(CHROMA_WEIGHT if layers.shape[1] > 1 else 1)
    energies(planes, Frame(0, 0, height, width), chroma, energy, 0, height)
    usual, unknown = known.edges(known.prior), [known.edges(known.uncertainty(float(exact))) for exact in precisions]
    for i, of_layer in enumerate(np.array(unknown, dtype=np.float32).T):
        gaussian_filter(energy[i], _BLUR_PX, mode="nearest", output=energy[i])
        if precision is None:
            not_told[i] = of_layer[0]
        else:
            not_told[i] = np.interp(precision[min(i, len(precision) - 1)], precisions, of_layer)
    level = np.asarray(usual, dtype=np.float32)[:, None, None]
    return energy / level, not_told / level


def _by_pixel(pse: VaryingPSE, known: Knowledge, noise: float, shape: tuple[int, ...]) -> tuple[Knowledge, Images]:
    """What is known of a tile before a pane that varies, and how exact each layer is in a pixel of it, (2, h, w).

    Ghosts hide frequencies that images in place show: what is known of them stays as it is.
    """
    told = _information_by_pixel(pse, noise, shape)
    mean = told.mean(axis=(-1, -2), dtype=np.float64)
    exact = np.stack([_alone(told, i) / np.float32(_alone(mean, i)) for i in (0, 1)])
    known = known if pse.scene.has_ghosts else _with_information(known, mean)
    return known, np.maximum(exact, np.float32(LEAST))


def _alone(told: NDArray[Any], layer: int) -> Any:
    """Information (2, 2, ...) on one layer where nothing is known of the other."""
    return told[layer, layer] - told[0, 1] ** 2 / told[1 - layer, 1 - layer]


def _information_by_pixel(pse: VaryingPSE, noise: float, shape: tuple[int, ...]) -> Images:
    """What its own photographs tell of the layers of each pixel, (2, 2, h, w)."""
    mixtures = pse.mixtures(*shape)
    weights = np.tensordot((pse.analyzer.T @ pse.analyzer / noise**2).astype(np.float32), mixtures, axes=1)
    return np.asarray(np.einsum("ilhw,imhw->lmhw", mixtures, weights))


def _with_information(known: Knowledge, told: NDArray[np.float64]) -> Knowledge:
    """The same information (2, 2) at every frequency."""
    flat = np.ones_like(known.share)
    return replace(known, told=np.stack([np.float32(told[i, i]) * flat for i in (0, 1)]), cross=told[0, 1] ** 2 * flat)
