"""The reader's options, as a person gives them, checked."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from polaropt.errors import InputError
from polaropt.focal_length import check_view
from polaropt.image_io import parse_gamma
from polaropt.mosaic import check_cell_order

ANGLES_DEG = (0.0, 45.0, 90.0, 135.0)
SENSORS = ("auto", "mono", "color")
SENSES = ("ccw", "cw")


@dataclass(frozen=True)
class ReaderOptions:
    """The reader's arguments, checked."""

    angles_deg: tuple[float, ...]
    sensor: str
    cell_order: tuple[float, ...]
    black_level: float
    white_level: float | None
    pair_gain: float | None
    gamma: float | str | None
    full_resolution: bool
    angle_sense: str
    field_of_view_deg: float | None

    def counted(self, angles_deg: Sequence[float]) -> tuple[float, ...]:
        """Angles counter-clockwise from the image's x axis, given in the sense that was asked for."""
        return tuple(angles_deg) if self.angle_sense == "ccw" else tuple(-angle % 180 for angle in angles_deg)


def checked_options(
    angles_deg: Sequence[float],
    sensor: str,
    cell_order: Sequence[float],
    black_level: float,
    white_level: float | None,
    pair_gain: float | None,
    gamma: float | str | None,
    full_resolution: bool,
    *,
    angle_sense: str = "ccw",
    field_of_view_deg: float | None = None,
) -> ReaderOptions:
    """Check every option of `polaropt.reader.read_capture` by itself; InputError with what to give instead."""
    if sensor not in SENSORS:
        raise InputError(f"sensor {sensor!r} does not exist; choose one of {', '.join(SENSORS)}")
    if angle_sense not in SENSES:
        raise InputError(f"angle sense {angle_sense!r} does not exist; choose one of {', '.join(SENSES)}")
    if field_of_view_deg is not None:
        check_view(_number(field_of_view_deg, "the field of view"))
    listed: Sequence[Any] = angles_deg if isinstance(angles_deg, Iterable) else (angles_deg,)
    angles = tuple(_number(angle, "a polarizer angle") for angle in listed)
    black = _number(black_level, "the black level")
    white = None if white_level is None else _number(white_level, "the white level")
    if white is not None and white <= black:
        raise InputError(f"the white level {white:g} is not above the black level {black:g}; correct one of them")
    gain = None if pair_gain is None else _number(pair_gain, "the pair gain")
    if gain is not None and not 0.5 <= gain <= 2:
        raise InputError(f"the pair gain is {gain:g}; give a value near 1 (0.5 to 2)")
    cell = check_cell_order(cell_order)
    encoding = parse_gamma(gamma)
    return ReaderOptions(
        angles, sensor, cell, black, white, gain, encoding, full_resolution, angle_sense, field_of_view_deg
    )


def _number(value: Any, what: str) -> float:
    try:
        number = float(value)
    except (TypeError, ValueError):
        number = np.nan
    if not np.isfinite(number):
        raise InputError(f"{what} is {value!r}; give a number")
    return number
