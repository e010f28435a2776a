"""separate: a capture looked at, its scene found, solved and judged."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from polaropt.capture import Capture
from polaropt.errors import InputError
from polaropt.estimation import LadderResult, model_names
from polaropt.judging import Diagnostics
from polaropt.kernels import KERNELS
from polaropt.numerics import MUCH_VALUES, arrays_apart
from polaropt.optics import GLASS_INDEX, SceneErrors, SceneParameters
from polaropt.progress import COMPILING, Progress, Stages
from polaropt.separation.case import Case, case_of
from polaropt.separation.result import Separation, separated, unseparated
from polaropt.solving import (
    Memory,
    Problem,
    Settings,
    Weights,
    check_device,
    check_given_start,
    check_start,
    solve,
    solve_at_once,
    whole,
)
from solvers.ahead import compile_ahead
from solvers.base import StoppingRule
from solvers.kernels import compilations_reported_to
from solvers.registry import ready_solver

Images = NDArray[np.float32]
_OF_SCENE = (
    "refractive_index",
    "single_surface",
    "model",
    "thickness_px",
    "thickness_kind",
    "index_known",
    "match_photographs",
    "leave_out_unglazed",
)


def separate(
    capture: Capture,
    scene: SceneParameters | None = None,
    solver: str = "lbfgs",
    init: str = "closed-form",
    refractive_index: float | None = GLASS_INDEX,
    single_surface: bool = False,
    weights: Weights = Weights(),  # noqa: B008 (frozen)
    stopping: StoppingRule = StoppingRule(),  # noqa: B008 (frozen)
    *,
    model: str = "auto",
    thickness_px: float | None = None,
    thickness_kind: Literal["paper", "plate"] = "paper",
    keep_start: float = 0.0,
    robust: bool = False,
    device: str | None = None,
    scene_errors: SceneErrors | None = None,
    start: Images | None = None,
    progress: Progress | None = None,
    index_known: bool = False,
    match_photographs: bool = True,
    leave_out_unglazed: bool = True,
) -> Separation:
    """`polaropt.separate`, which adds what shows the result; the scene is given as parameters, never as a file."""
    settings = Settings(
        model=model,
        solver=solver,
        device=device,
        init=init,
        keep_start=keep_start,
        robust=robust,
        match_photographs=match_photographs,
        leave_out_unglazed=leave_out_unglazed,
        weights=weights,
        stopping=stopping,
        thickness_px=thickness_px,
        thickness_kind=thickness_kind,
    )
    check(settings)
    asked = scene or _blind(refractive_index, single_surface)
    check_given_start(start, capture.shape)
    return _separate(
        capture,
        asked,
        settings,
        Stages(progress),
        scene_errors=scene_errors,
        start=start,
        index_assumed=_index_assumed(asked, index_known),
    )


def separate_at_once(
    captures: Sequence[Capture],
    device: str,
    *,
    scene: SceneParameters | None = None,
    refractive_index: float | None = GLASS_INDEX,
    single_surface: bool = False,
    scene_errors: SceneErrors | None = None,
    progress: Progress | None = None,
    index_known: bool = False,
    **chosen: Any,
) -> list[Separation]:
    """Several captures, each as `separate` does it; those of one size are solved together on the device.

    Parameters
    ----------
    captures : sequence of Capture
    device : str
    scene, refractive_index, single_surface, scene_errors, progress, index_known
        As of `separate`.
    **chosen
        Of `Settings`.
    """
    settings = Settings(device=device, **chosen)
    check(settings)
    asked = scene or _blind(refractive_index, single_surface)
    assumed = _index_assumed(asked, index_known)
    of_each = [Stages(progress) for _ in captures]
    cases, together = [], Stages(progress)
    with one_thread(together):
        for capture, stages in zip(captures, of_each, strict=True):
            cases.append(case_of(capture, asked, settings, stages, index_assumed=assumed, scene_errors=scene_errors))
            stages.end()
        polarized = [i for i, case in enumerate(cases) if not case.unpolarized]
        problems = [_problem(cases[i]) for i in polarized]
        solutions = solve_at_once(problems, settings, together, [whole(problem.capture) for problem in problems])
        together.end()
        found = dict(zip(polarized, solutions, strict=True))
        results = []
        for i, (case, stages) in enumerate(zip(cases, of_each, strict=True)):
            stages.begin("Taking stock", 0.97)
            if i in found:
                stages.share(together, len(found))
                results.append(separated(case, found[i], stages, None))
            else:
                results.append(unseparated(case, stages))
    return results


def estimate(capture: Capture, scene: SceneParameters | None = None, **options: Any) -> LadderResult:
    """Find the scene of a capture as `separate` does, and nothing else; parameters are those of `scene_case`.

    The scene's `signal` is False where nothing is polarized.
    """
    return scene_case(capture, scene, **options).found


def scene_case(
    capture: Capture,
    scene: SceneParameters | None = None,
    *,
    refractive_index: float | None = GLASS_INDEX,
    single_surface: bool = False,
    model: str = "auto",
    thickness_px: float | None = None,
    thickness_kind: Literal["paper", "plate"] = "paper",
    index_known: bool = False,
    match_photographs: bool = True,
    leave_out_unglazed: bool = True,
    progress: Progress | None = None,
) -> Case:
    """A capture with all that `separate` finds before it solves.

    Parameters
    ----------
    capture, scene, refractive_index, single_surface, model, thickness_px, thickness_kind, index_known
        As of `separate`.
    match_photographs, leave_out_unglazed, progress
        As of `separate`.

    Returns
    -------
    Case
    """
    settings = Settings(
        model=model,
        thickness_px=thickness_px,
        thickness_kind=thickness_kind,
        match_photographs=match_photographs,
        leave_out_unglazed=leave_out_unglazed,
    )
    check(settings)
    asked = scene or _blind(refractive_index, single_surface)
    stages = Stages(progress)
    with one_thread(stages):
        case = case_of(capture, asked, settings, stages, index_assumed=_index_assumed(asked, index_known))
    stages.end()
    return case


def scene_options(options: Mapping[str, Any]) -> dict[str, Any]:
    """Those of the options of `separate` that `estimate` takes beside the scene."""
    return {name: options[name] for name in _OF_SCENE if name in options}


def _separate(
    capture: Capture,
    asked: SceneParameters,
    settings: Settings,
    stages: Stages,
    *,
    scene_errors: SceneErrors | None,
    start: Images | None,
    index_assumed: bool,
) -> Separation:
    with one_thread(stages), arrays_apart(2 * capture.intensities[0].size > MUCH_VALUES):
        case = case_of(capture, asked, settings, stages, index_assumed=index_assumed, scene_errors=scene_errors)
        if case.unpolarized:
            return unseparated(case, stages)
        return solved_case(case, start, stages)[0]


def _problem(case: Case) -> Problem:
    """A capture whose scene is known, to be solved in one piece."""
    still, settings = case.still.for_layers(), case.settings
    scene, capture = case.found.scene, case.of_pane()
    return Problem(capture, scene, still.noise, settings.weights, settings.robust, growth=still.growth)


def _index_assumed(asked: SceneParameters, known: bool) -> bool:
    """Whether the index is what glass usually has, not one that somebody knows."""
    return not known and asked.refractive_index == GLASS_INDEX


def _blind(refractive_index: float | None, single_surface: bool) -> SceneParameters:
    """A scene of which all but the index is to be found."""
    return SceneParameters(
        None,
        None,
        None,
        refractive_index,
        single_surface=single_surface,
        n_panes=1 if single_surface else None,
        gap_shift=None,
        absorption=0.0 if single_surface else None,
    )


def check(settings: Settings) -> None:
    """ValueError where a solver, start or model does not exist, or lacks a package or its device."""
    ready_solver(settings.solver)
    check_start(settings.init)
    if settings.model not in model_names():
        raise InputError(f"unknown model {settings.model!r}; there are: {', '.join(model_names())}")
    if settings.device is not None:
        check_device(settings.device, settings.solver)


@contextmanager
def one_thread(stages: Stages) -> Iterator[None]:
    """Many small products: a second BLAS thread waits more than it works, many times so on a busy machine."""
    from threadpoolctl import threadpool_limits

    with threadpool_limits(1, "blas"), compilations_reported_to(stages.compiling):
        compile_ahead(KERNELS, lambda: stages.begin(COMPILING, 0.0))
        yield


def solved_case(
    case: Case,
    start: Images | None,
    stages: Stages,
    *,
    before: tuple[Memory | None, ...] = (),
    remember: bool = False,
    judged: Diagnostics | None = None,
) -> tuple[Separation, tuple[Memory | None, ...]]:
    """A capture whose scene is known, solved and judged."""
    capture, still, scene = case.capture, case.still.for_layers(), case.found.scene
    solution = solve(
        case.of_pane(),
        scene,
        still.noise,
        case.settings,
        stages,
        growth=still.growth,
        start=None if start is None else start.reshape(2, -1, *capture.shape[-2:]),
        before=before,
        remember=remember,
    )
    stages.begin("Taking stock", 0.97)
    return separated(case, solution, stages, judged), solution.memories
