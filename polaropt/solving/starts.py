"""Where a solve can start, by name, and the way back to a start for those who ask for it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from importlib.util import find_spec
from typing import Any

import numpy as np
from numpy.typing import NDArray

from polaropt.capture import Capture
from polaropt.errors import InputError, check_installed
from polaropt.inversion import per_pixel_layers, varying_pixel_layers
from polaropt.optics import PSE
from polaropt.solving.objective import Term
from polaropt.solving.problem import Coordinates, Problem

Images = NDArray[np.float32]
_OF_NETWORKS = ("torch", "safetensors")


@dataclass(frozen=True)
class Initializer:
    """A start of the solve.

    Attributes
    ----------
    name : str
        As `separate(init=...)` takes it.
    sentence : str
        What it is.
    installed : bool
        Whether all that it needs is there.

    Examples
    --------
    >>> from polaropt import Initializer, initializers
    >>> start = initializers()[0]
    >>> isinstance(start, Initializer), start.name, start.installed
    (True, 'closed-form', True)
    """

    name: str
    sentence: str
    installed: bool = True


def initializers() -> tuple[Initializer, ...]:
    """The starts that `separate` knows.

    Returns
    -------
    tuple of Initializer
        One for each name that ``separate(init=...)`` takes, installed or not.

    Examples
    --------
    >>> from polaropt import initializers
    >>> [start.name for start in initializers()]
    ['closed-form', 'cold', 'learned', 'per-pixel']
    """
    there = all(find_spec(package) is not None for package in _OF_NETWORKS)
    return (
        Initializer("closed-form", "A Wiener filter per frequency, with all ghosts (the default)."),
        Initializer("cold", "The plain intensity."),
        Initializer("learned", "Networks that improve the closed form.", there),
        Initializer("per-pixel", "Each pixel's own photographs, double images in place."),
    )


def start_names() -> tuple[str, ...]:
    """Names that `take_start` knows, installed or not."""
    return tuple(start.name for start in initializers())


def check_start(name: str) -> None:
    """InputError where there is no such start, or where a package that it needs is not there, or broken."""
    known = {start.name: start for start in initializers()}
    if name not in known:
        raise InputError(f"unknown start {name!r}; there are: {', '.join(known)}")
    if name == "learned":
        check_installed(_OF_NETWORKS, f"the start {name!r}", "'polaropt[torch]'")


def check_given_start(start: Any, shape: tuple[int, ...]) -> None:
    """InputError where layers to start from are none of a capture of this shape; None is no start."""
    if start is None:
        return
    if np.shape(start) != (2, *shape):
        raise InputError(f"the start has shape {np.shape(start)}, the layers {(2, *shape)}; make them equal")
    if not isinstance(start, np.ndarray) or not np.isfinite(start).all():
        raise InputError("the start holds NaN or infinite values, or is no array; give an array of numbers")


def take_start(problem: Problem, name: str, layers: Images | None = None) -> Images:
    """Canvas layers (2, channel, H, W) to start from; what only the start needs of the closed form is given up.

    Parameters
    ----------
    problem : Problem
        With the closed form that it was made with, whose layers it loses: canvas layers are much memory.
    name : str
        See `initializers`.
    layers : ndarray, shape (2, channel, h, w), optional
        Layers to start from instead, such as those of the photographs before.
    """
    start = _start_layers(problem, name) if layers is None else problem.canvas.continued(layers)
    problem.derive_priors()
    nothing = np.empty(0, dtype=np.float32)
    problem.known = replace(problem.known, layers=nothing, prior=nothing)
    return start


def _start_layers(problem: Problem, name: str) -> Images:
    capture, canvas, pse = problem.capture, problem.canvas, problem.pse
    if name == "closed-form":
        known = problem.best_known()
        return known if problem.expected is not None else canvas.continued(canvas.crop(known))
    if name == "learned":
        start = canvas.continued(_learned_layers(problem))
        problem.expect_around(start)
        return start
    if name == "per-pixel":
        layers = per_pixel_layers(capture, pse.scene) if isinstance(pse, PSE) else varying_pixel_layers(capture, pse)
        return canvas.continued(_with_channels(layers, capture))
    intensity = _with_channels(capture.stokes[:1], capture)
    flat = np.broadcast_to(intensity.mean((-1, -2), keepdims=True), intensity.shape)
    return canvas.continued(np.concatenate([intensity, flat]))


def _learned_layers(problem: Problem) -> Images:
    """What the shipped networks make of the layers known best before, on the frame."""
    from polaropt.solving.observation import conditioned_observation
    from priors.learned import shipped_initializer
    from priors.networks.critics import WrongWeights

    try:
        learned = shipped_initializer()
    except WrongWeights as error:
        raise InputError(str(error)) from None
    return learned.layers(conditioned_observation(problem), problem.known.layers.shape[1])


def _with_channels(layers: Images, capture: Capture) -> Images:
    return layers if capture.color else layers[:, None]


def pulled_to_start(objective: Coordinates, start: Images, end: Images, share: float) -> tuple[Images, dict[str, Term]]:
    """Canvas layers a share of the way back from the end of a solve to its start, and the terms there.

    Parameters
    ----------
    objective : Coordinates
    start, end : ndarray, shape (2, channel, H, W)
    share : float
        0 (the end) to 1 (the start).

    Returns
    -------
    layers : ndarray, shape (2, channel, H, W)
        The objective's own, which its next call overwrites.
    terms : dict of str to Term
    """
    return objective.solution(objective.coordinates(end + np.float32(share) * (start - end)))
