"""What a capture shows that no two layers make behind a pane with ghosts, whatever these layers are.

Three Stokes components are made of two layers, each of them through filters of its own, whose taps are the layer's
ghosts. So there are filters, products of those, that leave nothing of either layer, and these are known as soon as the
pane is and how both layers' light is polarized. Light that they leave is noise, or the pane is another one: nothing is
assumed of the layers, where they are like each other or have edges in common. That tells what ghosts tell without
doubt; directions of the layers' vectors, which they do not tell, are left to edges (`Mixture`) and tiles.

References
----------
G. Xu, H. Liu, L. Tong, T. Kailath, A least-squares approach to blind channel identification, IEEE TSP, 1995.
"""

from __future__ import annotations

import math
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from polaropt.capture import StokesImages
from polaropt.estimation.polarized.light import SHIFT, Point, first_images, shown_light, stokes_of_entries
from polaropt.estimation.polarized.likelihood import ghost_step
from polaropt.numerics import bilinear_transfer, middle_part, opponent_basis
from polaropt.optics import SceneParameters

Images = NDArray[np.float32]
Mask = NDArray[np.bool_]
Values = NDArray[np.float64]

_SIDE = 512
"""Longest side of the middle of the frame that is looked at, in pixels: bounded time. Set by hand."""
_BLUR_PX, _REACH, _EVERY = 1.5, 4, 2
"""Of the Gaussian before: standard deviation and half width in pixels, and how far apart pixels are looked at. Finer
light between two pixels is blurred, by the sensor and by any model of its ghosts. Set by hand."""
_ORDERS, _LEAST_ORDERS, _MOST_LOST = 5, 3, 0.5
"""Ghosts that are followed, at least, and share of a side that may be lost to them. At 80 degrees those beyond five
are 1e-3 of the first; with less than three a pane is not told from others. Set by hand."""
_LEAST_SHARE, _LEAST_SIDE = 0.1, 24
"""Share of the pixels that must be measured wherever ghosts come from, and side of a frame in pixels. Set by hand."""
_NOTHING = 1e-9
"""Least mean square, and distance of ghosts in sides, that is told from none."""
_KEPT = 24
"""Places of ghosts whose products are kept: a Newton step asks at some forty points of some ten places."""


class _Products(NamedTuple):
    """Mean products of whitened images moved to all their ghosts' places, those of noise, and how many they are of."""

    of_light: Values
    of_noise: Values
    n: float


