"""The side on which double images lie, told by the edges of the layers that a pane leaves on either side, or by tiles.

Double images on one side of their layer and on the other leave the photographs the same spectra but for a phase, and
where they are faint that phase is lost in what the two layers have in common by chance. A pane with its double images
on the wrong side does not take them out of the layers, it doubles them again: such layers have more edges. Unless one
layer has hardly any: what is left in it of the other one then counts for more than edges that are doubled, and single
tiles of the frame, where they surely tell the side, tell it right.

Where neither edges nor tiles tell the side there are no double images: a picture that repeats itself, or whose spectra
fall otherwise than pictures' do, looks as if it had some, and on both sides alike.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from dataclasses import dataclass

from polaropt.capture import Capture, plate_frame, stokes_images
from polaropt.estimation.flat.estimate import SceneEstimate
from polaropt.estimation.flat.ghosts import is_of_two_faces
from polaropt.estimation.flat.pane_by_tiles import LEAST_TILES
from polaropt.estimation.flat.windows.axis import window_of
from polaropt.estimation.flat.windows.likelihood import Window
from polaropt.estimation.flat.windows.tiles import tile_likelihood
from polaropt.estimation.ladder import LadderResult
from polaropt.optics import Rival, SceneParameters

_SURE = 0.0035
"""Share of edges from which on the side is certain. Of 170 panes of training photographs (20 to 70 degrees, noise 0.5
and 2 %) in which double images were found the wrong side had fewer once, by a tenth of this."""
_SURE_OF_TILES, _AGAINST = 2.0, 1.0
"""Standard errors by which tiles must find one side likelier to be believed whatever the edges say, and from which on
edges that say otherwise are not certain. Of 120 panes of training photographs (18 to 60 degrees, shifts of 2 to 14 px,
noise 0.05 to 1 %, 83 with one layer blurred by 2 to 14 px; seeds 0 to 119 of an engine of its own) edges have 21 on the
wrong side; tiles have none of 68 there by two standard errors, 7 of those 21 among them, and 4 by 1 to 1.5."""
_TOLD_BY_TILES, _UNTOLD, _NO_LIKELIER = 2.5, 0.0045, 1.0
"""Standard errors from which on tiles tell a side, what they are worth with the share of edges (their product) below
which neither does, and standard errors by which tiles must find double images likelier than none. Of 760 panes of
training photographs (20 to 80 degrees, noise 0.05 to 2 %, half in place; an engine of its own) 13 in place have double
images before they are asked for their side, and lose up to 26 dB of the reflection; all of them go, and two of 300 that
are there, whose reflection loses 1 and 2 dB."""
_BY_EDGES = "Its double images lie where the layers have fewer edges, on the other side than their spectra say."
_BY_TILES = "Its double images lie where single tiles surely have them, on the other side than their spectra say."


def with_likelier_side(
    found: LadderResult,
    capture: Capture,
    edges: Callable[[SceneParameters], float],
    noise: float,
    in_place: Callable[[], LadderResult] | None = None,
) -> LadderResult:
    """The scene found, with its double images on the side that tiles surely tell, or that leaves fewer edges.

    Parameters
    ----------
    found : LadderResult
    capture : Capture
        Full photographs that the scene was found from, in its pixels. Photographs between the samples of a mosaic have
        edges of their own: their scene is left as it is.
    edges : callable
        Logarithm of the edges that the layers behind a complete scene have.
    noise : float
        Standard deviation of one photograph's noise.
    in_place : callable, optional
        What is found of a pane without double images, for where nothing tells their side. Default: they stay.

    Returns
    -------
    LadderResult
    """
    scene, estimate = found.scene, found.estimate
    of_mosaic = capture.samples is not None or capture.low_passed
    if estimate is None or of_mosaic or not scene.signal or not scene.has_ghosts or scene.varies:
        return found
    more_edges, tiles = edges(scene.opposite()) - edges(scene), _told_by_tiles(capture, scene, noise)
    if in_place is not None and tiles.show_none(more_edges):
        return _as_found(in_place(), found)
    by_tiles = tiles.of_side
    told_by_tiles = abs(by_tiles) > _SURE_OF_TILES
    contradicted = abs(by_tiles) > _AGAINST and by_tiles * more_edges < 0
    stays = (by_tiles if told_by_tiles else more_edges) >= 0
    if told_by_tiles or (abs(more_edges) > _SURE and not contradicted):
        estimate = _of_known_side(estimate)
    elif not stays:
        estimate = _of_either_side(estimate)
    if stays:
        return dataclasses.replace(found, estimate=estimate)
    rivals = tuple(Rival(rival.scene.opposite(), rival.chance) for rival in estimate.rivals)
    scene = scene.opposite()
    remark = _BY_TILES if told_by_tiles else _BY_EDGES
    tried = tuple(
        dataclasses.replace(rung, reason=f"{rung.reason} {remark}") if rung.taken else rung for rung in found.tried
    )
    estimate = dataclasses.replace(estimate, scene=scene, rivals=rivals)
    return dataclasses.replace(found, scene=scene, estimate=estimate, tried=tried)


def _as_found(placed: LadderResult, before: LadderResult) -> LadderResult:
    """What was found with images in place, as if nobody had told that they are.

    Nothing speaks against what is told then, and the index is the one that was found before.
    """
    estimate = placed.estimate
    if estimate is None:
        return placed
    errors = dataclasses.replace(estimate.errors, refractive_index=before.errors.refractive_index)
    estimate = dataclasses.replace(estimate, doubtful_shift=False, errors=errors)
    return dataclasses.replace(placed, estimate=estimate)


@dataclass(frozen=True)
class _TilesTell:
    """Standard errors by which tiles find a window's images likelier on this side than on the other, and than none.

    The second is None where it is not asked for: of a window of several panes, and of a frame of few tiles.
    """

    of_side: float = 0.0
    of_none: float | None = None

    def show_none(self, more_edges: float) -> bool:
        """Whether neither tiles nor edges, so many more on the other side, show double images."""
        if self.of_none is None:
            return False
        untold = abs(self.of_side) < _TOLD_BY_TILES and abs(self.of_side * more_edges) < _UNTOLD
        return untold or (self.of_none < _NO_LIKELIER and abs(self.of_side) < _SURE_OF_TILES)


def _told_by_tiles(capture: Capture, scene: SceneParameters, noise: float) -> _TilesTell:
    """What tiles tell of a complete scene's double images."""
    if not is_of_two_faces(scene) or scene.polarized:
        return _TilesTell()
    azimuth, index = scene.values()[1], scene.index
    tiles = tile_likelihood(plate_frame(stokes_images(capture, noise), azimuth))
    window = window_of(scene, azimuth)
    here, across = (tiles.fitted(one, index) for one in (window, window_of(scene.opposite(), azimuth)))
    of_side = here.surer_than(across)
    if window.n_panes > 1 or tiles.n_tiles < LEAST_TILES:
        return _TilesTell(of_side)
    return _TilesTell(of_side, here.surer_than(tiles.nearest(Window(window.incidence_deg, 0.0), index)))


def _of_known_side(estimate: SceneEstimate) -> SceneEstimate:
    """The estimate whose error of the ghost shift does not reach to the other side any more, where it did."""
    shift, error, of_side = estimate.scene.ghost_shift, estimate.errors.ghost_shift, estimate.shift_error_of_side
    if estimate.scene.rung != "ghosts" or not shift or error is None or of_side is None or error <= abs(shift) / 2:
        return estimate
    return dataclasses.replace(estimate, errors=dataclasses.replace(estimate.errors, ghost_shift=of_side))


def _of_either_side(estimate: SceneEstimate) -> SceneEstimate:
    """The estimate whose error of the ghost shift reaches to the other side: two of them, as spectra that tell none."""
    shift, error = estimate.scene.ghost_shift, estimate.errors.ghost_shift
    if not shift or error is None or error >= abs(shift):
        return estimate
    return dataclasses.replace(estimate, errors=dataclasses.replace(estimate.errors, ghost_shift=abs(shift)))
