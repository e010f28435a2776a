"""torch's L-BFGS, on the device where the start lies."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from solvers.base import (
    HISTORY,
    NUMPY,
    Norms,
    Progress,
    SolverResult,
    Status,
    StoppingRule,
    StopSolving,
    Traced,
    ValueAndGrad,
)


class TorchLBFGS:
    """torch.optim.LBFGS with its line search for the strong Wolfe conditions."""

    def minimize(self, objective: ValueAndGrad, start: Any, stopping: StoppingRule) -> SolverResult:
        """Minimize `objective` from `start` until `stopping` says so.

        Parameters
        ----------
        objective : callable
            Is called with arrays or tensors, whichever the start is, and gives a gradient of the same kind.
        start : array or tensor, shape (n,)
            A tensor's device is where everything stays; the result is brought back as a float32 array.
        stopping : StoppingRule
        """
        import torch

        tensors = isinstance(start, torch.Tensor)
        traced = Traced(objective, stopping, _tensor_norms() if tensors else NUMPY)
        progress = Progress(traced, stopping)
        point = start.detach() if tensors else torch.from_numpy(np.array(start, dtype=np.float32))
        x = torch.nn.Parameter(point.to(torch.float32, copy=True))
        try:
            self._optimize(x, traced, progress, tensors, 10 * stopping.max_evaluations + 100)
            # With its tests off it ends by itself only where a step no longer moves the point.
            status = Status.ROUNDOFF_LIMITED
        except StopSolving as stop:
            status = stop.status
        return traced.result(status, progress.count, start, to_numpy=_to_numpy)

    def _optimize(self, x: Any, traced: Traced, progress: Progress, tensors: bool, unlimited: int) -> None:
        import torch

        optimizer = torch.optim.LBFGS(
            [x],
            max_iter=unlimited,
            max_eval=unlimited,
            tolerance_grad=0.0,
            tolerance_change=0.0,
            history_size=HISTORY,
            line_search_fn="strong_wolfe",
        )
        step: Callable[[Any], Any] = optimizer.step
        step(_closure(x, optimizer.state, traced, progress, tensors))


def _closure(x: Any, state: Any, traced: Traced, progress: Progress, tensors: bool) -> Callable[[], float]:
    """The evaluation that torch asks for, in units of the first value: one of its constants expects values near 1."""
    import torch

    unit, begun = 0.0, 0

    def evaluate() -> float:
        nonlocal unit, begun
        # It tells nothing of its iterations but keeps their number up to date.
        if state[x].get("n_iter", 0) > begun:
            begun = state[x]["n_iter"]
            if begun > 1:
                progress.iteration()
        # A fresh copy, which `Traced` may keep: the optimizer moves its own point in place.
        point = x.detach().clone()
        given: Any = point if tensors else point.numpy()
        value, gradient = traced(given)
        unit = unit or abs(value) or 1.0
        x.grad = torch.as_tensor(gradient, dtype=x.dtype) / unit
        return value / unit

    return evaluate


def _tensor_norms() -> Norms:
    import torch

    return Norms(
        euclidean=lambda gradient: float(torch.linalg.vector_norm(gradient, dtype=torch.float64)),
        largest=lambda gradient: float(gradient.abs().max()),
    )


def _to_numpy(point: Any) -> Any:
    """A tensor's copy on the host, or the array itself."""
    return point.detach().cpu().numpy() if hasattr(point, "detach") else np.asarray(point)
