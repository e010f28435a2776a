"""Capture: the photographs, their polarizer angles, which pixels can be trusted."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, fields, replace
from enum import StrEnum
from functools import cached_property, partial
from operator import methodcaller
from os import PathLike
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from polaropt.capture.files.exif import CameraFacts
from polaropt.capture.files.jpeg import JpegFacts
from polaropt.capture.validity import (
    FloatImages,
    angles_of,
    check_angles,
    check_black_level,
    check_mask,
    check_order,
    check_shape,
    check_values,
    check_white_level,
    photographs_of,
)
from polaropt.errors import InputError
from polaropt.numerics import (
    AnyMask,
    BitMask,
    block_mean,
    block_shares,
    count_true,
    fill_gaps,
    spread_blocks,
    strips,
    whole_blocks,
)
from polaropt.optics import Sampling, stokes_from_intensities

ANGLES_DEG = (0.0, 45.0, 90.0, 135.0)
"""Polarizer angles of polarization cameras (Sony IMX250MZR), and what is taken where none are given."""


def planes_first(image: FloatImages) -> FloatImages:
    """(h, w[, channel]) to ([channel,] h, w)."""
    return np.moveaxis(image, -1, 0) if image.ndim == 3 else image


def planes_last(image: FloatImages) -> FloatImages:
    """([channel,] h, w) to (h, w[, channel])."""
    return np.ascontiguousarray(np.moveaxis(image, 0, -1)) if image.ndim == 3 else image


_LARGE = 2**24
"""Values of photographs from which on their mask is kept in bits: 4 in colour of 1.4 megapixels; set by hand."""


class EncodingHint(StrEnum):
    """What a file's format says about the encoding of its values."""

    NONE = ""
    SRGB_PNG = "the PNG says it is sRGB"
    JPEG = "JPEG files nearly always are"
    HEIF = "HEIC files nearly always are"
    PROFILE = "its colour profile says that they are"
    SHALLOW_PNG = "8-bit PNG files often are"

    @property
    def decides(self) -> bool:
        """Whether values are taken for encoded by it where the photographs do not tell."""
        return self not in (EncodingHint.NONE, EncodingHint.SHALLOW_PNG)


_UNTOLD = CameraFacts()


@dataclass(frozen=True)
class FileContent:
    """What one file holds.

    Attributes
    ----------
    pixels : ndarray, shape (h, w), (h, w, channel), (k, h, w) or (k, h, w, channel)
        As stored, without alpha. Colours come last here.
    stack : bool
        Whether the first axis counts photographs.
    angles_deg : tuple of float or None
        Polarizer angles, where the file tells them.
    valid : ndarray of bool or None
        Validity of each value, where the file tells it.
    encoding_hint : EncodingHint
        What the format says about gamma; empty if nothing.
    focal_px : float or None
        Focal length in pixels, where the camera wrote it into the file.
    bits : int or None
        Depth of the values, where it is told and less than that of their type.
    camera : CameraFacts
        How it was held and exposed, and what else the camera tells.
    jpeg : JpegFacts or None
        How a JPEG was compressed.
    white_balance : (float, float, float) or None
        Of a camera's raw file: factors on red, green and blue, 1 at most; its values are without them.
    """

    pixels: NDArray[Any]
    stack: bool = False
    angles_deg: tuple[float, ...] | None = None
    valid: NDArray[np.bool_] | None = None
    encoding_hint: EncodingHint = EncodingHint.NONE
    focal_px: float | None = None
    bits: int | None = None
    camera: CameraFacts = _UNTOLD
    jpeg: JpegFacts | None = None
    white_balance: tuple[float, float, float] | None = None


