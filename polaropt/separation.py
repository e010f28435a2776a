"""separate: from a capture to its two layers, the pipeline from end to end."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from polaropt.capture import Capture, Matching, planes_last, registered_noise
from polaropt.errors import InputError
from polaropt.estimation import (
    IndexFit,
    LadderResult,
    LikelierIndex,
    RungReport,
    StillPhotographs,
    agreeing_photographs,
    clear_pane,
    find_scene,
    in_full,
    left_alone,
    likelier_index,
    likelier_index_of_mosaic,
    model_names,
    scene_source,
    still_photographs,
    surely_unglazed,
    tiles_of_mosaic,
    unglazed_pixels,
    with_incidence_checked,
    with_index,
    with_likelier_side,
)
from polaropt.judging import (
    Diagnostics,
    Uncertainty,
    UncertaintyStrip,
    assembled,
    diagnose,
    estimate_uncertainty,
    noise_share,
    scene_loss,
    uncertainty_without_polarization,
)
from polaropt.kernels import KERNELS
from polaropt.numerics import MUCH_VALUES, arrays_apart
from polaropt.optics import GLASS_INDEX, SceneErrors, SceneParameters
from polaropt.parts import errors_beside, halves, layers_beside, parts_beside, solved_parts
from polaropt.progress import COMPILING, Progress, Stages
from polaropt.solving import (
    ComponentStrip,
    Memory,
    Problem,
    Settings,
    Solution,
    Term,
    Weights,
    check_device,
    check_given_start,
    check_start,
    edges_of_layers,
    inpainted,
    solve,
    solve_at_once,
    whole,
)
from solvers.ahead import compile_ahead
from solvers.base import SolverResult, Status, StoppingRule
from solvers.kernels import compilations_reported_to
from solvers.registry import ready_solver

Images = NDArray[np.float32]
Tell = Callable[[float], None]
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

# Share by which the noise of a film may change before what was fitted to a frame is fitted anew: set by hand.
_SAME_NOISE = 0.1
# When the solve of a film's frame ends, unless a rule is given: where it starts from what is expected, the first slow
# iteration is the last that shows. Frames lose 0.1 dB of either layer by it at most (films of training photographs, 45
# to 70 degrees, noise 0.5 to 2 %, still and moving), and by windows that take one turn those that move lose as much.
_FRAME_CHANGE, _FRAME_ITERATIONS = 1e-3, 1
# Noise that an estimation is told at least (white = 1): with less, what no model has (interpolation, light from beyond
# the frame, quantization) is taken for other rungs. By trial on random windows without noise (`studies.random_windows`,
# training photographs, numbers from 20000): scenes told 1e-3 are found as they are with that noise.
_LEAST_NOISE_OF_SCENE = 1e-3
# How far the estimation has come, in parts of the whole separation, for the progress alone: set by hand.
_INDEX_KNOWN, _INCIDENCE_CHECKED, _SCENE_FOUND, _INDEX_CHECKED = 0.02, 0.05, 0.15, 0.2


@dataclass(frozen=True, eq=False)
class Separation:
    """Two layers and how they were found.

    Attributes
    ----------
    layers : ndarray of float32, shape (2, [channel,] h, w)
        [0] transmission, [1] reflection, linear. Colours come before rows, as in `PSE.forward` and all arrays of
        several images; `transmission` and `reflection` have them last.
    scene : SceneParameters
        Complete: given or estimated.
    errors : SceneErrors
        Standard errors of what was estimated.
    tried : tuple of RungReport
        The rungs of the ladder that were looked at, with why they were taken or left; empty where the scene was given.
    terms : dict of str to Term
        Raw value and weight of each term of the objective at the solution.
    solver : SolverResult
        Its `x` is empty: the layers are what it stands for.
    diagnostics : Diagnostics
    asked : SceneParameters
        What was asked for; None in it was estimated.
    settings : Settings
    n_bounces : int or None
        Bounces that the solve kept apart, as many as stand out of the noise; None where all lie on each other.
    seconds, cpu_seconds : dict of str to float
        Time of each stage: elapsed, and of all cores together.
    moving : ndarray of bool, shape (h, w), or None
        Where something moves between the photographs: it was left out when the scene was estimated, and the layers are
        those of one photograph, with the reflection around. None where nothing does, or nothing could tell.
    matching : Matching or None
        The photographs as they were separated, where they, or both layers of them, had to be moved onto each other, or
        they had to be made equally sharp.
    unglazed : ndarray of bool, shape (h, w), or None
        Where the frame shows no glass, as far as its light tells: it was left out, the transmission is the light there,
        and the reflection nothing. None where no such place was found.
    parts : callable
        Makes `components`.
    judge : callable
        Makes `uncertainty` and `reflection_known`; takes `tell` as `uncertainty_strips` does.
    """

    layers: Images = field(repr=False)
    scene: SceneParameters
    errors: SceneErrors
    tried: tuple[RungReport, ...]
    terms: dict[str, Term]
    solver: SolverResult
    diagnostics: Diagnostics
    asked: SceneParameters
    settings: Settings
    n_bounces: int | None
    seconds: dict[str, float]
    cpu_seconds: dict[str, float]
    moving: NDArray[np.bool_] | None = field(repr=False)
    matching: Matching | None = field(repr=False)
    unglazed: NDArray[np.bool_] | None = field(repr=False)
    parts: Callable[[], Iterator[ComponentStrip]] = field(repr=False)
    judge: Callable[..., Iterator[UncertaintyStrip]] = field(repr=False)

    @cached_property
    def components(self) -> Images:
        """The two parts of every photograph, (2, k, [channel,] h, w); simulated when first asked for."""
        return np.concatenate([strip.components for strip in self.parts()], axis=-2)

    def component_strips(self) -> Iterator[ComponentStrip]:
        """`components` of some rows at a time, which are not kept."""
        if "components" in vars(self):
            yield ComponentStrip(slice(0, self.layers.shape[-2]), self.components)
        else:
            yield from self.parts()

    @property
    def uncertainty(self) -> Images:
        """Standard error of the layers in every pixel, (2, [channel,] h, w), with what the scene's own errors add.

        Computed when first asked for.
        """
        return self._judged.standard_error

    @property
    def reflection_known(self) -> Images:
        """Share of the reflection's detail that the photographs tell, (h, w), 0..1."""
        return self._judged.reflection_known

    @cached_property
    def _judged(self) -> Uncertainty:
        return assembled(self.judge(), self.layers)

    def uncertainty_strips(self, tell: Tell | None = None) -> Iterator[UncertaintyStrip]:
        """`uncertainty` and `reflection_known` of some rows at a time, which are not kept.

        Parameters
        ----------
        tell : callable, optional
            Called with the fraction done, 0..1.
        """
        if "_judged" in vars(self):
            yield UncertaintyStrip(slice(0, self.layers.shape[-2]), self._judged)
        else:
            yield from self.judge(tell=tell)

    @property
    def transmission(self) -> Images:
        """What is behind the glass, (h, w) or (h, w, channel)."""
        return planes_last(self.layers[0])

    @property
    def reflection(self) -> Images:
        """What the glass mirrors, (h, w) or (h, w, channel)."""
        return planes_last(self.layers[1])


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
    _check(settings)
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
    _check(settings)
    asked = scene or _blind(refractive_index, single_surface)
    assumed = _index_assumed(asked, index_known)
    of_each = [Stages(progress) for _ in captures]
    cases, together = [], Stages(progress)
    with _one_thread(together):
        for capture, stages in zip(captures, of_each, strict=True):
            cases.append(_case_with_errors(capture, asked, settings, stages, scene_errors, index_assumed=assumed))
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
                results.append(_separated(case, found[i], stages, None))
            else:
                results.append(_unseparated(case, stages))
    return results


