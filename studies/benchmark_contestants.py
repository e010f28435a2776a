"""Who races: polaropt's solvers in its own coordinates, and scipy and torch on the pixels with automatic gradients.

What a contestant needs is set up on its clock: Problem (closed form, spectra, penalties), start and coordinates. Those
that start cold on the pixels are given the penalties for nothing.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from polaropt.solving import Problem, Weights, take_start
from solvers.base import MissingPackage, Status, StoppingRule, StopSolving, TooLarge
from solvers.registry import get_solver, solver_names
from studies.benchmark_race import Finish, Judge, Limits, Recorder, Run, watched
from studies.kit.timing import Threads

Images = NDArray[np.float32]

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
    if not _has_torch():
        return found
    if _has_gpu():
        found.append(Contestant(f"{WHITENED} torch on cuda", "closed-form", _registered("torch", "cuda")))
    inits = ("cold", "closed-form")
    rivals = {SCIPY_AUTOGRAD: _scipy_autograd, TORCH_AUTOGRAD: _torch_autograd}
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


def _has_torch() -> bool:
    from importlib.util import find_spec

    return find_spec("torch") is not None


def _has_gpu() -> bool:
    import torch

    return bool(torch.cuda.is_available())


def _registered(name: str, device: str | None = None) -> Callable[[Judge, str, Recorder], Status]:
    """A registered solver in whitened coordinates, as `separate` runs it."""

    def solve(judge: Judge, init: str, recorder: Recorder) -> Status:
        minimizer = get_solver(name)
        place = device or ("cpu" if name == "torch" else None)
        example = judge.example
        with threadpool_limits(1, "blas"):
            problem = Problem(example.capture, example.scene, judge.noise, Weights())
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
    example = judge.example
    with threadpool_limits(1, "blas"):
        problem = Problem(example.capture, example.scene, judge.noise, Weights())
        return problem, take_start(problem, init)


def _scipy_autograd(judge: Judge, init: str, recorder: Recorder) -> Status:
    """scipy's L-BFGS-B in float64 on the pixels of the canvas, gradients by torch in float32."""
    from scipy.optimize import minimize

    from studies.autograd_objective import AutogradObjective

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

    from studies.autograd_objective import AutogradObjective

    problem, start = _pixels(judge, init)
    objective = AutogradObjective(problem, Weights())
    layers = torch.nn.Parameter(torch.from_numpy(start))
    optimizer = torch.optim.LBFGS(
        [layers],
        max_iter=_MOST,
        max_eval=_MOST,
        tolerance_grad=0.0,
        tolerance_change=0.0,
        history_size=_HISTORY,
        line_search_fn="strong_wolfe",
    )
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
