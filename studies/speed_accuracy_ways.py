"""Ways to separate: polaropt with every solver, start, rung and tolerance, and the methods that it is measured against.

Around the default of `separate`, read from its signature, either one setting is changed at a time, or all are crossed.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from inspect import signature
from itertools import product

from polaropt.estimation import model_names
from polaropt.separation import separate
from polaropt.solving import start_names
from solvers.base import StoppingRule
from solvers.registry import solver_names
from studies.peer_methods import FULL, METHODS, Method

TOLD = "the scene told"
"""In the place of a rung: the true scene is given. No photographer has it."""
# It takes at most 100 000 unknowns, and a minute for them.
_SMALL_ONLY = ("casadi",)
_TOLERANCES = (1.0, 10.0, 0.1)


@dataclass(frozen=True)
class Way:
    """One way to separate.

    Attributes
    ----------
    method : str
        The full solve, which the other fields describe, or a name of `studies.peer_methods.METHODS`.
    solver, start, rung : str
        As `separate` takes them (`solver`, `init`, `model`); `TOLD` in the place of a rung.
    relative_change : float
        Of the stopping rule.
    """

    method: str = FULL
    solver: str = ""
    start: str = ""
    rung: str = ""
    relative_change: float = 0.0

    @property
    def ours(self) -> bool:
        """Whether it is the full solve."""
        return self.method == FULL

    @property
    def stopping(self) -> StoppingRule:
        """The default stopping rule at this tolerance."""
        return replace(_STOPPING, relative_change=self.relative_change)

    @property
    def blind(self) -> bool:
        """Whether nothing of the truth is told."""
        return self.rung != TOLD if self.ours else method_of(self).told == "nothing"

    @property
    def factor(self) -> str:
        """The one setting that is not the default; empty for the default, and for several."""
        changed = self._changed()
        return "method" if not self.ours else changed[0] if len(changed) == 1 else ""

    @property
    def label(self) -> str:
        """In a few words, what is not as by default."""
        if not self.ours:
            return self.method
        told = {name: str(getattr(self, name)) for name in ("solver", "start", "rung")}
        told["tolerance"] = f"{self.relative_change:.0e}".replace("e-0", "e-")
        return (
            ", ".join(TOLD if told[name] == TOLD else f"{name} {told[name]}" for name in self._changed()) or "default"
        )

    def _changed(self) -> list[str]:
        names = {"solver": "solver", "start": "start", "rung": "rung", "relative_change": "tolerance"}
        return [said for name, said in names.items() if getattr(self, name) != getattr(DEFAULT, name)]


_SEPARATE = {name: parameter.default for name, parameter in signature(separate).parameters.items()}
_STOPPING: StoppingRule = _SEPARATE["stopping"]
DEFAULT = Way(FULL, _SEPARATE["solver"], _SEPARATE["init"], _SEPARATE["model"], _STOPPING.relative_change)
"""What `separate` does when it is asked for nothing."""


def tolerances() -> tuple[float, ...]:
    """The default relative change, a coarser and a finer one."""
    return tuple(float(f"{factor * DEFAULT.relative_change:.3g}") for factor in _TOLERANCES)


def rungs() -> tuple[str, ...]:
    """All that separate; "none" is the plain intensity, a method of its own."""
    return tuple(name for name in model_names() if name != "none")


def one_at_a_time() -> tuple[Way, ...]:
    """The default, and all ways that differ from it in one setting."""
    ways = [
        DEFAULT,
        *(replace(DEFAULT, solver=name) for name in solver_names()),
        *(replace(DEFAULT, start=name) for name in start_names()),
        *(replace(DEFAULT, rung=name) for name in (*rungs(), TOLD)),
        *(replace(DEFAULT, relative_change=value) for value in tolerances()),
    ]
    return tuple(dict.fromkeys(ways))


def crossed(relative_changes: Sequence[float]) -> tuple[Way, ...]:
    """Every solver that takes photographs of 256x256 pixels with every start, rung and these tolerances."""
    solvers = (name for name in solver_names() if name not in _SMALL_ONLY)
    return tuple(Way(FULL, *settings) for settings in product(solvers, start_names(), rungs(), relative_changes))


def other_methods() -> tuple[Way, ...]:
    """What is not the full solve, from the plain intensity to the closed form alone."""
    return tuple(Way(method.name) for method in METHODS if method.name != FULL)


def method_of(way: Way) -> Method:
    """The method that a way names."""
    (method,) = (method for method in METHODS if method.name == way.method)
    return method
