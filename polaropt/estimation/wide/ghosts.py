"""Ghost shift of a pane that varies over the frame: the spectral likelihood of parts of the frame, taken together.

Each part is seen in the plane of incidence at its own middle and weighs ghosts by its own incidence, while all ghosts
lie along one direction, at one distance.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from polaropt.capture import StokesImages, plate_frame
from polaropt.estimation.flat.ghosts import LEAST_SHIFT_PX, CrossSpectra, ShiftLikelihood, cross_spectra
from polaropt.numerics import grid_minimum
from polaropt.optics import SceneParameters, largest_search_shift, pixel_grid, scene_angles

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


def likeliest_shift(stokes: StokesImages, scene: SceneParameters) -> VaryingShift:
    """The likeliest ghost shift of a pane whose stand is known.

    Parameters
    ----------
    stokes : StokesImages
    scene : SceneParameters
        Complete, with a focal length or a bent pane; its shift is not used.
    """
    parts = list(_parts(stokes, scene))
    pane = scene.replace(ghost_shift=0.0, focal_px=None, bend_deg_per_px=(0.0, 0.0, 0.0))
    quick = _Together([(ShiftLikelihood(part.spectra, pane), part.incidence_deg) for part in parts])
    most = math.floor(largest_search_shift(min(stokes.images.shape[-2:])))
    # At the ends of a grid misfits merely fall.
    grid = np.arange(-most, most + 1.0)
    shift = grid_minimum(grid[1:-1], quick.misfit(grid, _ROUNDS)[1:-1])
    fine = round(shift) + _FINE
    shift = grid_minimum(fine, quick.misfit(fine, _ROUNDS))
    closely = _Together([(ShiftLikelihood(part.spectra, pane, _DETAIL), part.incidence_deg) for part in parts])
    without, with_ghosts = closely.misfit(np.array([0.0, shift]), _CLOSELY)
    return VaryingShift(shift, float(without - with_ghosts))


@dataclass(frozen=True)
class _Together:
    """Likelihoods of all parts, each with its incidence."""

    parts: list[tuple[ShiftLikelihood, float]]

    def misfit(self, shifts: Curve, rounds: int) -> Curve:
        """Mean over the parts."""
        curves = [likelihood.misfit(incidence, shifts, rounds) for likelihood, incidence in self.parts]
        return np.asarray(np.mean(curves, axis=0))


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
