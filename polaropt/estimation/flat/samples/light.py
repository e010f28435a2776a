"""Light that arrives polarized before a polarization camera, as tiles of its raw samples tell it.

Light that is polarized along the plane of incidence, or across, leaves none between these, and looks like that of
another pane. Edges and mean spectra tell it from photographs. Of a mosaic's cells fine detail aliases into both, and
looks polarized itself. Tiles of its samples, in which carriers count as far as they are clean of detail, tell how much
of each layer is polarized along and how much across, for which a pane before unpolarized light leaves one number free.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from polaropt.estimation.flat.samples.single import likeliest_panes
from polaropt.estimation.flat.samples.tiles import SampledTileLikelihood, SampledTiles
from polaropt.estimation.flat.windows.likelihood import Window
from polaropt.estimation.flat.windows.tiles import TileFit
from polaropt.optics import SceneParameters, in_place_reflectance

_LAYERS = {"behind_degree": "transmission_polarization", "mirrored_degree": "reflection_polarization"}
"""Degrees of a window, negative across, and what the polarization of that layer's light is called in a scene."""
_DEGREES, _INCIDENCES_DEG = (-0.4, 0.4), (35.0, 55.0, 72.0)
"""Degrees of polarization and incidences where a search begins, beside the incidence of the plain pane. Set by hand."""
_MOST_TILES = 64
"""Tiles that are asked for the best of these starts. Set by hand."""
_LEAST_GAIN, _SURE = 0.4, 2.0
"""Log likelihood per tile, and standard errors, that polarized light must gain to be looked for in cells. Of some 700
mosaics of plain panes (an engine of its own, 22 to 78 degrees) cells alone find polarized light in 15, of which none
gains as much; of 200 more none is taken for polarized, nor do 131 of 150 random windows without polarized light gain as
much (`studies.random_windows --sensor mono`, even seeds from 100000); what others gain, cells do not bear out."""
_GAIN_ALONE, _SURE_ALONE, _SURE_OF_LAYER, _MOST_DEGREE = 1.0, 2.5, 1.0, 0.9
"""What it must gain to be possible whatever cells tell, standard errors by which one layer must be likelier to have it
than the other, and the degree beyond which it is none: so it is in 1 of those 150 windows, of two panes, and in one
with a polarized sky that cells do not tell (80104), whose transmission lies 17 dB low. It must make both layers look
less alike than the plain pane does: for more of the brighter one passes all that is not as it is taken to be."""


@dataclass(frozen=True)
class PolarizedPane:
    """A flat pane before light of which one layer's is polarized along its plane of incidence, or across.

    Attributes
    ----------
    scene : SceneParameters
    is_possible : bool
        Whether tiles are so sure of it that it may be the true one whatever the mosaic's cells tell.
    """

    scene: SceneParameters
    is_possible: bool


def polarized_pane(mosaic: SampledTiles, scene: SceneParameters, asked: SceneParameters) -> PolarizedPane | None:
    """The pane before polarized light that tiles surely find likelier than any before unpolarized light; None without.

    All in pixels of the sensor.

    Parameters
    ----------
    mosaic : SampledTiles
    scene : SceneParameters
        The plain pane that explains the mosaic's cells best.
    asked : SceneParameters
        Incidence and ghost shift that are not None are kept.
    """
    azimuth = scene.values()[1]
    likelihood = SampledTileLikelihood(mosaic, azimuth)
    others = _INCIDENCES_DEG if asked.incidence_deg is None else ()
    plain = _plain(likelihood, scene, asked, others)
    starts = [replace(plain.window, incidence_deg=angle) for angle in (plain.window.incidence_deg, *others)]
    free: tuple[str, ...] = ("incidence_deg",) if asked.incidence_deg is None else ()
    free += ("pane_shift",) if plain.window.pane_shift and asked.ghost_shift is None else ()
    fits = {layer: _polarized(likelihood, starts, scene.index, free, layer) for layer in _LAYERS}
    layer, other = sorted(fits, key=lambda one: fits[one].misfit)
    likely = fits[layer]
    gain, sure = likely.gain_per_tile(plain), likely.surer_than(plain)
    if gain < _LEAST_GAIN or sure < _SURE:
        return None
    window, degree = likely.window, float(getattr(likely.window, layer))
    is_possible = gain > _GAIN_ALONE and sure > _SURE_ALONE and likely.surer_than(fits[other]) > _SURE_OF_LAYER
    is_possible &= _apart(likely, scene) > _apart(plain, scene) and abs(degree) < _MOST_DEGREE
    light: dict[str, Any] = {_LAYERS[layer]: (abs(degree), (azimuth + (90 if degree < 0 else 0)) % 180)}
    scene = scene.replace(incidence_deg=window.incidence_deg, ghost_shift=window.pane_shift, **light)
    return PolarizedPane(scene, is_possible)


def _plain(
    likelihood: SampledTileLikelihood,
    scene: SceneParameters,
    asked: SceneParameters,
    incidences_deg: tuple[float, ...],
) -> TileFit:
    """The likeliest pane before unpolarized light, near that of a scene or one in place at some other incidences."""
    incidence, _, shift = scene.values()
    free = ("incidence_deg",) if asked.incidence_deg is None else ()
    if asked.ghost_shift is None:
        place, ghosts = likeliest_panes(likelihood, asked.replace(refractive_index=scene.index), incidence)
    else:
        place = ghosts = likelihood.nearest(Window(incidence, shift), scene.index, free)
    others = (replace(place.window, incidence_deg=angle) for angle in incidences_deg)
    fits = [likelihood.nearest(start, scene.index, free) for start in others]
    fits += [ghosts if ghosts.surer_than(place) > _SURE else place]
    return min(fits, key=lambda fit: fit.misfit)


def _polarized(
    likelihood: SampledTileLikelihood,
    starts: Sequence[Window],
    refractive_index: float,
    free: tuple[str, ...],
    layer: str,
) -> TileFit:
    """The likeliest pane near some windows before light of which one layer's is polarized."""
    glance, free = likelihood.some(_MOST_TILES), (*free, layer)
    lit = (_with_degree(start, layer, degree) for start in starts for degree in _DEGREES)
    near = (glance.nearest(window, refractive_index, free) for window in lit)
    return likelihood.nearest(min(near, key=lambda fit: fit.misfit).window, refractive_index, free)


def _with_degree(window: Window, layer: str, degree: float) -> Window:
    """A window before light of one layer that is polarized along its plane of incidence, or across if negative."""
    change: dict[str, Any] = {layer: degree}
    return replace(window, **change)


def _apart(fit: TileFit, scene: SceneParameters) -> float:
    """How far apart the degrees of polarization are that both layers show, their images in place."""
    window = fit.window
    mirrored = np.array(in_place_reflectance(window.incidence_deg, scene.index, scene.single_surface))
    light = 1 + np.outer([window.behind_degree, window.mirrored_degree], [1, -1])
    shown = light * [1 - mirrored, mirrored]
    behind, reflected = (shown[:, 0] - shown[:, 1]) / shown.sum(axis=1)
    return float(abs(behind - reflected))