@dataclass(frozen=True)
class Origin:
    """Where a capture was read from, and what was done to its values.

    Attributes
    ----------
    files : tuple of str
    layout : str
        "files", "stack", "mono mosaic" or "color mosaic"; "memory" for a capture that was read from nowhere.
    sample_type : str
        Type of the values in the file, such as "uint16"; empty for "memory".
    black_level, white_level : float
        Values that became 0 and 1, in the file's units.
    pair_gain : float
        Gain of the 45/135 pair that was divided out; 1 if none was.
    gamma : float, str or None
        Encoding that was undone.
    encoding_hint : EncodingHint
        What the file's format says about its encoding.
    raw_noise : float, optional
        Noise of a sample of a mosaic whose photographs are interpolated (white = 1).
    filtered_noise : float, optional
        What noise, and detail that aliases, leave in photographs of one pixel per cell that samples were filtered to.
    exposures : tuple of float
        As told by the files (seconds at ISO 100 and the first one's aperture) or given: divided out where they differ.
    exposures_given : bool
        Whether a person gave them.
    orientation : int
        How the camera was held, as EXIF has it; the photographs are turned upright. 1 where they were so.
    camera : CameraFacts
        Of the first file.
    jpeg : JpegFacts or None
        Of the file that was compressed most.
    low_passed : bool
        Whether the photographs went through a low pass, as the cells of a mosaic: their noise is not white.
    grey_levels : int, optional
        Levels between black and white that the samples of a mosaic lie on.
    cell_order : tuple of float, optional
        Polarizer angles of a mosaic's cell as it was read: top left, top right, bottom left, bottom right.
    cell_order_found : bool
        Whether that is not the usual order, which was not asked for and whose orthogonal pairs do not add up.
    left_out_px : (int, int)
        Rows and columns at the far sides of a mosaic that make no whole pattern and were left out.
    calibrated : bool
        Whether gains, angles and contrasts of a mosaic's analyzers were measured before, and what they do was undone.
    defects : int
        Samples of a mosaic that stood out by themselves, and what lies around them took their place.
    shifts_px : tuple of pairs of float
        How far down and to the right each photograph lay from the first and was moved back; empty if none was.
    shift_error_px : float, optional
        Standard error of these shifts.
    rotations_deg, scales : tuple of float
        How far each photograph was turned clockwise, and how much larger it showed the scene; empty if none was.
    focal_px : float, optional
        Focal length in pixels of these photographs, from the field of view or from what the camera wrote into the file.
    angle_sense : {"ccw", "cw"}
        Sense in which the polarizer angles were counted; those of the capture are counter-clockwise.
    start_unknown : bool
        Whether it is not known where the polarizer's angles start from the image's x axis.
    start_deg : float, optional
        Where they start, if the ghosts told it; it is added in the capture's angles.
    """

    files: tuple[str, ...] = ()
    layout: str = "memory"
    sample_type: str = ""
    black_level: float = 0.0
    white_level: float = 1.0
    pair_gain: float = 1.0
    gamma: float | str | None = None
    encoding_hint: EncodingHint = EncodingHint.NONE
    raw_noise: float | None = None
    filtered_noise: float | None = None
    exposures: tuple[float, ...] = ()
    exposures_given: bool = False
    orientation: int = 1
    camera: CameraFacts = _UNTOLD
    jpeg: JpegFacts | None = None
    low_passed: bool = False
    grey_levels: int | None = None
    cell_order: tuple[float, ...] | None = None
    cell_order_found: bool = False
    left_out_px: tuple[int, int] = (0, 0)
    calibrated: bool = False
    defects: int = 0
    shifts_px: tuple[tuple[float, float], ...] = ()
    shift_error_px: float | None = None
    rotations_deg: tuple[float, ...] = ()
    scales: tuple[float, ...] = ()
    focal_px: float | None = None
    angle_sense: str = "ccw"
    start_unknown: bool = False
    start_deg: float | None = None


def grey_levels(step: float, origin: Origin) -> int | None:
    """Levels between black and white of values that are `step` apart (white = 1); None where they lie on no grid."""
    if step == 0:
        return None
    if origin.sample_type.startswith(("int", "uint")):
        # Integers are apart by whole numbers, which float32 has rounded.
        span = origin.white_level - origin.black_level
        step = max(1, round(step * span)) / span
    return round(1 / step) + 1


@dataclass(frozen=True, eq=False, repr=False)
class RawSamples:
    """What a sensor with a mosaic measured: one value in each pixel.

    Attributes
    ----------
    values : ndarray of float32, shape (h, w)
        Linear, white = 1; gains divided out.
    valid : ndarray of bool, shape (h, w)
    sampling : Sampling
        Which photograph and colour each value belongs to.
    """

    values: FloatImages
    valid: NDArray[np.bool_]
    sampling: Sampling

    def part(self, rows: slice, columns: slice) -> RawSamples:
        """Those of a part of the frame."""
        corner = (rows.start or 0, columns.start or 0)
        return RawSamples(self.values[rows, columns], self.valid[rows, columns], self.sampling.moved(*corner))

    def left_out(self, where: NDArray[np.bool_]) -> RawSamples:
        """The same, of which some (h, w) are not valid."""
        return replace(self, valid=self.valid & ~where)

    def without_gains(self, gains: Sequence[float]) -> RawSamples:
        """The same less the gain of each photograph's analyzer."""
        if all(gain == 1 for gain in gains):
            return self
        values, period = self.values.copy(), self.sampling.period
        for photograph, _, row, column in self.sampling.places:
            if gains[photograph] != 1:
                values[row::period, column::period] /= np.float32(gains[photograph])
        return replace(self, values=values)


