"""The separation with one part left out or put in: what is changed of capture, scene, objective, start or solver."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from polaropt.capture import Capture, noise_level
from polaropt.estimation import find_scene
from polaropt.optics import PSE, SceneParameters
from polaropt.progress import Stages
from polaropt.solving import (
    Coordinates,
    Misfit,
    Problem,
    Settings,
    Weights,
    build_objective,
    check_start,
    is_kept,
    solve,
    take_start,
)
from solvers.base import SolverResult, StoppingRule
from solvers.registry import get_solver

Images = NDArray[np.float32]

ALL = "nothing"
# Where the noise is not measured, this is taken for it: twice what the protocol has.
FIXED_NOISE = 0.01
_STOPPING = StoppingRule(max_evaluations=500)


@dataclass(frozen=True)
class Solved:
    """Layers on the frame (2, channel, h, w), and how the solver ended."""

    layers: Images
    solver: SolverResult


@dataclass(frozen=True)
class Variant:
    """One part left out, or one put in that is not there by default.

    Attributes
    ----------
    name : str
        What is left out, or put in.
    said : str
        What stands in its place, or what it stands for.
    weights : Weights
    scene : callable
        From the scene that was found and the true one to the one that is solved with.
    asked : SceneParameters
        What is told of the scene before it is found.
    noise : float or None
        Taken for the noise; None: measured.
    init : str
    prepared : callable
        From capture, scene, noise and weights to the problem.
    coordinates : callable
        From problem, weights and start to the objective.
    added : bool
        Whether the part is put in.
    """

    name: str
    said: str
    weights: Weights = Weights()  # noqa: RUF009 (frozen)
    scene: Callable[[SceneParameters, SceneParameters], SceneParameters] = lambda found, true: found
    asked: SceneParameters = SceneParameters(None, None, None)  # noqa: RUF009 (frozen)
    noise: float | None = None
    init: str = "closed-form"
    prepared: Callable[..., Problem] = Problem
    coordinates: Callable[[Problem, Weights, Images], Coordinates] = lambda problem, weights, start: problem.compiled(
        start
    )
    added: bool = False

    @property
    def change(self) -> str:
        """In a few words, what was done."""
        if self.name == ALL:
            return "the whole"
        return f"{'with' if self.added else 'without'} {self.name}"

    def found(self, capture: Capture, noise: float) -> SceneParameters:
        """The scene as it is estimated."""
        return find_scene(capture, self.asked, noise).scene

    def solved(self, capture: Capture, found: SceneParameters, true: SceneParameters) -> Solved:
        """Layers of a capture whose scene was found; InputError where the start lacks a package."""
        check_start(self.init)
        noise = noise_level(capture) if self.noise is None else self.noise
        if is_kept(self.init):
            return self._kept(capture, self.scene(found, true), noise)
        problem = self.prepared(capture, self.scene(found, true), noise, self.weights)
        start = take_start(problem, self.init)
        objective = self.coordinates(problem, self.weights, start)
        z = objective.coordinates(start)
        result = get_solver("lbfgs").minimize(objective.value_and_grad, z, _STOPPING)
        layers, _ = objective.solution(result.x)
        return Solved(np.ascontiguousarray(problem.canvas.crop(layers)), replace(result, x=z[:0]))

    def _kept(self, capture: Capture, scene: SceneParameters, noise: float) -> Solved:
        """From a start that a solve leaves only as far as the photographs say, as `separate` goes there."""
        settings = Settings(init=self.init, weights=self.weights, stopping=_STOPPING)
        solution = solve(capture, scene, noise, settings, Stages())
        return Solved(solution.layers, solution.solver)


class _Unpolarized(Problem):
    """A problem that knows the intensity alone: every photograph as if taken without a polarizer."""

    def __init__(self, capture: Capture, scene: SceneParameters, noise: float, weights: Weights) -> None:
        mean = np.broadcast_to(capture.intensities.mean(axis=0), capture.intensities.shape)
        super().__init__(Capture.of_planes(mean, capture.angles_deg, capture.valid), scene, noise, weights)

    def _engine(self, center: tuple[float, float] | None) -> PSE:
        engine = super()._engine(center)
        assert isinstance(engine, PSE)
        engine.mixing = np.broadcast_to(engine.mixing.mean(axis=0), engine.mixing.shape).copy()
        return engine


class _Pixels:
    """The objective in the layers' own pixels, without a preconditioner."""

    def __init__(self, problem: Problem, weights: Weights, start: Images) -> None:
        misfit = Misfit(problem.capture, problem.pse, problem.canvas, problem.noise)
        self._objective = build_objective(misfit, problem.penalties, problem.canvas, weights)
        self._shape = start.shape

    def coordinates(self, layers: Images) -> Images:
        """The pixels, flat."""
        return layers.reshape(-1)

    def value_and_grad(self, z: Images) -> tuple[float, Images]:
        """Value and gradient at pixels z."""
        value, gradient = self._objective.value_and_grad(z.reshape(self._shape))
        return value, gradient.reshape(-1)

    def solution(self, z: Images) -> tuple[Images, dict[str, Any]]:
        """Layers, and no terms."""
        return z.reshape(self._shape), {}


def _in_place(found: SceneParameters, true: SceneParameters) -> SceneParameters:
    return found.replace(ghost_shift=0.0, transmission_ghost_shift=None)


VARIANTS = (
    Variant(ALL, ""),
    Variant("misfit", "start and regularizers alone", Weights(misfit=0)),
    Variant("polarization", "the intensity alone", prepared=_Unpolarized),
    Variant("multi-bounce", "a single bounce", asked=SceneParameters(None, None, None, n_bounces=1)),
    Variant("ghosts", "all bounces in place", scene=_in_place),
    Variant("edge independence", "", Weights(edge_independence=0)),
    Variant("gradient sparsity", "", Weights(gradient_sparsity=0)),
    Variant("nonnegativity", "", Weights(nonnegativity=0)),
    Variant("natural-image prior", "", Weights(natural_image=0)),
    Variant("closed-form start", "from the plain intensity", init="cold"),
    Variant("learned start", "in the place of the closed form", init="learned", added=True),
    Variant("blind estimation", "the scene known", scene=lambda found, true: true),
    Variant("weights from the noise", f"those of a noise of {FIXED_NOISE:g}", noise=FIXED_NOISE),
    Variant("preconditioner", "L-BFGS on the pixels", coordinates=_Pixels),
)
