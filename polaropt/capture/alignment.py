"""Photographs through a filter turned by hand, moved back onto each other."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from polaropt.capture.capture import Capture, check_capture
from polaropt.capture.registration import (
    MIRRORED_PX,
    WHOLE,
    Matrix,
    Motions,
    corners,
    finely_moved_back,
    measure_shifts,
    measure_turns,
    moved_back,
)
from polaropt.capture.validity import MOST_NEGATIVE, SMALLEST_SIDE, FloatImages
from polaropt.errors import InputError
from polaropt.numerics import BitMask
from polaropt.progress import Progress

Mask = NDArray[np.bool_]
Frame = tuple[slice, slice]
Moved = Callable[[FloatImages, Mask, int], tuple[FloatImages, Mask]]
"""Puts a plane of photograph k and its valid pixels back; what touches invalid pixels is not valid."""
# Fractions of the progress; set by hand.
_SHIFTS_MEASURED, _TURNS_MEASURED = 0.15, 0.4


def align(capture: Capture, *, overwrite: bool = False, progress: Progress | None = None) -> Capture:
    """Move photographs that are shifted, turned or scaled against each other onto the first one.

    Parameters
    ----------
    capture : Capture
    overwrite : bool
        Whether the result may take the capture's own memory, which is then of no use any more: large photographs need
        it only once.
    progress : callable, optional
        Called with what is being done and the fraction done, 0..1.

    Returns
    -------
    Capture
        The part of the frame that all photographs show, resampled in the Fourier domain; pixels that touch clipped ones
        are not valid. `origin.shifts_px`, `origin.rotations_deg` and `origin.scales` tell how the photographs were
        moved. The capture itself where the motions found are below 0.05 px or three times their own error, or the
        photographs do not agree better with them. Photographs that are shifted only are not turned.

    Raises
    ------
    InputError
        The photographs lie so far apart that too little of them overlaps, or come from a mosaic; it is no capture.

    Examples
    --------
    The second photograph shows everything three pixels farther to the right:

    >>> import numpy as np
    >>> from skimage.data import astronaut, coffee
    >>> from polaropt import Capture, SceneParameters, align, simulate
    >>> taken = simulate(coffee()[90:250, 180:340], astronaut()[:160, 150:310], SceneParameters(60.0, 20.0, 4.0))
    >>> photographs = np.moveaxis(taken.intensities, 1, -1).copy()
    >>> photographs[1] = np.roll(photographs[1], 3, axis=1)
    >>> aligned = align(Capture(photographs[:, :, 3:]))
    >>> [round(right) for down, right in aligned.origin.shifts_px]
    [0, 3, 0, 0]
    """
    if check_capture(capture).cells is not None:
        raise InputError("a mosaic's photographs are taken at once, through one filter each pixel; leave --align out")

    def tell(fraction: float) -> None:
        if progress is not None:
            progress("Aligning", fraction)

    shifts = measure_shifts(capture)
    tell(_SHIFTS_MEASURED)
    turns = measure_turns(capture, shifts)
    tell(_TURNS_MEASURED)

    def tell_moved(fraction: float) -> None:
        tell(_TURNS_MEASURED + (1 - _TURNS_MEASURED) * fraction)

    if turns.certain:
        motions = turns.motions
        aligned = _aligned(capture, motions, _common_frame(motions, capture.shape[-2:]), overwrite, tell_moved)
        rotations, scales = tuple(map(float, motions.rotations_deg)), tuple(map(float, motions.scales))
        return _with_motions(aligned, motions.offsets, turns.error, rotations, scales)
    if not shifts.certain:
        return capture
    motions = Motions.of_shifts(shifts.pixels)
    aligned = _aligned(capture, motions, _common_frame(motions, capture.shape[-2:]), overwrite, tell_moved)
    return _with_motions(aligned, shifts.pixels, shifts.error)


def _with_motions(
    aligned: Capture,
    offsets: Matrix,
    error: float,
    rotations: tuple[float, ...] = (),
    scales: tuple[float, ...] = (),
) -> Capture:
    return aligned.with_origin(
        shifts_px=tuple((float(down), float(right)) for down, right in offsets),
        shift_error_px=error,
        rotations_deg=rotations,
        scales=scales,
    )


def moved_onto_first(capture: Capture, motions: Motions, tell: Callable[[float], None] | None = None) -> Capture:
    """Photographs put back in the frame of the first one; what one of them does not show is not valid in it.

    Parameters
    ----------
    capture : Capture
    motions : Motions
        From the middle of its frame.
    tell : callable, optional
        Called with the fraction done, 0..1.
    """
    height, width = capture.shape[-2:]
    return _aligned(capture, motions, np.s_[0:height, 0:width], False, tell or (lambda _: None))


def shown_by_all(motions: Motions, shape: tuple[int, ...]) -> Mask:
    """Pixels (h, w) of a rectangle in the first photograph's frame that all photographs show."""
    shown = np.zeros(shape[-2:], dtype=np.bool_)
    shown[_common_frame(motions, shape[-2:])] = True
    return shown


