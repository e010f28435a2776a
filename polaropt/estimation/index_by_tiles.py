"""The refractive index that single tiles of the frame tell beside the one that was told, of a single clear pane.

Where double images lie apart, how bright they are goes by the index, as what is mirrored along and across does; of a
mosaic tiles tell both from samples, where what aliases in its cells passes for another index.
"""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass
from functools import partial

from polaropt.capture import PlateFrame
from polaropt.estimation.flat.ghosts import LIKE_BLUR_PX
from polaropt.estimation.flat.overlap import MOST_NOISE, noise_of_mirrored
from polaropt.estimation.flat.samples.ghosts import is_told_by_samples
from polaropt.estimation.flat.samples.tiles import SampledTileLikelihood, SampledTiles
from polaropt.estimation.flat.windows.axis import window_of
from polaropt.estimation.flat.windows.search import TRIAL_INDICES, alike_incidences
from polaropt.estimation.flat.windows.tiles import TileFit, TileLikelihood
from polaropt.numerics import local_minimum
from polaropt.optics import SceneParameters

INDEX_SEARCH = (1.3, 2.0)
"""Indices that are searched: from water to the heaviest flint glass, and what coatings make of 1.5. Set by hand."""
_LEAST_GAIN_OF_TILES, _SURE_OF_TILES, _FAR_OFF = 50.0, 2.5, 2.0
"""Log likelihood of tiles that another index must gain, standard errors of it, and standard errors of the index that it
must be off. Of 40 random windows of single panes whose index was told rightly, among them 22 of photographs that no
figure is taken of, one lacks more than 33 (73, 1.6 standard errors off); of three that were told wrongly by 0.15 and
more all gain 62 to 379."""
_LEAST_GLANCE = 20.0
"""Log likelihood of tiles' luminance that another index must gain for them to be looked at closely. By hand."""
_TILE_STEP, _TILES_WIDER, _LEAST_TILE_ERROR = 0.08, 5.0, 0.03
"""First step from the likeliest of them, and how much wider its error is than the curvature says, at least so much:
with them all of those 40 lie within two errors."""
_LEAST_GAIN_OF_MOSAIC, _LEAST_ERROR_OF_MOSAIC, _BEYOND_DEG = 1.5, 0.06, 4.0
"""Log likelihood per tile of a mosaic that another index must gain, the least error, and degrees beyond Brewster's
angle from which on it is told: before it, panes that look alike gain up to 2.8 per tile."""
_INDEX_TOLERANCE = 0.01
"""Accuracy of the likeliest index. Set by hand."""
_BORNE_OUT = 1.5
"""Standard errors by which tiles of a mosaic must find an index that its cells tell likelier than the one told. By
trial."""


@dataclass(frozen=True)
class LikelierIndex:
    """An index that explains a capture clearly better than the one that was told.

    Attributes
    ----------
    index : float
    error : float
        Standard error.
    sure : bool
        Whether it lies inside of what was searched, the spectra alone speak for it as well, and one clear pane of it is
        clearly better than what was found with the index that was told, be that several panes or tinted glass.
    """

    index: float
    error: float
    sure: bool = True


def likelier_index_of_mosaic(
    mosaic: SampledTiles, scene: SceneParameters, of_cells: LikelierIndex | None
) -> LikelierIndex | None:
    """What tiles of a mosaic tell of an index beside the one that was told; None where they do not speak against it.

    Parameters
    ----------
    mosaic : SampledTiles
    scene : SceneParameters
        Complete, in pixels of the sensor, with the index that was told and all else as it was found.
    of_cells : LikelierIndex or None
        What the mosaic's cells tell: it is told, too, where tiles bear it out.
    """
    if scene.polarized or scene.absorption or not (scene.signal and is_told_by_samples(scene)):
        return None
    azimuth_deg = scene.values()[1]
    tiles = SampledTileLikelihood(mosaic, azimuth_deg)
    told_by = partial(told_by_tiles, tiles, azimuth_deg=azimuth_deg, of_mosaic=True)
    # With a wrong index images in place may have been given ghosts.
    found = told_by(scene) or (told_by(scene.replace(ghost_shift=0.0), beside=scene) if scene.has_ghosts else None)
    if found is not None or of_cells is None:
        return found
    window, told = window_of(scene, azimuth_deg), scene.index
    here = tiles.nearest(window, told)
    angles = alike_incidences(here.window.incidence_deg, told, of_cells.index - told)
    near = (tiles.nearest(dataclasses.replace(window, incidence_deg=angle), of_cells.index) for angle in angles)
    # On the other side of Brewster's angle are panes that look alike.
    same_side = [fit for fit in near if _is_beyond(fit, 0.0) == _is_beyond(here, 0.0)]
    best = min(same_side, key=lambda fit: fit.misfit, default=here)
    return of_cells if best is not here and best.surer_than(here) > _BORNE_OUT else None


