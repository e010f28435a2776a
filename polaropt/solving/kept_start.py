"""How far a solve may leave a start that knows more than the objective does."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from polaropt.capture import Capture
from polaropt.solving.objective import Term

if TYPE_CHECKING:
    from polaropt.solving.problem import Coordinates, Problem


Images = NDArray[np.float32]

# Found with ``python -m studies.learned_init``: the mean of two estimates that err differently is better than either.
_HALFWAY = 0.5
_LITTLE = 0.05
_REACH_PX = 24


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
        self._least_share = share_told(unknown)
        near = near_clipped(problem.capture)
        self._near = None if near is None else problem.canvas.pad_zeros(near)

    @property
    def may_be_the_end(self) -> bool:
        """Whether nothing is to be solved where the start explains the photographs."""
        return self._least_share == 0 and self._near is None

    def left(self, objective: Coordinates, end: Images) -> tuple[Images, dict[str, Term]]:
        """Canvas layers on the way to the end of a solve, and the terms there."""
        start = self._layers if self._near is None else self._layers + self._near * (end - self._layers)
        return left_start(objective, start, end, enough=self.enough, least_share=self._least_share)


def share_told(unknown: float) -> float:
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


def left_start(
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