def _problem(case: Case) -> Problem:
    """A capture whose scene is known, to be solved in one piece."""
    still, settings = case.still.filtered(), case.settings
    scene, capture = case.found.scene, case.of_pane()
    return Problem(capture, scene, still.noise, settings.weights, settings.robust, growth=still.growth)


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
    _check(settings)
    asked = scene or _blind(refractive_index, single_surface)
    stages = Stages(progress)
    with _one_thread(stages):
        case = _case_of(capture, asked, settings, stages, index_assumed=_index_assumed(asked, index_known))
    stages.end()
    return case


def scene_options(options: Mapping[str, Any]) -> dict[str, Any]:
    """Those of the options of `separate` that `estimate` takes beside the scene."""
    return {name: options[name] for name in _OF_SCENE if name in options}


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


def _check(settings: Settings) -> None:
    """ValueError where a solver, start or model does not exist, or lacks a package or its device."""
    ready_solver(settings.solver)
    check_start(settings.init)
    if settings.model not in model_names():
        raise InputError(f"unknown model {settings.model!r}; there are: {', '.join(model_names())}")
    if settings.device is not None:
        check_device(settings.device, settings.solver)


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
    _check(settings)
    stages = Stages(progress)
    with _one_thread(stages):
        stages.begin("Measuring the noise", 0.0)
        if before is not None and before.suits(capture, scene):
            case = _next_case(capture, before)
        else:
            case, before = _case_of(capture, scene, settings, stages, index_assumed=False), None
        if scene_errors is not None:
            case = replace(case, given_errors=scene_errors)
        solved = () if before is None or not _as_noisy(case, before.case) else before.solved
        # A device works each frame out anew.
        sooner = bool(solved) and settings.device is None
        case = replace(case, settings=_settings_of_frame(settings) if sooner else settings)
        judged = None if before is None else before.diagnostics
        result, memories = _solved(case, start, stages, before=solved, remember=True, judged=judged)
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
    case = before.case
    if before.noise_known(capture):
        return replace(case, capture=capture, still=replace(case.still, capture=capture))
    return replace(case, capture=capture, still=still_photographs(capture))


