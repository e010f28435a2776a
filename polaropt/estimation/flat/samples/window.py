"""Windows of several panes, or of tinted glass, before a polarization camera: which of those that its samples tell."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from typing import Any

from polaropt.estimation.flat.estimate import SceneEstimate
from polaropt.estimation.flat.samples.edges import LayerEdges, WindowEdges
from polaropt.estimation.flat.samples.panes import NOTABLE_CHANCE
from polaropt.estimation.flat.samples.tiles import PaneOfTiles, SampledTiles
from polaropt.estimation.flat.window import ACROSS_FROM_DEG, TRIAL_DEG
from polaropt.estimation.flat.windows.axis import scene_of, window_of
from polaropt.estimation.flat.windows.likelihood import Window
from polaropt.estimation.flat.windows.tiles import TileFit
from polaropt.optics import Rival, SceneErrors, SceneParameters


def with_window_of_mosaic(
    estimate: SceneEstimate,
    mosaic: SampledTiles,
    asked: SceneParameters,
    edges: LayerEdges,
) -> SceneEstimate:
    """An estimate from a mosaic's cells with the window of several panes that tiles find, if that is surely likelier.

    Where it may be, it is a rival of the single pane, and the single pane one of it. Tinted glass is found where its
    ghosts show that clear glass has not.

    Parameters
    ----------
    estimate : SceneEstimate
        Of a single flat pane, or of as many as are asked for, in pixels of the cells.
    mosaic : SampledTiles
    asked : SceneParameters
        Fields that are None are to be found. If the number of panes is told, the likeliest window of so many is taken.
    edges : LayerEdges
        Of scenes in pixels of the cells.
    """
    scene, to_cells = estimate.scene.scaled(mosaic.period), 1 / mosaic.period
    incidence, azimuth, _ = scene.values()
    known = asked.replace(refractive_index=scene.index)

    def of_axis(azimuth_deg: float) -> PaneOfTiles:
        of_windows = WindowEdges(known.replace(azimuth_deg=azimuth_deg), edges, to_cells)
        return PaneOfTiles(mosaic, azimuth_deg, of_windows)

    first, rivals = of_axis(azimuth), tuple[Rival, ...]()
    if asked.n_panes is not None:
        incidences = TRIAL_DEG if asked.incidence_deg is None else (asked.incidence_deg,)
        tiles, fit = first, first.of_panes(known, window_of(scene, azimuth), incidences)
    else:
        singles = [(first, first.single(known, (incidence,)))]
        if asked.azimuth_deg is None and incidence > ACROSS_FROM_DEG:
            across = of_axis(azimuth + 90)
            singles.append((across, across.single(known, TRIAL_DEG)))
        single = singles[0][1]
        asked_of = [(one, one.several(known, own, *(() if one is first else (single,)))) for one, own in singles]
        likely = [(one, panes) for one, panes in asked_of if panes is not None]
        told = [one for one in likely if one[1].is_told]
        tinted = _tinted(known, singles) if asked.absorption is None and not told else None
        if not likely and tinted is None:
            return estimate
        if told:
            tiles, panes = min(told, key=lambda one: one[1].fit.misfit)
            fit, wrong = panes.fit, 1 - panes.chance
            rivals = (Rival(estimate.scene, wrong),) if wrong > NOTABLE_CHANCE else ()
        elif tinted is not None:
            tiles, fit = tinted
        else:
            tiles, panes = max(likely, key=lambda one: one[1].chance)
            rival = Rival(_scene(panes.fit.window, tiles, scene, to_cells), panes.chance)
            return dataclasses.replace(estimate, rivals=(*estimate.rivals, rival))
    names = {"pane_shift": "ghost_shift", "gap_along": "gap_shift"}
    if fit.window.n_panes == 1:
        names = {"pane_shift": "ghost_shift", "absorption": "absorption"}
    if asked.incidence_deg is None:
        names = {"incidence_deg": "incidence_deg", **names}
    of_fit: dict[str, Any] = dict(zip(names.values(), tiles.errors(fit, tuple(names)), strict=True))
    errors = dataclasses.replace(SceneErrors(**of_fit).scaled(to_cells), azimuth_deg=estimate.errors.azimuth_deg)
    scene = _scene(fit.window, tiles, scene, to_cells)
    return dataclasses.replace(
        estimate, scene=scene, errors=errors, axis_chance=0.0, axis_gain_db=math.inf, rivals=rivals
    )


def _tinted(
    known: SceneParameters, singles: Sequence[tuple[PaneOfTiles, TileFit]]
) -> tuple[PaneOfTiles, TileFit] | None:
    """The pane of tinted glass that is surely likelier than any single pane of either axis, the first ones' rather."""
    tinted = [tiles.tinted(known, single) for tiles, single in singles]
    for k, ((tiles, own), found) in enumerate(zip(singles, tinted, strict=True)):
        others = [single for _, single in singles if single is not own]
        others += [other for other in tinted if other is not None and other is not found]
        if found is not None and tiles.tells_tint(known, found, own, *others, across=k > 0):
            return tiles, found
    return None


def _scene(window: Window, tiles: PaneOfTiles, scene: SceneParameters, to_cells: float) -> SceneParameters:
    """The scene of a window that tiles tell, in pixels of the cells; what else it has is that of another one."""
    return scene_of(window, tiles.azimuth_deg, scene.replace(gap_shift=None)).scaled(to_cells)
