"""The misfit in two compiled passes: whitened residuals of the plate's entries, and their way back to the layers.

The photographs of a pixel enter through their normal equations alone: with G the information on its entries, the misfit
is ``|G^(1/2) entries - data|^2 / 2`` plus a constant. Which photographs are trusted decides G, so that the few kinds of
pixels there are share a table.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from polaropt.canvas import Canvas
from polaropt.capture import Capture
from polaropt.forward import PSE, Displacements
from polaropt.misfit_kernels import Ghosts, residuals, spread
from polaropt.noise_model import NoiseClasses
from solvers.blocks import in_blocks

Images = NDArray[np.float32]

_ROWS = 32
_SINGULAR = 1e-9
_SNAP = 1e-9


@dataclass(frozen=True)
class Information:
    """What the photographs tell of a pixel's entries, for each kind of pixel."""

    root: Images
    """G^(1/2), symmetric, (kind, entry, entry)."""
    to_data: Images
    """From the photographs to G^(-1/2) times the normal equations' right-hand side, (kind, entry, k)."""
    to_rest: list[NDArray[np.float64]]
    """From the photographs to what no entries explain, in units of the noise: one matrix (rest, k) a kind."""


class Whitened:
    """Photographs reduced to the residuals' data, and what whitens entries to compare with them.

    Parameters
    ----------
    capture : Capture
    mixing : ndarray, shape (k, entry)
        Photographs from entries.
    noise : float or NoiseClasses
    """

    def __init__(self, capture: Capture, mixing: NDArray[np.float64], noise: float | NoiseClasses) -> None:
        shape = (len(capture.angles_deg), -1, *capture.shape[-2:])
        patterns, self.kinds = kinds_of_pixels(capture.valid.reshape(shape))
        if isinstance(noise, NoiseClasses):
            patterns, sigmas, self.kinds = _kinds_of_noise(patterns, self.kinds, noise)
        else:
            sigmas = np.full(len(patterns), noise)
        information = _information(mixing, sigmas, patterns)
        self.roots = information.root
        self.data, self.constant = _reduced(capture.intensities.reshape(shape), self.kinds, information)
        self.slopes = np.empty_like(self.data)

    @property
    def height(self) -> int:
        """Rows of the frame."""
        return int(self.data.shape[2])


class FusedMisfit:
    """Half the sum of squared residuals of the trusted photographs, in units of their noise.

    The same as `polaropt.objective.Misfit`, from one plane per entry and colour instead of one per photograph.

    Parameters
    ----------
    capture : Capture
    pse : PSE
    canvas : Canvas
    noise : float or NoiseClasses
        Standard deviation of a photograph's noise, the same everywhere or by classes of pixels.
    """

    def __init__(self, capture: Capture, pse: PSE, canvas: Canvas, noise: float | NoiseClasses) -> None:
        self._seen = Whitened(capture, pse.mixing[:, : pse.taps.shape[2]], noise)
        self._ghosts = ghosts_of(pse)
        self._corner = (canvas.top, canvas.left)

    def value_and_grad(self, layers: Images, gradient: Images, weight: float = 1.0) -> float:
        """Value at canvas layers (2, channel, H, W); `gradient` is overwritten by weight times the gradient."""
        seen, ghosts, factor = self._seen, self._ghosts, np.float32(weight)
        top, left = self._corner

        def rows(start: int, stop: int) -> float:
            parts = (seen.roots, seen.kinds, seen.data, factor, seen.slopes)
            return float(residuals(layers, top, left, ghosts, *parts, start, stop))

        def planes(start: int, stop: int) -> None:
            spread(seen.slopes, top, left, ghosts, gradient, start, stop)

        value = sum(in_blocks(rows, seen.height, _ROWS)) + seen.constant
        in_blocks(planes, 2 * layers.shape[1], 1)
        return value


def ghosts_of(pse: PSE) -> Ghosts:
    """The ghosts of a pane as whole and fractional shifts."""
    return ghosts_at(pse.displacements, pse.taps)


def ghosts_at(displacements: Displacements, taps: NDArray[np.float64]) -> Ghosts:
    """The same of images at these places, with weights (2, ghost, entry)."""
    distance = np.array(displacements)
    whole = np.floor(distance + _SNAP)
    fraction = np.where(np.abs(distance - whole) < _SNAP, 0, distance - whole)
    shown = np.any(taps != 0, axis=2)
    return Ghosts(taps.astype(np.float32), whole.astype(np.int64), fraction.astype(np.float32), shown)


def kinds_of_pixels(valid: NDArray[np.bool_]) -> tuple[NDArray[np.bool_], NDArray[np.uint16]]:
    """Which photographs are trusted, (kind, k), and the kind of each pixel, (channel, h, w), empty where all are 0."""
    k = len(valid)
    if valid.all():
        return np.ones((1, k), dtype=bool), np.zeros((0, 0, 0), dtype=np.uint16)
    packed = np.zeros(valid.shape[1:], dtype=np.int64)
    for j in range(k):
        packed |= valid[j].astype(np.int64) << j
    codes, kinds = np.unique(packed, return_inverse=True)
    patterns = (codes[:, None] >> np.arange(k)) & 1 == 1
    return patterns, kinds.reshape(valid.shape[1:]).astype(np.uint16)


def _kinds_of_noise(
    patterns: NDArray[np.bool_], kinds: NDArray[np.uint16], noise: NoiseClasses
) -> tuple[NDArray[np.bool_], NDArray[np.float64], NDArray[np.uint16]]:
    """Kinds divided by their noise: patterns (kind, k), standard deviations (kind,) and kinds (channel, h, w)."""
    n = len(noise.sigmas)
    codes = noise.classes + (n * kinds.astype(np.int64) if kinds.size else 0)
    present, divided = np.unique(codes, return_inverse=True)
    return patterns[present // n], noise.sigmas[present % n], divided.reshape(codes.shape).astype(np.uint16)


def _information(mixing: NDArray[np.float64], sigmas: NDArray[np.float64], patterns: NDArray[np.bool_]) -> Information:
    roots, to_data, to_rest = [], [], []
    for trusted, noise in zip(patterns, sigmas, strict=True):
        known = mixing * trusted[:, None] / noise
        left, singular, right = np.linalg.svd(known, full_matrices=True)
        told = singular > _SINGULAR * max(singular[0], 1e-300)
        n = int(told.sum())
        roots.append(right.T @ np.diag(singular) @ right)
        to_data.append(right[:n].T @ left[:, :n].T * trusted / noise)
        to_rest.append(left[:, n:].T * trusted / noise)
    return Information(np.array(roots, dtype=np.float32), np.array(to_data, dtype=np.float32), to_rest)


def _reduced(photographs: Images, kinds: NDArray[np.uint16], information: Information) -> tuple[Images, float]:
    """Data (entry, channel, h, w) of photographs, and half the squares that they leave over."""
    k, colors, height, width = photographs.shape
    data = np.empty((information.root.shape[1], colors, height, width), dtype=np.float32)
    rest = 0.0
    for c in range(colors):
        pixels = photographs[:, c].reshape(k, -1)
        of_kind = kinds[c].ravel() if kinds.size else None
        for kind, to_rest in enumerate(information.to_rest):
            chosen = slice(None) if of_kind is None else np.flatnonzero(of_kind == kind)
            values = pixels[:, chosen]
            data[:, c].reshape(len(data), -1)[:, chosen] = information.to_data[kind] @ values
            left_over = to_rest.astype(np.float32) @ values
            rest += 0.5 * float(np.vecdot(left_over, left_over).sum(dtype=np.float64))
    return data, rest
