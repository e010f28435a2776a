"""From a capture and its scene to the layers: closed form, objective and minimizer, tile by tile."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from hashlib import sha256
from itertools import count, zip_longest
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from polaropt.capture import Capture, NoiseModel
from polaropt.errors import InputError, check_flags, check_installed, check_numbers
from polaropt.inversion import Canvas, Knowledge, thinned
from polaropt.numerics import MUCH_VALUES, give_back_freed
from polaropt.optics import GHOST_STEPS, PSE, SceneParameters, VaryingPSE, engine_for
from polaropt.progress import Stages
from polaropt.solving.objective import Term, Weights, check_plugged
from polaropt.solving.problem import Coordinates, Memory, Problem
from polaropt.solving.starts import pulled_to_start, take_start
from solvers.base import Solver, SolverResult, Status, TooLarge, TracePoint
from solvers.base import StoppingRule as StoppingRule  # part of this wing's face
from solvers.registry import get_solver

LARGEST_TILE = 800
"""Longest side in pixels that is solved in one piece: what a tile needs of memory; set by hand."""
_MUCH, _TILE_BESIDE_MUCH = MUCH_VALUES, 384
"""Values of layers that are much memory themselves, and the longest side of a tile beside them: of 1488x992 pixels in
colour such tiles are as good as those of 512 (T +0.01, R -0.03 dB) and take no longer. Set by hand."""
# Pixels in which neighbours overlap and fade into each other: more than ghosts reach; set by hand.
_OVERLAP = 64


@dataclass(frozen=True)
class Tile:
    """A part of a frame.

    Attributes
    ----------
    rows, columns : slice
    down, across : ndarray of float32, shape (rows,), (columns,)
        Weights of its rows and columns: falling linearly where neighbours overlap.
    """

    rows: slice
    columns: slice
    down: NDArray[np.float32]
    across: NDArray[np.float32]

    @property
    def weights(self) -> NDArray[np.float32]:
        """Weights (rows, columns); over all tiles they add up to 1 in every pixel."""
        return np.outer(self.down, self.across)

    @property
    def where(self) -> tuple[slice, slice]:
        """Rows and columns."""
        return self.rows, self.columns


def tiles(height: int, width: int, largest: int = LARGEST_TILE) -> list[Tile]:
    """Tiles of a frame, none with a side longer than `largest` pixels.

    Parameters
    ----------
    height, width : int
    largest : int
        More than twice the overlap of 64 px.
    """
    return [
        Tile(rows, columns, down, across)
        for rows, down in _parts(height, largest)
        for columns, across in _parts(width, largest)
    ]


def _parts(length: int, largest: int) -> Iterator[tuple[slice, NDArray[np.float32]]]:
    """Equal parts of a side with their weights."""
    n = max(1, math.ceil((length - _OVERLAP) / (largest - _OVERLAP)))
    inner = (length - _OVERLAP) / n
    ramp = (np.arange(_OVERLAP, dtype=np.float32) + np.float32(0.5)) / _OVERLAP
    for i in range(n):
        start, stop = round(i * inner), round((i + 1) * inner) + _OVERLAP
        weights = np.ones(stop - start, dtype=np.float32)
        if i > 0:
            weights[:_OVERLAP] = ramp
        if i < n - 1:
            weights[-_OVERLAP:] = ramp[::-1]
        yield slice(start, min(stop, length)), weights[: length - start]


@dataclass(frozen=True)
class Piece:
    """A tile of a separation with what is known of its layers.

    Attributes
    ----------
    tile : Tile
    known : Knowledge
    pse : PSE or VaryingPSE
    expected : bool
        Whether its layers were expected in each place (`polaropt.solving.local_spectra`) before they were solved for.
    """

    tile: Tile
    known: Knowledge
    pse: PSE | VaryingPSE
    expected: bool


Images = NDArray[np.float32]

# Fractions of a separation at which its stages begin, for the progress alone: set by hand.
_CLOSED_FORM, _SOLVING, _TAKING_STOCK = 0.3, 0.4, 0.97
_REACH = _TAKING_STOCK - _CLOSED_FORM
# Evaluations that most solves end within, for the same.
_USUAL_EVALUATIONS = 7
# Names of the minimizers of tensors: the own one solves several captures at once.
_OWN, _OF_TORCH = "lbfgs", "torch"
# Values of layers that a device works on at once, 200 bytes each (`torch.cuda.max_memory_allocated`): all tiles of
# 1224x1024 pixels in colour, in 3 GB. And the most captures. Set by hand.
_VALUES_AT_ONCE, _MOST_AT_ONCE = 2**24, 32
# What is known of a tile's layers that no photograph changes.
_OF_PANE = ("told", "cross", "share", "squared_frequency")
# Of tiles that ended differently the whole has the status that stands first.
_BY_SEVERITY = (
    Status.NOT_FINITE,
    Status.TIME_LIMIT,
    Status.EVALUATION_LIMIT,
    Status.ROUNDOFF_LIMITED,
    Status.CONVERGED,
    Status.SMALL_GRADIENT,
)


@dataclass(frozen=True)
class Settings:
    """What a person can set of a separation, but for the scene; described at `polaropt.separate`.

    Attributes
    ----------
    model : str
        Rung of the ladder of scene models, or "auto".
    solver : str
        Name of a minimizer.
    device : str or None
        Where closed form, objective and solver work, as torch names it; None for compiled passes on the processor.
    init : str
        Name of the start.
    keep_start : float
        Share of the way back to the start that the layers are pulled once the solve has ended, 0..1.
    robust : bool
    match_photographs : bool
        Whether photographs that lie a little beside each other, as a whole or layer by layer, or are not equally sharp
        or exposed, are made to agree.
    leave_out_unglazed : bool
        Whether places that show no glass are looked for, and left out.
    weights : Weights
    stopping : StoppingRule
    thickness_px : float or None
        Of the pane; None where the ghost shift is not tied to the incidence.
    thickness_kind : {"paper", "plate"}
    """

    model: str = "auto"
    solver: str = "lbfgs"
    device: str | None = None
    init: str = "closed-form"
    keep_start: float = 0.0
    robust: bool = False
    match_photographs: bool = True
    leave_out_unglazed: bool = True
    weights: Weights = field(default_factory=Weights)
    stopping: StoppingRule = field(default_factory=StoppingRule)
    thickness_px: float | None = None
    thickness_kind: Literal["paper", "plate"] = "paper"

    def __post_init__(self) -> None:
        for name, kind in (("weights", Weights), ("stopping", StoppingRule)):
            if not isinstance(getattr(self, name), kind):
                raise InputError(f"{name} is a {type(getattr(self, name)).__name__}; give {kind.__name__}(...)")
        check_plugged(self.weights)
        flags = ("robust", "match_photographs", "leave_out_unglazed")
        check_flags((name, getattr(self, name)) for name in flags)
        check_numbers([("keep_start", self.keep_start)], none=False)
        check_numbers([("thickness_px", self.thickness_px)])
        if not 0 <= self.keep_start <= 1:
            raise InputError(f"keep_start is {self.keep_start}; give a share of 0 (the solve's end) to 1 (its start)")
        if self.thickness_kind not in GHOST_STEPS:
            raise InputError(f"unknown thickness_kind {self.thickness_kind!r}; there are: {', '.join(GHOST_STEPS)}")

    @property
    def device_of_tensors(self) -> str | None:
        """Where the readable objective runs on tensors; None for the compiled one."""
        return (self.device or "cpu") if self.solver == _OF_TORCH else self.device


def check_device(device: str, solver: str = _OWN) -> None:
    """InputError where torch or a device of this name is not there, or where the solver cannot work on it."""
    if not isinstance(device, str):
        raise InputError(f"device is {device!r}; give its name, such as cuda or cpu")
    if solver not in (_OWN, _OF_TORCH):
        raise InputError(f"device {device!r} is for the solver {_OWN} or {_OF_TORCH}, not {solver}")
    check_installed(("torch",), f"device {device!r}", "'polaropt[torch]'")
    import torch

    try:
        torch.zeros(1, device=device).cpu()
    except (RuntimeError, AssertionError) as error:
        raise InputError(f"device {device!r} cannot be used: {str(error).splitlines()[0]}") from None


@dataclass(frozen=True)
class Solution:
    """What a solve found.

    Attributes
    ----------
    layers : ndarray of float32, shape (2, channel, h, w)
        On the frame.
    terms : dict of str to Term
        Summed over tiles.
    solver : SolverResult
        Without its point.
    misfit_ratio : float
        Mean squared residual in units of the noise, less what the unknowns take up.
    reflection_unknown : float
        Share of the reflection's detail that the photographs leave open, 0..1.
    gain_of_less_noise : float
        How many times as much of that detail a third of the noise would tell; infinite of photographs.
    variance : ndarray, shape (2,)
        That the noise leaves to a pixel of each layer, where the scene is known.
    pse : PSE or VaryingPSE
    canvas : Canvas
    canvas_layers : ndarray of float32, shape (2, channel, H, W)
        The layers as far as they are known beyond the frame, too.
    pieces : tuple of Piece
        What is known of the layers, tile by tile.
    n_bounces : int or None
        Bounces that were kept apart, in the tile that keeps most; None where all lie on each other.
    """

    layers: Images
    terms: dict[str, Term]
    solver: SolverResult
    misfit_ratio: float
    reflection_unknown: float
    gain_of_less_noise: float
    variance: NDArray[np.float64]
    pse: PSE | VaryingPSE
    canvas: Canvas
    canvas_layers: Images
    pieces: tuple[Piece, ...]
    n_bounces: int | None
    memories: tuple[Memory | None, ...] = ()
    """What the next frame of a film may begin with, tile by tile; empty if not asked for."""


@dataclass(frozen=True)
class Part:
    """A tile to solve, its number among all, and the principal point (column, row) as seen from its corner."""

    tile: Tile
    number: int
    of: int
    center: tuple[float, float]

    @property
    def reached(self) -> float:
        """Fraction of the whole separation that is done when this tile begins."""
        return _CLOSED_FORM + _REACH * self.number / self.of


def solve(
    capture: Capture,
    scene: SceneParameters,
    noise: float,
    settings: Settings,
    stages: Stages,
    *,
    growth: NoiseModel | None = None,
    start: Images | None = None,
    before: tuple[Memory | None, ...] = (),
    remember: bool = False,
) -> Solution:
    """Solve for the layers of a capture whose scene is known, in tiles where it is large.

    Parameters
    ----------
    capture : Capture
    scene : SceneParameters
        A complete scene.
    noise : float
    settings : Settings
        Of them the solver, its start, weights and stopping rule.
    stages : Stages
    growth : NoiseModel, optional
        How the noise grows with the light. Default: it is the same everywhere.
    start : ndarray, shape (2, channel, h, w), optional
        Layers to start from. Default: what the settings name.
    before : tuple of Memory or None
        Of the frame before, tile by tile: of the same size, behind the same pane. Empty where there is none.
    remember : bool
        Whether the capture is a frame of a film: the solution tells its `memories`, and where layers are expected in
        each place a solve starts from these, with what the frame before has added to its own.

    Raises
    ------
    InputError
        The solver cannot take so many unknowns.
    """
    height, width = capture.shape[-2:]
    colors = capture.shape[0] if capture.color else 1
    much = n_values(capture) > _MUCH
    parts = tiles(height, width, _TILE_BESIDE_MUCH) if much else tiles(height, width)

    def problem_of(place: Part) -> Problem:
        stages.begin("Closed form", place.reached)
        return Problem(
            capture if len(parts) == 1 else capture.part(*place.tile.where),
            scene,
            noise,
            settings.weights,
            settings.robust,
            place.center,
            growth=growth,
            memory=before[place.number] if before else None,
            remember=remember,
        )

    frame = whole(capture)
    if len(parts) == 1:
        return solve_at_once([problem_of(frame)], settings, stages, [frame], start)[0]
    # Of what photographs left that were read and looked at, too: layers are as much as half of them.
    give_back_freed()
    layers = np.zeros((2, colors, height, width), dtype=np.float32)
    solutions: list[Solution] = []
    shared: dict[Any, NDArray[Any]] = {}
    places = [
        Part(tile, i, len(parts), (frame.center[0] - tile.columns.start, frame.center[1] - tile.rows.start))
        for i, tile in enumerate(parts)
    ]
    at_once = 1 if settings.device is None else n_at_once(2 * colors * places[0].tile.weights.size)
    for first in range(0, len(places), at_once):
        some = places[first : first + at_once]
        solved = solve_at_once([problem_of(place) for place in some], settings, stages, some, start)
        for place, solution in zip(some, solved, strict=True):
            tile = place.tile
            layers[:, :, tile.rows, tile.columns] += tile.weights * solution.layers
            nothing = np.empty(0, dtype=np.float32)
            # The spectra of all tiles wait for the error maps' tables, which need no more.
            told = [thinned(piece.known) if much else piece.known for piece in solution.pieces]
            pieces = tuple(
                replace(piece, known=_sharing(known, shared))
                for piece, known in zip(solution.pieces, told, strict=True)
            )
            solutions.append(replace(solution, layers=nothing, canvas_layers=nothing, pieces=pieces))
        # The next tile needs the memory of this one's layers, and in one piece.
        del solved, solution
        give_back_freed()
    pse = engine_for(scene, capture.angles_deg, noise, capture.shape[-2:])
    return _merge(solutions, parts, layers, Canvas(height, width, 0, 0, 0, 0), pse)


def _sharing(known: Knowledge, shared: dict[Any, NDArray[Any]]) -> Knowledge:
    """The same with arrays of `shared` where these are equal: what is the pane's alone is so for nearly all tiles."""
    arrays: dict[str, Any] = {name: np.ascontiguousarray(getattr(known, name)) for name in _OF_PANE}
    keys = {name: (name, array.shape, sha256(array.data).digest()) for name, array in arrays.items()}
    one_of_each: dict[str, Any] = {name: shared.setdefault(keys[name], array) for name, array in arrays.items()}
    return replace(known, **one_of_each)


