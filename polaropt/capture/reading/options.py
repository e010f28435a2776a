"""What a person says of a capture's files, checked before they are opened."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from polaropt.capture.capture import ANGLES_DEG, FileContent, Origin
from polaropt.capture.files.encoding import parse_gamma
from polaropt.capture.files.focal_length import check_view
from polaropt.capture.files.limits import MAX_PIXELS, check_max_pixels
from polaropt.capture.files.opening import AnyPath, read_json
from polaropt.capture.mosaic import check_cell_order
from polaropt.capture.reading.levels import Levels
from polaropt.errors import InputError
from polaropt.optics import Analyzer

SENSORS = ("auto", "mono", "color")
SENSES = ("ccw", "cw")
RESOLUTIONS = ("sensor", "cell")
# White less black in the file's units, in which values of any file can still be told; set by hand.
_LEAST_RANGE = 1e-20
_GAIN_RANGE = (0.5, 2.0)
"""Pair gains that a person can give; set by hand."""


@dataclass(frozen=True)
class ReaderOptions:
    """The reader's arguments, checked."""

    angles_deg: tuple[float, ...]
    sensor: str
    cell_order: tuple[float, ...] | None
    black_level: float
    white_level: float | None
    pair_gain: float | None
    gamma: float | str | None
    resolution: str
    angle_sense: str
    field_of_view_deg: float | None
    analyzer: Analyzer | None
    exposures: tuple[float, ...] | None = None
    max_pixels: int = MAX_PIXELS
    keep_defects: bool = False

    def counted(self, angles_deg: Sequence[float]) -> tuple[float, ...]:
        """Angles counter-clockwise from the image's x axis, given in the sense that was asked for."""
        return tuple(angles_deg) if self.angle_sense == "ccw" else tuple(-angle % 180 for angle in angles_deg)


def checked_options(
    *,
    angles_deg: Sequence[float] = ANGLES_DEG,
    sensor: str = "auto",
    cell_order: Sequence[float] | None = None,
    black_level: float = 0,
    white_level: float | None = None,
    pair_gain: float | None = None,
    gamma: float | str | None = None,
    resolution: str = "sensor",
    angle_sense: str = "ccw",
    field_of_view_deg: float | None = None,
    analyzer: AnyPath | Analyzer | None = None,
    exposures: Sequence[float] | None = None,
    max_pixels: int = MAX_PIXELS,
    keep_defects: bool = False,
) -> ReaderOptions:
    """Check every option of `polaropt.capture.read.read_capture` by itself; InputError with what to give instead."""
    if sensor not in SENSORS:
        raise InputError(f"sensor {sensor!r} does not exist; choose one of {', '.join(SENSORS)}")
    if resolution not in RESOLUTIONS:
        raise InputError(f"resolution {resolution!r} does not exist; choose one of {', '.join(RESOLUTIONS)}")
    if angle_sense not in SENSES:
        raise InputError(f"angle sense {angle_sense!r} does not exist; choose one of {', '.join(SENSES)}")
    if field_of_view_deg is not None:
        check_view(number_of(field_of_view_deg, "the field of view"))
    given: Any = angles_deg
    listed: Iterable[Any] = given if isinstance(given, Iterable) else (given,)
    angles = tuple(number_of(angle, "a polarizer angle") for angle in listed)
    black = number_of(black_level, "the black level")
    white = None if white_level is None else number_of(white_level, "the white level")
    if white is not None and white <= black:
        raise InputError(f"the white level {white:g} is not above the black level {black:g}; correct one of them")
    if white is not None and white - black < _LEAST_RANGE:
        raise InputError(
            f"the white level {white:g} is hardly above the black level {black:g}; give it as it is stored"
        )
    gain = None if pair_gain is None else number_of(pair_gain, "the pair gain")
    if gain is not None and not _GAIN_RANGE[0] <= gain <= _GAIN_RANGE[1]:
        raise InputError(f"the pair gain is {gain:g}; give a value near 1 (0.5 to 2)")
    cell = None if cell_order is None else check_cell_order(cell_order)
    encoding = parse_gamma(gamma)
    return ReaderOptions(
        angles,
        sensor,
        cell,
        black,
        white,
        gain,
        encoding,
        resolution,
        angle_sense,
        field_of_view_deg,
        read_analyzer(analyzer),
        None if exposures is None else _exposures(exposures),
        check_max_pixels(max_pixels),
        bool(keep_defects),
    )


def _exposures(values: Any) -> tuple[float, ...]:
    try:
        each = list(values)
    except TypeError:
        raise InputError(f"exposures are {values!r}; give one number for each photograph") from None
    return tuple(_exposure(value) for value in each)


def _exposure(value: Any) -> float:
    number = number_of(value, "an exposure")
    if number <= 0:
        raise InputError(f"an exposure is {number:g}; give how long each photograph was exposed, or in what proportion")
    return number


def number_of(value: Any, what: str) -> float:
    try:
        number = float(value)
    except (TypeError, ValueError):
        number = np.nan
    if not np.isfinite(number):
        raise InputError(f"{what} is {value!r}; give a number")
    return number


def read_analyzer(analyzer: AnyPath | Analyzer | None) -> Analyzer | None:
    """An analyzer from the file of ``polaropt calibrate``; InputError for anything else."""
    if analyzer is None or isinstance(analyzer, Analyzer):
        return analyzer
    try:
        document = read_json(Path(analyzer))
        lists = (document[name] for name in ("angles_deg", "gains", "contrasts", "true_angles_deg"))
        return Analyzer(*(tuple(float(value) for value in values) for values in lists))
    except InputError as error:
        told = str(error)
        raise InputError(told if told.startswith(f"{analyzer}: ") else f"{analyzer}: {told}") from None
    except (ValueError, KeyError, TypeError, OverflowError):
        raise InputError(f"{analyzer}: is no calibration; make one with polaropt calibrate") from None


def origin_of(layout: str, content: FileContent, levels: Levels, options: ReaderOptions) -> Origin:
    return Origin(
        files=(),
        layout=layout,
        sample_type=str(content.pixels.dtype),
        black_level=levels.black,
        white_level=levels.white,
        gamma=options.gamma,
        encoding_hint=content.encoding_hint,
        angle_sense=options.angle_sense,
    )