def _aligned(
    capture: Capture, motions: Motions, frame: Frame, overwrite: bool, tell: Callable[[float], None]
) -> Capture:
    """Rows and columns of the first photograph's frame, those that moved put back."""
    moved_back = _turned_back(motions) if motions.turned else _shifted_back(motions)
    shape = (*capture.intensities.shape[:-2], *(lines.stop - lines.start for lines in frame))
    images = _room(capture.intensities, shape, overwrite)
    valid = BitMask.empty(shape)
    for k, photograph in enumerate(capture.intensities):
        moved = motions.offsets[k].any() or (motions.matrices[k] != np.eye(2)).any()
        # Overshoot at clipped pixels and at dark edges; what noise has left below black stays there.
        bounds = min(0.9 * MOST_NEGATIVE, float(photograph.min())), max(1.0, float(photograph.max()))
        for plane in np.ndindex(photograph.shape[:-2]):
            image, kept = photograph[plane], capture.mask[k, *plane]
            if moved:
                image, kept = moved_back(image, kept, k)
                np.clip(image, *bounds, out=image)
            images[k, *plane] = image[frame]
            valid.keep((k, *plane), kept[frame])
        tell((k + 1) / len(capture.intensities))
    return Capture.of_planes(images, capture.angles_deg, valid, capture.origin)


def _room(array: NDArray[Any], shape: tuple[int, ...], overwrite: bool) -> NDArray[Any]:
    """Room for planes no larger than an array's, in its own memory where that may be overwritten.

    Filled from the first plane on, it takes no plane of the array before that has been read.
    """
    return array.reshape(-1)[: math.prod(shape)].reshape(shape) if overwrite else np.empty(shape, array.dtype)


def _common_frame(motions: Motions, shape: tuple[int, ...]) -> Frame:
    """Rows and columns that all photographs show once they are moved back."""
    places = motions.displacements(corners(shape))
    farthest = float(np.linalg.norm(places, axis=-1).max())
    # Displacements are linear over the frame: those of an edge lie between those of its ends.
    top, bottom = places[:, :2, 0], places[:, 2:, 0]
    left, right = places[:, ::2, 1], places[:, 1::2, 1]
    first = np.ceil([max(0, -float(edge.min())) for edge in (top, left)]).astype(int)
    last = np.floor([n - max(0, float(edge.max())) for n, edge in zip(shape, (bottom, right), strict=True)]).astype(int)
    if (last - first < SMALLEST_SIDE).any():
        raise InputError(f"the photographs are shifted by {farthest:.0f} px; too little of them overlaps")
    return slice(first[0], last[0]), slice(first[1], last[1])


def _shifted_back(motions: Motions) -> Moved:
    from scipy.ndimage import shift

    def moved(plane: FloatImages, valid: Mask, k: int) -> tuple[FloatImages, Mask]:
        back = -motions.offsets[k]
        # First, so that one plane's shares are gone when the other is moved; nothing is valid beyond the edges.
        whole = shift(valid.astype(np.float32), back, order=1) > WHOLE
        return _fourier_moved(plane, back), whole

    return moved


def _turned_back(motions: Motions) -> Moved:
    def moved(plane: FloatImages, valid: Mask, k: int) -> tuple[FloatImages, Mask]:
        part = motions.matrices[k], motions.offsets[k]
        whole = moved_back(valid.astype(np.float32), *part, order=1) > WHOLE
        return finely_moved_back(plane, *part), whole

    return moved


def _fourier_moved(plane: FloatImages, offset: Matrix) -> FloatImages:
    """An image (h, w) moved in the Fourier domain, mirrored beyond its edges.

    Splines of degree 3 smooth the finest detail, and the noise by 10 %: a separation afterwards loses up to 1.6 dB,
    with degree 5 up to 1 dB, with this 0.3.
    """
    from scipy.fft import irfft2, next_fast_len, rfft2
    from scipy.ndimage import fourier_shift

    sides = [next_fast_len(side + 2 * MIRRORED_PX, real=True) for side in plane.shape]
    padding = [(MIRRORED_PX, whole - side - MIRRORED_PX) for whole, side in zip(sides, plane.shape, strict=True)]
    spectrum = rfft2(np.pad(plane, padding, mode="symmetric"))
    fourier_shift(spectrum, offset, n=sides[1], output=spectrum)
    moved: FloatImages = irfft2(spectrum, s=sides, overwrite_x=True)
    return moved[MIRRORED_PX : MIRRORED_PX + plane.shape[0], MIRRORED_PX : MIRRORED_PX + plane.shape[1]]
