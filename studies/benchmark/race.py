"""Time and evaluations to the same gap: polaropt's solvers, and scipy and torch on the pixels with autograd.

What a contestant needs is set up on its clock: Problem (closed form, spectra, penalties), start and coordinates. Those
that start cold on the pixels are given the penalties for nothing.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from importlib.util import find_spec
from typing import Any

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from polaropt.solving import Problem, Weights, take_start
from solvers.base import MissingPackage, Status, StoppingRule, StopSolving, TooLarge
from solvers.registry import get_solver, solver_names
from studies.benchmark.judge import Finish, Judge, Limits, Recorder, Run, find_finish, watched
from studies.benchmark.rows import Place, Row
from studies.camera import Sample
from studies.kit.timing import Threads

Images = NDArray[np.float32]

INCIDENCES_DEG = {"hard": 20.0, "easy": 60.0}
REFERENCE = "lowest value found"
LEAST_GAP = 1e-9
"""Nothing falls below the lowest value; rounding of a logarithm's axis."""
OURS = "polaropt lbfgs"
SCIPY_AUTOGRAD = "scipy L-BFGS-B + autograd"
TORCH_AUTOGRAD = "torch LBFGS + autograd"
WHITENED = "whitened"
_HISTORY = 10
_MOST = 100_000
# Evaluations of a line search that finds nothing lower.
_FRUITLESS = 25
_TRIAL = 6
_CHOICES = (Threads(torch=1, blas=1), Threads(blas=1), Threads())


@dataclass(frozen=True)
class Contestant:
    """A solver and where it starts.

    Attributes
    ----------
    solver : str
        OURS, SCIPY_AUTOGRAD, TORCH_AUTOGRAD, or WHITENED with the name of a registered solver.
    init : str
    solve : callable
        Sets up and solves, telling a recorder.
    chooses_threads : bool
        Whether it may run with all threads or with one, whichever is faster here.
    threads : Threads
    """

    solver: str
    init: str
    solve: Callable[[Judge, str, Recorder], Status]
    chooses_threads: bool = False
    threads: Threads = Threads()  # noqa: RUF009 (frozen)

    @property
    def name(self) -> str:
        """As tables and legends have it."""
        return f"{self.solver}, {self.init}"


def contestants() -> list[Contestant]:
    """All that can be had here, the fast ones first."""
    found = [Contestant(OURS, init, _registered("lbfgs")) for init in ("closed-form", "cold")]
    others = [name for name in solver_names() if name != "lbfgs"]
    found += [Contestant(f"{WHITENED} {name}", "closed-form", _registered(name)) for name in others]
    if find_spec("torch") is None:
        return found
    import torch

    if torch.cuda.is_available():
        found.append(Contestant(f"{WHITENED} torch on cuda", "closed-form", _registered("torch", "cuda")))
    rivals = {SCIPY_AUTOGRAD: _scipy_autograd, TORCH_AUTOGRAD: _torch_autograd}
    inits = ("cold", "closed-form")
    return found + [Contestant(name, init, solve, True) for name, solve in rivals.items() for init in inits]


def warmed_up(contestant: Contestant, judge: Judge, finish: Finish, seconds: float) -> Contestant:
    """Run a contestant for a moment, and let it choose its threads if it may: no rival shall be kept slow."""
    if not contestant.chooses_threads:
        race(contestant, judge, finish, Limits(seconds, 2))
        return contestant
    best, shortest = contestant, math.inf
    for threads in _CHOICES:
        choice = replace(contestant, threads=threads)
        race(choice, judge, finish, Limits(seconds, 1))
        # One that is slower need not show by how much.
        run = race(choice, judge, finish, Limits(min(seconds, _TRIAL * shortest), _TRIAL))
        each = (run.points[-1].seconds - run.set_up[0]) / len(run.points)
        if each < shortest:
            best, shortest = choice, each
    return best


def race(contestant: Contestant, judge: Judge, finish: Finish, limits: Limits) -> Run:
    """Let one contestant run; where it cannot, the note says why."""
    recorder = Recorder(judge, finish, limits)
    run = recorder.run
    try:
        with contestant.threads.set():
            run.status = contestant.solve(judge, contestant.init, recorder)
    except StopSolving as stop:
        run.status = stop.status
    except (TooLarge, MissingPackage) as reason:
        run.note = str(reason)
    except ImportError as reason:
        run.note = f"not there: {reason}"
    return run