@dataclass(frozen=True, eq=False, repr=False)
class RegisteredCells:
    """A mosaic's photographs of one pixel per pattern, which a scene is estimated from.

    Attributes
    ----------
    scale : int
        Pixels of the capture that these belong to per pixel of theirs.
    noise_share : float
        Standard deviation of their noise in units of a raw sample's.
    make : callable
        Makes `capture` and `samples` when one of them is first asked for: frames of a sequence hardly ever need them.
    photographs_of : callable
        Makes the capture's photographs (k, channel, h, w) of samples.
    """

    scale: int
    noise_share: float
    make: Callable[[], tuple[Capture, RawSamples]]
    photographs_of: Callable[[RawSamples], FloatImages]

    @cached_property
    def _made(self) -> tuple[Capture, RawSamples]:
        return self.make()

    @property
    def capture(self) -> Capture:
        """All samples referred to the middle of their pattern by one low pass, see `polaropt.capture.mosaic`."""
        return self._made[0]

    @property
    def samples(self) -> RawSamples:
        """What they were made of."""
        return self._made[1]

    def changed(self, change: Callable[[Capture], Capture]) -> RegisteredCells:
        """The same cells with what `change` makes of their capture."""
        return replace(self, make=partial(_changed_cells, self, change))

    def left_out(self, where: NDArray[np.bool_]) -> RegisteredCells:
        """The same without some pixels (h, w) of the capture, the samples in them, and the cells that hold some."""
        return replace(self, make=partial(_cells_left_out, self, where))

    def without_gains(self, gains: Sequence[float]) -> RegisteredCells:
        """The same less the gain of each photograph's analyzer."""
        return replace(self, make=partial(_cells_without_gains, self, tuple(gains)))


def _changed_cells(cells: RegisteredCells, change: Callable[[Capture], Capture]) -> tuple[Capture, RawSamples]:
    return change(cells.capture), cells.samples