class CrossRelation:
    """Likelihood of panes with ghosts given a capture's Stokes images, of light that no two layers make.

    Parameters
    ----------
    stokes : StokesImages
    asked : SceneParameters
        Index and surfaces of the pane; its geometry is not used.
    """

    def __init__(self, stokes: StokesImages, asked: SceneParameters) -> None:
        from scipy.ndimage import binary_erosion, gaussian_filter1d

        self._asked = asked
        self._whiten = np.linalg.inv(np.linalg.cholesky(stokes.covariance))
        part = middle_part(stokes.images.shape, _SIDE)
        images = np.asarray(stokes.images[..., *part], np.float32)
        basis = opponent_basis(images.shape[1])
        images = np.einsum("ij,dc,jcyx->idyx", self._whiten, basis, images)
        images = (images - images.mean(axis=(-2, -1), keepdims=True)).astype(np.float32)
        for axis in (-2, -1):
            images = gaussian_filter1d(images, _BLUR_PX, axis, radius=_REACH)
        self._images = images[..., _REACH:-_REACH, _REACH:-_REACH]
        seen = stokes.valid[..., *part].all(axis=0)
        self._seen: Mask = binary_erosion(seen, iterations=_REACH, border_value=1)[_REACH:-_REACH, _REACH:-_REACH]
        impulse = np.zeros(2 * _SIDE)
        impulse[_SIDE] = 1
        spectrum = np.abs(np.fft.fft(gaussian_filter1d(impulse, _BLUR_PX, radius=_REACH))) ** 2
        self._frequency = np.asarray(2 * np.pi * np.fft.fftfreq(impulse.size), np.float64)
        self._blur = spectrum / impulse.size
        # Blurred pixels are alike: that many are as good as one.
        self._independent = float(spectrum.mean() ** 2 / np.square(spectrum).mean()) ** 2
        self._products = lru_cache(maxsize=_KEPT)(self._products_at)

    def misfit(self, point: Point) -> float:
        """Minus log likelihood of a point, but for a constant; 0 where the frame is too small for its ghosts.

        The noise's level is free, so that what the model does not know, of aliases for one, counts as noise.
        """
        left, n = self.left(point)
        return n / 2 * math.log(max(left, _NOTHING))

    def left(self, point: Point) -> tuple[float, float]:
        """Mean square, in units of the noise, of light that no two layers make, and how many numbers it is of.

        It is 1 where the pane is the true one, and 1 of none where the frame is too small for its ghosts.
        """
        products = self._products(*ghost_step(point, float(point[SHIFT])))
        if products is None:
            return 1.0, 0.0
        taps = self._taps(point, len(products.of_noise))
        noise = float(np.einsum("ji,jk,ki->", taps, products.of_noise, taps))
        return float(taps.ravel() @ products.of_light @ taps.ravel()) / noise, products.n

    def _taps(self, point: Point, n: int) -> Values:
        """Taps of the filters of three whitened components that leave nothing of either layer, (n, 3)."""
        mixing = self._whiten @ stokes_of_entries(point)
        behind, mirrored = (mixing @ first_images(shown_light(point, self._asked), n)).swapaxes(-2, -1)
        taps = np.zeros((n, 3))
        for i in range(n):
            taps[i:] += np.cross(behind[i], mirrored[: n - i])
        return taps

    def _products_at(self, right: float, up: float) -> _Products | None:
        """Products of the images with themselves where ghosts lie so far apart; None where these leave the frame."""
        height, width = self._seen.shape
        orders = min(_ORDERS, math.floor(_MOST_LOST / max(abs(right) / width, abs(up) / height, _NOTHING)))
        if orders < _LEAST_ORDERS or min(height, width) < _LEAST_SIDE:
            return None
        steps = np.arange(orders + 1)
        columns, rows = _inside(orders * right, width), _inside(-orders * up, height)
        moved = [self._moved(-k * right, k * up, columns, rows) for k in steps]
        seen = np.logical_and.reduce([mask for _, mask in moved])
        if seen.mean() < _LEAST_SHARE:
            return None
        images = np.stack([image for image, _ in moved])
        n_colours = images.shape[2]
        values = images[..., seen]
        values -= values.mean(axis=-1, keepdims=True)
        values = values.reshape(3 * len(steps), -1)
        noise = self._noise_along(steps * right) * self._noise_along(steps * up)
        n = float(seen.sum()) * n_colours * _EVERY**2 * self._independent
        return _Products((values @ values.T).astype(np.float64) / values.shape[1], noise, n)

    def _noise_along(self, places: Values) -> Values:
        """Mean products, along one side, of white noise that is blurred, and moved to places in pixels, (n, n)."""
        still = np.zeros(self._frequency.size)
        moved = bilinear_transfer(places, np.zeros_like(places), self._frequency, still)
        return np.asarray(((moved * self._blur) @ moved.conj().T).real)

    def _moved(self, right: float, down: float, columns: slice, rows: slice) -> tuple[Images, Mask]:
        """Every second pixel of some columns and rows, so far to the right and down, bilinear; and which are known."""
        (x, part_x), (y, part_y) = ((math.floor(by), by - math.floor(by)) for by in (right, down))
        images, seen = None, None
        for i, of_y in enumerate((1 - part_y, part_y)):
            for j, of_x in enumerate((1 - part_x, part_x)):
                if of_x * of_y == 0:
                    continue
                where = (_shifted(rows, y + i), _shifted(columns, x + j))
                piece, known = np.float32(of_x * of_y) * self._images[..., *where], self._seen[where]
                images = piece if images is None else images + piece
                seen = known if seen is None else seen & known
        assert images is not None
        assert seen is not None
        return images, seen


def _inside(farthest: float, side: int) -> slice:
    """Pixels of a side whose ghosts, up to so far away, come from inside of the frame."""
    return slice(math.ceil(max(0.0, farthest)), side - 1 - math.ceil(max(0.0, -farthest)))


def _shifted(part: slice, by: int) -> slice:
    return slice(part.start + by, part.stop + by, _EVERY)