def _as_noisy(case: Case, other: Case) -> bool:
    """Whether what was fitted to one capture holds for the noise of another."""
    return abs(case.still.noise - other.still.noise) < _SAME_NOISE * other.still.noise


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
    with _one_thread(stages), arrays_apart(2 * capture.intensities[0].size > MUCH_VALUES):
        case = _case_with_errors(capture, asked, settings, stages, scene_errors, index_assumed=index_assumed)
        if case.unpolarized:
            return _unseparated(case, stages)
        return _solved(case, start, stages)[0]


def _case_with_errors(
    capture: Capture,
    asked: SceneParameters,
    settings: Settings,
    stages: Stages,
    scene_errors: SceneErrors | None,
    *,
    index_assumed: bool,
) -> Case:
    """A capture with all that is known of it; errors that are given are those of a scene that is."""
    case = _case_of(capture, asked, settings, stages, index_assumed=index_assumed)
    return case if case.found.estimate is not None else replace(case, given_errors=scene_errors)


@contextmanager
def _one_thread(stages: Stages) -> Iterator[None]:
    """Many small products: a second BLAS thread waits more than it works, many times so on a busy machine."""
    from threadpoolctl import threadpool_limits

    with threadpool_limits(1, "blas"), compilations_reported_to(stages.compiling):
        compile_ahead(KERNELS, lambda: stages.begin(COMPILING, 0.0))
        yield


def _solved(
    case: Case,
    start: Images | None,
    stages: Stages,
    *,
    before: tuple[Memory | None, ...] = (),
    remember: bool = False,
    judged: Diagnostics | None = None,
) -> tuple[Separation, tuple[Memory | None, ...]]:
    """A capture whose scene is known, solved and judged."""
    capture, still, scene = case.capture, case.still.filtered(), case.found.scene
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
    return _separated(case, solution, stages, judged), solution.memories


