"""From captures of a camera that films through one pane to their layers, one after another."""

from __future__ import annotations

import dataclasses
import math
import sys
from collections.abc import Iterable, Iterator
from itertools import chain, islice
from typing import Any, Literal

import numpy as np

from polaropt.batch import Estimate, SharedScene, combine_scenes
from polaropt.capture import Capture
from polaropt.errors import InputError
from polaropt.optics import SceneErrors, SceneParameters
from polaropt.separation import FrameMemory, Separation, estimate, scene_options, separate, separate_frame
from polaropt.sequence.ahead import read_ahead

FIRST = 5
"""Frames that the pane is found from; set by hand."""
EVERY = 10
"""Frames after which a pane that is followed is looked at again; set by hand."""
# How far a pane that is followed may have come from frame to frame, one standard deviation: a camera held by hand, set
# by hand.
_DRIFT = {
    "incidence_deg": 0.05,
    "azimuth_deg": 0.05,
    "ghost_shift": 0.01,
    "transmission_ghost_shift": 0.01,
    "gap_shift": 0.01,
}
_OF_UNKNOWN = ("refractive_index", "single_surface", "thickness_px", "index_known")
"""Options of `separate` for a scene that is not known."""
_OPEN = 1e3
"""Standard errors, as multiples of those that are known, of what a frame does not tell."""


def separate_sequence(
    captures: Iterable[Capture],
    scene: SceneParameters | None = None,
    *,
    pane: Literal["follow", "still"] = "follow",
    first: int = FIRST,
    every: int = EVERY,
    ahead: bool = True,
    **options: Any,
) -> Iterator[Separation]:
    """`polaropt.separate_sequence`, which adds what shows the results."""
    if pane not in ("follow", "still"):
        raise InputError(f"unknown pane {pane!r}; there are: follow, still")
    if first < 1 or every < 1:
        raise InputError(f"first is {first} and every {every}; give 1 or more")
    frames = read_ahead(captures) if ahead else iter(captures)
    known: _Pane | None = None
    if scene is not None and scene.complete and options.get("thickness_px") is None:
        known = _Pane(SharedScene(scene, SceneErrors(), 0, ()), scene, options, math.inf)
    before: Separation | None = None
    while True:
        if known is None:
            begin = list(islice(frames, min(first, sys.maxsize)))
            if not begin:
                return
            known = _found(begin, scene, options, every if pane == "follow" else math.inf)
            if known is None:
                yield from (separate(capture, scene, **options) for capture in begin)
                continue
            frames = chain(begin, frames)
            known.fresh(len(begin))
        capture = next(frames, None)
        if capture is None:
            return
        known.look(capture)
        before = known.separated(capture, before)
        yield before


def _found(
    captures: list[Capture], asked: SceneParameters | None, options: dict[str, Any], every: float
) -> _Pane | None:
    """The pane of the first frames; None where none of them is polarized."""
    found = [estimate(capture, asked, **scene_options(options)) for capture in captures]
    estimates = [Estimate(one.scene, one.errors) for one in found]
    if not any(one.scene.signal for one in estimates):
        return None
    return _Pane(combine_scenes(estimates), asked, options, every)


class _Pane:
    """What is known of the pane, frame after frame."""

    def __init__(
        self, shared: SharedScene, asked: SceneParameters | None, options: dict[str, Any], every: float
    ) -> None:
        self._shared, self._asked, self._options, self._every = shared, asked, options, every
        self._age = 0
        self._odd: Estimate | None = None
        self._memory: FrameMemory | None = None

    def fresh(self, frames: int) -> None:
        """It was found from so many frames, which come next."""
        self._age = -frames

    def look(self, capture: Capture) -> None:
        """Let a frame tell the pane, where it is time."""
        self._age += 1
        if self._age < self._every:
            return
        model = self._options.get("model", "auto")
        # The rung stays: a frame that shows no double images does not make the pane another one.
        rung = self._shared.scene.rung if model == "auto" else model
        found = estimate(capture, self._asked, **{**scene_options(self._options), "model": rung})
        self._see(Estimate(found.scene, found.errors))

    def _see(self, told: Estimate) -> None:
        if not told.scene.signal:
            return
        known = Estimate(self._shared.scene, widened(self._shared.errors, self._age))
        both = combine_scenes([known, completed(told, known)])
        if not both.disagreements:
            self._shared, self._age, self._odd = both, 0, None
            return
        # One frame may err; two that say the same of another pane are believed.
        if self._odd is not None:
            odd = combine_scenes([self._odd, told])
            if not odd.disagreements:
                self._shared, self._age, self._odd = odd, 0, None
                return
        self._odd = told

    def separated(self, capture: Capture, before: Separation | None) -> Separation:
        """A frame with the pane as it is known, and with what the frame before tells of it."""
        start = None
        if before is not None and before.layers.shape == (2, *capture.shape):
            start = before.layers
        options = {name: value for name, value in self._options.items() if name not in _OF_UNKNOWN}
        shared = self._shared
        result, self._memory = separate_frame(
            capture, shared.scene, self._memory, scene_errors=shared.errors, start=start, **options
        )
        return result


def widened(errors: SceneErrors, frames: int) -> SceneErrors:
    """Standard errors of a pane that may have moved for so many frames."""
    changes: dict[str, Any] = {}
    for name, drift in _DRIFT.items():
        error = getattr(errors, name)
        if error is not None:
            changes[name] = math.hypot(error, drift * math.sqrt(max(0, frames)))
    return dataclasses.replace(errors, **changes)


def completed(told: Estimate, known: Estimate) -> Estimate:
    """What a frame tells of a pane, with hardly any weight on numbers that it leaves open and that are known."""
    scene, errors = told.scene, told.errors
    for name in ("focal_px", *_DRIFT):
        error = getattr(known.errors, name)
        if error is not None and getattr(errors, name) is None:
            scene = scene.replace(**{name: getattr(known.scene, name)})
            errors = dataclasses.replace(errors, **{name: _OPEN * error})
    return Estimate(scene, errors)


def flicker(results: Iterable[Separation]) -> tuple[float, float]:
    """Root mean square change of both layers from frame to frame, 16 px at the border left out.

    Parameters
    ----------
    results : iterable of Separation
        Of one size.
    """
    margin, changes = 16, []
    before = None
    for result in results:
        layers = result.layers[..., margin:-margin, margin:-margin]
        if before is not None:
            changes.append(np.mean((layers - before) ** 2, axis=tuple(range(1, layers.ndim)), dtype=np.float64))
        before = layers
    transmission, reflection = np.sqrt(np.mean(changes, axis=0)).tolist()
    return transmission, reflection
