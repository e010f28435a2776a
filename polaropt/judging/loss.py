"""What the errors of a scene cost its layers, against a scene that is known: decibels that a person loses."""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from polaropt.capture import Capture, NoiseModel
from polaropt.judging.uncertainty import doubts, scene_variance
from polaropt.numerics import middle_part
from polaropt.optics import SceneErrors, SceneParameters

Pair = NDArray[np.float64]

_SIDE = 256
"""Pixels per side of the frame's middle that is looked at, which bounds the time. Set by hand."""

_OF_RIVALS = dict.fromkeys(
    ("ghost_shift", "transmission_ghost_shift", "gap_shift", "transmission_polarization", "reflection_polarization")
)
"""Their errors reach to rivals that are less likely, and are no normal ones: what follows from them is not expected.
Of polarized light POLARIZATION_DOUBTFUL tells."""


@dataclass(frozen=True)
class SceneLoss:
    """How much worse the layers are expected to be than with the scene known.

    Attributes
    ----------
    transmission_db, reflection_db : float
        Mean squared error by the noise and the scene's errors together, over that by the noise alone.
    number : str
        The number of the scene whose error costs the transmission most.
    error : float
        Its standard error; of a bend the largest of its numbers'.
    """

    transmission_db: float
    reflection_db: float
    number: str
    error: float


def scene_loss(
    capture: Capture,
    noise: float,
    scene: SceneParameters,
    errors: SceneErrors,
    of_noise: Pair,
    growth: NoiseModel | None = None,
) -> SceneLoss | None:
    """Expected loss for the standard errors of a scene; None where it has none.

    Parameters
    ----------
    capture : Capture
    noise : float
    scene : SceneParameters
        Complete.
    errors : SceneErrors
        Those of shifts and of polarized light do not count.
    of_noise : ndarray, shape (2,)
        Variance that the noise leaves to a pixel of each layer.
    growth : NoiseModel, optional
        How the noise grows with the light. Default: it is the same everywhere.
    """
    rows, columns = middle_part(capture.shape, _SIDE)
    height, width = capture.shape[-2:]
    center = ((width - 1) / 2 - columns.start, (height - 1) / 2 - rows.start)
    part = capture.part(rows, columns)
    added: dict[str, Pair] = defaultdict(lambda: np.zeros(2))
    for doubt in doubts(scene, replace(errors, **_OF_RIVALS)):
        variance = scene_variance(part, noise, (doubt,), center, growth)
        added[doubt.number] += variance.mean(axis=tuple(range(1, variance.ndim)), dtype=np.float64)
    if not added:
        return None
    transmission, reflection = (float(loss) for loss in 10 * np.log10(1 + sum(added.values()) / of_noise))
    number = max(added, key=lambda name: added[name][0])
    return SceneLoss(transmission, reflection, number, float(np.max(getattr(errors, number))))
