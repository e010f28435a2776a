"""How likely a capture's mean spectra are under windows of several panes, or tinted ones.

Each image of a layer beside the others shapes its spectrum: the brightness of the images tells the incidence, the
number of panes and the tint, their places the shifts.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from polaropt.estimation.flat.ghosts import (
    DEGREES_OF_FREEDOM,
    FIRST_LEVEL,
    LEAST_FACTOR,
    CrossSpectra,
)
from polaropt.estimation.flat.windows.images import Kind, KindLags, SeenImages, kind_lags, seen_images
from polaropt.numerics import hann_autocorrelation
from solvers.kernels import in_blocks

if TYPE_CHECKING:
    from polaropt.estimation.flat.windows.kernels import Seen

Values = NDArray[np.float64]

DETAIL = (5, 4)
"""Radii and directions into which the layers' spectra are split: with fewer, edges pass for further panes. By trial."""
_ROUNDS = 8
"""In which each trial's spectra are fitted. By trial."""
_TRIALS_OF_A_THREAD = 8
"""Set by hand."""
_DIGITS = 3
"""Decimals of incidence (degrees) and absorption to which windows are told apart: less than any error. Set by hand."""


@dataclass(frozen=True)
class Window:
    """A trial window in the frame of its azimuth.

    Attributes
    ----------
    incidence_deg : float
    pane_shift : float
        In pixels along the azimuth.
    gap_along, gap_across : float
        From one pane's back to the next one's front, in pixels along the azimuth, and 90 degrees clockwise from it.
    n_panes : int
    absorption : float
    behind_degree, mirrored_degree : float
        To which the light behind the window and the mirrored one are polarized along the azimuth, or across where they
        are negative. Tiles heed them, mean spectra take all light for unpolarized.
    exposed_along : float
        Share by which light polarized along the azimuth was exposed longer than the mean of it and what is polarized
        across. Tiles heed it, mean spectra take all photographs for exposed alike.
    """

    incidence_deg: float
    pane_shift: float
    gap_along: float = 0.0
    gap_across: float = 0.0
    n_panes: int = 1
    absorption: float = 0.0
    behind_degree: float = 0.0
    mirrored_degree: float = 0.0
    exposed_along: float = 0.0


class WindowLikelihood:
    """Likelihood of windows given a capture's mean spectra.

    Parameters
    ----------
    spectra : CrossSpectra
    refractive_index : float
    """

    def __init__(self, spectra: CrossSpectra, refractive_index: float) -> None:
        self._spectra, self._index = spectra, refractive_index
        self._seen = _seen(spectra)

    def misfit(self, windows: Sequence[Window], rounds: int = _ROUNDS) -> Values:
        """Minus log likelihood per frequency of trial windows, up to a constant, (window,)."""
        from polaropt.estimation.flat.windows.kernels import Lags, window_misfits

        glass = [_kind(window, self._index) for window in windows]
        different = list(dict.fromkeys(glass))
        tables = kind_lags(different)
        longest = max(len(of_lags.orders) for of_lags in tables)
        orders = np.zeros((len(tables), 2, longest, 2), np.int64)
        weights = np.zeros((len(tables), 2, longest, 4), np.float32)
        for k, (own, of_lags) in enumerate(tables):
            orders[k, :, : len(own)], weights[k, :, : len(own)] = own, of_lags
        kinds = np.array([different.index(of) for of in glass])
        shifts = np.array([(w.pane_shift, w.gap_along, w.gap_across) for w in windows])
        common = common_light(orders[kinds], shifts, self._spectra.azimuth_deg, self._spectra.tile)
        lags, trials, out = Lags(orders, weights), shifts.astype(np.float32), np.empty(len(windows))
        settings = (DEGREES_OF_FREEDOM, np.float32(LEAST_FACTOR), rounds, np.float32(FIRST_LEVEL))

        def some(start: int, stop: int) -> None:
            window_misfits(trials, kinds, lags, common, self._seen, *settings, out, start, stop)

        in_blocks(some, len(windows), _TRIALS_OF_A_THREAD)
        return out


def common_light(orders: NDArray[np.int64], shifts: Values, azimuth_deg: float, tile: int) -> NDArray[np.float32]:
    """Share of its light that a tile's window has in common with itself one lag further, (window, 2, lag).

    Parameters
    ----------
    orders : ndarray of int, shape (window, 2, lag, 2)
        Shifts of a pane and of a gap between two images.
    shifts : ndarray, shape (window, 3)
        Of a pane, and of a gap along and across the azimuth, in pixels.
    azimuth_deg : float
    tile : int
        Side in pixels.
    """
    along = orders[..., 0] * shifts[:, :1, None] + orders[..., 1] * shifts[:, 1:2, None]
    across = orders[..., 1] * shifts[:, 2:, None]
    azimuth = math.radians(azimuth_deg)
    columns = along * math.cos(azimuth) + across * math.sin(azimuth)
    rows = along * math.sin(azimuth) - across * math.cos(azimuth)
    return (hann_autocorrelation(columns / tile) * hann_autocorrelation(rows / tile)).astype(np.float32)


def lags_of(window: Window, refractive_index: float) -> KindLags:
    """How far images of a layer lie from each other, see `KindLags`."""
    return kind_lags([_kind(window, refractive_index)])[0]


def images_of(window: Window, refractive_index: float) -> SeenImages:
    """Images of a window that count."""
    return seen_images([_kind(window, refractive_index)])[0]


def _kind(window: Window, refractive_index: float) -> Kind:
    incidence, absorption = round(window.incidence_deg, _DIGITS), round(window.absorption, _DIGITS)
    return Kind(incidence, window.n_panes, absorption, refractive_index)


def _seen(spectra: CrossSpectra) -> Seen:
    from polaropt.estimation.flat.windows.kernels import Seen

    (par, cross), (_, perp) = spectra.covariance
    data = np.stack([spectra.par, spectra.perp, spectra.cross.real, spectra.cross.imag])
    parts = (spectra.along, spectra.across_azimuth, spectra.multiplicity)
    arrays = (*parts, spectra.shapes(*DETAIL), data, np.array([par, perp, cross]))
    return Seen(*(np.ascontiguousarray(part, dtype=np.float32) for part in arrays))
