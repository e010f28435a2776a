"""Windows of several panes before a polarization camera: which of those that its raw samples tell is taken."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable
from functools import partial
from typing import Any

from polaropt.estimation.flat.estimate import SceneEstimate
from polaropt.estimation.flat.samples.tiles import PaneOfTiles, SampledTiles
from polaropt.estimation.flat.window import ACROSS_FROM_DEG, TRIAL_DEG
from polaropt.estimation.flat.windows.axis import scene_of, window_of
from polaropt.estimation.flat.windows.likelihood import Window
from polaropt.optics import SceneErrors, SceneParameters


def fewer_edges(
    known: SceneParameters, edges: Callable[[SceneParameters], float], to_capture: float, window: Window
) -> float:
    """Share of edges by which layers have fewer behind a window than behind it with its images on the other side.

    Parameters
    ----------
    known : SceneParameters
        With the azimuth of the window.
    edges : callable
        Logarithm of the edges that the layers behind a complete scene have, in pixels of some capture.
    to_capture : float
        Of such pixels in one of the sensor's, which the window is in.
    window : Window
    """
    scene = scene_of(window, known.azimuth_deg or 0.0, known.replace(gap_shift=None)).scaled(to_capture)
    return edges(scene.opposite()) - edges(scene)


def with_window_of_mosaic(
    estimate: SceneEstimate,
    mosaic: SampledTiles,
    asked: SceneParameters,
    edges: Callable[[SceneParameters], float],
) -> SceneEstimate:
    """An estimate from a mosaic's cells with the window of several panes that tiles find, if that is surely likelier.

    Parameters
    ----------
    estimate : SceneEstimate
        Of a single flat pane, or of as many as are asked for, in pixels of the cells.
    mosaic : SampledTiles
    asked : SceneParameters
        Fields that are None are to be found. If the number of panes is told, the likeliest window of so many is taken.
    edges : callable
        Logarithm of the edges that the layers behind a complete scene have, in pixels of the cells.
    """
    scene, to_cells = estimate.scene.scaled(mosaic.period), 1 / mosaic.period
    incidence, azimuth, _ = scene.values()
    known = asked.replace(refractive_index=scene.index)

    def of_axis(azimuth_deg: float) -> PaneOfTiles:
        fewer = partial(fewer_edges, known.replace(azimuth_deg=azimuth_deg), edges, to_cells)
        return PaneOfTiles(mosaic, azimuth_deg, fewer)

    first, told = of_axis(azimuth), asked.incidence_deg
    if asked.n_panes is not None:
        tiles, fit = first, first.of_panes(known, window_of(scene, azimuth), TRIAL_DEG if told is None else (told,))
    else:
        single = first.single(known, (incidence,))
        likely = [(first, first.several(known, single))]
        if asked.azimuth_deg is None and incidence > ACROSS_FROM_DEG:
            across = of_axis(azimuth + 90)
            likely.append((across, across.several(known, across.single(known, TRIAL_DEG), single)))
        found = [(tiles, fit) for tiles, fit in likely if fit is not None]
        if not found:
            return estimate
        tiles, fit = min(found, key=lambda one: one[1].misfit)
    names = {"pane_shift": "ghost_shift", "gap_along": "gap_shift"}
    if told is None:
        names = {"incidence_deg": "incidence_deg", **names}
    of_fit: dict[str, Any] = dict(zip(names.values(), tiles.errors(fit, tuple(names)), strict=True))
    errors = dataclasses.replace(SceneErrors(**of_fit).scaled(to_cells), azimuth_deg=estimate.errors.azimuth_deg)
    scene = scene_of(fit.window, tiles.azimuth_deg, scene.replace(gap_shift=None)).scaled(to_cells)
    return dataclasses.replace(estimate, scene=scene, errors=errors, axis_chance=0.0, axis_gain_db=math.inf, rivals=())
