"""casadi's classes for functions that it cannot look into. Importing this imports casadi."""

from __future__ import annotations

import io
from contextlib import ExitStack, redirect_stderr
from typing import Any

import casadi
import numpy as np
from numpy.typing import NDArray

from solvers.base import Progress, Scaled, Status, StopSolving, Traced


class Evaluations:
    """What IPOPT asks for: value and gradient one after the other, and whether to go on."""

    def __init__(self, traced: Traced, progress: Progress, silenced: ExitStack) -> None:
        self._scaled, self._progress, self._silenced = Scaled(traced), progress, silenced
        self._x: NDArray[np.float64] | None = None
        self._known: tuple[float, NDArray[np.float64]] = (0.0, np.zeros(0))
        self._raised: BaseException | None = None

    def at(self, x: NDArray[np.float64]) -> tuple[float, NDArray[np.float64]]:
        """Value and gradient at `x`, evaluated once for both."""
        try:
            if self._raised is not None:
                raise self._raised
            if self._x is None or not np.array_equal(x, self._x):
                self._known = self._scaled(x)
                self._x = x
            return self._known
        except BaseException as raised:
            self._raised = raised
            # The one exception that casadi takes for an order to stop; it also prints a line about it.
            self._silenced.enter_context(redirect_stderr(io.StringIO()))
            raise KeyboardInterrupt from raised

    def goes_on(self, iteration: int) -> bool:
        """Note that an iteration has ended; whether there shall be another."""
        try:
            if iteration:
                self._progress.iteration()
        except StopSolving as stop:
            self._raised = stop
        return self._raised is None

    def status(self, return_status: str) -> Status:
        """Why it stopped; raises what is not a reason to stop but an error."""
        if self._raised is None:
            if return_status == "NonIpopt_Exception_Thrown":
                raise KeyboardInterrupt
            if return_status == "Insufficient_Memory":
                raise MemoryError("IPOPT found no memory")
            # With its tests off it ends by itself only where it finds nothing lower.
            return Status.ROUNDOFF_LIMITED
        if not isinstance(self._raised, StopSolving):
            raise self._raised
        return self._raised.status


def nonlinear_program(evaluations: Evaluations, n: int, options: dict[str, Any]) -> Any:
    """The program that minimizes what `evaluations` give, of n unknowns; called with the start as `x0`."""
    objective, watch = _Objective(evaluations, n), _Watch(evaluations, n)
    x: Any = casadi.MX.sym("x", n)
    silent: dict[str, Any] = {
        "print_time": False,
        "error_on_fail": False,
        "show_eval_warnings": False,
        "iteration_callback": watch,
    }
    program = casadi.nlpsol("separation", "ipopt", {"x": x, "f": objective(x)}, silent | {"ipopt": options})
    return _Kept(program, (objective, watch))


class _Kept:
    """A program with its callbacks: casadi does not keep them alive."""

    def __init__(self, program: Any, callbacks: tuple[Any, ...]) -> None:
        self._program, self._callbacks = program, callbacks

    def __call__(self, x0: Any) -> Any:
        return self._program(x0=x0)

    def stats(self) -> dict[str, Any]:
        """What casadi tells about the run."""
        stats: dict[str, Any] = self._program.stats()
        return stats


class _Objective(casadi.Callback):
    """The value, and through its Jacobian the gradient."""

    def __init__(self, evaluations: Evaluations, n: int) -> None:
        casadi.Callback.__init__(self)
        self._evaluations, self._n = evaluations, n
        self._jacobian: Any = None
        self.construct("objective", {})

    def get_sparsity_in(self, i: int) -> Any:
        return casadi.Sparsity.dense(self._n)

    def eval(self, arguments: Any) -> list[float]:
        return [self._evaluations.at(_flat(arguments[0]))[0]]

    def has_jacobian(self) -> bool:
        return True

    def get_jacobian(self, name: str, inputs: Any, outputs: Any, options: Any) -> Any:
        self._jacobian = _Jacobian(self._evaluations, self._n, name)
        return self._jacobian


class _Jacobian(casadi.Callback):
    """The gradient as a row, from the point and the value there."""

    def __init__(self, evaluations: Evaluations, n: int, name: str) -> None:
        casadi.Callback.__init__(self)
        self._evaluations, self._n = evaluations, n
        self.construct(name, {})

    def get_n_in(self) -> int:
        return 2

    def get_sparsity_in(self, i: int) -> Any:
        return casadi.Sparsity.dense(self._n) if i == 0 else casadi.Sparsity.dense(1)

    def get_sparsity_out(self, i: int) -> Any:
        return casadi.Sparsity.dense(1, self._n)

    def eval(self, arguments: Any) -> list[Any]:
        return [self._evaluations.at(_flat(arguments[0]))[1].reshape(1, -1)]


class _Watch(casadi.Callback):
    """Called at the end of every iteration; 1 stops."""

    def __init__(self, evaluations: Evaluations, n: int) -> None:
        casadi.Callback.__init__(self)
        self._evaluations, self._n, self._count = evaluations, n, 0
        self.construct("watch", {})

    def get_n_in(self) -> int:
        return int(casadi.nlpsol_n_out())

    def get_name_in(self, i: int) -> str:
        return str(casadi.nlpsol_out(i))

    def get_sparsity_in(self, i: int) -> Any:
        sizes = {"x": self._n, "lam_x": self._n, "f": 1}
        return casadi.Sparsity.dense(sizes.get(self.get_name_in(i), 0), 1)

    def eval(self, arguments: Any) -> list[int]:
        self._count += 1
        return [0 if self._evaluations.goes_on(self._count - 1) else 1]


def _flat(argument: Any) -> Any:
    return np.array(argument, dtype=np.float64).ravel()
