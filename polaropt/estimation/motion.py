"""What moves between photographs taken one after the other, found by their closure.

More than three photographs through a polarizer say some things twice: ``I0 + I90 = I45 + I135`` holds at every pixel
that stands still, whatever light comes from there. Where it fails all over a region, by more than noise, gains, stray
light and photographs that do not lie quite on each other explain, something has moved.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from polaropt.capture import (
    Capture,
    Matching,
    Mistakes,
    NoiseModel,
    NoiseSpectrum,
    Shifts,
    agree_as_wholes,
    blocks_of,
    correlated_noise,
    far_motions,
    find_mistakes,
    look_swapped_in_place,
    match_photographs,
    may_lie_apart,
    measured_noise,
    moved_onto_first,
    noise_of_blocks,
    redundancy_residual,
    shifts_in_the_middle,
    shown_by_all,
)
from polaropt.numerics import MAD_TO_SIGMA, block_mean, spread_blocks, strips
from polaropt.optics import analyzer_matrix

Images = NDArray[np.float32]
Floats = NDArray[np.float64]
Real = NDArray[np.floating[Any]]
Mask = NDArray[np.bool_]

_BLOCK = 4
"""Side in pixels of the blocks that are looked at, and of the grain of what is found; set by hand."""
_WINDOWS = (1, 2, 4, 8)
"""Sides in blocks of the windows that the closure is averaged over, 4 to 32 px; set by hand."""
_FULL = 0.25
"""Share of a window's pixels that must be trusted; set by hand."""
_FROM_WHITE = 4.0
"""Standard errors below white from which on noise is cut off: what is left of it does not average to nothing."""
_PILE = 5e-4
"""Share of the values at the lowest one from which on they are clipped there; as where the noise is measured."""
_OUTLIER = 12.0
"""Standard errors that one pixel counts at most: defects are no regions; set by hand."""
_SURE, _LIKELY = 6.0, 3.0
"""Standard errors by which the closure fails in a window that tells of motion, and in those that belong to it; by
trial."""
_FEWEST_BLOCKS = 16
"""Blocks of a region at least, that is 16 px square; by trial: on real photographs edges feign fewer."""
_BETWEEN = 4
"""Half as many blocks as may lie between parts of a region: where changes cancel the closure is blind; set by hand."""
_RIM = 2
"""Blocks around a region that are left out with it, in which little of it shows; set by hand."""
_MOST_MOVING = 0.5
"""Share of the frame that can move: beyond that nothing tells what stands still. Set by hand."""
_ROUNDS = 2
"""Looks, the second of which knows noise and gains without what the first has found."""

_SPREADS = 2.0
"""What is tolerated, in units of what is usual in the capture; by trial on real photographs in which nothing moves."""
_LEAST_PX, _MOST_PX = 0.1, 1.0
"""Distance in pixels at which photographs may lie beside each other: at least, and what is no still scene; by hand."""
_LEAST_SHARE, _STRAY_SHARE = 0.005, 0.003
"""Error of a pixel's light as a share of it (a sensor's curve), and as a share of the frame's mean (stray light of a
filter turned): by trial on real photographs."""
_MATTERING_PX, _MATTERING_SHARE = 0.3, 0.01
"""What is usual is measured where such errors would stand out of the noise; set by hand."""
_FEWEST_VALUES = 20
"""Blocks that this needs; set by hand."""
_WIDE = 4
"""Side in blocks of those that errors of the light are measured on: their noise is small; set by hand."""
_FIT_ROUNDS = 20
"""Rounds of a fit that outliers do not move; set by hand."""