def tiles_tell(frame: PlateFrame, scene: SceneParameters) -> bool:
    """Whether tiles tell an index: only by double images that lie apart, and where noise leaves them to be seen.

    Without any, spectra that differ from natural ones pass for another index.
    """
    return abs(scene.values()[2]) >= LIKE_BLUR_PX and noise_of_mirrored(frame, scene) < MOST_NOISE


def told_by_tiles(
    tiles: TileLikelihood,
    scene: SceneParameters,
    azimuth_deg: float,
    *,
    beside: SceneParameters | None = None,
    of_mosaic: bool = False,
) -> LikelierIndex | None:
    """What single tiles tell of an index beside the one that was told, of a single clear pane.

    Where several were found, `beside` it they must not be likelier. Of a mosaic none is told but beyond Brewster's
    angle, before which panes of other indices look much alike.
    """
    window, told = window_of(scene, azimuth_deg), scene.index
    glance = tiles.luminance()
    first = glance.nearest(window, told)
    if of_mosaic and not _is_beyond(first, _BEYOND_DEG):
        return None
    starts = [
        (dataclasses.replace(window, incidence_deg=angle), index)
        for index in TRIAL_INDICES
        for angle in alike_incidences(window.incidence_deg, told, index - told)
    ]
    likeliest = min((glance.nearest(*start) for start in starts), key=lambda fit: fit.misfit)
    if first.misfit - likeliest.misfit < _LEAST_GLANCE:
        return None
    panes = dict[float, TileFit]()

    def pane(index: float) -> TileFit:
        """The likeliest single pane of an index."""
        if index not in panes:
            known = min((likeliest, *panes.values()), key=lambda fit: abs(fit.refractive_index - index))
            angles = alike_incidences(
                known.window.incidence_deg, known.refractive_index, index - known.refractive_index
            )
            near = [tiles.fitted(dataclasses.replace(window, incidence_deg=angle), index) for angle in angles]
            panes[index] = tiles.nearest(min(near, key=lambda fit: fit.misfit).window, index)
        return panes[index]

    # Of a mosaic the glance was at all there is.
    here, start = first if of_mosaic else tiles.nearest(window, told), likeliest.refractive_index
    best = pane(local_minimum(lambda index: pane(index).misfit, start, INDEX_SEARCH, _TILE_STEP, _INDEX_TOLERANCE))
    least = _LEAST_GAIN_OF_MOSAIC * len(here.misfits) if of_mosaic else _LEAST_GAIN_OF_TILES
    if here.misfit - best.misfit < least or best.surer_than(here) < _SURE_OF_TILES:
        return None
    if beside is not None and tiles.nearest(window_of(beside, azimuth_deg), told).misfit < best.misfit:
        return None
    if of_mosaic and not _is_beyond(best, _BEYOND_DEG):
        return None
    index = best.refractive_index
    before, after = (pane(index + move).misfit for move in (-_TILE_STEP, _TILE_STEP))
    curvature = (before + after - 2 * best.misfit) / _TILE_STEP**2
    low, high = INDEX_SEARCH
    if curvature <= 0 or not low + _INDEX_TOLERANCE < index < high - _INDEX_TOLERANCE:
        return None
    error = math.hypot(_LEAST_ERROR_OF_MOSAIC if of_mosaic else _LEAST_TILE_ERROR, _TILES_WIDER / math.sqrt(curvature))
    # What lies at the end of the search, as a pane across does, is none.
    inside = not of_mosaic or (low < index - error and index + error < high)
    return LikelierIndex(index, error) if inside and abs(index - told) > _FAR_OFF * error else None


def _is_beyond(fit: TileFit, by_deg: float) -> bool:
    """Whether a pane lies beyond Brewster's angle by so many degrees and more."""
    return fit.window.incidence_deg > math.degrees(math.atan(fit.refractive_index)) + by_deg