def _cells_left_out(cells: RegisteredCells, where: NDArray[np.bool_]) -> tuple[Capture, RawSamples]:
    of_cells = block_shares(where[None], cells.scale)[0] > 0
    # Of a capture that has a pixel per cell each holds several samples.
    shape = cells.samples.values.shape
    of_samples = spread_blocks(where, shape[0] // where.shape[0], shape)
    return cells.capture.left_out(of_cells), cells.samples.left_out(of_samples)


def _cells_without_gains(cells: RegisteredCells, gains: tuple[float, ...]) -> tuple[Capture, RawSamples]:
    return cells.capture.without_gains(gains), cells.samples.without_gains(gains)


@dataclass(frozen=True, init=False, eq=False, repr=False)
class Capture:
    """Photographs of one scene through glass, behind a linear polarizer at several angles.

    Parameters
    ----------
    intensities : array_like, shape (k, h, w) or (k, h, w, 3)
        Linear photographs, white = 1, one per polarizer angle, as image libraries have them: colours last. What a
        masked array of numpy masks cannot be trusted.
    angles_deg : sequence of k floats
        Polarizer angles in degrees, counter-clockwise from the image's x axis.
    valid : array_like of bool, same shape, optional
        Pixels that can be trusted; others may be NaN. Default: those below white (at white and above a sensor clips).

    Attributes
    ----------
    intensities : ndarray of float32, shape (k, [channel,] h, w)
        The photographs as planes: unlike those that the constructor takes their channels come first, as they do in
        `shape`, `stokes`, `PSE.forward` and `Separation.layers`.
    angles_deg : tuple of float
    mask : ndarray of bool or BitMask, shape (k, [channel,] h, w)
        Pixels that can be trusted, of large photographs in one bit each: what looks at parts takes them from here.
    valid : ndarray of bool, shape (k, [channel,] h, w)
        The same as an array, which is made of the bits each time that it is asked for.
    origin : Origin or None
        Where it was read from; None for a capture made in memory.
    samples : RawSamples or None
        What the sensor measured, where the photographs are interpolated between samples of a mosaic.
    cells : RegisteredCells or None
        A mosaic's photographs as a scene is estimated from them; None where the photographs are good for that.

    Notes
    -----
    A capture does not change; `replace` and `with_origin` make another one. Its arrays are shared and must not be
    written to: they are not marked as read-only, for which kernels would be compiled a second time.

    Raises
    ------
    InputError
        Wrong shape, fewer than 3 or two equal angles, NaN, values below -1 % of white that are no noise, an image
        smaller than 16 px, a constant capture, or one that is clipped everywhere.

    Examples
    --------
    Four photographs of 64x48 pixels in grey, from arrays:

    >>> import numpy as np
    >>> from polaropt import Capture
    >>> photographs = np.random.default_rng(0).uniform(0.2, 0.8, (4, 48, 64))
    >>> capture = Capture(photographs, angles_deg=(0, 45, 90, 135))
    >>> capture.shape, capture.color, capture.stokes.shape
    ((48, 64), False, (3, 48, 64))
    """

    # `dataclasses.replace` would give planes to a constructor that takes colours last: it is refused.
    intensities: FloatImages = field(init=False)
    angles_deg: tuple[float, ...] = field(init=False)
    mask: AnyMask = field(init=False)
    origin: Origin | None = field(init=False)
    samples: RawSamples | None = field(init=False)
    cells: RegisteredCells | None = field(init=False)

    def __init__(
        self,
        intensities: ArrayLike,
        angles_deg: Sequence[float] = ANGLES_DEG,
        valid: ArrayLike | None = None,
    ) -> None:
        hidden = np.ma.getmaskarray(intensities) if isinstance(intensities, np.ma.MaskedArray) else None
        images = photographs_of(intensities if hidden is None else np.ma.filled(intensities, 0))
        trusted = None if valid is None else np.asarray(valid, dtype=bool)
        angles_deg = angles_of(angles_deg)
        check_order(images.shape, len(angles_deg))
        if trusted is not None:
            check_mask(trusted.shape, images.shape)
            # What is not trusted may be NaN, as where a mask of numpy hides it.
            if not np.isfinite(images).all():
                images = np.where(trusted | np.isfinite(images), images, 0)
        if images.ndim == 4:
            images = np.moveaxis(images, -1, 1)
            trusted = None if trusted is None else np.moveaxis(trusted, -1, 1)
        # Where a mask says what is clipped, values may go beyond white.
        if trusted is None:
            check_white_level(images)
        if hidden is not None:
            shown = ~(np.moveaxis(hidden, -1, 1) if images.ndim == 4 else hidden)
            trusted = shown & (images < 1 if trusted is None else trusted)
        self._take(images, angles_deg, trusted, None)

    @classmethod
    def of_planes(
        cls,
        intensities: ArrayLike,
        angles_deg: Sequence[float] = ANGLES_DEG,
        valid: ArrayLike | BitMask | None = None,
        origin: Origin | None = None,
        samples: RawSamples | None = None,
        cells: RegisteredCells | None = None,
    ) -> Capture:
        """A capture of photographs whose channels come first, (k, [channel,] h, w), as its own attributes are.

        Parameters
        ----------
        intensities : array_like, shape (k, h, w) or (k, channel, h, w)
        angles_deg : sequence of k floats
        valid : array_like of bool or BitMask, same shape, optional
        origin : Origin, optional
        samples : RawSamples, optional
        cells : RegisteredCells, optional
        """
        capture = cls.__new__(cls)
        trusted = valid if valid is None or isinstance(valid, BitMask) else np.asarray(valid, dtype=bool)
        capture._take(photographs_of(intensities), angles_deg, trusted, origin, samples, cells)
        return capture

    def _take(
        self,
        planes: NDArray[Any],
        angles_deg: Sequence[float],
        valid: AnyMask | None,
        origin: Origin | None,
        samples: RawSamples | None = None,
        cells: RegisteredCells | None = None,
    ) -> None:
        """Keep photographs (k, [channel,] h, w) that pass all checks."""
        intensities = np.ascontiguousarray(planes, dtype=np.float32)
        trusted = _below_white(intensities) if valid is None else valid
        self._keep(intensities, angles_of(angles_deg), trusted, origin, samples, cells)
        check_values(intensities, self.mask)
        # What is interpolated between samples has no noise of its own: their cells are checked instead.
        if samples is None and cells is None:
            check_black_level(intensities, self.mask, self.angles_deg)

    def _keep(
        self,
        intensities: FloatImages,
        angles_deg: tuple[float, ...],
        mask: AnyMask,
        origin: Origin | None,
        samples: RawSamples | None,
        cells: RegisteredCells | None,
    ) -> None:
        """Keep planes of the right shape, whatever their values."""
        check_angles(angles_deg)
        check_shape(intensities, angles_deg, mask)
        kept = {"intensities": intensities, "angles_deg": angles_deg, "mask": _kept(mask), "origin": origin}
        kept |= {"samples": samples, "cells": cells}
        for name, value in kept.items():
            object.__setattr__(self, name, value)

    def replace(
        self,
        *,
        intensities: FloatImages | None = None,
        angles_deg: Sequence[float] | None = None,
        valid: NDArray[np.bool_] | None = None,
        origin: Origin | None = None,
    ) -> Capture:
        """The same capture but for what is given, photographs as planes (k, [channel,] h, w).

        The values are not checked again: they may be such as no camera gives (all clipped, beyond white). Samples of a
        mosaic stay what they are; its cells have the angles that are given.
        """
        cells = self.cells
        if cells is not None and angles_deg is not None:
            cells = cells.changed(methodcaller("replace", angles_deg=angles_deg))
        return self._with(
            intensities=self.intensities if intensities is None else intensities,
            angles_deg=self.angles_deg if angles_deg is None else angles_of(angles_deg),
            mask=self.mask if valid is None else valid,
            origin=self.origin if origin is None else origin,
            cells=cells,
        )

    def without_gains(self, gains: Sequence[float]) -> Capture:
        """The same less what each photograph was exposed more than others, or its analyzer's gain in a mosaic.

        Parameters
        ----------
        gains : sequence of k floats
        """
        if self.cells is None:
            planes = self.planes / np.asarray(gains, np.float32)[:, None, None, None]
            return self._with(intensities=planes.reshape(self.intensities.shape))
        # What lies between samples is made of them anew: it holds those of other photographs.
        of_cells = (self.samples or self.cells.samples).without_gains(gains)
        return self._with(
            intensities=self.cells.photographs_of(of_cells).reshape(self.intensities.shape),
            samples=None if self.samples is None else of_cells,
            cells=self.cells.without_gains(gains),
        )

    def without_mosaic(self) -> Capture:
        """The photographs alone, whatever they were interpolated from."""
        return self._with(samples=None, cells=None)

    def _with(self, **changes: Any) -> Capture:
        """The same capture but for some attributes, whose values are not checked."""
        kept = {attribute.name: getattr(self, attribute.name) for attribute in fields(self)} | changes
        kept["intensities"] = np.ascontiguousarray(kept["intensities"], dtype=np.float32)
        other = object.__new__(type(self))
        other._keep(**kept)
        return other

    def with_origin(self, **changes: Any) -> Capture:
        """The same capture, of which other facts are known: `changes` are attributes of `Origin`."""
        other = self.replace(origin=replace(self.origin or Origin(), **changes))
        if self.cells is None:
            return other
        if changes.get("focal_px") is not None:
            changes["focal_px"] /= self.cells.scale
        return other._with(cells=self.cells.changed(methodcaller("with_origin", **changes)))

    @property
    def valid(self) -> NDArray[np.bool_]:
        """Pixels that can be trusted, (k, [channel,] h, w)."""
        return np.asarray(self.mask)

    @property
    def valid_in_all(self) -> NDArray[np.bool_]:
        """Pixels (h, w) that can be trusted in all photographs and colours."""
        return np.asarray(self.mask.all(axis=(0, 1) if self.color else (0,)))

    @property
    def n_valid(self) -> int:
        """Number of values that can be trusted."""
        return count_true(self.mask)

    @property
    def registered(self) -> Capture:
        """The photographs as a scene is estimated from them: the cells of a mosaic, else these."""
        return self if self.cells is None else self.cells.capture

    @property
    def camera(self) -> CameraFacts | None:
        """What the files tell of how they were taken; None for a capture made in memory."""
        return None if self.origin is None else self.origin.camera

    @property
    def of_mosaic(self) -> bool:
        """Whether the files that it was read from are a mosaic's, which takes all photographs at once."""
        return self.origin is not None and "mosaic" in self.origin.layout

    @property
    def low_passed(self) -> bool:
        """Whether a mosaic's samples were filtered to make the photographs."""
        return self.origin is not None and self.origin.low_passed

    @property
    def scale(self) -> int:
        """Pixels of this capture per pixel of `registered`."""
        return 1 if self.cells is None else self.cells.scale

    @property
    def observed(self) -> Capture:
        """The photographs as far as they were measured: those of a mosaic are valid where it was sampled alone."""
        samples = self.samples
        if samples is None:
            return self
        k, shape = len(self.angles_deg), self.intensities.shape
        measured = samples.sampling.spread(samples.values, k).reshape(shape)
        valid = samples.sampling.spread(samples.valid, k).reshape(shape)
        return self.without_mosaic().replace(intensities=measured, valid=valid)

    @property
    def shape(self) -> tuple[int, ...]:
        """Shape of one layer, ([channel,] h, w)."""
        return self.intensities.shape[1:]

    @property
    def planes(self) -> FloatImages:
        """The photographs with a channel axis, grey ones too, (k, channel, h, w)."""
        return self.intensities.reshape(len(self.angles_deg), -1, *self.shape[-2:])

    @property
    def color(self) -> bool:
        """Whether there is a channel axis."""
        return self.intensities.ndim == 4

    @property
    def focal_px(self) -> float | None:
        """Focal length in pixels as far as the files or whoever read them told; None if nobody said.

        To be used where a scene needs a focal length, and no reason to use one.
        """
        return None if self.origin is None else self.origin.focal_px

    @property
    def start_unknown(self) -> bool:
        """Whether it is not known where the polarizer's angles start from the image's x axis."""
        return self.origin is not None and self.origin.start_unknown

    @property
    def stokes(self) -> FloatImages:
        """Least-squares Stokes images (3, [channel,] h, w), clipped pixels taken as they are."""
        images: Any = stokes_from_intensities(self.intensities, self.angles_deg)
        return np.asarray(images, dtype=np.float32)

    def intensity_strips(self, multiple: int = 1) -> Iterator[tuple[slice, FloatImages]]:
        """Rows from top to bottom, a multiple of so many at a time, and their s0, ([channel,] rows, w)."""
        height = self.shape[-2]
        for rows in strips(height, self.intensities.size // height, multiple):
            yield rows, stokes_from_intensities(self.intensities[..., rows, :], self.angles_deg)[0]

    def left_out(self, where: NDArray[np.bool_]) -> Capture:
        """The same without some pixels (h, w): they are not valid, and their photographs hold what lies around them.

        Of a mosaic their samples and cells are left out, too.
        """
        kept = np.broadcast_to(~where, (self.planes.shape[1], *where.shape))
        around = fill_gaps(self.planes, kept).reshape(self.intensities.shape)
        samples = None if self.samples is None else self.samples.left_out(where)
        cells = None if self.cells is None else self.cells.left_out(where)
        return self._with(intensities=around, mask=self.valid & ~where, samples=samples, cells=cells)

    def part(self, rows: slice, columns: slice) -> Capture:
        """A part of the frame, which need not be a capture that makes sense by itself (all clipped, all black)."""
        part = (..., rows, columns)
        samples = None if self.samples is None else self.samples.part(rows, columns)
        return self._with(intensities=self.intensities[part], mask=self.mask[part], samples=samples, cells=None)

    def in_blocks(self, block: int) -> Capture:
        """Means over blocks of so many pixels a side, of the photographs alone; like a part it is not checked."""
        height, width = (side // block * block for side in self.shape[-2:])
        inside = (..., slice(height), slice(width))
        means = block_mean(self.intensities[inside], block)
        return self._with(intensities=means, mask=whole_blocks(self.valid[inside], block), samples=None, cells=None)

    def __repr__(self) -> str:
        return f"Capture(shape={self.intensities.shape}, angles_deg={self.angles_deg})"


def check_capture(capture: Any) -> Capture:
    """The capture; InputError where something else is given for one."""
    if isinstance(capture, Capture):
        return capture
    kind = type(capture).__name__
    if isinstance(capture, str | PathLike) or (isinstance(capture, list | tuple) and capture):
        raise InputError(f"capture is a {kind}; read files with read_capture, and give what it returns")
    raise InputError(
        f"capture is a {kind}; make one of photographs (angle, height, width[, colour]) with Capture(photographs, "
        "angles_deg), or of files with read_capture"
    )


def _below_white(intensities: FloatImages) -> AnyMask:
    """Pixels that did not clip."""
    if intensities.size <= _LARGE:
        return intensities < 1
    return BitMask.made(intensities.shape, lambda part: intensities[part] < 1)


def _kept(mask: AnyMask) -> AnyMask:
    """A mask as a capture keeps it."""
    if mask.size <= _LARGE:
        return np.ascontiguousarray(mask)
    return mask if isinstance(mask, BitMask) else BitMask.of(mask)