@dataclass(frozen=True)
class StillPhotographs:
    """Photographs without what moves between them.

    Attributes
    ----------
    capture : Capture
        What moves is not valid, and holds what lies around it.
    moving : ndarray of bool, shape (h, w), or None
        Where something moves; None where nothing does, or nothing could tell.
    mistakes : Mistakes
        What else is wrong with the photographs.
    noise : float
    growth : NoiseModel
        `measured_noise` of the capture.
    valid_share : float
        Share of the frame's pixels that stand still and can be trusted, as they were taken: what lies near the edges of
        photographs that were moved onto each other is not valid, but not clipped.
    """

    capture: Capture
    moving: Mask | None
    mistakes: Mistakes
    noise: float
    growth: NoiseModel
    valid_share: float

    def seen(self, capture: Capture) -> Capture:
        """Other photographs of the same scene without what moves."""
        return capture if self.moving is None else capture.left_out(self.moving)

    def with_noise(self, noise: float) -> StillPhotographs:
        """The same where another level of the noise is known, which grows with the light as it was measured to."""
        return replace(self, noise=noise, growth=self.growth.scaled(noise / self.noise))

    def for_layers(self) -> StillPhotographs:
        """The same with the noise that layers are solved for, as if it were white.

        That of the photographs where a filter made them of a mosaic's samples, and more than that of a pixel where
        neighbours or colours have it in common.
        """
        origin = self.capture.origin
        filtered = None if origin is None else origin.filtered_noise
        if filtered is not None:
            return self.with_noise(filtered)
        return self if self.correlated is None else self.with_noise(self.noise * self.correlated.of_layers)

    @cached_property
    def correlated(self) -> NoiseSpectrum | None:
        """How the noise of photographs is correlated; None where it is white."""
        return correlated_noise(self.capture, self.noise)

    @property
    def moving_share(self) -> float:
        """Share of the frame that moves."""
        return 0.0 if self.moving is None else float(self.moving.mean())


def still_photographs(capture: Capture) -> StillPhotographs:
    """Leave out what moves between the photographs, and look for other mistakes in what is left.

    A wrong order, an encoding and photographs that lie beside each other break the closure, too: where they are found
    in what stands still, nothing is said to move.
    """
    noise, growth = measured_noise(capture)
    moving = moving_pixels(capture, noise, growth)
    if moving is not None:
        still = capture.left_out(moving)
        mistakes = find_mistakes(still)
        if mistakes == Mistakes():
            return StillPhotographs(still, moving, mistakes, *measured_noise(still), _valid_share(still, None))
    return StillPhotographs(
        capture, None, find_mistakes(capture.registered), noise, growth, _valid_share(capture, None)
    )


def agreeing_photographs(
    capture: Capture, still: StillPhotographs, tell: Callable[[float], None] | None = None
) -> tuple[Capture, StillPhotographs, Matching | None]:
    """Photographs made to agree by what stands still, and what stands still of them; all as it was where they do.

    What moves is seen by each photograph elsewhere, and stays as each saw it, unless both layers have moved: then that
    may have been all that moved. Photographs in a wrong order agree only once they are in the right one. `tell`, where
    it is given, is called with the fraction done, 0..1, as photographs are put back.
    """
    if not may_lie_apart(still.capture, still.noise):
        return capture, still, None
    shifts = shifts_in_the_middle(still.capture)
    motions = far_motions(still.capture, shifts)
    if motions is None:
        return _agreeing_nearby(capture, still, shifts)
    # What lay apart passed for what moves, for noise and for a wrong order.
    laid = moved_onto_first(capture, motions, tell)
    if not agree_as_wholes(still.capture, laid):
        return _agreeing_nearby(capture, still, shifts)
    still = still_photographs(laid)
    laid, still, matching = _agreeing_nearby(laid, still, shifts_in_the_middle(still.capture))
    still = replace(still, valid_share=_valid_share(capture, still.moving))
    matching = matching or Matching.of_none(laid)
    # At the edges three photographs tell a pane less exactly than four do elsewhere.
    of_scene = matching.of_scene
    of_scene = of_scene.replace(valid=of_scene.valid & shown_by_all(motions, laid.shape))
    return laid, still, replace(matching, of_scene=of_scene, motions=motions)


