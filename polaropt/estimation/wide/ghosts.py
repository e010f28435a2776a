"""Ghosts and incidence of a pane that varies over the frame: the spectral likelihood of its parts, taken together.

Each part is seen in the plane of incidence at its own middle and weighs ghosts by its own incidence, while all ghosts
lie along one direction, at one distance.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
from numpy.typing import NDArray

from polaropt.capture import StokesImages, plate_frame
from polaropt.estimation.flat.errors import INCIDENCE_DETAIL, INCIDENCE_ROUNDS, widened_incidence
from polaropt.estimation.flat.ghosts import LEAST_SHIFT_PX, CrossSpectra, ShiftLikelihood, cross_spectra
from polaropt.numerics import grid_minimum, left_out, local_minimum, minimum_error
from polaropt.optics import INCIDENCE_SEARCH_DEG, SceneParameters, largest_search_shift, pixel_grid, scene_angles

Curve = NDArray[np.float64]

# Parts per side, which overlap by half, and the least side of one in pixels. Set by hand.
_PARTS = 3
_LEAST_SIDE = 48
# Shifts in pixels that are compared around the best whole one. Set by hand.
_FINE: Curve = np.arange(-8.0, 8.5) / 8
# Steps of the fit of the layers' spectra, in the search and where a shift is compared with none. Set by hand.
_ROUNDS, _CLOSELY = 2, 16
# Radii and directions of the layers' spectra where misfits with and without ghosts are compared. Set by hand.
_DETAIL = (6, 6)
# Gain in minus log likelihood per frequency that a shift must have. By trial.
_LEAST_GAIN = 3e-3
# Ghosts that are closer, in pixels, look like a blur; by trial.
_CLOSE_PX = 3.0
# How much steeper than its fit a pane may stand where ghosts are looked for: edges that ghosts double mislead that of
# bent panes by two degrees, and one of 30 random windows to fit on by 5.4 (`studies.random_windows`, even seeds to
# 942). Then first step, farthest and accuracy of its incidence. By trial, and set by hand.
_TURNS_DEG, _STEP_DEG, _FARTHEST_DEG, _TOLERANCE_DEG = (0.0, -3.0, 3.0, -6.0, 6.0), 2.0, 10.0, 0.5
# Standard error in degrees that parts, which overlap, do not see beside: as of a mosaic's samples.
_SHAPES_DEG = 0.6


@dataclass(frozen=True)
class VaryingShift:
    """A ghost shift in pixels along the azimuth at the middle, and how much likelier than none it is per frequency."""

    pixels: float
    gain: float

    @property
    def shows(self) -> bool:
        """Whether chance would hardly gain as much: the closer the ghosts, the more blurred scenes look like them."""
        size = abs(self.pixels)
        return size >= LEAST_SHIFT_PX and self.gain > _LEAST_GAIN * max(1.0, _CLOSE_PX / size) ** 3


@dataclass(frozen=True)
class _Part:
    """Spectra of a part of the frame, and the incidence there."""

    spectra: CrossSpectra
    incidence_deg: float


class VaryingSpectra:
    """What the spectra of a frame's parts tell of a pane whose stand is about known: its ghosts, and its incidence.

    Parameters
    ----------
    stokes : StokesImages
    scene : SceneParameters
        Complete, with a focal length or a bent pane; its shift is not used.
    steady : bool
        Whether the incidence is known so well that ghosts need not be looked for at others.
    """

    def __init__(self, stokes: StokesImages, scene: SceneParameters, *, steady: bool = False) -> None:
        self._parts = list(_parts(stokes, scene))
        self._pane = scene.replace(ghost_shift=0.0, focal_px=None, bend_deg_per_px=(0.0, 0.0, 0.0))
        self._most = math.floor(largest_search_shift(min(stokes.images.shape[-2:])))
        self._usual, self._closely = self._together(None), self._together(_DETAIL)
        self._of_incidence = self._together(INCIDENCE_DETAIL)
        self._steady, self._turn = steady, cache(self._likeliest_turn)

    def likeliest_shift(self) -> VaryingShift:
        """The likeliest ghost shift, wherever the pane stands near what is known of it."""
        # At the ends of a grid misfits merely fall.
        grid = np.arange(-self._most, self._most + 1.0)
        curves = [self._usual.misfit(grid, _ROUNDS, turn)[1:-1] for turn in ((0.0,) if self._steady else _TURNS_DEG)]
        best = int(np.argmin([curve.min() for curve in curves]))
        shift, turn = grid_minimum(grid[1:-1], curves[best]), _TURNS_DEG[best]
        fine = round(shift) + _FINE
        shift = grid_minimum(fine, self._usual.misfit(fine, _ROUNDS, turn))
        turns = (0.0, 0.0) if self._steady else (self._turn(0.0), self._turn(shift))
        without, with_ghosts = (
            float(self._closely.misfit(np.array([pixels]), _CLOSELY, turn)[0])
            for pixels, turn in zip((0.0, shift), turns, strict=True)
        )
        return VaryingShift(shift, without - with_ghosts)

    def incidence(self, ghost_shift: float) -> tuple[float, float] | None:
        """How many degrees steeper the pane stands for its ghosts, and the standard error; None where nothing tells."""
        turn = self._turn(ghost_shift)
        before, here, after = (self._misfits(turn + step, ghost_shift) for step in (-_STEP_DEG, 0.0, _STEP_DEG))
        # One part alone does not tell how far others would differ.
        if here.size < 2 or here.mean() >= min(before.mean(), after.mean()):
            return None
        error = minimum_error([left_out(misfits) / (misfits.size - 1) for misfits in (before, here, after)], _STEP_DEG)
        return turn, math.hypot(widened_incidence(error), _SHAPES_DEG)

    def _likeliest_turn(self, ghost_shift: float) -> float:
        """The likeliest turn of the pane in degrees."""

        def misfit(turn: float) -> float:
            return float(self._misfits(turn, ghost_shift).mean())

        return local_minimum(misfit, 0.0, (-_FARTHEST_DEG, _FARTHEST_DEG), _STEP_DEG, _TOLERANCE_DEG)

    def _misfits(self, turn: float, ghost_shift: float) -> Curve:
        """Of each part."""
        return self._of_incidence.each(np.array([ghost_shift]), INCIDENCE_ROUNDS, turn)[:, 0]

    def _together(self, detail: tuple[int, int] | None) -> _Together:
        return _Together(
            [(ShiftLikelihood(part.spectra, self._pane, detail), part.incidence_deg) for part in self._parts]
        )


@dataclass(frozen=True)
class _Together:
    """Likelihoods of all parts, each with its incidence."""

    parts: list[tuple[ShiftLikelihood, float]]

    def each(self, shifts: Curve, rounds: int, turn: float = 0.0) -> Curve:
        """Misfits (part, shift), for a pane that stands so many degrees steeper."""
        lowest, highest = INCIDENCE_SEARCH_DEG
        return np.array(
            [
                likelihood.misfit(min(max(incidence + turn, lowest), highest), shifts, rounds)
                for likelihood, incidence in self.parts
            ]
        )

    def misfit(self, shifts: Curve, rounds: int, turn: float = 0.0) -> Curve:
        """Mean over the parts."""
        return np.asarray(self.each(shifts, rounds, turn).mean(axis=0))


def _parts(stokes: StokesImages, scene: SceneParameters) -> Iterator[_Part]:
    height, width = stokes.images.shape[-2:]
    x, y = pixel_grid(height, width, ((width - 1) / 2, (height - 1) / 2))
    for rows in _spans(height):
        for columns in _spans(width):
            middle = x[:, (columns.start + columns.stop) // 2], y[(rows.start + rows.stop) // 2]
            cosine, cos, sin = (np.asarray(part).item() for part in scene_angles(scene, *middle))
            part = replace(stokes, images=stokes.images[..., rows, columns], valid=stokes.valid[..., rows, columns])
            frame = plate_frame(part, math.degrees(math.atan2(sin, cos)) / 2)
            spectra = cross_spectra(frame).with_ghosts_along(scene.values()[1])
            yield _Part(spectra, math.degrees(math.acos(min(cosine, 1.0))))


def _spans(length: int) -> list[slice]:
    """Overlapping parts of a side."""
    side = min(length, max(_LEAST_SIDE, 2 * length // (_PARTS + 1)))
    n = max(1, math.ceil(2 * length / side) - 1)
    return [slice(int(start), int(start) + side) for start in np.linspace(0, length - side, n).round()]
