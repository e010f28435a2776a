"""From captures of a camera that films through one pane to their layers, one after another."""

from __future__ import annotations

import dataclasses
import math
import sys
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from itertools import chain, islice
from types import MappingProxyType
from typing import Any, Literal

import numpy as np

from polaropt.batch import Estimate, SharedScene, as_seen_from, combine_scenes
from polaropt.capture import Capture
from polaropt.errors import InputError, check_whole
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
_WORSE = 1.15
"""Misfit of a frame beside the least since a frame told the pane, beyond which the next one is asked: frames of a still
film differ by a tenth at most, a pane that has turned by a degree or two explains less by more. Set by hand."""
_SURELY = 2.0
"""Standard errors by which a number must have changed to be seen to move; set by hand."""
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
    check_whole([("first", first), ("every", every)], least=1)
    if options.pop("start", None) is not None:
        raise InputError("a frame starts from what the one before has left; leave out start")
    known_errors = options.pop("scene_errors", None) or SceneErrors()
    frames = read_ahead(captures) if ahead else iter(captures)
    known: _Pane | None = None
    if scene is not None and scene.complete and options.get("thickness_px") is None:
        known = _Pane(SharedScene(scene, known_errors, 0, ()), scene, options, math.inf)
    before: Separation | None = None
    while True:
        if known is None:
            begin = list(islice(frames, int(min(first, sys.maxsize))))
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
        self._track = Track(Estimate(shared.scene, shared.errors), every)
        self._asked, self._options = asked, options
        self._memory: FrameMemory | None = None
        self._least_misfit = math.inf

    def fresh(self, frames: int) -> None:
        """It was found from so many frames, which come next."""
        self._track.age = -frames

    def look(self, capture: Capture) -> None:
        """Let a frame tell the pane, where it is time."""
        track = self._track
        track.age += 1
        if track.age < track.patience:
            return
        model = self._options.get("model", "auto")
        # The rung stays: a frame that shows no double images does not make the pane another one.
        rung = track.known.scene.rung if model == "auto" else model
        found = estimate(capture, self._asked, **{**scene_options(self._options), "model": rung})
        track.see(Estimate(found.scene, found.errors))
        if track.age == 0:
            self._least_misfit = math.inf

    def separated(self, capture: Capture, before: Separation | None) -> Separation:
        """A frame with the pane as it is known, and with what the frame before tells of it."""
        start = None
        if before is not None and before.layers.shape == (2, *capture.shape):
            start = before.layers
        options = {name: value for name, value in self._options.items() if name not in _OF_UNKNOWN}
        stated = self._track.stated
        result, self._memory = separate_frame(
            capture, stated.scene, self._memory, scene_errors=stated.errors, start=start, **options
        )
        misfit = result.diagnostics.misfit_ratio
        if misfit > _WORSE * self._least_misfit:
            # The camera was knocked, or moves on.
            self._track.doubt()
        self._least_misfit = min(self._least_misfit, misfit)
        return result


@dataclass
class Track:
    """How a pane stands from frame to frame, as now and then one tells it.

    Attributes
    ----------
    known : Estimate
        When a frame told it last.
    every : float
        Frames after which another one is asked to, at the latest.
    age : int
        Frames since then; negative while those come that it was found from.
    speed : dict of str to float
        How far its numbers were seen to move in a frame, whichever way.
    patience : float
        Frames after which the next one is asked: fewer than `every` while it moves, more and more once it stands still.
    odd : (Estimate, int) or None
        What the last frame that was asked told of another pane, and the age at which it did.
    """

    known: Estimate
    every: float = math.inf
    age: int = 0
    speed: dict[str, float] = field(default_factory=dict)
    odd: tuple[Estimate, int] | None = None
    patience: float = field(init=False)

    def __post_init__(self) -> None:
        self.patience = self.every

    @property
    def follows(self) -> bool:
        """Whether frames are asked at all: a pane that stands still is known from before."""
        return math.isfinite(self.every)

    def doubt(self) -> None:
        """Let the next frame be asked."""
        if self.follows:
            self.patience = 1

    @property
    def stated(self) -> Estimate:
        """The pane with its errors at this frame; where the last one that told of it says otherwise they reach that."""
        frames = self.age if self.follows else 0
        scene, errors = self.known.scene, widened(self.known.errors, frames, self.speed)
        if self.odd is not None:
            apart = changes(self.known, self.odd[0])
            far: dict[str, Any] = {name: math.hypot(getattr(errors, name), by) for name, by in apart.items()}
            errors = dataclasses.replace(errors, **far)
        return Estimate(scene, errors)

    def see(self, told: Estimate) -> None:
        """Weigh what a frame tells against what is known, by the standard errors of both."""
        if not told.scene.signal:
            return
        known = Estimate(self.known.scene, widened(self.known.errors, self.age, self.speed))
        if self._agree(known, completed(told, known), self._speed_to(told, self.age)):
            self.patience = max(1, self.patience / 2) if self._moves() else min(self.every, 2 * self.patience)
            return
        # One frame may err; two that say the same of another pane are believed, or of one that moves on as fast.
        if self.odd is not None:
            odd, age = self.odd
            speed = self._speed_to(odd, age)
            before = Estimate(odd.scene, widened(odd.errors, self.age - age, speed))
            if self._agree(before, told, speed):
                self.doubt()
                return
        self.odd = told, self.age

    def _agree(self, one: Estimate, other: Estimate, speed: dict[str, float]) -> bool:
        """Take two estimates for what is known, unless they disagree."""
        both = combine_scenes([one, other])
        if both.disagreements:
            return False
        self.known, self.age, self.speed, self.odd = Estimate(both.scene, both.errors), 0, speed, None
        return True

    def _moves(self) -> bool:
        """Whether it moves by more than is known of it until it is asked again."""
        errors = self.known.errors
        return any(speed * self.patience > (getattr(errors, name) or math.inf) for name, speed in self.speed.items())

    def _speed_to(self, told: Estimate, frames: int) -> dict[str, float]:
        """How far each number has moved in a frame, where that is more than the errors of what told it explain.

        What single frames hardly tell falls off slowly.
        """
        speed = {}
        for name, by in changes(self.known, told).items():
            by_errors = math.hypot(getattr(self.known.errors, name), getattr(told.errors, name))
            seen = by / max(1, frames) if by > _SURELY * by_errors else 0.0
            speed[name] = max(seen, self.speed.get(name, 0.0) / 2)
        return speed


def changes(one: Estimate, other: Estimate) -> dict[str, float]:
    """By how much the numbers that drift differ between two estimates, where both tell them."""
    turned = as_seen_from(other, one.scene)
    told = (name for name in _DRIFT if None not in (getattr(one.errors, name), getattr(turned.errors, name)))
    return {name: abs(getattr(turned.scene, name) - getattr(one.scene, name)) for name in told}


def widened(errors: SceneErrors, frames: int, speed: Mapping[str, float] = MappingProxyType({})) -> SceneErrors:
    """Standard errors of a pane that may have moved for so many frames, at a speed that was seen."""
    grown: dict[str, Any] = {}
    frames = max(0, frames)
    for name, drift in _DRIFT.items():
        error = getattr(errors, name)
        if error is not None:
            grown[name] = math.hypot(error, drift * math.sqrt(frames), speed.get(name, 0.0) * frames)
    return dataclasses.replace(errors, **grown)


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
