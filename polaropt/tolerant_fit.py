"""A flat pane before a lens where part of the scene is polarized itself: told by the blocks that agree.

Metal and sky are polarized, and outshine what the pane does. So a block's polarized light may be unexplained by a share
of itself beside the noise, and blocks that are left far off lose their weight, down to the half that agrees best.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from polaropt.pane_edges import Candidate, candidate_near, named
from polaropt.pane_program import (
    AZIMUTH,
    INCIDENCE,
    N_NUMBERS,
    USUAL_VIEW,
    VIEW,
    VIEW_SPREAD,
    Prior,
    fitted,
)
from polaropt.perspective_fit import PerspectiveFit, asked_of_edges, fit_result
from polaropt.plate_frame import StokesImages
from polaropt.polarized_blocks import PolarizedBlocks
from polaropt.scene import SceneParameters
from polaropt.varying_overlap import VaryingOverlap

Values = NDArray[np.float64]

# Share of its polarized light that a block may have across.
_SHARE = 0.1
_INCIDENCE_SPREAD = math.radians(12)
_ROUNDS = 5
_TURNS_DEG = (0.0, 90.0, 180.0, 270.0)
# A block counts a quarter where it is this many times as far off as the median, in squares.
_FAR = 2.0
# Weights that the blocks themselves choose make them look surer than they are.
_WIDER = 2.0


@dataclass(frozen=True)
class TolerantFit:
    """A pane, and what it explains where blocks agree.

    Attributes
    ----------
    pane : PerspectiveFit
        Its misfit is that of the blocks as they are trusted.
    plain_misfit : float
        The same of the best pane that is seen from far.
    """

    pane: PerspectiveFit
    plain_misfit: float

    @property
    def explained(self) -> float:
        """Share of what the pane seen from far leaves that this one explains."""
        return (self.plain_misfit - self.pane.misfit) / max(self.plain_misfit - 1, 1e-9)


def fit_tolerant(
    stokes: StokesImages, plain: SceneParameters, focal_px: float | None = None, enough: float = 0.0
) -> TolerantFit:
    """Fit normal and focal length to the blocks that agree, then ask the layers' edges.

    Parameters
    ----------
    stokes : StokesImages
    plain : SceneParameters
        The flat pane seen from far that explains the capture best: where to begin, and index and surfaces.
    focal_px : float, optional
        Focal length, where it is known; else it begins with what lenses usually have.
    enough : float
        Share explained below which the edges are not looked at.
    """
    blocks = PolarizedBlocks(stokes)
    blocks = blocks.trusted(1 / (1 + _SHARE**2 * blocks.brightness))
    search = _beforehand(blocks, plain, focal_px)
    ways = [_agreed(blocks, _leaning(search.start, turn), search) for turn in _TURNS_DEG]
    best = ways[_most_agreed([_squares(blocks, way.fit.point) for way in ways])]
    plain_misfit = best.blocks.least_constant_misfit()
    found = TolerantFit(fit_result(best.blocks, best.fit, True), plain_misfit)
    overlap = VaryingOverlap(stokes, plain)
    if found.explained < enough or not overlap.usable:
        return found
    told, agree = asked_of_edges(best, overlap, best.blocks, plain)
    widened = replace(told.fit, covariance=_WIDER**2 * told.fit.covariance)
    return TolerantFit(fit_result(best.blocks, widened, agree), plain_misfit)


@dataclass(frozen=True)
class _Search:
    """Where to begin, what is known beforehand and which numbers are to be found."""

    start: Values
    prior: Prior
    free: tuple[int, ...]


def _beforehand(blocks: PolarizedBlocks, plain: SceneParameters, focal_px: float | None) -> _Search:
    incidence, azimuth, _ = plain.values()
    view = USUAL_VIEW if focal_px is None else blocks.half_px / focal_px
    point, spread = np.zeros(N_NUMBERS), np.full(N_NUMBERS, math.inf)
    point[[INCIDENCE, AZIMUTH, VIEW]] = math.radians(incidence), math.radians(azimuth % 360), view
    spread[[INCIDENCE, VIEW]] = _INCIDENCE_SPREAD, VIEW_SPREAD
    free = (INCIDENCE, AZIMUTH, VIEW) if focal_px is None else (INCIDENCE, AZIMUTH)
    return _Search(point, Prior(point * (spread < math.inf), np.diag(1 / spread**2)), free)


def _leaning(point: Values, turn_deg: float) -> Values:
    """The pane leaning another way."""
    turned = point.copy()
    turned[AZIMUTH] = (point[AZIMUTH] + math.radians(turn_deg)) % (2 * math.pi)
    return turned


def _agreed(blocks: PolarizedBlocks, point: Values, search: _Search) -> Candidate:
    """The pane near a point that most blocks agree on, and their weights."""
    trusted = blocks
    for _ in range(_ROUNDS):
        point = fitted(trusted, point, search.free, search.prior)
        trusted = _weighted(blocks, point)
    return candidate_near(trusted, search.prior, search.free, point)


def _weighted(blocks: PolarizedBlocks, point: Values) -> PolarizedBlocks:
    """Blocks with the less weight the farther off they are left."""
    squares = _squares(blocks, point)
    return blocks.trusted(1 / (1 + squares / (_FAR * max(1.0, float(np.median(squares))))) ** 2)


def _most_agreed(squares: list[Values]) -> int:
    """Index of the least sum over blocks, each counted up to a limit that is the same for all."""
    limit = _FAR * max(1.0, min(float(np.median(part)) for part in squares))
    return int(np.argmin([np.sum(part / (1 + part / limit)) for part in squares]))


def _squares(blocks: PolarizedBlocks, point: Values) -> Values:
    incidence_deg, azimuth_deg, focal, _ = named(point, blocks)
    return blocks.squares(incidence_deg, azimuth_deg, focal)
