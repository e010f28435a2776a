"""What the scene's own standard errors do to the layers: each estimated number is moved both ways.

Per number and pixel the layers move together by half the difference of the two closed forms; their squares add up. The
incidence is moved by two errors, as two are to cover the truth: towards frontal glass what follows from it soars.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from polaropt.capture import Capture
from polaropt.noise_model import NoiseModel
from polaropt.objective import Weights
from polaropt.problem import Problem
from polaropt.scene import SceneParameters
from polaropt.scene_errors import SceneErrors

Images = NDArray[np.float32]

# Beyond these the layers change no more in proportion, and the engine's ranges end.
_LARGEST_DEG, _LARGEST_PX = 20.0, 8.0
_COVERING = 2.0


@dataclass(frozen=True)
class Doubt:
    """A scene on both sides of the one found, in one number, and how many standard errors it is moved each way."""

    below: SceneParameters
    above: SceneParameters
    n_errors: float


def doubts(scene: SceneParameters, errors: SceneErrors) -> tuple[Doubt, ...]:
    """Moved scenes for every number of a complete scene that was estimated.

    Parameters
    ----------
    scene : SceneParameters
    errors : SceneErrors
        What is None in it adds nothing; nor does the azimuth of a flat pane that is seen from far, as polarization
        falls with the cosine of its error.
    """
    # Ghosts hardly matter to how slow changes answer, and before a wide lens they cost many times as much.
    base = scene.replace(ghost_shift=0.0, transmission_ghost_shift=None) if scene.varies else scene
    return tuple(_moved(base, errors))


def scene_variance(
    capture: Capture,
    noise: float,
    doubtful: tuple[Doubt, ...],
    center: tuple[float, float] | None = None,
    growth: NoiseModel | None = None,
) -> Images:
    """Variance of the layers for the scene's errors alone, (2, channel, h, w).

    Errors of different numbers count as independent.

    Parameters
    ----------
    capture : Capture
        The frame, or a tile of it.
    noise : float
    doubtful : tuple of Doubt
        At least one.
    center : (float, float), optional
    growth : NoiseModel, optional
        Both as for `polaropt.problem.Problem`.
    """

    def layers(scene: SceneParameters) -> Images:
        problem = Problem(capture, scene, noise, Weights(), center=center, growth=growth)
        return np.asarray(problem.canvas.crop(problem.known.layers))

    def variance(doubt: Doubt) -> Images:
        change = layers(doubt.above)
        change -= layers(doubt.below)
        change *= np.float32(0.5 / doubt.n_errors)
        return np.asarray(np.square(change, out=change))

    total = variance(doubtful[0])
    for doubt in doubtful[1:]:
        total += variance(doubt)
    return total


def _moved(scene: SceneParameters, errors: SceneErrors) -> Iterator[Doubt]:
    """A doubt for each number that was estimated."""
    incidence, focal = scene.values()[0], scene.focal_px or 0.0
    # Name, largest error that counts, errors to move by, largest step.
    limits = (
        ("incidence_deg", _LARGEST_DEG, _COVERING, min(incidence, 90 - incidence) / 2),
        ("azimuth_deg", _LARGEST_DEG if scene.varies else 0.0, 1.0, _LARGEST_DEG),
        ("ghost_shift", _LARGEST_PX, 1.0, _LARGEST_PX),
        ("transmission_ghost_shift", _LARGEST_PX, 1.0, _LARGEST_PX),
        ("focal_px", focal, 1.0, focal / 2),
    )
    for name, largest, n_errors, farthest in limits:
        value, error = getattr(scene, name), min(getattr(errors, name) or 0.0, largest)
        if value is not None and min(error, farthest) > 0:
            step = min(n_errors * error, farthest)
            below, above = (scene.replace(**{name: value + sign * step}) for sign in (-1, 1))
            yield Doubt(below, above, step / error)
    for i, error in enumerate(errors.bend_deg_per_px or ()):
        if 0 < error < math.inf:
            below, above = (scene.replace(bend_deg_per_px=_bent(scene, i, sign * error)) for sign in (-1, 1))
            yield Doubt(below, above, 1.0)


def _bent(scene: SceneParameters, i: int, more: float) -> tuple[float, ...]:
    """The scene's bend with more of one of its numbers."""
    return tuple(part + more * (i == j) for j, part in enumerate(scene.bend_deg_per_px))
