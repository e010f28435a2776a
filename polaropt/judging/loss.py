"""What the errors of a scene cost its layers, against a scene that is known: decibels that a person loses."""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from polaropt.capture import Capture, NoiseModel
from polaropt.judging.uncertainty import Doubt, doubts, scene_variance
from polaropt.numerics import middle_part
from polaropt.optics import Rival, SceneErrors, SceneParameters, widened

Pair = NDArray[np.float64]

_SIDE = 256
"""Pixels per side of the frame's middle that is looked at, which bounds the time. Set by hand."""

_OF_RIVALS = dict.fromkeys(("ghost_shift", "transmission_ghost_shift", "gap_shift"))
"""Their errors reach to rivals that are less likely, and are no normal ones: what follows from them is not expected."""

MUCH_DB = 3.0
"""A loss that counts as large: twice the mean squared error."""
LEAST_NOTABLE = 1e-3
"""Standard deviation (white = 1) below which what layers or photographs are off by is no fault: a quarter of a level of
8 bits. Only of photographs without noise, as a renderer makes them, does it matter. Set by hand."""


@dataclass(frozen=True)
class SceneLoss:
    """How much worse the layers are expected to be than with the scene known.

    Attributes
    ----------
    transmission_db, reflection_db : float
        Mean squared error by the noise and the scene's errors together, over that by the noise alone, or by
        `LEAST_NOTABLE` where the noise leaves less.
    chance : float
        That the transmission loses more than `MUCH_DB`, if the errors are normal and independent, and rivals as likely
        as they are said to be.
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
    rivals: Sequence[Rival] = (),
) -> SceneLoss | None:
    """Expected loss for the standard errors of a scene, and its rivals; None where it has none.

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
    rivals : sequence of Rival
        Scenes that the errors do not reach.
    """
    rows, columns = middle_part(capture.shape, _SIDE)
    height, width = capture.shape[-2:]
    center = ((width - 1) / 2 - columns.start, (height - 1) / 2 - rows.start)
    part = capture.part(rows, columns)
    least = np.maximum(of_noise, LEAST_NOTABLE**2)

    def share(doubt: Doubt) -> Pair:
        """What a doubt adds to the variance of both layers, in units of the noise's."""
        variance = scene_variance(part, noise, (doubt,), center, growth)
        mean: Pair = variance.mean(axis=tuple(range(1, variance.ndim)), dtype=np.float64)
        return mean / least

    near = doubts(scene, replace(errors, **_OF_RIVALS))
    far = doubts(scene, SceneErrors(), rivals=rivals)
    if not (near or far):
        return None
    # The errors' own are those of the scene that was taken.
    by_errors, by_rivals = (np.array([share(doubt) for doubt in some]).reshape(-1, 2) for some in (near, far))
    chances = np.array([rival.chance for rival in rivals])
    left, limit = 1 - chances.sum(), 10 ** (MUCH_DB / 10) - 1
    expected = left * by_errors.sum(axis=0) + by_rivals.sum(axis=0)
    transmission, reflection = (float(loss) for loss in 10 * np.log10(1 + expected))
    chance = left * _chance(by_errors[:, 0], limit) + chances[by_rivals[:, 0] / chances > limit].sum()
    added: dict[str, float] = defaultdict(float)
    for doubt, (of_transmission, _) in zip((*near, *far), (*by_errors, *by_rivals), strict=True):
        added[doubt.number] += float(of_transmission)
    number = max(added, key=lambda name: added[name])
    stated = replace(errors, incidence_deg=errors.incidence_deg or 0.0)
    error = float(np.max(getattr(widened(stated, scene, rivals), number)))
    return SceneLoss(transmission, reflection, float(chance), number, error)


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