def _agreeing_nearby(
    capture: Capture, still: StillPhotographs, shifts: Shifts
) -> tuple[Capture, StillPhotographs, Matching | None]:
    """`agreeing_photographs` of such as lie a few pixels apart, with `shifts_in_the_middle` of what stands still."""
    if still.mistakes.swapped and look_swapped_in_place(still.capture, shifts):
        return capture, still, None
    matching = match_photographs(still.capture, still.noise, shifts)
    if matching is None:
        return capture, still, None
    if still.moving is not None and matching.transfer.layers is not None:
        matching = matching.of(capture)
    elif still.moving is not None:
        kept = np.where(still.moving, capture.intensities, matching.capture.intensities)
        valid = np.where(still.moving, capture.valid, matching.capture.valid)
        matching = replace(matching, capture=capture.replace(intensities=kept, valid=valid))
    agreeing = still_photographs(matching.capture)
    agreeing = replace(agreeing, valid_share=_valid_share(capture, agreeing.moving))
    return matching.capture, agreeing if matching.noise is None else agreeing.with_noise(matching.noise), matching


def _valid_share(capture: Capture, moving: Mask | None) -> float:
    """Share of the pixels that can be trusted, without those that move."""
    n_valid = capture.n_valid if moving is None else np.count_nonzero(capture.valid & ~moving)
    return n_valid / capture.mask.size


def motion_shows(capture: Capture) -> bool:
    """Whether it would show if something moved: a closure, and photographs taken one after the other."""
    return len(capture.angles_deg) > 3 and capture.cells is None and not capture.of_mosaic


def moving_pixels(capture: Capture, noise: float, growth: NoiseModel) -> Mask | None:
    """Pixels (h, w) in which something moves between the photographs; None where nothing does, or nothing tells.

    Parameters
    ----------
    capture : Capture
    noise, growth : float and NoiseModel
        `measured_noise` of the capture.
    """
    if not motion_shows(capture) or min(capture.shape[-2:]) < _BLOCK * max(_WINDOWS):
        return None
    moving: Mask | None = None
    for _ in range(_ROUNDS):
        if moving is not None:
            noise, growth = measured_noise(capture.left_out(moving))
        closure = _Closure.of(capture, noise, growth, moving)
        found = None if closure is None else _regions(closure)
        if found is None or not found.any() or found.mean() > _MOST_MOVING:
            return None
        moving = spread_blocks(found, _BLOCK, capture.shape[-2:])
    return moving


@dataclass(frozen=True)
class _Closure:
    """How far the closure fails, in sums over blocks.

    Attributes
    ----------
    failure : ndarray, shape (n, rows, columns)
        Residual of each closure and colour, in standard errors of its pixel.
    systematic : ndarray, shape (n, rows, columns)
        Of each pixel's variance the share that does not average out.
    count : ndarray, shape (rows, columns)
        Pixels that can be trusted.
    white : float
        Variance of the noise of means, in units of what white noise leaves.
    """

    failure: Images
    systematic: Images
    count: Images
    white: float

    @classmethod
    def of(cls, capture: Capture, noise: float, growth: NoiseModel, moving: Mask | None) -> _Closure | None:
        """That of a capture, of which something is known to move; None where its photographs do not lie together."""
        trusted = _trusted(capture, growth)
        still = trusted if moving is None else trusted & ~moving
        white = (noise_of_blocks(capture, noise) / noise) ** 2
        residuals = _Residuals(capture, growth, _gains(capture, still))
        tolerance = _tolerance(residuals, still, white)
        if tolerance is None:
            return None
        parts = []
        for rows, residual, noise_variance, slope, light in residuals.strips():
            lie = tolerance.variance(slope, light)
            variance = noise_variance + lie
            inside = trusted[rows]
            failure = np.clip(residual / np.sqrt(variance), -_OUTLIER, _OUTLIER) * inside
            systematic = np.broadcast_to(lie / variance * inside, failure.shape)
            sums = (_sums(part) for part in (failure, systematic, inside.astype(np.float32)))
            parts.append(tuple(sums))
        failure, systematic, count = (np.concatenate(part, axis=-2) for part in zip(*parts, strict=True))
        blocks = count.shape
        return cls(failure.reshape(-1, *blocks), systematic.reshape(-1, *blocks), count, white)

    def standard_errors(self, window: int, left_out: Mask) -> Floats:
        """By how many standard errors means over windows of blocks fail, root mean square over colours."""
        from scipy.ndimage import uniform_filter

        def summed(values: Images) -> Floats:
            sides = (0,) * (values.ndim - 2) + (window, window)
            kept = (values * ~left_out).astype(np.float64)
            return np.asarray(window**2 * uniform_filter(kept, sides, mode="constant"))

        count = summed(self.count)
        n = np.maximum(count, 1)
        systematic = summed(self.systematic) / n
        variance = (1 - systematic) * self.white / n + systematic
        squares = np.square(summed(self.failure) / n) / variance
        return np.where(count < _FULL * (_BLOCK * window) ** 2, 0.0, np.sqrt(squares.mean(axis=0)))