def _solve_tile(
    problem: Problem, settings: Settings, stages: Stages, place: Part, begin: Images | None = None
) -> Solution:
    """One tile, in the time that is its own."""
    if settings.device is not None and isinstance(problem.pse, PSE):
        # What is expected of a frame, which a device soon works out, is nearer than the layers of the one before.
        of_film = problem.remember and settings.init == "closed-form" and problem.capture.samples is None
        return _solved_there([problem], settings, stages, [place], None if of_film else begin)[0]
    share, stopping = 1 / place.of, settings.stopping
    unknown = problem.unknown_detail()
    memory = problem.memory
    # What is expected of a frame is nearer to its layers than those of the frame before are.
    of_film = memory is not None and settings.init == "closed-form"
    added = problem.found_before if of_film else None
    start = take_start(problem, settings.init, None if of_film else begin)
    expected = start
    if added is not None:
        start = start + added
    stages.begin("Setting up", place.reached)
    device = settings.device_of_tensors
    objective = problem.compiled(start) if device is None else problem.readable(start, device)
    z = objective.coordinates(start)
    if device is None:
        problem.give_up_expected()
    kept = start if settings.keep_start > 0 else None
    # A solve of a large image needs the memory.
    del start
    if memory is None:
        del expected
    advance = _solving(stages, place, place.of)
    minimizer: Solver = get_solver(settings.solver)
    if settings.device is not None and settings.solver == _OWN:
        minimizer = _batch_of_one()
    try:
        result = minimizer.minimize(_with_progress(objective, advance), z, _stopping_of_tile(stopping, share))
    except TooLarge as error:
        raise InputError(str(error)) from None
    stages.begin("Taking stock", place.reached + _REACH * share)
    layers, terms, result = _end_of(objective, result, kept, settings.keep_start)
    solution = _solution_of(problem, place, layers, terms, result, unknown)
    if not problem.remember:
        return solution
    return replace(solution, memories=(None if memory is None else replace(memory, found=layers - expected),))


