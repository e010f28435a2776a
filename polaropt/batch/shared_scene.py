"""One scene from several captures behind a pane that stands still against the camera."""

from __future__ import annotations

import dataclasses
import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from polaropt.errors import InputError
from polaropt.optics import FIELDS, Field, SceneErrors, SceneParameters, scale_between

_FAR = 4.0
"""Standard errors from which a capture disagrees with the others: hardly one of ten thousand does by chance. Set by
hand."""
_LEAST_ERROR = 1e-9
_MOST = 0.5
"""Share of the captures that must tell a number that not all do, such as the transmission's own ghost shift."""
_SHIFTS = ("ghost_shift", "transmission_ghost_shift", "gap_shift")

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Estimate:
    """A scene as one capture tells it, with the standard errors of what was estimated.

    Attributes
    ----------
    scene : SceneParameters
    errors : SceneErrors
    shape : (int, int) or None
        Height and width of the capture in pixels; None where all have one size.
    """

    scene: SceneParameters
    errors: SceneErrors
    shape: tuple[int, int] | None = None

    def scaled(self, shape: tuple[int, int] | None) -> Estimate | None:
        """As captures of a shape tell it; None where that is no shape of the same view."""
        if shape is None or self.shape is None or shape == self.shape:
            return self
        factor = scale_between(self.shape, shape)
        return None if factor is None else Estimate(self.scene.scaled(factor), self.errors.scaled(factor), shape)


@dataclass(frozen=True)
class Disagreement:
    """A number of a scene in which one capture differs from the others.

    Attributes
    ----------
    capture : int
        Its place among the captures.
    field : str
        Of `SceneParameters`, or "rung" where the capture asks for another model.
    sigmas : float
        Difference in standard errors of the difference.
    """

    capture: int
    field: str
    sigmas: float


@dataclass(frozen=True)
class SharedScene:
    """What several captures tell of one pane.

    Attributes
    ----------
    scene : SceneParameters
        Complete.
    errors : SceneErrors
    n_captures : int
        That told it.
    disagreements : tuple of Disagreement
    shape : (int, int) or None
        Height and width in pixels of the captures whose pixels lengths are counted in; None where all have one size.
    """

    scene: SceneParameters
    errors: SceneErrors
    n_captures: int
    disagreements: tuple[Disagreement, ...]
    shape: tuple[int, int] | None = None

    def seen_by(self, shape: tuple[int, int]) -> Estimate:
        """The scene for a capture of a shape.

        Raises
        ------
        InputError
            Its sides are in other proportions.
        """
        found = Estimate(self.scene, self.errors, self.shape).scaled(shape)
        if found is None:
            assert self.shape is not None
            raise InputError(
                f"has {shape[1]}x{shape[0]} px, and most that share a scene {self.shape[1]}x{self.shape[0]}; "
                "separate it by itself"
            )
        return found


def combine_scenes(estimates: Sequence[Estimate | None]) -> SharedScene:
    """The scene that captures behind one pane tell together.

    Each number is the mean of what the captures tell, weighted by their standard errors; where they scatter by more
    than these, the mean's error grows with the scatter (R. T. Birge, Physical Review 40, 1932). A capture that lies
    more than four standard errors from the others' mean is left out of it, and named.

    Parameters
    ----------
    estimates : sequence of Estimate or None
        None, or a scene without signal, is a capture that tells nothing; so is one whose sides are in other
        proportions than those of most. Lengths are counted in the pixels of captures of the commonest shape.

    Raises
    ------
    InputError
        No capture tells the scene.
    """
    polarized = {i: one for i, one in enumerate(estimates) if one is not None and one.scene.signal}
    shapes = Counter(one.shape for one in polarized.values()).most_common(1)
    shape = shapes[0][0] if shapes else None
    of_shape = ((i, one.scaled(shape)) for i, one in polarized.items())
    told = {i: one for i, one in of_shape if one is not None}
    if not told:
        raise InputError(
            "no capture shows polarization; a shared scene needs one that does, or give the scene (--incidence ...)"
        )
    kind, _ = Counter(_kind(one.scene) for one in told.values()).most_common(1)[0]
    alike = {i: one for i, one in told.items() if _kind(one.scene) == kind}
    disagreements = [Disagreement(i, "rung", math.inf) for i in told if i not in alike]
    first = _most_exact(alike)
    turned = {i: as_seen_from(one, alike[first].scene) for i, one in alike.items()}
    scene, errors = turned[first].scene, SceneErrors()
    for field in FIELDS:
        if not field.estimable or field.name == "n_panes":
            continue
        values = {i: _numbers(getattr(one.scene, field.name)) for i, one in turned.items()}
        spreads = {i: _numbers(getattr(one.errors, field.name)) for i, one in turned.items()}
        known = [i for i in turned if values[i] is not None and spreads[i] is not None]
        if len(known) <= _MOST * len(turned):
            # What most captures do not tell stays as the most exact one has it.
            if field.name == "transmission_ghost_shift":
                scene = scene.replace(transmission_ghost_shift=None)
            continue
        value = np.array([values[i] for i in known], dtype=np.float64)
        spread = np.maximum(np.array([spreads[i] for i in known], dtype=np.float64), _LEAST_ERROR)
        mean, error, sigmas = _robust_mean(_unwrapped(field, value), spread)
        scene = scene.replace(**{field.name: _as_field(mean)})
        errors = _with(errors, field.name, _as_field(error))
        far = sigmas.max(axis=1)
        disagreements += [Disagreement(i, field.name, float(s)) for i, s in zip(known, far, strict=True) if s > _FAR]
    return SharedScene(scene, errors, len(alike), tuple(disagreements), shape)


