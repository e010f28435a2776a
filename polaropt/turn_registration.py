"""How far photographs are shifted, turned and scaled against each other: a camera that was not held still.

From halved and halved again photographs to whole ones, so that a turn that moves the corners by many pixels moves them
by few at first. On each size the likelihood of all photographs together is climbed (`polaropt.shift_fit`); the first
start is the correlation of all pairs.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from polaropt.capture import Capture
from polaropt.motion import Matrix, Motions, corners, moved_back
from polaropt.plate_frame import block_mean
from polaropt.registration import (
    BY_CHANCE,
    FEWEST,
    NEGLIGIBLE,
    SURE,
    Mask,
    Shifts,
    band_passed,
    coarse_shifts,
    far_from_invalid,
    luminance,
    middle,
)
from polaropt.shift_fit import Images, disagreement, fit_small_shifts, products

_SIDE = 1024
_SMALLEST = 64
_LARGEST_BLOCK = 8
_STEPS, _LONGEST_STEP, _AT_REST = 10, 2.0, 0.004
_MOTIONS = 4
_WHOLE = 0.999


@dataclass(frozen=True)
class Turns:
    """Where the photographs lie, turns and growth included.

    Attributes
    ----------
    motions : Motions
        In pixels from the middle of the frame.
    error : float
        Largest standard error of a shift, and of a turn or growth at the corners of what was looked at, in pixels.
    at_corners : float
        How far turns and growth move the corners against each other, in pixels.
    better : bool
        Whether the photographs agree better than with the best shifts alone.
    """

    motions: Motions
    error: float
    at_corners: float
    better: bool

    @property
    def certain(self) -> bool:
        """Whether turning the photographs back is better than shifting them only."""
        return self.better and self.at_corners > max(SURE * self.error, NEGLIGIBLE)


@dataclass(frozen=True)
class _Level:
    """Band-passed photographs (k, h, w) of one size, and which of their pixels count."""

    bands: Images
    inner: Mask

    @property
    def half_diagonal(self) -> float:
        return float(np.hypot(*corners(self.bands.shape)[0]))

    def moved(self, motions: Motions) -> tuple[Images, Mask]:
        """Photographs moved back, and where all of them hold values that count."""
        parts = list(zip(motions.matrices, motions.offsets, strict=True))
        bands = [moved_back(band, *part, order=3) for band, part in zip(self.bands, parts, strict=True)]
        seen = [moved_back(m.astype(np.float32), *part, order=1) for m, part in zip(self.inner, parts, strict=True)]
        return np.stack(bands), np.min(seen, axis=0) > _WHOLE


def measure_turns(capture: Capture, shifts: Shifts) -> Turns:
    """Measure shifts, turns and growth of all photographs against the first.

    Parameters
    ----------
    capture : Capture
    shifts : Shifts
        The best shifts alone (`polaropt.registration.measure_shifts`).
    """
    part = _evenly(middle(capture.shape, _SIDE), capture.shape)
    images, valid = luminance(capture.part(*part))
    blocks = _blocks(images.shape)
    levels = [_level(images, valid, block) for block in blocks]
    motions, error = _climbed(levels, _started(levels[0], shifts.pixels / blocks[0]))
    better = _gain(levels[-1], Motions.of_shifts(shifts.pixels), motions) > 0
    turned = Motions(motions.matrices, np.zeros_like(motions.offsets)).displacements(corners(images.shape))
    at_corners = float(max(np.linalg.norm(a - b, axis=1).max() for a in turned for b in turned))
    sides = capture.shape[-2:]
    looked_at = np.array([(lines.start + lines.stop - side) / 2 for lines, side in zip(part, sides, strict=True)])
    return Turns(motions.about(-looked_at), error, at_corners, better)


def _started(level: _Level, shifts: Matrix) -> Motions:
    """Motions on the coarsest size: the best near no shift, near the best shifts, and where pairs correlate."""
    starts = (np.zeros_like(shifts), shifts, coarse_shifts(level.bands))
    tries = [_refined(level, Motions.of_shifts(start))[0] for start in starts]
    return max(tries, key=lambda motions: _gain(level, Motions.of_shifts(starts[0]), motions))


def _evenly(part: tuple[slice, slice], shape: tuple[int, ...]) -> tuple[slice, slice]:
    """The part, cut so that blocks of every size fill it."""
    ends = [min(rows.stop, side) for rows, side in zip(part, shape[-2:], strict=True)]
    sides = [(end - rows.start) // _LARGEST_BLOCK * _LARGEST_BLOCK for rows, end in zip(part, ends, strict=True)]
    return slice(part[0].start, part[0].start + sides[0]), slice(part[1].start, part[1].start + sides[1])


def _blocks(shape: tuple[int, ...]) -> list[int]:
    """Sides of the blocks whose means are looked at, coarsest first."""
    return [size for size in (8, 4, 2) if min(shape[-2:]) // size >= _SMALLEST] + [1]


def _level(images: Images, valid: Mask, block: int) -> _Level:
    means = block_mean(images.astype(np.float32), block)
    whole = block_mean(valid.astype(np.float32), block) == 1
    bands = np.stack([band_passed(image, mask) for image, mask in zip(means, whole, strict=True)])
    return _Level(bands, np.stack([far_from_invalid(mask) for mask in whole]))


def _climbed(levels: list[_Level], motions: Motions) -> tuple[Motions, float]:
    """Motions near a start on the coarsest level, refined up to the finest, in its pixels; and their error."""
    size, error = levels[0].bands.shape[-1], np.inf
    for level in levels:
        finer = level.bands.shape[-1]
        motions, error = _refined(level, motions.magnified(finer / size))
        size = finer
    return motions, error


def _refined(level: _Level, start: Motions) -> tuple[Motions, float]:
    """Motions near a start, and their error; infinite where too little is left in common."""
    motions, longest = start, np.inf
    for _ in range(_STEPS):
        moved, common = level.moved(motions)
        if np.count_nonzero(common) < FEWEST:
            return start, np.inf
        step = fit_small_shifts(products(moved, common, turning=True), n_motions=_MOTIONS)
        if not np.isfinite(step.error):
            return start, np.inf
        clipped = np.clip(step.pixels, -_LONGEST_STEP, _LONGEST_STEP)
        motions = motions.followed_by(clipped, level.half_diagonal)
        longest = float(np.abs(step.pixels).max())
        if longest < _AT_REST:
            return motions, step.error
    # What does not rest is known no better than its last step.
    return motions, max(step.error, longest)


def _gain(level: _Level, alone: Motions, motions: Motions) -> float:
    """How much less photographs disagree with motions than with shifts alone, on the same pixels; 0 if not surely."""
    (shifted, common), (moved, also) = level.moved(alone), level.moved(motions)
    common = common & also
    count = np.count_nonzero(common)
    if count < FEWEST:
        return 0.0
    gain = disagreement(products(shifted, common)) - disagreement(products(moved, common))
    return gain if gain > BY_CHANCE / count else 0.0
