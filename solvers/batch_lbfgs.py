"""L-BFGS of several objectives side by side on a device: one evaluation of all at a time, each with steps of its own.

The algorithm is that of `solvers.lbfgs`: directions are found among a few inner products, on the host; a device waits
once per evaluation.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from solvers.base import NotFinite, Progress, SolverResult, Status, StoppingRule, StopSolving, Traced, ValueAndGrad
from solvers.lbfgs import (
    HISTORY,
    MOST_HALVINGS,
    MOST_RESTARTS,
    SHORTER,
    SUFFICIENT,
    VALUE_NOISE,
    Direction,
    Gram,
    first_reach,
    shorter_step,
)

# Tensors (objective,) and (objective, n).
Tensor = Any
ValuesAndGrads = Callable[[Tensor], tuple[Tensor, Tensor]]


@dataclass(frozen=True)
class Minima:
    """Where objectives are least.

    Attributes
    ----------
    points : Tensor, shape (objective, n)
    results : list of SolverResult
        One for each; their points are empty.
    """

    points: Tensor
    results: list[SolverResult]


def minimize_all(objective: ValuesAndGrads, start: Tensor, stopping: StoppingRule) -> Minima:
    """Minimize several objectives of one length from their starts, until `stopping` says so of each.

    Parameters
    ----------
    objective : callable
        Gives values (objective,) in double precision and gradients (objective, n) at points (objective, n).
    start : Tensor, shape (objective, n)
        In single precision; its device is where everything stays.
    stopping : StoppingRule
        Seconds are those of all together.
    """
    import torch

    state = _State(start.clone(), *_pairs_like(start))
    descents = [_Descent(stopping, start.shape[1]) for _ in start]
    with torch.no_grad():
        trial = start
        while any(descent.runs for descent in descents):
            for descent in descents:
                descent.check_limits()
            if not any(descent.runs for descent in descents):
                break
            values, gradients = objective(trial)
            numbers = torch.stack([values, torch.linalg.vector_norm(gradients, dim=1, dtype=torch.float64)]).cpu()
            for i, descent in enumerate(descents):
                if descent.runs:
                    descent.take(state, i, (trial[i], gradients[i]), float(numbers[0, i]), float(numbers[1, i]))
            trial = state.proposed([descent.step if descent.runs else None for descent in descents])
    points = torch.stack([s if d.best is None else d.best for d, s in zip(descents, start, strict=True)])
    return Minima(points, [descent.result() for descent in descents])


class OneOfBatch:
    """The same of a single objective, as a `solvers.base.Solver` of tensors."""

    def minimize(self, objective: ValueAndGrad, start: Any, stopping: StoppingRule) -> SolverResult:
        """Minimize `objective` from a tensor `start` until `stopping` says so; the point comes back as an array."""
        import torch

        def of_one(points: Tensor) -> tuple[Tensor, Tensor]:
            value, gradient = objective(points[0])
            return torch.tensor([value], dtype=torch.float64, device=points.device), gradient[None]

        found = minimize_all(of_one, start[None], stopping)
        return replace(found.results[0], x=np.asarray(found.points[0].cpu(), dtype=np.float32))


def _pairs_like(start: Tensor) -> tuple[Tensor, Tensor]:
    """Where gradients and pairs are kept: (objective, n) and (objective, 2 m, n)."""
    return start.new_zeros(start.shape), start.new_zeros((len(start), 2 * HISTORY, start.shape[1]))


@dataclass
class _Step:
    """A direction as weights of gradient, steps and gradient changes, times how far to go."""

    weights: np.ndarray[Any, np.dtype[np.float64]]
    length: float


@dataclass
class _State:
    """Points at hand, the gradients there, and the pairs that led there."""

    x: Tensor
    gradient: Tensor
    pairs: Tensor

    def proposed(self, steps: list[_Step | None]) -> Tensor:
        """The points to look at next; where there is no step, the point at hand."""
        import torch

        weights = np.zeros((len(steps), 1 + 2 * HISTORY), np.float32)
        for i, step in enumerate(steps):
            if step is not None:
                weights[i] = step.length * step.weights
        there = torch.from_numpy(weights).to(self.x.device)
        moved = torch.baddbmm(self.x[:, None], there[:, None, 1:], self.pairs)[:, 0]
        return moved.addcmul_(there[:, :1], self.gradient)

    def absorbed(self, i: int, point: Tensor, gradient: Tensor, slot: int | None) -> np.ndarray[Any, Any]:
        """Move to a point and take in the pair that led there; the products that `Gram.remember` takes.

        Without a slot there is no pair yet: only the gradient's square is told, the last but two.
        """
        import torch

        m, pairs = HISTORY, self.pairs[i]
        vectors = [gradient]
        if slot is not None:
            torch.sub(point, self.x[i], out=pairs[slot])
            torch.sub(gradient, self.gradient[i], out=pairs[m + slot])
            vectors.append(pairs[m + slot])
        self.x[i], self.gradient[i] = point, gradient
        products = pairs @ torch.stack(vectors).T
        squares = torch.stack([torch.linalg.vecdot(gradient, gradient)])
        if slot is None:
            return np.array([float(squares[0])])
        step_step = torch.linalg.vecdot(pairs[slot], pairs[slot])
        flat = torch.cat([products.T.flatten(), squares, products[m + slot, 1:], step_step[None]])
        return np.asarray(flat.cpu(), dtype=np.float64)


class _Descent:
    """The course of one objective."""

    def __init__(self, stopping: StoppingRule, n_unknowns: int) -> None:
        self._traced = Traced(_never, stopping)
        self._progress = Progress(self._traced, stopping)
        self._gram = Gram(HISTORY)
        self._n_unknowns = n_unknowns
        self._status: Status | None = None
        self._value, self._slope, self._tries, self._restarts = math.inf, 0.0, 0, 0
        self._reach: float | None = None
        self.step: _Step | None = None

    @property
    def runs(self) -> bool:
        """Whether it goes on."""
        return self._status is None

    @property
    def best(self) -> Tensor:
        """The best point; None where nothing was finite."""
        return self._traced.best

    def check_limits(self) -> None:
        """End where the rule allows no more evaluation."""
        if self.runs:
            try:
                self._traced.check_limits()
            except StopSolving as stop:
                self._status = stop.status

    def take(self, state: _State, i: int, trial: tuple[Tensor, Tensor], value: float, norm: float) -> None:
        """Take in an evaluation and choose the next step."""
        point, gradient = trial
        try:
            try:
                self._traced.note(point, value, norm, lambda: float(gradient.abs().max()))
            except NotFinite:
                self._tread_carefully()
                return
            if self.step is None:
                self._gram.begin(float(state.absorbed(i, point, gradient, None)[0]))
            elif value <= self._value + SUFFICIENT * self.step.length * self._slope + VALUE_NOISE * abs(self._value):
                self._progress.iteration()
                slot, _ = self._gram.take_slot()
                products = state.absorbed(i, point, gradient, slot)
                self._gram.remember(slot, products)
                self._reach = math.sqrt(products[-1])
            else:
                self._shorten(value)
                return
            self._value = value
            self._turn()
        except StopSolving as stop:
            self._status = stop.status

    def _turn(self) -> None:
        """Begin a search along the direction of the pairs; raises `StopSolving` where nothing leads down."""
        direction = self._gram.direction()
        if not direction.slope < 0 and not self._gram.empty:
            self._gram.clear()
            direction = self._gram.direction()
        if not direction.slope < 0:
            raise StopSolving(Status.ROUNDOFF_LIMITED)
        self._slope, self._tries = direction.slope, 0
        self.step = _Step(direction.weights, self._first_length(direction))

    def _first_length(self, direction: Direction) -> float:
        if not self._gram.empty:
            return 1.0
        length = max(math.sqrt(-direction.slope), 1e-30)
        if self._reach is None:
            self._reach = first_reach(length, self._value, self._n_unknowns)
        return self._reach / length

    def _shorten(self, value: float) -> None:
        """Try a shorter step, or without pairs; raises `StopSolving` where neither leads down."""
        assert self.step is not None
        self._tries += 1
        if self._tries < MOST_HALVINGS:
            self.step.length = shorter_step(self.step.length, self._slope, value - self._value)
            return
        if self._gram.empty:
            raise StopSolving(Status.ROUNDOFF_LIMITED)
        self._gram.clear()
        self._turn()

    def _tread_carefully(self) -> None:
        """A tenth of the step that led where nothing is finite, some times."""
        if self.step is None or self._restarts == MOST_RESTARTS:
            self._status = Status.NOT_FINITE
            return
        self._restarts += 1
        self.step.length *= SHORTER

    def result(self) -> SolverResult:
        """How it went."""
        status = self._status or Status.NOT_RUN
        empty = np.zeros(0, dtype=np.float32)
        found = self._traced.result(
            status, self._progress.count, empty, restarts=self._restarts, to_numpy=lambda _: empty
        )
        return found


def _never(_: Any) -> tuple[float, Any]:
    raise AssertionError("evaluations of a batch are made together")
