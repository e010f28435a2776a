"""What photographs tell of the layers in each place of a frame over which the pane varies."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from polaropt.inversion import Canvas, ghost_transfer, images_that_tell
from polaropt.optics import VaryingPSE

Power = NDArray[np.float32]
Spectrum = NDArray[np.complex64]

# Places in a window in units of half its side, and their weights: its profile's square there.
_OFFSETS = np.array([-0.75, -0.25, 0.25, 0.75])
_WEIGHTS = np.cos(np.pi / 2 * _OFFSETS) ** 2 / 2


class VaryingInformation:
    """Normal equations of the photographs around any place, where the pane is taken to be as it is there.

    Ghosts lie at the same places all over the frame, and only their weights change: what photographs tell at a
    frequency is a sum over pairs of images.

    Parameters
    ----------
    pse : VaryingPSE
        Made for the frame.
    canvas : Canvas
    precision : ndarray, shape (3, 3)
        Inverse covariance of a pixel's Stokes vector.

    Attributes
    ----------
    pairs : ndarray of complex64, shape (image * image, H, W // 2 + 1)
        What a pair of images of weight 1 tells per frequency.
    """

    def __init__(self, pse: VaryingPSE, canvas: Canvas, precision: NDArray[np.float64]) -> None:
        self._frame, self._precision = (canvas.height, canvas.width), precision
        self._mixtures, places = images_that_tell(pse, *self._frame)
        # Each image by itself, in place of the entries.
        weights = np.eye(len(places))[None].repeat(2, axis=0)
        moved = ghost_transfer(weights, places, *canvas.shape)[:, 0]
        self.pairs: Spectrum = (moved.conj()[:, None] * moved).reshape(-1, *moved.shape[1:])

    def told(self, row: int, columns: NDArray[np.intp], reach_px: int) -> Power:
        """Weights of the pairs of images around places of one row of pixels.

        Parameters
        ----------
        row : int
        columns : ndarray of int, shape (n,)
            Places beyond the frame are taken for those at its edge.
        reach_px : int
            Half the side of the windows around the places, of which it is the mean.

        Returns
        -------
        ndarray of float32, shape (3, n, image * image)
            Of the transmission, the reflection, and both together.
        """
        height, width = self._frame
        rows = np.clip(row + reach_px * _OFFSETS, 0, height - 1).astype(int)
        across = np.clip(columns[:, None] + reach_px * _OFFSETS, 0, width - 1).astype(int)
        # (entry, layer, image, row, window, column)
        own = self._mixtures[..., rows[:, None, None], across].astype(np.float64)
        weighted = np.tensordot(self._precision, own, axes=1)
        pairs = ((0, 0), (1, 1), (0, 1))
        each = np.stack([np.einsum("egrnc,ehrnc->nrcgh", own[:, i], weighted[:, j]) for i, j in pairs])
        told = np.einsum("inrcgh,r,c->ingh", each, _WEIGHTS, _WEIGHTS)
        return np.asarray(told.reshape(3, columns.size, -1), dtype=np.float32)
