"""Whether light arrives polarized before a polarization camera: what tiles of its raw samples tell of that.

Light that is polarized along the plane of incidence, or across, leaves none between these, and looks like that of
another pane. Edges and mean spectra tell it from photographs. Of a mosaic's cells fine detail aliases into both, and
looks polarized itself. Tiles of its samples, in which carriers count as far as they are clean of detail, tell how much
of each layer is polarized along and how much across, for which a pane before unpolarized light leaves one number free.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

from polaropt.estimation.flat.samples.tiles import SampledTileLikelihood, SampledTiles, likeliest_panes
from polaropt.estimation.flat.windows.tiles import TileFit
from polaropt.optics import SceneParameters

_LAYERS = ("behind_degree", "mirrored_degree")
_DEGREES, _INCIDENCES_DEG = (-0.4, 0.4), (35.0, 55.0, 72.0)
"""Degrees of polarization and incidences where a search begins, beside the incidence of the plain pane. Set by hand."""
_LEAST_GAIN, _SURE = 0.4, 2.0
"""Log likelihood that polarized light must gain in a tile on average, and standard errors by which it must be
likelier."""


def light_looks_polarized(mosaic: SampledTiles, scene: SceneParameters, asked: SceneParameters) -> bool:
    """Whether tiles surely find light that arrives polarized likelier than any pane before unpolarized light.

    Parameters
    ----------
    mosaic : SampledTiles
    scene : SceneParameters
        The plain pane that explains the mosaic's cells best, in pixels of the sensor.
    asked : SceneParameters
        An incidence that is not None is kept.
    """
    _, azimuth, _ = scene.values()
    likelihood = SampledTileLikelihood(mosaic, azimuth)
    plain = _plain(likelihood, scene, asked)
    likely = min(_polarized(likelihood, plain, asked), key=lambda fit: fit.misfit)
    return plain.misfit - likely.misfit > _LEAST_GAIN * len(plain.misfits) and likely.surer_than(plain) > _SURE


def _plain(likelihood: SampledTileLikelihood, scene: SceneParameters, asked: SceneParameters) -> TileFit:
    """The likeliest pane before unpolarized light."""
    known, (incidence, _, _) = asked.replace(refractive_index=scene.index), scene.values()
    starts = (incidence,) if asked.incidence_deg is not None else (incidence, *_INCIDENCES_DEG)
    fits = (fit for start in starts for fit in likeliest_panes(likelihood, known, start))
    return min(fits, key=lambda fit: fit.misfit)


def _polarized(likelihood: SampledTileLikelihood, plain: TileFit, asked: SceneParameters) -> Iterator[TileFit]:
    """Panes with the double images of the plain one, one layer's light polarized."""
    window, is_open = plain.window, asked.incidence_deg is None
    free = (*(("incidence_deg",) if is_open else ()), *(("pane_shift",) if window.pane_shift else ()))
    incidences = (window.incidence_deg, *(_INCIDENCES_DEG if is_open else ()))
    for layer in _LAYERS:
        for incidence in incidences:
            for degree in _DEGREES:
                start = replace(window, incidence_deg=incidence, **{layer: degree})
                yield likelihood.nearest(start, plain.refractive_index, (*free, layer))
