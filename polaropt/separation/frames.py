"""Frames of a film, one after the other, each with what the one before has left to it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from polaropt.capture import Capture
from polaropt.estimation import still_photographs
from polaropt.judging import Diagnostics
from polaropt.optics import SceneErrors, SceneParameters
from polaropt.progress import Progress, Stages
from polaropt.separation.case import Case, case_of
from polaropt.separation.pipeline import check, one_thread, solved_case
from polaropt.separation.result import Separation
from polaropt.solving import Memory, Settings
from solvers.base import StoppingRule

Images = NDArray[np.float32]

# Share by which the noise of a film may change before what was fitted to a frame is fitted anew: set by hand.
_SAME_NOISE = 0.1
# When the solve of a film's frame ends, unless a rule is given: where it starts from what is expected, the first slow
# iteration is the last that shows. Frames lose 0.1 dB of either layer by it at most (films of training photographs, 45
# to 70 degrees, noise 0.5 to 2 %, still and moving), and by windows that take one turn those that move lose as much.
_FRAME_CHANGE, _FRAME_ITERATIONS = 1e-3, 1


@dataclass(frozen=True)
class FrameMemory:
    """What a frame of a film leaves to the next one: what holds for all frames of a camera behind a pane."""

    case: Case
    solved: tuple[Memory | None, ...]
    diagnostics: Diagnostics

    def suits(self, capture: Capture, scene: SceneParameters) -> bool:
        """Whether it holds for another frame."""
        own = self.case.capture
        alike = (own.shape, own.angles_deg, self.case.asked) == (capture.shape, capture.angles_deg, scene)
        return alike and self.case.still.moving is None

    def noise_known(self, capture: Capture) -> bool:
        """Whether whoever read the frames says that their noise is the same."""
        noises = [None if of.origin is None else of.origin.raw_noise for of in (self.case.capture, capture)]
        return noises[0] is not None and noises[0] == noises[1]


def separate_frame(
    capture: Capture,
    scene: SceneParameters,
    before: FrameMemory | None,
    *,
    scene_errors: SceneErrors | None = None,
    start: Images | None = None,
    progress: Progress | None = None,
    **chosen: Any,
) -> tuple[Separation, FrameMemory]:
    """A frame of a film, with what the frame before has left to it.

    Parameters
    ----------
    capture : Capture
    scene : SceneParameters
        Complete.
    before : FrameMemory or None
    scene_errors, start, progress
        As of `separate`.
    **chosen
        Of `Settings`.
    """
    settings = Settings(**chosen)
    check(settings)
    stages = Stages(progress)
    with one_thread(stages):
        stages.begin("Measuring the noise", 0.0)
        if before is not None and before.suits(capture, scene):
            case = _next_case(capture, before)
        else:
            case, before = case_of(capture, scene, settings, stages, index_assumed=False), None
        if scene_errors is not None:
            case = replace(case, given_errors=scene_errors)
        solved = () if before is None or not _as_noisy(case, before.case) else before.solved
        # A device works each frame out anew.
        sooner = bool(solved) and settings.device is None
        case = replace(case, settings=_settings_of_frame(settings) if sooner else settings)
        judged = None if before is None else before.diagnostics
        result, memories = solved_case(case, start, stages, before=solved, remember=True, judged=judged)
        return result, FrameMemory(case, memories, result.diagnostics)


def _settings_of_frame(settings: Settings) -> Settings:
    """Those of a frame that begins with what the one before has left: without a rule, its solve ends sooner."""
    rule, default = settings.stopping, StoppingRule()
    if (rule.relative_change, rule.slow_iterations) != (default.relative_change, default.slow_iterations):
        return settings
    sooner = replace(rule, relative_change=_FRAME_CHANGE, slow_iterations=_FRAME_ITERATIONS)
    return replace(settings, stopping=sooner)


def _next_case(capture: Capture, before: FrameMemory) -> Case:
    """What is known of a frame behind a pane that is known."""
    case = before.case.of_next(capture)
    if before.noise_known(capture):
        return replace(case, still=replace(case.still, capture=case.capture))
    return replace(case, still=still_photographs(case.capture))


def _as_noisy(case: Case, other: Case) -> bool:
    """Whether what was fitted to one capture holds for the noise of another."""
    return abs(case.still.noise - other.still.noise) < _SAME_NOISE * other.still.noise
