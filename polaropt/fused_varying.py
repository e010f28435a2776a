"""The misfit in compiled passes where what the pane does is another thing in every pixel."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from polaropt.canvas import Canvas
from polaropt.capture import Capture
from polaropt.fused_misfit import Whitened, ghosts_at
from polaropt.noise_model import NoiseClasses
from polaropt.varying import VaryingPSE
from polaropt.varying_kernels import varying_ghost_residuals, varying_ghost_spread, varying_residuals
from solvers.blocks import in_blocks

Images = NDArray[np.float32]

_ROWS = 32


class FusedVaryingMisfit:
    """The misfit where incidence and azimuth vary over the frame, all bounces in place: one pass there and back.

    Parameters
    ----------
    capture : Capture
    pse : VaryingPSE
        Made for the frame.
    canvas : Canvas
    noise : float or NoiseClasses
    """

    def __init__(self, capture: Capture, pse: VaryingPSE, canvas: Canvas, noise: float | NoiseClasses) -> None:
        self._seen = Whitened(capture, pse.analyzer, noise)
        self._mixtures = pse.mixtures(canvas.height, canvas.width)
        self._corner = (canvas.top, canvas.left)

    def value_and_grad(self, layers: Images, gradient: Images, weight: float = 1.0) -> float:
        """Value at canvas layers (2, channel, H, W); `gradient` is overwritten by weight times the gradient."""
        seen, factor = self._seen, np.float32(weight)
        top, left = self._corner
        gradient[...] = 0

        def rows(start: int, stop: int) -> float:
            parts = (self._mixtures, seen.roots, seen.kinds, seen.data, factor, seen.slopes)
            return float(varying_residuals(layers, top, left, *parts, gradient, start, stop))

        return sum(in_blocks(rows, seen.height, _ROWS)) + seen.constant


class FusedGhostMisfit:
    """The same with ghosts beside each other; parameters as of `FusedVaryingMisfit`."""

    def __init__(self, capture: Capture, pse: VaryingPSE, canvas: Canvas, noise: float | NoiseClasses) -> None:
        self._seen = Whitened(capture, pse.analyzer, noise)
        frame = (canvas.height, canvas.width)
        self._mixtures = pse.ghost_mixtures(*frame)
        shown = np.abs(self._mixtures).max(axis=(0, 3, 4))[..., None].astype(np.float64)
        self._ghosts = ghosts_at(pse.displacements(*frame), shown)
        self._corner = (canvas.top, canvas.left)

    def value_and_grad(self, layers: Images, gradient: Images, weight: float = 1.0) -> float:
        """Value at canvas layers (2, channel, H, W); `gradient` is overwritten by weight times the gradient."""
        seen, ghosts, mixtures, factor = self._seen, self._ghosts, self._mixtures, np.float32(weight)
        top, left = self._corner

        def rows(start: int, stop: int) -> float:
            parts = (seen.roots, seen.kinds, seen.data, factor, seen.slopes)
            return float(varying_ghost_residuals(layers, top, left, ghosts, mixtures, *parts, start, stop))

        def planes(start: int, stop: int) -> None:
            varying_ghost_spread(seen.slopes, top, left, ghosts, mixtures, gradient, start, stop)

        value = sum(in_blocks(rows, seen.height, _ROWS)) + seen.constant
        in_blocks(planes, 2 * layers.shape[1], 1)
        return value