def _solution_of(
    problem: Problem, place: Part, layers: Images, terms: dict[str, Term], result: SolverResult, unknown: float
) -> Solution:
    """A tile's solution, from its canvas layers (2, channel, H, W) and the share of detail that remains unknown."""
    return Solution(
        layers=np.ascontiguousarray(problem.canvas.crop(layers)),
        terms=terms,
        solver=replace(result, x=np.zeros(0, dtype=np.float32)),
        misfit_ratio=problem.misfit_ratio(terms["misfit"].value),
        reflection_unknown=unknown,
        gain_of_less_noise=problem.known.gain_of_less_noise,
        variance=problem.known.sampled.variance(),
        pse=problem.pse,
        canvas=problem.canvas,
        canvas_layers=layers,
        pieces=(Piece(place.tile, problem.known.sampled, problem.pse, _is_local(problem)),),
        n_bounces=problem.n_bounces,
    )


def n_values(capture: Capture) -> int:
    """Values of its layers."""
    return 2 * int(np.prod(capture.shape))


def n_at_once(n_values: int) -> int:
    """How many captures, or tiles, with layers of so many values are solved together on a device."""
    return max(1, min(_MOST_AT_ONCE, _VALUES_AT_ONCE // n_values))


def whole(capture: Capture) -> Part:
    """A frame that is a tile of its own."""
    height, width = capture.shape[-2:]
    ones = (np.ones(side, dtype=np.float32) for side in (height, width))
    return Part(Tile(slice(0, height), slice(0, width), *ones), 0, 1, ((width - 1) / 2, (height - 1) / 2))


def solve_at_once(
    problems: Sequence[Problem],
    settings: Settings,
    stages: Stages,
    places: Sequence[Part],
    start: Images | None = None,
) -> list[Solution]:
    """Solve problems one after another; on a device, those that are alike together.

    Parameters
    ----------
    problems : sequence of Problem
    settings : Settings
    stages : Stages
    places : sequence of Part
        Of each problem: tiles of a frame, or frames of their own.
    start : ndarray, shape (2, channel, h, w), optional
        Of the frame whose tiles they are: layers to start from.
    """
    solutions: dict[int, Solution] = {}
    for numbers in _groups(problems, settings, start):
        if len(numbers) == 1:
            i = numbers[0]
            tile = places[i].tile
            begin = None if start is None else start[:, :, tile.rows, tile.columns]
            solutions[i] = _solve_tile(problems[i], settings, stages, places[i], begin)
        else:
            some, there = [problems[i] for i in numbers], [places[i] for i in numbers]
            solutions.update(zip(numbers, _solved_there(some, settings, stages, there), strict=True))
    return [solutions[i] for i in range(len(problems))]


def _groups(problems: Sequence[Problem], settings: Settings, start: Images | None) -> list[list[int]]:
    """Numbers of the problems that are solved together."""
    if settings.device is None or settings.solver != _OWN or start is not None or len(problems) == 1:
        return [[i] for i in range(len(problems))]
    from polaropt.solving.tensors import alike

    groups: dict[Any, list[int]] = {}
    for i, problem in enumerate(problems):
        groups.setdefault(alike(problem) if isinstance(problem.pse, PSE) else i, []).append(i)
    return list(groups.values())


def _solved_there(
    problems: Sequence[Problem],
    settings: Settings,
    stages: Stages,
    places: Sequence[Part],
    begin: Images | None = None,
) -> list[Solution]:
    """Problems that are alike, solved on a device from the closed form on."""
    from polaropt.solving.tensors import batch_problem, minimize_batch

    device, place, of = str(settings.device), places[0], places[0].of / len(places)
    there = batch_problem(problems, device, settings.init, begin)
    advance = _solving(stages, place, of)
    stopping = _stopping_of_tile(settings.stopping, 1 / of)
    minimizer = None if settings.solver == _OWN else get_solver(settings.solver)
    points, results = minimize_batch(there, stopping, advance, minimizer)
    stages.begin("Taking stock", place.reached + _REACH / of)
    points = points + settings.keep_start * (there.start - points)
    found = zip(problems, places, there.layers(points), there.objective.terms(points), results, strict=True)
    solutions = []
    for i, (problem, of_tile, layers, terms, result) in enumerate(found):
        problem.known = there.forms[i]
        if settings.keep_start > 0:
            result = replace(result, value=sum(term.weight * term.value for term in terms.values()))
        solution = _solution_of(problem, of_tile, layers, terms, result, there.unknown_detail[i])
        solutions.append(replace(solution, memories=(None,)) if problem.remember else solution)
    return solutions


def _batch_of_one() -> Solver:
    from solvers.batch_lbfgs import OneOfBatch

    return OneOfBatch()


def _solving(stages: Stages, place: Part, of: float) -> Callable[[int], None]:
    """Begin the stage of the solver; what tells its evaluations, of a share of the whole that is 1 / `of`."""
    share = 1 / of
    stages.begin("Solving", place.reached + _REACH * (_SOLVING - _CLOSED_FORM) * share)

    def advance(evaluations: int) -> None:
        # How many it takes is not known: each half of what is left takes as many as most do altogether.
        stages.advance((_TAKING_STOCK - _SOLVING) * share * (1 - 0.5 ** (evaluations / _USUAL_EVALUATIONS)))

    return advance


def _is_local(problem: Problem) -> bool:
    """Whether standard errors are narrower as layers were expected in each place; of mosaics they suit as they are."""
    varying = not isinstance(problem.pse, PSE)
    fits = problem.expected is not None if varying else problem.fits_windows
    return fits and problem.capture.samples is None


def _with_progress(objective: Coordinates, advance: Callable[[int], None]) -> Callable[[Any], tuple[float, Any]]:
    """Value and gradient, which tell their number."""
    numbers = count(1)

    def evaluate(z: Any) -> tuple[float, Any]:
        advance(next(numbers))
        return objective.value_and_grad(z)

    return evaluate


def _end_of(
    objective: Coordinates, result: SolverResult, start: Images | None, share: float
) -> tuple[Images, dict[str, Term], SolverResult]:
    """Canvas layers where the solver ended, or so far back to a start that is to be kept."""
    layers, terms = objective.solution(result.x)
    if start is None:
        return layers, terms, result
    layers, terms = pulled_to_start(objective, start, layers.copy(), share)
    return layers, terms, replace(result, value=sum(term.weight * term.value for term in terms.values()))


def _stopping_of_tile(stopping: StoppingRule, share: float) -> StoppingRule:
    """A tile's part of the time; evaluations are counted per tile."""
    return stopping if stopping.seconds is None else replace(stopping, seconds=stopping.seconds * share)


def _merge(
    solutions: list[Solution], parts: list[Tile], layers: Images, frame: Canvas, pse: PSE | VaryingPSE
) -> Solution:
    areas = np.array([tile.weights.sum() for tile in parts])
    mean = areas / areas.sum()
    return Solution(
        layers=layers,
        terms=_sum_terms([solution.terms for solution in solutions]),
        solver=_merge_results([solution.solver for solution in solutions]),
        misfit_ratio=float(mean @ [solution.misfit_ratio for solution in solutions]),
        reflection_unknown=float(mean @ [solution.reflection_unknown for solution in solutions]),
        gain_of_less_noise=float(mean @ [solution.gain_of_less_noise for solution in solutions]),
        variance=mean @ [solution.variance for solution in solutions],
        pse=pse,
        canvas=frame,
        canvas_layers=layers,
        pieces=tuple(piece for solution in solutions for piece in solution.pieces),
        memories=tuple(memory for solution in solutions for memory in solution.memories),
        n_bounces=max((solution.n_bounces for solution in solutions if solution.n_bounces is not None), default=None),
    )


def _sum_terms(all_terms: list[dict[str, Term]]) -> dict[str, Term]:
    return {
        name: Term(sum(terms[name].value for terms in all_terms), term.weight) for name, term in all_terms[0].items()
    }


def _merge_results(results: list[SolverResult]) -> SolverResult:
    """As if the tiles had been solved side by side: values and seconds add up, evaluations are the longest tile's."""
    trace = []
    last = [result.trace[0] for result in results if result.trace]
    for points in zip_longest(*(result.trace for result in results if result.trace)):
        last = [point or before for point, before in zip(points, last, strict=True)]
        trace.append(
            TracePoint(
                n_evaluations=max(point.n_evaluations for point in last),
                seconds=sum(point.seconds for point in last),
                value=sum(point.value for point in last),
                gradient_norm=float(np.linalg.norm([point.gradient_norm for point in last])),
                cpu_seconds=sum(point.cpu_seconds for point in last),
            )
        )
    return SolverResult(
        x=results[0].x,
        value=sum(result.value for result in results),
        n_evaluations=max(result.n_evaluations for result in results),
        n_iterations=max(result.n_iterations for result in results),
        status=min((result.status for result in results), key=_BY_SEVERITY.index),
        seconds=sum(result.seconds for result in results),
        trace=trace,
        restarts=sum(result.restarts for result in results),
    )