def _sums(images: Images) -> Images:
    return block_mean(images, _BLOCK) * np.float32(_BLOCK**2)


def _trusted(capture: Capture, growth: NoiseModel) -> Mask:
    """Pixels (h, w) whose noise is not cut off anywhere, at white or at the lowest value, away from such."""
    from scipy.ndimage import binary_erosion

    photographs = capture.planes
    trusted = capture.valid_in_all
    if not trusted.all():
        far = _FROM_WHITE * math.sqrt(float(growth.variance(np.ones(1, np.float32))[0]))
        trusted = binary_erosion(trusted & (photographs.max(axis=(0, 1)) < 1 - far), border_value=1)
    lowest = photographs.min()
    if sum(np.count_nonzero(photograph == lowest) for photograph in photographs) > _PILE * photographs.size:
        trusted &= photographs.min(axis=(0, 1)) > lowest
    return trusted


def _gains(capture: Capture, still: Mask) -> Floats:
    """What the residuals hold of each Stokes image, (k - 3, 3): gains and angles that are not what they should be."""
    blocks = blocks_of(capture.intensities, np.broadcast_to(still, capture.intensities.shape)).astype(np.float64)
    residuals = redundancy_residual(blocks, capture.angles_deg)
    stokes = np.linalg.pinv(analyzer_matrix(capture.angles_deg)) @ blocks
    gains = np.zeros((len(residuals), 3))
    if blocks.shape[1] < _FEWEST_VALUES:
        return gains
    for gain, residual in zip(gains, residuals, strict=True):
        # From none on: behind a flat pane what moves in one photograph alone is all that is polarized across, and in
        # proportion to what does not add up.
        for _ in range(_FIT_ROUNDS):
            off = residual - gain @ stokes
            spread = 2 * MAD_TO_SIGMA * float(np.median(np.abs(off))) + np.finfo(np.float32).tiny
            weights = 1 / (1 + np.square(off / spread))
            gain[:], *_ = np.linalg.lstsq(stokes.T * weights[:, None], residual * weights, rcond=1e-6)
    return gains


