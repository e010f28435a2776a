"""Photographs, one for each angle, to a capture."""

from __future__ import annotations

from dataclasses import replace
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from polaropt.capture.capture import ANGLES_DEG, Capture, FileContent, Origin
from polaropt.capture.pair_gain import divide_out_gain, orthogonal_pairs, redundancy_residual
from polaropt.capture.reading.levels import Levels
from polaropt.capture.reading.options import ReaderOptions, origin_of
from polaropt.errors import InputError
from polaropt.numerics import AnyMask

Images = NDArray[np.float32]

_LOOK_STEP = 4
"""Of the pixels that tell whether photographs are alike, and add up; set by hand."""
_ADDS_UP = 0.003
"""Of the light, what photographs that add up may leave: as much as noise. Set by hand."""
_MOST_EXPOSED = 1e5
"""How many times as long one photograph may be exposed as another; set by hand, more than a sensor's range."""


def from_photographs(content: FileContent, levels: Levels, options: ReaderOptions, told: tuple[float, ...]) -> Capture:
    if options.analyzer is not None:
        raise InputError("an analyzer's calibration is for one raw mosaic; leave it out")
    if options.sensor != "auto" or options.resolution != "sensor":
        asked = "resolution 'cell'" if options.resolution != "sensor" else f"sensor {options.sensor!r}"
        raise InputError(f"{asked} is for one raw mosaic, not for {len(content.pixels)} photographs; leave it out")
    if len(content.pixels) < 3:
        raise InputError(f"holds {len(content.pixels)} photograph(s); at least 3 polarizer angles are needed")
    stored = content.angles_deg if options.angles_deg == ANGLES_DEG else None
    angles = options.counted(stored or options.angles_deg)
    colored = content.pixels.ndim == 4
    valid: AnyMask
    intensities, valid = levels.apply(np.moveaxis(content.pixels, -1, 1) if colored else content.pixels, options.gamma)
    if content.valid is not None:
        valid = np.moveaxis(content.valid, -1, 1) if colored else content.valid
    exposures = _exposures_of(len(intensities), options.exposures, told)
    if exposures:
        relative = (np.array(exposures) / min(exposures)).astype(np.float32)
        intensities /= relative.reshape(-1, *[1] * (intensities.ndim - 1))
    origin = replace(
        origin_of("stack", content, levels, options),
        exposures=exposures,
        exposures_given=options.exposures is not None,
        orientation=content.camera.orientation,
    )
    if len(intensities) == len(angles):
        _check_repeated(intensities, angles)
    return _finished(intensities, valid, angles, origin, options.pair_gain or 1.0)


def _exposures_of(n: int, given: tuple[float, ...] | None, told: tuple[float, ...]) -> tuple[float, ...]:
    """Exposures of n photographs: as given, or as the files tell them."""
    if given is not None and len(given) != n:
        raise InputError(f"{len(given)} exposures are given for {n} photographs; give one for each")
    exposures = told if given is None else given
    if exposures and not max(exposures) <= _MOST_EXPOSED * min(exposures):
        raise InputError(
            f"the longest exposure is {max(exposures):g}, the shortest {min(exposures):g}; "
            "give how long each photograph was exposed (--exposures)"
        )
    return exposures


def _check_repeated(images: Images, angles_deg: tuple[float, ...]) -> None:
    """InputError where one picture was given for two angles: rendered ones may be alike, but then they add up."""
    if len(images) < 4:
        return
    some = images[..., ::_LOOK_STEP, ::_LOOK_STEP]
    for one, other in combinations(range(len(images)), 2):
        if not (np.array_equal(some[one], some[other]) and np.array_equal(images[one], images[other])):
            continue
        left = np.abs(redundancy_residual(some.reshape(len(some), -1), angles_deg)).mean()
        if left > _ADDS_UP * np.abs(some).mean():
            raise InputError(
                f"photographs {one + 1} and {other + 1} are the same picture, and not all add up; give the one that "
                "was taken at each angle"
            )


def _finished(images: Images, valid: AnyMask, angles: tuple[float, ...], origin: Origin, gain: float) -> Capture:
    if gain != 1 and orthogonal_pairs(angles) is None:
        raise InputError("a pair gain needs four angles in two orthogonal pairs, such as 0,45,90,135; leave it out")
    return Capture.of_planes(divide_out_gain(images, angles, gain), angles, valid, replace(origin, pair_gain=gain))