def _case_of(
    capture: Capture, asked: SceneParameters, settings: Settings, stages: Stages, *, index_assumed: bool
) -> Case:
    """All that is known of a capture before it is solved."""
    stages.begin("Measuring the noise", 0.0)
    still, matching = still_photographs(capture), None
    if settings.match_photographs:
        capture, still, matching = agreeing_photographs(capture, still)
    noise, mistakes = max(still.noise, _LEAST_NOISE_OF_SCENE), still.mistakes
    # A scene is estimated from the cells of a mosaic, in their pixels.
    of_scene, scale = still.capture if matching is None else still.seen(matching.of_scene), capture.scale
    stages.begin("Estimating the scene", 0.02)
    of_registered = max(registered_noise(capture, noise), _LEAST_NOISE_OF_SCENE)
    unglazed = unglazed_pixels(of_scene, noise, still.growth) if settings.leave_out_unglazed else None
    of_scene = of_scene if unglazed is None else of_scene.left_out(unglazed)
    registered = of_scene.registered
    source, of_source = scene_source(registered, of_registered, mistakes)
    thickness_px = None if settings.thickness_px is None else settings.thickness_px / scale
    kind = settings.thickness_kind
    fit = with_index(source, asked.scaled(1 / scale), of_source, thickness_px=thickness_px, thickness_kind=kind)
    stages.advance(_INDEX_KNOWN)
    checked = with_incidence_checked(source, fit.scene, of_source)
    stages.advance(_INCIDENCE_CHECKED)
    mosaic = None if checked.scene.complete else tiles_of_mosaic(of_scene, noise)
    edges = partial(edges_of_layers, of_scene, noise=noise, growth=still.growth)
    find = partial(
        find_scene,
        noise=of_source,
        model=settings.model,
        thickness_px=thickness_px,
        thickness_kind=kind,
        mosaic=mosaic,
        edges=lambda seen: edges(seen.scaled(scale)),
    )
    in_whole = partial(
        in_full,
        capture=of_scene,
        asked=asked,
        noise=noise,
        model=settings.model,
        mosaic=mosaic,
        sense_only=settings.thickness_px is not None,
        edges=edges,
    )
    of_cells = find(source, checked.scene).with_index(fit)
    if settings.model == "auto":
        of_cells = left_alone(of_cells, checked)
    found = in_whole(of_cells)
    stages.advance(_SCENE_FOUND)
    # An index that is told fits badly where the incidence is, too.
    index = None
    asks_index = asked.refractive_index is not None and asked.incidence_deg is None and of_cells.things is None
    # Of a mosaic's windows of several panes no index is told.
    if asks_index and (mosaic is None or not found.scene.stacked):
        index = likelier_index(source, of_cells.scene, of_source)
        if mosaic is not None:
            index = likelier_index_of_mosaic(mosaic, found.scene.scaled(mosaic.period / scale), index)
    if index is not None and index.sure and index_assumed and asked.single_and_clear:
        fit = IndexFit(clear_pane(checked.scene, index.index), index.error)
        found = in_whole(find(source, fit.scene).with_index(fit))
        asked, index = asked.replace(refractive_index=None), None
    stages.advance(_INDEX_CHECKED)
    # Edges of things that are polarized by themselves tell no side; the scene found beside them has it by spectra.
    if asked.ghost_shift is None and of_cells.things is None:
        of_source_edges = partial(edges_of_layers, source, noise=of_source, growth=still.growth)
        found = with_likelier_side(found, source, of_source_edges)
    if matching is not None:
        matching = matching.with_azimuth(found.scene.azimuth_deg)
    unglazed = None if unglazed is None else surely_unglazed(unglazed, found.scene)
    return Case(
        capture,
        still,
        asked,
        settings,
        checked.doubtful,
        fit.coated,
        index,
        found,
        matching=matching,
        unglazed=unglazed,
    )


@dataclass(frozen=True)
class Case:
    """A capture with what was asked of it, and all that is known before it is solved."""

    capture: Capture
    still: StillPhotographs
    asked: SceneParameters
    settings: Settings
    doubtful_incidence: bool
    coated: bool
    likelier_index: LikelierIndex | None
    found: LadderResult
    given_errors: SceneErrors | None = None
    matching: Matching | None = None
    unglazed: NDArray[np.bool_] | None = None

    @property
    def unpolarized(self) -> bool:
        """Whether nothing is polarized, as was found or given."""
        return not self.found.scene.signal

    def of_pane(self) -> Capture:
        """The capture as it is solved: what moves is filled, and what shows no glass left out.

        Not of a mosaic, whose closed form loses more by what is filled in than by what is there: up to 6 dB.
        """
        capture, moving = self.capture, self.still.moving
        if moving is not None:
            capture = inpainted(capture, moving, self.found.scene, self.still.noise)
        return capture if self.unglazed is None or capture.samples is not None else capture.left_out(self.unglazed)

    @property
    def known(self) -> dict[str, Any]:
        """What `diagnose` is told of it, whatever its solve says."""
        return {
            "estimate": self.found.estimate,
            "scene": self.found.scene,
            "unexplained": self.found.unexplained,
            "mistakes": self.still.mistakes,
            "moving": self.still.moving,
            "valid_share": self.still.valid_share,
            "doubtful_incidence": self.doubtful_incidence,
            "coated": self.coated,
            "likelier_index": self.likelier_index,
            "polarized_things": self.found.things is not None,
        }

    @property
    def errors(self) -> SceneErrors:
        """Standard errors of the scene, as they were found or given."""
        return self.found.errors if self.given_errors is None else self.given_errors

    @property
    def near_errors(self) -> SceneErrors:
        """The same without what rivals add; before polarized light in place these say how all numbers move."""
        estimate = self.found.estimate
        if estimate is None or self.given_errors is not None:
            return self.errors
        return SceneErrors() if estimate.rivals and estimate.scene.polarized else estimate.errors