def _kind(scene: SceneParameters) -> tuple[str, int, int]:
    """What of a scene no mean can be taken of."""
    return scene.rung, scene.n_panes or 1, int(scene.bent)


def _most_exact(estimates: dict[int, Estimate]) -> int:
    return min(estimates, key=lambda i: estimates[i].errors.incidence_deg or math.inf)


def as_seen_from(one: Estimate, reference: SceneParameters) -> Estimate:
    """The same pane with its azimuth within a quarter of a turn of another's: the other way round, shifts change signs.

    Before a lens the azimuth is a direction, and the other way round is another pane.
    """
    scene = one.scene
    if scene.varies or scene.azimuth_deg is None or reference.azimuth_deg is None:
        return one
    turns = round((scene.azimuth_deg - reference.azimuth_deg) / 180)
    changes: dict[str, object] = {"azimuth_deg": scene.azimuth_deg - 180 * turns}
    if turns % 2:
        changes |= {name: -getattr(scene, name) for name in _SHIFTS if getattr(scene, name) is not None}
    return Estimate(scene.replace(**changes), one.errors)


def _numbers(value: object) -> tuple[float, ...] | None:
    """The numbers of a field; None where they say nothing, as errors without bound do."""
    if value is None:
        return None
    numbers = tuple(value) if isinstance(value, tuple) else (float(value),)  # type: ignore[arg-type]
    return numbers if all(map(math.isfinite, numbers)) else None


def _as_field(numbers: Floats) -> float | tuple[float, ...]:
    listed = tuple(float(number) for number in numbers)
    return listed[0] if len(listed) == 1 else listed


def _with(errors: SceneErrors, name: str, value: object) -> SceneErrors:
    return dataclasses.replace(errors, **{name: value})  # type: ignore[arg-type]


def _unwrapped(field: Field, values: Floats) -> Floats:
    """Angles of captures (n, components) without turns between them."""
    unwrapped = values.copy()
    for i, component in enumerate(field.components):
        if component.period is not None and field.name != "azimuth_deg":
            turns = np.round((values[:, i] - values[0, i]) / component.period)
            unwrapped[:, i] -= component.period * turns
    return unwrapped


def _robust_mean(values: Floats, errors: Floats) -> tuple[Floats, Floats, Floats]:
    """Weighted means (components,) of captures (n, components), their errors, and how far each capture lies from the
    others' mean, in standard errors (n, components)."""
    kept = np.ones(values.shape, dtype=bool)
    # The farthest goes first, one at a time: it pulls the mean that others are compared with.
    for _ in range(len(values)):
        worst = np.where(kept, _distances(values, errors, kept), 0)
        far = (worst > _FAR) & (worst == worst.max(axis=0)) & (kept.sum(axis=0) > 2)
        if not far.any():
            break
        kept &= ~far
    weights = kept / errors**2
    total = weights.sum(axis=0)
    mean = (weights * values).sum(axis=0) / total
    free = np.maximum(kept.sum(axis=0) - 1, 1)
    scatter = (weights * (values - mean) ** 2).sum(axis=0) / free
    return mean, np.sqrt(np.maximum(scatter, 1.0) / total), _distances(values, errors, kept)


def _distances(values: Floats, errors: Floats, kept: NDArray[np.bool_]) -> Floats:
    """Distance of each capture (n, components) from the mean of those kept without it, in standard errors.

    Where the others scatter by more than their errors say, all errors are taken for too small by as much.
    """
    weights = kept / errors**2
    centered = values - (weights * values).sum(axis=0) / weights.sum(axis=0)
    without = weights.sum(axis=0) - weights
    alone = without <= 0
    without = np.where(alone, 1.0, without)
    first = (weights * centered).sum(axis=0) - weights * centered
    second = (weights * centered**2).sum(axis=0) - weights * centered**2
    mean = first / without
    free = np.maximum(kept.sum(axis=0) - kept - 1, 1)
    scatter = np.maximum((second - without * mean**2) / free, 1.0)
    distances: Floats = np.where(alone, 0.0, np.abs(centered - mean) / np.sqrt((errors**2 + 1 / without) * scatter))
    return distances