@dataclass(frozen=True)
class _Residuals:
    """What no Stokes vector explains of a capture's photographs, after gains, worked out some rows at a time."""

    capture: Capture
    growth: NoiseModel
    gains: Floats

    def strips(self) -> Iterator[tuple[slice, Images, Images, Images, Images]]:
        """Rows, residual (k - 3, channel, rows, w), the variance of its noise, slope and light (channel, rows, w).

        Slope is the square of the light's gradient.
        """
        capture = self.capture
        inverse = np.linalg.pinv(analyzer_matrix(capture.angles_deg))
        of_photographs = (self.gains @ inverse).astype(np.float32)
        height = capture.shape[-2] // _BLOCK * _BLOCK
        planes = capture.planes[..., :height, :]
        for rows in strips(height, planes.size // height, _BLOCK):
            photographs = planes[..., rows, :]
            residual = redundancy_residual(photographs, capture.angles_deg)
            residual -= np.tensordot(of_photographs, photographs, axes=1)
            light = np.maximum(photographs.mean(axis=0), np.float32(0))
            variance = self.growth.variance(light)
            down, across = np.gradient(light, axis=(-2, -1))
            slope = np.maximum(down**2 + across**2 - variance / np.float32(len(photographs)), np.float32(0))
            yield rows, residual, variance, slope, light


@dataclass(frozen=True)
class _Tolerance:
    """Errors that are no motion: photographs beside each other (px), and light that is off by a share and by stray."""

    px: float
    share: float
    stray: float

    def variance(self, slope: Images, light: Images) -> Images:
        """Their variance in pixels of these slopes and this light."""
        of_light = np.square(np.float32(self.share) * light) + np.float32(self.stray**2)
        return np.asarray(np.float32(self.px**2) * slope + of_light)


def _tolerance(residuals: _Residuals, still: Mask, white: float) -> _Tolerance | None:
    """What is usual in what stands still; None where the photographs lie too far beside each other."""
    parts = []
    for rows, residual, *images in residuals.strips():
        inside = still[rows].astype(np.float32)
        share = block_mean(inside, _BLOCK)
        mean = block_mean(residual * inside, _BLOCK) / np.maximum(share, np.float32(1e-6))
        parts.append((mean, *(block_mean(image, _BLOCK) for image in images), share))
    mean, variance, slope, light, share = (np.concatenate(part, axis=-2) for part in zip(*parts, strict=True))
    variance *= np.float32(white / _BLOCK**2)
    px = _usual(mean, variance, slope, share > _FULL, _MATTERING_PX)
    if px * _SPREADS > _MOST_PX:
        return None
    wide = [block_mean(part, _WIDE) for part in (mean, variance / _WIDE**2, light**2)]
    off = _usual(wide[0], wide[1], wide[2], block_mean(share, _WIDE) == 1, _MATTERING_SHARE)
    return _Tolerance(
        max(_LEAST_PX, _SPREADS * px),
        max(_LEAST_SHARE, _SPREADS * off),
        _STRAY_SHARE * float(light.mean()),
    )


def _usual(mean: Real, variance: Real, cause: Real, known: Mask, mattering: float) -> float:
    """Robust spread of means in units of the root of a cause, beyond noise, where it would matter."""
    where = known & (mattering**2 * cause > variance)
    if np.count_nonzero(where) < _FEWEST_VALUES:
        return 0.0
    beyond = np.maximum(np.square(mean) - variance, 0)[:, where]
    return MAD_TO_SIGMA * math.sqrt(float(np.median(beyond / cause[where])))


def _regions(closure: _Closure) -> Mask:
    """Blocks of the regions that move; coarser windows see only what finer ones have left."""
    from scipy.ndimage import binary_closing, binary_dilation, binary_fill_holes, label

    found = np.zeros(closure.count.shape, dtype=bool)
    for window in _WINDOWS:
        errors = closure.standard_errors(window, found)
        regions, _ = label((errors > _LIKELY) | found, np.ones((3, 3)))
        sizes = np.bincount(regions.ravel())
        sure = np.bincount(regions.ravel(), weights=((errors > _SURE) | found).ravel()) > 0
        kept = sure & (sizes >= _FEWEST_BLOCKS)
        kept[0] = False
        found |= kept[regions]
    if not found.any():
        return found
    # Beyond the frame lies nothing that a closing would take for its own.
    room = _BETWEEN + _RIM
    grown = binary_closing(np.pad(found, room), _disk(_BETWEEN))
    grown = binary_dilation(binary_fill_holes(grown), _disk(_RIM))
    return np.asarray(grown[room:-room, room:-room])


def _disk(radius: int) -> Mask:
    down, across = np.mgrid[-radius : radius + 1, -radius : radius + 1]
    return np.asarray(np.hypot(down, across) <= radius + 0.5)
