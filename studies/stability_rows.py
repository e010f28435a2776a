"""Rows of the stability study: every scene separated on every rung, by doing nothing, and by independent components."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from studies.camera import Sample, take
from studies.photographs import Pair
from studies.scenes import Scene
from studies.scores import both_psnr, detail_correlation
from studies.ways import COMPONENTS, METHODS, RUNGS
from studies.ways import MINIMUM as MINIMUM_OVER_ANGLES
from studies.ways import PLAIN as PLAIN_INTENSITY

NOTHING, MINIMUM = "s0", "minimum"
BASELINES = {NOTHING: PLAIN_INTENSITY, MINIMUM: MINIMUM_OVER_ANGLES, COMPONENTS: COMPONENTS}
"""Methods that know no pane, by the names that they have in this study."""


@dataclass(frozen=True)
class Row:
    """One separation.

    Attributes
    ----------
    family, case, value, second, pair
        The scene, see `studies.scenes.Scene`; the pair's number.
    method : str
    transmission, reflection : float
        PSNR in dB over pixels that no photograph clips, 16 px at the border left out.
    detail : float
        Correlation of the reflection's detail (finer than about 5 px) with the true one.
    rung : str
        That was taken; empty for the baselines.
    incidence_deg : float or None
        That was found.
    misfit : float or None
        Mean squared residual in units of the noise.
    seconds : float
    warnings : tuple of str
    """

    family: str
    case: str
    value: float
    second: float
    pair: int
    method: str
    transmission: float
    reflection: float
    detail: float
    rung: str
    incidence_deg: float | None
    misfit: float | None
    seconds: float
    warnings: tuple[str, ...]


def methods() -> tuple[str, ...]:
    """Names of all methods: polaropt's models first, "auto" at their head; its model "none" is doing nothing."""
    return (*RUNGS, *BASELINES)


def rows_of(scene: Scene, pair: Pair, wanted: Sequence[str]) -> list[Row]:
    """Separate one scene in every way that is wanted."""
    sample = take(scene, pair)
    return [_row(scene, pair, method, sample) for method in wanted]


def _row(scene: Scene, pair: Pair, method: str, sample: Sample) -> Row:
    began = time.perf_counter()
    rung, incidence, misfit, warnings = "", None, None, ()
    if method in BASELINES:
        transmission, reflection = METHODS[BASELINES[method]].run(sample)
        layers = np.stack([transmission, np.zeros_like(transmission) if reflection is None else reflection])
    else:
        result = RUNGS[method].separation(sample)
        layers, rung = result.layers, result.scene.rung
        incidence, misfit = result.scene.incidence_deg, result.diagnostics.misfit_ratio
        warnings = tuple(warning.name for warning in result.diagnostics.warnings)
    seconds = time.perf_counter() - began
    quality = both_psnr(layers, sample.layers, sample.unclipped)
    detail = detail_correlation(layers[1], sample.layers[1], sample.unclipped)
    return Row(
        scene.family, scene.name, scene.value, scene.second, pair.number, method, *quality, detail, rung, incidence,
        misfit, seconds, warnings,
    )  # fmt: skip
