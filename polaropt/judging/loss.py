"""What the errors of a scene cost its layers, against a scene that is known: decibels that a person loses."""

from __future__ import annotations

import math
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

_OF_RIVALS = dict.fromkeys(("ghost_shift", "transmission_ghost_shift", "gap_shift"))
"""Their errors reach to rivals that are less likely, and are no normal ones: what follows from them is not expected."""

MUCH_DB = 3.0
"""A loss that counts as large: twice the mean squared error."""


@dataclass(frozen=True)
class SceneLoss:
    """How much worse the layers are expected to be than with the scene known.

    Attributes
    ----------
    transmission_db, reflection_db : float
        Mean squared error by the noise and the scene's errors together, over that by the noise alone.
    chance : float
        That the transmission loses more than `MUCH_DB`, if the errors are normal and independent.
    number : str
        The number of the scene whose error costs the transmission most.
    error : float
        Its standard error; of a bend, and of polarized light, the largest of its numbers'.
    """

    transmission_db: float
    reflection_db: float
    chance: float
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
        Those of shifts do not count.
    of_noise : ndarray, shape (2,)
        Variance that the noise leaves to a pixel of each layer.
    growth : NoiseModel, optional
        How the noise grows with the light. Default: it is the same everywhere.
    """
    rows, columns = middle_part(capture.shape, _SIDE)
    height, width = capture.shape[-2:]
    center = ((width - 1) / 2 - columns.start, (height - 1) / 2 - rows.start)
    part = capture.part(rows, columns)
    shares: list[Pair] = []
    added: dict[str, float] = defaultdict(float)
    for doubt in doubts(scene, replace(errors, **_OF_RIVALS)):
        variance = scene_variance(part, noise, (doubt,), center, growth)
        share = variance.mean(axis=tuple(range(1, variance.ndim)), dtype=np.float64) / of_noise
        shares.append(share)
        added[doubt.number] += float(share[0])
    if not shares:
        return None
    transmission, reflection = (float(loss) for loss in 10 * np.log10(1 + np.sum(shares, axis=0)))
    chance = _chance(np.array(shares)[:, 0], 10 ** (MUCH_DB / 10) - 1)
    number = max(added, key=lambda name: added[name])
    return SceneLoss(transmission, reflection, chance, number, float(np.max(getattr(errors, number))))


def _chance(weights: Pair, limit: float) -> float:
    """That the sum of squared standard normal numbers with these weights exceeds a limit.

    Notes
    -----
    By the chi-square law of the same mean and variance, which a single number has (Satterthwaite, An approximate
    distribution of estimates of variance components, 1946).
    """
    from scipy.special import gammaincc

    total, squares = float(weights.sum()), float(np.square(weights).sum())
    if not 0 < squares < math.inf:
        return float(squares > 0)
    return float(gammaincc(total**2 / squares / 2, limit * total / squares / 2))