def _registered(name: str, device: str | None = None) -> Callable[[Judge, str, Recorder], Status]:
    """A registered solver in whitened coordinates, as `separate` runs it."""

    def solve(judge: Judge, init: str, recorder: Recorder) -> Status:
        minimizer = get_solver(name)
        place = device or ("cpu" if name == "torch" else None)
        with threadpool_limits(1, "blas"):
            problem = judge.new_problem()
            start = take_start(problem, init)
            objective = problem.compiled(start) if place is None else problem.readable(start, place)
            z = objective.coordinates(start)
            recorder.set_up()
            with recorder.clock.paused():
                # Its own buffers: to look at a point must not disturb the solve.
                viewer = problem.compiled(start) if place is None else objective
            view = watched(_waiting(objective.value_and_grad, place), lambda z: viewer.solution(z)[0], recorder)
            return minimizer.minimize(view, z, StoppingRule(max_evaluations=_MOST, relative_change=0.0)).status

    return solve


def _waiting(objective: Callable[[Any], tuple[float, Any]], place: str | None) -> Callable[[Any], tuple[float, Any]]:
    """An objective that is over when its kernels are: a GPU returns before."""
    if place is None or not place.startswith("cuda"):
        return objective
    import torch

    def evaluate(z: Any) -> tuple[float, Any]:
        both = objective(z)
        torch.cuda.synchronize()
        return both

    return evaluate


def _pixels(judge: Judge, init: str) -> tuple[Problem, Images]:
    """The problem and the start; from cold both are given."""
    if init == "cold":
        return judge.problem, judge.cold.copy()
    with threadpool_limits(1, "blas"):
        problem = judge.new_problem()
        return problem, take_start(problem, init)


def _scipy_autograd(judge: Judge, init: str, recorder: Recorder) -> Status:
    """scipy's L-BFGS-B in float64 on the pixels of the canvas, gradients by torch in float32."""
    from scipy.optimize import minimize

    from studies.benchmark.autograd import AutogradObjective

    problem, start = _pixels(judge, init)
    objective = AutogradObjective(problem, Weights())
    recorder.set_up()
    evaluate = watched(objective.value_and_grad, lambda layers: layers, recorder)
    unit = 0.0

    def scaled(x: NDArray[np.float64]) -> tuple[float, NDArray[np.float64]]:
        # In units of the first value: its constants expect values near 1.
        nonlocal unit
        value, gradient = evaluate(x.astype(np.float32).reshape(start.shape))
        unit = unit or abs(value)
        return value / unit, np.divide(gradient.ravel(), unit, dtype=np.float64)

    options = {"maxcor": _HISTORY, "ftol": 0.0, "gtol": 0.0, "maxfun": _MOST, "maxiter": _MOST}
    x, done = start.astype(np.float64).ravel(), -_MOST
    # It may end in the rounding of float32; it is started again as long as that leads anywhere.
    while len(recorder.run.points) > done + _FRUITLESS:
        done = len(recorder.run.points)
        x = minimize(scaled, x, jac=True, method="L-BFGS-B", options=options).x
    return Status.ROUNDOFF_LIMITED


def _torch_autograd(judge: Judge, init: str, recorder: Recorder) -> Status:
    """torch.optim.LBFGS on the pixels of the canvas in float32."""
    import torch

    from studies.benchmark.autograd import AutogradObjective

    problem, start = _pixels(judge, init)
    objective = AutogradObjective(problem, Weights())
    layers = torch.nn.Parameter(torch.from_numpy(start))
    optimizer = torch.optim.LBFGS(
        [layers], max_iter=_MOST, max_eval=_MOST, tolerance_grad=0.0, tolerance_change=0.0, history_size=_HISTORY,
        line_search_fn="strong_wolfe",
    )  # fmt: skip
    recorder.set_up()
    unit = 0.0

    def closure() -> Any:
        nonlocal unit
        optimizer.zero_grad()
        raw = objective.value(layers)
        value = float(raw.detach())
        unit = unit or abs(value)
        loss = raw / unit
        loss.backward()
        recorder.evaluated(value, lambda: layers.detach().numpy().copy())
        return loss

    optimizer.step(closure)
    return Status.ROUNDOFF_LIMITED


@dataclass(frozen=True)
class Rounds:
    """How often everything runs, and how long.

    Attributes
    ----------
    repeats : int
    cap_seconds : float
        A solve is broken off after this time.
    slow_seconds : float
        A contestant that takes longer runs only `slow_repeats` times.
    slow_repeats : int
    reference_evaluations : int
        Limit of each run that looks for the lowest value.
    """

    repeats: int
    cap_seconds: float
    slow_seconds: float
    slow_repeats: int
    reference_evaluations: int = 1000


