"""Things that are polarized each by itself: where they are, and the pane that the rest of the frame tells.

Water, leaves, screens and painted metal polarize what they mirror, each in its own way. No pane explains that light,
nor does a rung of the ladder, which knows one polarization of a whole layer. What a pane polarizes lies along one axis,
exactly, wherever nothing else is polarized: the axis on which most of the frame agrees, however much the rest pulls
another way.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from polaropt.estimation.wide.blocks import PolarizedBlocks

Mask = NDArray[np.bool_]
Values = NDArray[np.float64]

_UNLIKE = 4.0
"""Mean square of what is polarized across, in units of its noise, from which on a block is polarized by itself, and
half of what a loss that saturates takes it for. By trial on photographs with things polarized by 5 and 15 %."""
_STEP_DEG = 0.125
"""Of the azimuths that are tried."""
LEAST_SHARE = 0.003
"""Error of a photograph's gain, as a share of the light, that is always allowed for: set by hand."""
_SHOWS = 25.0
"""Mean square of polarized light, in units of its noise, that tells an axis at all: set by hand."""
_FEWEST_AGREE, _LEAST_LEFT = 0.2, 0.15
"""Share of the blocks that tell an axis which agree at least, and of the frame that is left: set by hand."""
_AROUND = 3
"""Blocks over which single ones are outvoted, an odd number; what is found is then widened by one. Set by hand."""


@dataclass(frozen=True)
class PolarizedThings:
    """Where a frame is polarized by itself.

    Attributes
    ----------
    azimuth_deg : float
        That the rest agrees on, modulo 90.
    where : ndarray of bool, shape (h, w)
    """

    azimuth_deg: float
    where: Mask

    @property
    def share(self) -> float:
        """Of the frame."""
        return float(self.where.mean())


def polarized_things(blocks: PolarizedBlocks, apart: float) -> PolarizedThings | None:
    """Where things are polarized by themselves; None where hardly anything agrees on a pane.

    Parameters
    ----------
    blocks : PolarizedBlocks
        Of full photographs, or of a mosaic's cells.
    apart : float
        Share of the light by which these do not add up, see `closure_share`.

    References
    ----------
    S. Geman, D. McClure, Statistical methods for tomographic image reconstruction, Bulletin of the International
    Statistical Institute 52, 1987 (the loss).
    """
    from scipy.ndimage import binary_dilation, median_filter

    allowed = _UNLIKE + np.square(max(LEAST_SHARE, apart) * blocks.stokes[0]).mean(axis=0)
    azimuth_deg = _agreed_azimuth(blocks, allowed)
    unlike = blocks.squares_across(azimuth_deg) > allowed
    shows = blocks.brightness > np.maximum(_SHOWS, allowed)
    if not shows.any() or np.mean(~unlike[shows]) < _FEWEST_AGREE:
        return None
    grid = blocks.laid_out(unlike)
    where = blocks.in_pixels(binary_dilation(median_filter(grid, _AROUND)))
    return PolarizedThings(azimuth_deg, where) if where.any() and where.mean() <= 1 - _LEAST_LEFT else None


def _agreed_azimuth(blocks: PolarizedBlocks, allowed: Values) -> float:
    """The azimuth, modulo 90 degrees, across which fewest blocks are polarized."""

    def loss(azimuth_deg: float) -> float:
        squares = blocks.squares_across(azimuth_deg)
        return float((squares / (squares + allowed)).sum())

    return min((float(azimuth) for azimuth in np.arange(0, 90, _STEP_DEG)), key=loss)
