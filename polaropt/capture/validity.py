"""What photographs must be to be a capture: their shape, angles, values and black level."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from polaropt.capture.pair_gain import redundancy_residual
from polaropt.errors import InputError, one_line
from polaropt.numerics import (
    AnyMask,
    block_mean,
    quantization_step,
    quietest_combination,
    robust_spread,
    second_differences,
    whole_blocks,
)

FloatImages = NDArray[np.float32]

_EQUAL_DEG = 1e-3
"""Polarizer angles that are nearer to each other are equal; set by hand, far below what a filter is turned to."""
_FULL_TURN_RAD = 2 * math.pi
"""Angles within so many degrees are radians, or tell nothing."""
SMALLEST_SIDE = 16
"""Least height and width of a capture in pixels; set by hand."""
MOST_NEGATIVE = -0.01
"""Values down to here (white = 1) are below black by noise or by a black level that does little harm; set by hand."""
_FAR_BEYOND_WHITE, _MOSTLY = 2.0, 0.5
"""Value, and share of values beyond white, of photographs that were not divided by their white level. Set by hand."""
_FARTHEST = 1e9
"""From black (white = 1) that any value lies: sums of fourth powers stay within float32. Set by hand."""
_BEYOND_EXPECTED = 1.5
"""Standard deviations: the least of n normal values lies about sqrt(2 ln n) below their mean, this more hardly ever."""
_AVERAGED = 8
"""Side of the blocks in pixels over which noise is averaged out."""
_FEWEST_BLOCKS = 100
"""Blocks of a plane whose own noise can be measured: with 64, one of 50 black captures of pure noise was refused."""
_DARKEST_SHARE, _ENOUGH_DARK, _MOST_DARK = 0.1, 500, 2**18
"""Pixels that the noise is measured on: the darkest tenth, not fewer than 500 (spread known to 5 %) nor too many."""


def photographs_of(intensities: ArrayLike) -> NDArray[Any]:
    if hasattr(intensities, "detach"):  # a tensor, wherever it lies and whatever follows it
        intensities = intensities.detach().cpu()
    try:
        images = np.asarray(intensities)
    except (TypeError, ValueError) as error:
        if hasattr(intensities, "shape"):
            raise InputError(f"the photographs cannot be read as an array of numpy ({one_line(error)})") from None
        raise InputError("the photographs differ in shape; give images of one size") from None
    if images.dtype.kind not in "buif":
        raise InputError(f"photographs hold values of type {images.dtype}; real numbers are needed, white = 1")
    if images.dtype.kind in "ui" and images.size and images.max() > 1:
        raise InputError(
            f"photographs hold whole numbers up to {images.max()}; white is 1: give floats, divided by the white level "
            f"({np.iinfo(images.dtype).max} where all {8 * images.dtype.itemsize} bits are used)"
        )
    if images.dtype.kind == "f" and images.itemsize > np.float32().itemsize:
        # Before they become float32, which holds no larger ones; NaN and infinity are told later.
        reach = max(abs(float(of.reduce(images, axis=None, initial=0))) for of in (np.fmin, np.fmax))
        if math.isfinite(reach):
            _check_reach(reach)
    return images


def _check_reach(reach: float) -> None:
    if reach > _FARTHEST:
        raise InputError(
            f"photographs hold values up to {reach:.3g}, trusted or not; white is 1: divide by the white level, and "
            "replace what stands for none"
        )


def check_order(shape: tuple[int, ...], n_angles: int) -> None:
    """InputError for photographs that do not come first, or in colour whose channels do not come last."""
    if len(shape) == 3 and shape[0] != n_angles == shape[2]:
        raise InputError(
            f"photographs have shape {shape}, (height, width, angle); "
            "give angles first, (angle, height, width): numpy.moveaxis(photographs, -1, 0)"
        )
    if len(shape) != 4 or shape[-1] == 3:
        return
    if shape[1] == 3:
        raise InputError(
            f"photographs have shape {shape}, (angle, 3, height, width); "
            "give channels last, (angle, height, width, 3): numpy.moveaxis(photographs, 1, -1)"
        )
    raise InputError(
        f"photographs have shape {shape}; expected (angle, height, width), or (angle, height, width, 3) for red, green "
        "and blue: leave out any other channel"
    )


def check_mask(valid: tuple[int, ...], intensities: tuple[int, ...]) -> None:
    if valid != intensities:
        raise InputError(f"the validity mask has shape {valid}, the photographs {intensities}; make them equal")


def angles_of(angles_deg: Sequence[float]) -> tuple[float, ...]:
    try:
        return tuple(float(angle) for angle in angles_deg)
    except (TypeError, ValueError):
        raise InputError(f"{angles_deg!r} are no polarizer angles; give numbers in degrees") from None


def check_angles(angles_deg: tuple[float, ...]) -> None:
    if len(angles_deg) < 3:
        raise InputError(f"{len(angles_deg)} polarizer angles; at least 3 different ones are needed")
    if not np.all(np.isfinite(angles_deg)):
        raise InputError("a polarizer angle is not a number; give angles in degrees")
    if max(angles_deg) - min(angles_deg) <= _FULL_TURN_RAD:
        listed = ", ".join(f"{angle:g}" for angle in angles_deg)
        raise InputError(f"the polarizer angles {listed} lie within a few degrees; give degrees, not radians")
    wrapped = np.sort(np.asarray(angles_deg) % 180)
    gaps = np.diff(np.append(wrapped, wrapped[0] + 180))
    if gaps.min() < _EQUAL_DEG:
        listed = ", ".join(f"{angle:g}" for angle in angles_deg)
        raise InputError(
            f"two polarizer angles are equal (modulo 180 degrees): {listed}; each photograph needs its own"
        )


def check_shape(intensities: FloatImages, angles_deg: tuple[float, ...], valid: AnyMask) -> None:
    if intensities.ndim not in (3, 4):
        expected = "(angle, height, width) or (angle, height, width, 3)"
        raise InputError(f"photographs have shape {intensities.shape}; expected {expected}")
    if intensities.shape[0] != len(angles_deg):
        raise InputError(
            f"{intensities.shape[0]} photographs but {len(angles_deg)} polarizer angles; give one angle each (--angles)"
        )
    check_mask(valid.shape, intensities.shape)
    height, width = intensities.shape[-2:]
    if min(height, width) < SMALLEST_SIDE:
        raise InputError(f"images are {width}x{height} px; at least {SMALLEST_SIDE}x{SMALLEST_SIDE} px are needed")


def _trusted_range(intensities: FloatImages, valid: AnyMask) -> tuple[float, float]:
    """Least and largest value that can be trusted, photograph by photograph; infinite where there is none."""
    lowest, highest = math.inf, -math.inf
    for photograph, trusted in zip(intensities, valid, strict=True):
        lowest = min(lowest, float(photograph.min(where=trusted, initial=np.inf)))
        highest = max(highest, float(photograph.max(where=trusted, initial=-np.inf)))
    return lowest, highest


def check_values(intensities: FloatImages, valid: AnyMask) -> None:
    planes = [intensities[plane] for plane in np.ndindex(intensities.shape[:-2])]
    extremes = [float(extreme) for plane in planes for extreme in (plane.min(), plane.max())]
    if not all(math.isfinite(extreme) for extreme in extremes):
        raise InputError("photographs hold NaN or infinite values; replace them, or mask them in finite images")
    _check_reach(max(map(abs, extremes)))
    lowest, highest = _trusted_range(intensities, valid)
    if lowest > highest:
        raise InputError("every pixel is saturated; take the photographs again with a shorter exposure")
    if highest <= 0:
        raise InputError("the capture is all black; check the exposure and the black level")
    if highest == lowest:
        raise InputError(f"the capture is constant ({highest:g} everywhere); it holds no scene")


def check_white_level(intensities: FloatImages) -> None:
    """InputError for photographs most of which lie beyond white, as those do that were not divided by it."""
    highest = float(intensities.max(initial=0))
    if highest > _FAR_BEYOND_WHITE and np.count_nonzero(intensities > 1) > _MOSTLY * intensities.size:
        raise InputError(
            f"most of the photographs lies beyond white, which is 1: values go up to {highest:g}; divide by the white "
            "level"
        )


def check_black_level(intensities: FloatImages, valid: AnyMask, angles_deg: tuple[float, ...]) -> None:
    """InputError where values lie further below black than their noise reaches, single ones or means of blocks.

    Light is not negative: what noise leaves below black comes nearer to it where it is averaged, a black level that is
    too high does not. A percentile instead of the least value would hide it where little is dark.
    """
    if _trusted_range(intensities, valid)[0] >= MOST_NEGATIVE:
        return
    valid = np.asarray(valid)
    _check_above_noise(intensities, valid, angles_deg, "values")
    means = block_mean(intensities, _AVERAGED)
    if means[0].size >= _FEWEST_BLOCKS:
        _check_above_noise(
            means, whole_blocks(valid, _AVERAGED), angles_deg, f"means of {_AVERAGED}x{_AVERAGED} pixels"
        )


def _check_above_noise(values: FloatImages, valid: NDArray[np.bool_], angles_deg: tuple[float, ...], what: str) -> None:
    lowest = float(values.min(where=valid, initial=np.inf))
    if lowest >= MOST_NEGATIVE:
        return
    reach = math.sqrt(2 * math.log(values.size)) + _BEYOND_EXPECTED
    limit = min(MOST_NEGATIVE, -reach * _noise_of_dark(values, angles_deg))
    if lowest < limit:
        raise InputError(
            f"{what} down to {lowest:.3g} of white; below {limit:.2g} it is no noise: correct the black level"
        )


def _noise_of_dark(values: FloatImages, angles_deg: tuple[float, ...]) -> float:
    """Robust standard deviation of the darkest values' noise.

    From what more than three photographs say twice; of three, from their second differences. Neither depends on the
    mean over the photographs (of the neighbours), by which the darkest are chosen.
    """
    step, brightness = quantization_step(values), values.mean(axis=0)
    if len(values) > 3:
        residual, step_of_residual = None, step / 2
    else:
        residual, step_of_residual = second_differences(values), step / 6
        brightness = _sums_of_three(_sums_of_three(brightness).swapaxes(-1, -2)).swapaxes(-1, -2)
    count = min(brightness.size, max(int(_DARKEST_SHARE * brightness.size), _ENOUGH_DARK))
    darkest = np.argpartition(brightness.ravel(), count - 1)[:count]
    chosen = darkest[:: math.ceil(count / _MOST_DARK)]
    if residual is None:
        samples = redundancy_residual(values.reshape(len(values), -1)[:, chosen], angles_deg)
    else:
        samples = quietest_combination(residual.reshape(len(residual), -1)[:, chosen])
    return max(robust_spread(samples, step_of_residual), step / math.sqrt(12))


def _sums_of_three(images: FloatImages) -> FloatImages:
    """Sums of each value and its neighbours along the last axis but one, (..., h - 2, w)."""
    return np.asarray(images[..., :-2, :] + images[..., 1:-1, :] + images[..., 2:, :], dtype=np.float32)
