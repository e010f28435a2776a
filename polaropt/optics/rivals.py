"""Scenes that explain a capture about as well as the one taken, and what they make of its errors."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

from polaropt.numerics import turn_between
from polaropt.optics.scene import SceneErrors, SceneParameters


@dataclass(frozen=True)
class Rival:
    """A scene that may be the true one.

    Attributes
    ----------
    scene : SceneParameters
        Complete.
    chance : float
        That it, or one like it, is the true one.
    """

    scene: SceneParameters
    chance: float

    def scaled(self, factor: float) -> Self:
        """The same of photographs with so many times the pixels a side."""
        return dataclasses.replace(self, scene=self.scene.scaled(factor))


def widened(errors: SceneErrors, scene: SceneParameters, rivals: Sequence[Rival]) -> SceneErrors:
    """Errors of a scene that reach its rivals: added to them is how far these lie, root mean square by chance."""

    def spread(name: str, period: float = math.inf, part: int | None = None) -> float:
        def number(of: SceneParameters) -> float:
            value = getattr(of, name)
            return float(value if part is None else value[part])

        return math.sqrt(
            sum(rival.chance * _apart(number(rival.scene) - number(scene), period) ** 2 for rival in rivals)
        )

    def wider(error: float | None, name: str, period: float = math.inf) -> float | None:
        return None if error is None else math.hypot(error, spread(name, period))

    def of_light(error: tuple[float, float] | None, name: str) -> tuple[float, float] | None:
        if error is None:
            return None
        return math.hypot(error[0], spread(name, part=0)), math.hypot(error[1], spread(name, 180.0, part=1))

    return dataclasses.replace(
        errors,
        incidence_deg=wider(errors.incidence_deg, "incidence_deg"),
        azimuth_deg=wider(errors.azimuth_deg, "azimuth_deg", 180.0),
        transmission_polarization=of_light(errors.transmission_polarization, "transmission_polarization"),
        reflection_polarization=of_light(errors.reflection_polarization, "reflection_polarization"),
    )


def _apart(difference: float, period: float) -> float:
    """A difference of numbers that come round after a period."""
    return difference if math.isinf(period) else turn_between(difference, 0.0, period)
