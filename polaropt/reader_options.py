"""The reader's options, as a person gives them, checked."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from polaropt.errors import InputError
from polaropt.image_io import parse_gamma
from polaropt.mosaic import check_cell_order

ANGLES_DEG = (0.0, 45.0, 90.0, 135.0)
SENSORS = ("auto", "mono", "color")


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


def checked_options(
    angles_deg: Sequence[float],
    sensor: str,
    cell_order: Sequence[float],
    black_level: float,
    white_level: float | None,
    pair_gain: float | None,
    gamma: float | str | None,
    full_resolution: bool,
) -> ReaderOptions:
    """Check every option of `polaropt.reader.read_capture` by itself; InputError with what to give instead."""
    if sensor not in SENSORS:
        raise InputError(f"sensor {sensor!r} does not exist; choose one of {', '.join(SENSORS)}")
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
    return ReaderOptions(angles, sensor, cell, black, white, gain, parse_gamma(gamma), full_resolution)


def _number(value: Any, what: str) -> float:
    try:
        number = float(value)
    except (TypeError, ValueError):
        number = np.nan
    if not np.isfinite(number):
        raise InputError(f"{what} is {value!r}; give a number")
    return number
