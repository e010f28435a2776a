"""Images of windows: how bright each is, and how bright any two that lie so far from each other are together.

They follow from a window's incidence, panes and tint alone. A search asks for many windows at once, of which few are of
another kind than those before: new kinds are worked out together, which takes a quarter of the time.
"""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable, Sequence
from contextlib import suppress
from typing import Generic, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from polaropt.optics import orders_of_windows

Values = NDArray[np.float64]

# Orders of images that are looked at, and the weight of those that count. By trial.
_ORDERS, _LEAST_WEIGHT = 10, 2e-3
_MOST_KEPT = 4096
"""Kinds of windows, of which a separation asks for some hundreds. Set by hand."""


class Kind(NamedTuple):
    """What the weights of a window's images follow from."""

    incidence_deg: float
    n_panes: int
    absorption: float
    refractive_index: float


class KindLags(NamedTuple):
    """How far images of a layer lie from each other: orders (lag, 2), and weights (2, lag, 4) as `kernels.Lags`."""

    orders: NDArray[np.int64]
    weights: NDArray[np.float32]


class SeenImages(NamedTuple):
    """How many shifts of a pane and of a gap images are off (image, 2), and their weights (2, image, 2).

    Those of both layers, transmission first, polarized along and across the azimuth.
    """

    orders: NDArray[np.int64]
    weights: Values


_Result = TypeVar("_Result")


class _OfKinds(Generic[_Result]):
    """Results of kinds of windows, kept for the next time; not to be written to."""

    def __init__(self, of_new: Callable[[list[Kind]], list[_Result]]) -> None:
        self._of_new = of_new
        self._kept: OrderedDict[Kind, _Result] = OrderedDict()

    def __call__(self, kinds: Sequence[Kind]) -> list[_Result]:
        known: dict[Kind, _Result] = {}
        for kind in kinds:
            # Another thread may have thrown it out meanwhile.
            with suppress(KeyError):
                known[kind] = self._kept[kind]
        new = [kind for kind in dict.fromkeys(kinds) if kind not in known]
        if new:
            found = dict(zip(new, self._of_new(new), strict=True))
            known |= found
            self._kept |= found
        while len(self._kept) > _MOST_KEPT:
            with suppress(KeyError):
                self._kept.popitem(last=False)
        return [known[kind] for kind in kinds]


def _weights(kinds: list[Kind]) -> list[Values]:
    """Weights (2, pane shifts, gap shifts, 2) of the images of kinds of windows."""
    weights: dict[Kind, Values] = {}
    for n_panes, index in dict.fromkeys((kind.n_panes, kind.refractive_index) for kind in kinds):
        alike = [kind for kind in kinds if (kind.n_panes, kind.refractive_index) == (n_panes, index)]
        incidences, absorptions = (np.array([kind[k] for kind in alike]) for k in (0, 2))
        images = orders_of_windows(incidences, absorptions, n_panes, index, 2 * _ORDERS)[:, :_ORDERS, :_ORDERS]
        weights |= zip(alike, np.ascontiguousarray(np.moveaxis(images, -1, 0)), strict=True)
    return [weights[kind] for kind in kinds]


_weights_of = _OfKinds(_weights)


def _seen(kinds: list[Kind]) -> list[SeenImages]:
    seen = []
    for images in _weights_of(kinds):
        bright = np.abs(images).max(axis=(0, -1)) > _LEAST_WEIGHT
        seen.append(SeenImages(np.argwhere(bright), images[:, bright]))
    return seen


seen_images = _OfKinds(_seen)
"""The images of kinds of windows that count."""


def _lags(kinds: list[Kind]) -> list[KindLags]:
    from scipy.fft import irfft2, rfft2

    images = np.stack(_weights_of(kinds))
    images[np.abs(images) <= _LEAST_WEIGHT] = 0
    # Products of every two images of a layer, added up by their lag: a correlation, within which none wraps around.
    par, perp = np.moveaxis(rfft2(images, (2 * _ORDERS, 2 * _ORDERS), axes=(2, 3)), -1, 0)
    of_par, of_perp, cross = irfft2(
        np.stack([par * par.conj(), perp * perp.conj(), par * perp.conj()]), (2 * _ORDERS, 2 * _ORDERS)
    )
    # One of each pair of opposite lags; the other is its mirror image.
    there, back = (tuple(sign * _LAG_ORDERS.T) for sign in (1, -1))
    forth, mirrored = cross[..., *there], cross[..., *back]
    weights = np.stack([of_par[..., *there], of_perp[..., *there], (forth + mirrored) / 2, forth - mirrored], axis=-1)
    weights[:, :, 1:, :3] *= 2
    used = np.abs(weights).max(axis=(1, -1)) > _LEAST_WEIGHT**2
    return [KindLags(_LAG_ORDERS[of], part[:, of].astype(np.float32)) for of, part in zip(used, weights, strict=True)]


kind_lags = _OfKinds(_lags)
"""The lags between images of kinds of windows that count."""

_LAG_ORDERS = np.array(
    [(pane, gap) for pane in range(_ORDERS) for gap in range(1 - _ORDERS, _ORDERS) if (pane, gap) >= (0, 0)]
)
"""Shifts of a pane and of a gap of one of each pair of opposite lags, none at all first."""