def _separated(case: Case, solution: Solution, stages: Stages, judged: Diagnostics | None) -> Separation:
    still, found = case.still, case.found
    capture, noise = still.capture, still.noise
    rivals = () if found.estimate is None else found.estimate.rivals
    diagnostics = diagnose(
        capture,
        noise,
        misfit_ratio=solution.misfit_ratio,
        reflection_unknown=solution.reflection_unknown,
        noise_share=noise_share(capture, solution.layers[0], float(solution.variance[0])),
        loss=scene_loss(capture, noise, found.scene, case.near_errors, solution.variance, still.growth, rivals),
        finite=solution.solver.status is not Status.NOT_FINITE,
        before=judged,
        **case.known,
    )
    stages.end()
    layers, parts = solution.layers, partial(solved_parts, solution, capture.color)
    judge: Callable[..., Iterator[UncertaintyStrip]] = partial(
        estimate_uncertainty,
        capture,
        solution.layers,
        noise,
        solution.pieces,
        still.growth,
        of_scene=case.near_errors,
        rivals=rivals,
    )
    if case.unglazed is not None:
        layers = layers_beside(layers, case.capture, case.unglazed)
        parts = partial(parts_beside, parts, case.capture, case.unglazed)
        judge = partial(errors_beside, judge, case.unglazed, noise, capture)
    return Separation(
        layers=layers if capture.color else layers[:, 0],
        scene=found.scene,
        errors=case.errors,
        tried=found.tried,
        terms=solution.terms,
        solver=solution.solver,
        diagnostics=replace(diagnostics, noise_model=still.growth),
        asked=case.asked,
        settings=case.settings,
        n_bounces=solution.n_bounces,
        seconds=stages.seconds,
        cpu_seconds=stages.cpu_seconds,
        moving=still.moving,
        matching=case.matching,
        unglazed=case.unglazed,
        parts=parts,
        judge=judge,
    )


def _unseparated(case: Case, stages: Stages) -> Separation:
    """The intensity as transmission: all that an unpolarized capture tells, and the better guess in doubt."""
    capture, still, found = case.capture, case.still, case.found
    estimate, noise = found.estimate, still.noise
    layers = np.zeros((2, *capture.shape), dtype=np.float32)
    for rows, intensity in capture.intensity_strips():
        layers[0][..., rows, :] = intensity
    diagnostics = diagnose(
        still.capture,
        noise,
        misfit_ratio=1.0,
        reflection_unknown=float(estimate is not None and not estimate.polarized),
        estimate=estimate,
        mistakes=still.mistakes,
        moving=still.moving,
        valid_share=still.valid_share,
        doubtful_incidence=case.doubtful_incidence,
        coated=case.coated,
    )
    stages.end()
    return Separation(
        layers=layers,
        scene=found.scene,
        errors=found.errors,
        tried=found.tried,
        terms={},
        solver=SolverResult(np.zeros(0, np.float32), 0.0, 0, 0, Status.NOT_RUN, 0.0),
        # Whatever the reason to warn of, no reflection is shown.
        diagnostics=replace(diagnostics, reflection_unknown=1.0),
        asked=case.asked,
        settings=case.settings,
        n_bounces=None,
        seconds=stages.seconds,
        cpu_seconds=stages.cpu_seconds,
        moving=still.moving,
        matching=case.matching,
        unglazed=None,
        parts=partial(halves, capture),
        judge=partial(uncertainty_without_polarization, capture, noise),
    )
