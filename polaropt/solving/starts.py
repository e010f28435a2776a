"""Where a solve can start, by name, and how far it may leave a start that knows more than the objective does."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from importlib.util import find_spec

import numpy as np
from numpy.typing import NDArray

from polaropt.capture import Capture
from polaropt.errors import InputError
from polaropt.inversion import per_pixel_layers, varying_pixel_layers
from polaropt.optics import PSE
from polaropt.solving.objective import Term
from polaropt.solving.problem import Coordinates, Problem

Images = NDArray[np.float32]

# Shares of the way to the minimum. Found with ``python -m studies.learned_init``: the mean of two estimates that err
# differently is better than either; the smallest share that is worth a solve was set by hand.
_HALFWAY = 0.5
_LITTLE = 0.05
# How far around clipped pixels the closed form errs, in pixels: set by hand.
_REACH_PX = 24


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
    there = all(find_spec(package) is not None for package in ("torch", "safetensors"))
    return (
        Initializer("closed-form", "A Wiener filter per frequency, with all ghosts (the default)."),
        Initializer("cold", "The plain intensity."),
        Initializer(
            "learned", "Networks that improve the closed form; the solve keeps what the photographs leave open.", there
        ),
        Initializer("per-pixel", "Each pixel's own photographs, double images in place."),
    )


def start_names() -> tuple[str, ...]:
    """Names that `take_start` knows, installed or not."""
    return tuple(start.name for start in initializers())


def check_start(name: str) -> None:
    """InputError where there is no such start, or where it lacks a package."""
    known = {start.name: start for start in initializers()}
    if name not in known:
        raise InputError(f"unknown start {name!r}; there are: {', '.join(known)}")
    if not known[name].installed:
        raise InputError(f"the start {name!r} needs torch and safetensors: pip install 'polaropt[torch]'")


def is_kept(name: str) -> bool:
    """Whether a solve leaves this start only as far as the photographs say, see `KeptStart`.

    The learned start knows what the objective does not; going on would trade that for what the objective prefers.
    """
    return name == "learned"


def take_start(problem: Problem, name: str) -> Images:
    """Canvas layers (2, channel, H, W) to start from; what only the start needs of the closed form is given up.

    Parameters
    ----------
    problem : Problem
        With the closed form that it was made with, whose layers it loses: canvas layers are much memory.
    name : str
        See `initializers`.
    """
    start = _start_layers(problem, name)
    problem.derive_priors()
    nothing = np.empty(0, dtype=np.float32)
    problem.known = replace(problem.known, layers=nothing, prior=nothing)
    return start


def _start_layers(problem: Problem, name: str) -> Images:
    capture, canvas, pse = problem.capture, problem.canvas, problem.pse
    if name == "closed-form":
        if problem.expected is not None:
            return problem.expected.in_colors(problem.known.basis)
        return canvas.continued(canvas.crop(problem.known.layers))
    if name == "learned":
        return canvas.continued(_learned_layers(problem))
    if name == "per-pixel":
        layers = per_pixel_layers(capture, pse.scene) if isinstance(pse, PSE) else varying_pixel_layers(capture, pse)
        return canvas.continued(_with_channels(layers, capture))
    intensity = _with_channels(capture.stokes[:1], capture)
    flat = np.broadcast_to(intensity.mean((-1, -2), keepdims=True), intensity.shape)
    return canvas.continued(np.concatenate([intensity, flat]))


def _learned_layers(problem: Problem) -> Images:
    """What the shipped networks make of the closed form, on the frame."""
    from polaropt.solving.observation import conditioned_observation
    from priors.learned import shipped_initializer
    from priors.networks.critics import WrongWeights

    layers = np.ascontiguousarray(problem.canvas.crop(problem.known.layers))
    try:
        learned = shipped_initializer()
    except WrongWeights as error:
        raise InputError(str(error)) from None
    return learned.layers(conditioned_observation(problem, layers), layers.shape[1])


def _with_channels(layers: Images, capture: Capture) -> Images:
    return layers if capture.color else layers[:, None]


class KeptStart:
    """A start that a solve leaves only so far.

    Parameters
    ----------
    layers : ndarray, shape (2, channel, H, W)
        On the canvas.
    problem : Problem
    unknown : float
        Share of the reflection's detail that the photographs leave open.

    Attributes
    ----------
    enough : float
        Raw misfit at which the photographs are explained to their noise.
    """

    def __init__(self, layers: Images, problem: Problem, unknown: float) -> None:
        self._layers, self.enough = layers, problem.misfit_of_noise
        self._least_share = least_share_of_way(unknown)
        near = near_clipped(problem.capture)
        self._near = None if near is None else problem.canvas.pad_zeros(near)

    @property
    def may_be_the_end(self) -> bool:
        """Whether nothing is to be solved where the start explains the photographs."""
        return self._least_share == 0 and self._near is None

    def nearest(self, objective: Coordinates, end: Images) -> tuple[Images, dict[str, Term]]:
        """Canvas layers on the way to the end of a solve, and the terms there."""
        start = self._layers if self._near is None else self._layers + self._near * (end - self._layers)
        return nearest_to_start(objective, start, end, enough=self.enough, least_share=self._least_share)


def least_share_of_way(unknown: float) -> float:
    """Least share of the way to the minimum that is gone, where so much of the reflection's detail is unknown.

    What the photographs tell of the layers, start and minimum estimate each in its own way, and their mean is better
    than either. What the photographs leave open the minimum takes from its prior alone, and the start knows better.
    """
    share = _HALFWAY * (1 - unknown)
    return share if share > _LITTLE else 0.0


def near_clipped(capture: Capture) -> Images | None:
    """Share of the way that each pixel (h, w) goes for sure: all of it where photographs are clipped.

    The objective leaves clipped photographs out; a closed form, and what improves it, cannot, and errs around them.
    None where there are none.
    """
    from scipy.ndimage import gaussian_filter, maximum_filter

    if capture.valid.all():
        return None
    clipped = ~capture.valid.reshape(-1, *capture.shape[-2:]).all(axis=0)
    around = maximum_filter(clipped.astype(np.float32), 2 * _REACH_PX + 1)
    return np.asarray(gaussian_filter(around, _REACH_PX / 4), dtype=np.float32)


def nearest_to_start(
    objective: Coordinates, start: Images, end: Images, *, enough: float, least_share: float
) -> tuple[Images, dict[str, Term]]:
    """Canvas layers on the way from a start to the end of a solve.

    They lie as near to the start as the photographs allow (Morozov's discrepancy principle along a line), but not
    nearer than `least_share`. The first whitened steps of a solve go nearly all the way to the minimum, so that ending
    it early would not do.

    Parameters
    ----------
    objective : Coordinates
    start, end : ndarray, shape (2, channel, H, W)
    enough : float
        Raw misfit to reach.
    least_share : float
        Of the way, 0..1.

    Returns
    -------
    layers : ndarray, shape (2, channel, H, W)
        The objective's own, which its next call overwrites.
    terms : dict of str to Term

    References
    ----------
    V. A. Morozov, On the solution of functional equations by the method of regularization, Soviet Mathematics Doklady
    7, 1966.
    """
    end = end.copy()

    def misfit(share: float) -> float:
        return _at(objective, start, end, share)[1]["misfit"].value

    first, share = misfit(0.0), least_share
    if first > enough:
        share = max(share, first_crossing(first, misfit(0.5), misfit(1.0), enough))
    return _at(objective, start, end, share)


def _at(objective: Coordinates, start: Images, end: Images, share: float) -> tuple[Images, dict[str, Term]]:
    between = start + np.float32(share) * (end - start)
    return objective.solution(objective.coordinates(between))


def first_crossing(start: float, middle: float, end: float, level: float) -> float:
    """Where between 0 and 1 the parabola through values at 0, 1/2 and 1 first falls to a level; 1 where it does not."""
    if start <= level:
        return 0.0
    curvature = 2 * (start - 2 * middle + end)
    slope = end - start - curvature
    root = slope**2 - 4 * curvature * (start - level)
    if slope >= 0 or root < 0:
        return 1.0
    # The form of the smaller root that does not cancel.
    return min(1.0, 2 * (start - level) / (-slope + math.sqrt(root)))