def measure_race(place: Place, sample: Sample, rounds: Rounds) -> list[Row]:
    """Race all contestants on one scene."""
    judge = Judge(sample)
    finish = find_finish(judge, rounds.reference_evaluations, place.say)
    runs = _runs(judge, finish, rounds, place)
    verdicts = [point.verdict for several in runs.values() for run in several for point in run.points[-1:]]
    finish = finish.lowered(verdicts)
    rows = _reference(place, finish)
    for contestant, several in runs.items():
        rows += _measured(place, contestant, several, finish)
    return rows


def _runs(judge: Judge, finish: Finish, rounds: Rounds, place: Place) -> dict[Contestant, list[Run]]:
    runs: dict[Contestant, list[Run]] = {}
    for contestant in contestants():
        place.say(f"{contestant.name}: warming up")
        runs[warmed_up(contestant, judge, finish, rounds.cap_seconds)] = []
    for repeat in range(rounds.repeats):
        for contestant, earlier in runs.items():
            if _again(earlier, rounds):
                place.say(f"{contestant.name}: round {repeat + 1} of {rounds.repeats}")
                earlier.append(race(contestant, judge, finish, Limits(rounds.cap_seconds)))
    return runs


def _again(earlier: list[Run], rounds: Rounds) -> bool:
    """Whether a contestant is to run once more: not where it cannot, is slow, or was cut off."""
    if not earlier:
        return True
    last = earlier[-1]
    if not last.points or last.status is Status.TIME_LIMIT:
        return False
    return len(earlier) < rounds.slow_repeats or last.points[-1].seconds <= rounds.slow_seconds


def _reference(place: Place, finish: Finish) -> list[Row]:
    best = finish.best
    values = {
        ("objective", ""): best.value,
        ("objective at the cold start", ""): finish.cold_value,
        ("transmission", "dB"): best.transmission_db,
        ("reflection", "dB"): best.reflection_db,
    }
    return [place.measured(REFERENCE, *quantity, [value]) for quantity, value in values.items()]


def _measured(place: Place, contestant: Contestant, runs: list[Run], finish: Finish) -> list[Row]:
    """Arrival of a contestant with all repeats, and the curve of its first run."""
    name, first = contestant.name, runs[0]
    if not first.points:
        return [place.measured(name, "evaluations", "", [], note=first.note or "it did not start")]
    arrivals = [run.arrival(finish) for run in runs]
    arrived = [(run, at) for run, at in zip(runs, arrivals, strict=True) if at is not None]
    # A run that did not arrive bounds the time from below.
    ends = arrived or [(run, len(run.points) - 1) for run in runs]
    bound = "" if arrived else ">="
    note = "" if arrived else _shortfall(first, finish)
    if contestant.chooses_threads:
        note = "; ".join(filter(None, (note, f"threads, the fastest here: {contestant.threads}")))
    points = [(run.points[at], run.set_up) for run, at in ends]
    quantities: dict[tuple[str, str], list[float]] = {
        ("wall, with set-up", "s"): [point.seconds for point, _ in points],
        ("CPU, with set-up", "s"): [point.cpu_seconds for point, _ in points],
        ("wall, solve", "s"): [point.seconds - set_up[0] for point, set_up in points],
        ("CPU, solve", "s"): [point.cpu_seconds - set_up[1] for point, set_up in points],
        ("evaluations", ""): [at + 1 for _, at in ends],
    }
    rows = [place.measured(name, *quantity, values, bound, note) for quantity, values in quantities.items()]
    by_gap = [at + 1 for run in runs if (at := run.arrival(finish, near=False)) is not None]
    if len(by_gap) == len(runs):
        rows.append(place.measured(name, "evaluations, by the gap alone", "", by_gap))
    return rows + _curve(place, name, first, finish)


def _shortfall(run: Run, finish: Finish) -> str:
    last = run.points[-1].verdict
    off = last.transmission_db - finish.best.transmission_db
    why = "broken off" if run.status is Status.TIME_LIMIT else "ended by itself"
    return f"{why} at gap {finish.gap(last):.1e}, transmission {off:+.2f} dB"


def _curve(place: Place, name: str, run: Run, finish: Finish) -> list[Row]:
    points = run.points
    columns = {
        ("wall, with set-up", "s"): [point.seconds for point in points],
        ("CPU, with set-up", "s"): [point.cpu_seconds for point in points],
        ("gap", ""): [max(finish.gap(point.verdict), LEAST_GAP) for point in points],
        ("transmission", "dB"): [point.verdict.transmission_db for point in points],
        ("reflection", "dB"): [point.verdict.reflection_db for point in points],
    }
    return [place.measured(name, f"curve: {what}", unit, values) for (what, unit), values in columns.items()]
