"""Frames of one polarization camera, read one after another: what the first one tells of the camera is kept."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from polaropt.capture.capture import Capture, FileContent
from polaropt.capture.reading.contents import focal_px_of
from polaropt.capture.reading.levels import find_levels
from polaropt.capture.reading.mosaics import Sensor, first_frame, next_frame
from polaropt.capture.reading.options import ReaderOptions, checked_options
from polaropt.errors import InputError

_CHANGED = 2.0
"""Ratio of the power of a colour's gradients, from which on a frame shows another scene than the one that the filter of
its camera was fitted to; set by hand."""
_LEAST_POWER = 1e-12
"""Power of gradients of a frame without any."""


@dataclass(frozen=True, eq=False)
class _Known:
    """What the frames have in common."""

    options: ReaderOptions
    sensor: Sensor
    power: NDArray[np.float64]
    shape: tuple[int, int]


class FrameReader:
    """Makes captures of a camera's raw frames, fast once it knows the camera.

    White level, kind of sensor, order of the cell and gain of the 45/135 pair are those of the first frame. At the
    resolution of cells, so are its defective pixels, the noise and the filter that makes photographs of the samples,
    until a frame shows twice or half as strong edges.

    Parameters
    ----------
    bits : int, optional
        Depth of the frames' integers, where it is less than that of their type.
    **reading
        As of `read_capture`: sensor, cell_order, black_level, white_level, pair_gain, gamma, resolution, angle_sense,
        field_of_view_deg, analyzer, keep_defects.

    Examples
    --------
    Frames as a camera gives them, separated as they come:

    >>> import numpy as np
    >>> from polaropt import FrameReader, SceneParameters, separate_sequence
    >>> from polaropt.simulation import Camera, photograph_mosaic, shipped_photograph
    >>> behind, before = (shipped_photograph(name)[100:228, 100:228] for name in ("coffee", "astronaut"))
    >>> pane = SceneParameters(60.0, 20.0, 4.0)
    >>> frames = (photograph_mosaic(behind, before, pane, Camera(seed=seed), color=False) for seed in range(3))
    >>> reader = FrameReader(resolution="cell", sensor="mono")
    >>> captures = (reader.read(frame) for frame in frames)
    >>> [result.transmission.shape for result in separate_sequence(captures, pane.scaled(0.5))]
    [(64, 64), (64, 64), (64, 64)]
    """

    def __init__(self, *, bits: int | None = None, **reading: Any) -> None:
        self._bits = bits
        self._options = checked_options(**reading)
        self._known: _Known | None = None

    def read(self, raw: NDArray[Any]) -> Capture:
        """A frame as a capture.

        Parameters
        ----------
        raw : ndarray, shape (h, w)
            As stored: integers, or floating point with white = 1. All frames of one shape and type.

        Raises
        ------
        InputError
            One line: what is wrong, what to do.
        """
        content = FileContent(np.asarray(raw), bits=self._bits)
        if content.pixels.ndim not in (2, 3):
            raise InputError(f"a mosaic has shape {content.pixels.shape}; give (height, width)")
        if self._known is not None and self._known.sensor.cell_filter is not None:
            known = self._known
            if content.pixels.shape[:2] != known.shape:
                raise InputError(
                    f"a frame has {content.pixels.shape[1]}x{content.pixels.shape[0]} px, the first "
                    f"{known.shape[1]}x{known.shape[0]}; give frames of one camera"
                )
            levels = find_levels(content.pixels, known.options.black_level, known.options.white_level, self._bits)
            capture = next_frame(content, levels, known.options, known.sensor)
            if _alike(_gradient_power(capture), known.power):
                return capture.with_origin(focal_px=focal_px_of(content, capture, known.options))
        return self._first(content)

    def _first(self, content: FileContent) -> Capture:
        """The first frame, or the first one of another scene."""
        options = self._options if self._known is None else self._known.options
        levels = find_levels(content.pixels, options.black_level, options.white_level, self._bits)
        capture, sensor = first_frame(content, levels, options)
        origin = sensor.origin
        options = replace(
            options,
            sensor="color" if capture.color else "mono",
            cell_order=options.cell_order or origin.cell_order,
            white_level=levels.white,
            pair_gain=origin.pair_gain,
        )
        height, width = content.pixels.shape[:2]
        self._known = _Known(options, sensor, _gradient_power(capture), (height, width))
        return capture.with_origin(focal_px=focal_px_of(content, capture, options))


def mosaic_capture(raw: NDArray[Any], *, bits: int | None = None, **reading: Any) -> Capture:
    """A raw mosaic in memory, of which no others of the camera are known; parameters are those of `FrameReader`."""
    return FrameReader(bits=bits, **reading).read(raw)


def _gradient_power(capture: Capture) -> NDArray[np.float64]:
    """Mean square of the differences of neighbours in each colour of the light of all photographs."""
    light = capture.intensities.mean(axis=0)
    squares = (np.square(np.diff(light, axis=axis)).mean(axis=(-1, -2), dtype=np.float64) for axis in (-1, -2))
    return np.atleast_1d(sum(squares)) + _LEAST_POWER


def _alike(power: NDArray[np.float64], known: NDArray[np.float64]) -> bool:
    return bool(np.all(power < _CHANGED * known) and np.all(known < _CHANGED * power))
