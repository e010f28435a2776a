"""The raw mosaic of a polarization camera to a capture."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from polaropt.capture.capture import (
    ANGLES_DEG,
    Capture,
    FileContent,
    Origin,
    RawSamples,
    RegisteredCells,
    grey_levels,
)
from polaropt.capture.checks import blocks_of, swapped_blocks
from polaropt.capture.files.encoding import linearize
from polaropt.capture.mosaic import (
    SONY_CELL,
    exchanged_order,
    filled_samples,
    looks_color,
    registered_cells,
    sampling_of,
    share_of_noise,
    wiener_photographs,
)
from polaropt.capture.noise import LEAST_NOISE, noise_level, noise_of_color_samples
from polaropt.capture.pair_gain import divide_out_gain, orthogonal_pairs, pair_gain_of, plausible
from polaropt.capture.reading.cell_filter import CellFilter
from polaropt.capture.reading.defects import defective_samples, without_defects
from polaropt.capture.reading.levels import Levels
from polaropt.capture.reading.options import ReaderOptions, origin_of
from polaropt.capture.validity import SMALLEST_SIDE
from polaropt.errors import InputError
from polaropt.numerics import quantization_step
from polaropt.optics import Analyzer, Sampling, analyzer_matrix

Mask = NDArray[np.bool_]
Images = NDArray[np.float32]
_NO_PLACES: NDArray[np.intp] = np.empty(0, np.intp)


@dataclass(frozen=True, eq=False)
class Sensor:
    """What is known of a polarization camera once a frame of it has been read.

    Attributes
    ----------
    origin : Origin
        Of that frame.
    angles : tuple of float
        Of the photographs, ascending, as the cell order counts them.
    sampling : Sampling
    noise : float
        Standard deviation of a sample's noise (white = 1).
    cell_filter : CellFilter or None
        What makes photographs of the patterns; None where they are made at the sensor's resolution.
    defects : ndarray of int
        Places of its defective pixels in the flat frame.
    """

    origin: Origin
    angles: tuple[float, ...]
    sampling: Sampling
    noise: float
    cell_filter: CellFilter | None
    defects: NDArray[np.intp]

    def gains(self, analyzer: Analyzer | None) -> list[float]:
        """What each photograph's samples are divided by."""
        of_analyzer = [1.0] * len(self.angles) if analyzer is None else list(analyzer.gains)
        if self.origin.pair_gain == 1:
            return of_analyzer
        pairs = orthogonal_pairs(self.angles)
        assert pairs is not None
        gain = self.origin.pair_gain
        return [own * (gain if i in pairs[1] else 1.0) for i, own in enumerate(of_analyzer)]


def from_mosaic(content: FileContent, levels: Levels, options: ReaderOptions) -> Capture:
    """The photographs of a mosaic, with what a scene is estimated from."""
    return first_frame(content, levels, options)[0]


def first_frame(content: FileContent, levels: Levels, options: ReaderOptions) -> tuple[Capture, Sensor]:
    """The same, and what other frames of the camera have in common with it."""
    if options.exposures is not None:
        raise InputError("exposures are for several photographs; a mosaic's are taken at once, leave them out")
    cell_order = options.cell_order or SONY_CELL
    if options.angles_deg != ANGLES_DEG and sorted(options.angles_deg) != sorted(cell_order):
        raise InputError("one single image is taken as a mosaic; give its angles as the cell order")
    raw = single_plane(content.pixels)
    intensities, below_white = levels.apply(raw)
    valid = np.asarray(below_white)
    color = looks_color(intensities) if options.sensor == "auto" else options.sensor == "color"
    sampling, angles = sampling_of(color, cell_order)
    samples = _whole_patterns(intensities, valid, sampling, options)
    height, width = samples.values.shape
    origin = origin_of("color mosaic" if color else "mono mosaic", content, levels, options)
    origin = replace(origin, cell_order=cell_order, left_out_px=(raw.shape[0] - height, raw.shape[1] - width))
    return _of_samples(samples, angles, origin, options)


def next_frame(content: FileContent, levels: Levels, options: ReaderOptions, sensor: Sensor) -> Capture:
    """Another frame of a camera whose photographs are those of patterns: gains, noise and filter are known."""
    assert sensor.cell_filter is not None
    intensities, below_white = levels.apply(single_plane(content.pixels))
    good = np.asarray(below_white)
    samples = _whole_patterns(intensities, good, sensor.sampling, options)
    samples = without_defects(samples, sensor.defects).without_gains(sensor.gains(options.analyzer))
    cells = partial(_cells_of, samples, sensor, options)
    color, k = sensor.sampling.n_channels > 1, len(sensor.angles)
    values, valid = _filled(samples, k)
    full = sensor.cell_filter.photographs(values)
    photographs_of = partial(_filtered, k=k, cell_filter=sensor.cell_filter)
    registered = RegisteredCells(1, share_of_noise(sensor.sampling), cells, photographs_of)
    origin = replace(sensor.origin, raw_noise=sensor.noise, filtered_noise=sensor.cell_filter.error)
    planes = (full, valid) if color else (full[:, 0], valid[:, 0])
    return Capture.of_planes(planes[0], options.counted(sensor.angles), planes[1], origin, None, registered)


def _filled(samples: RawSamples, k: int) -> tuple[Images, Mask]:
    """Values of samples, those that are not valid filled in, and which patterns' photographs are."""
    if samples.valid.all():
        return samples.values, np.ones((k, samples.sampling.n_channels, *_patterns(samples)), dtype=bool)
    expected, valid = registered_cells(samples.values, samples.valid, samples.sampling, k)
    return filled_samples(samples.values, samples.valid, samples.sampling, expected), valid


def _filtered(samples: RawSamples, k: int, cell_filter: CellFilter) -> Images:
    """Photographs (k, channel, h, w) of one pixel per pattern."""
    return cell_filter.photographs(_filled(samples, k)[0])


def _interpolated(samples: RawSamples, angles: tuple[float, ...], noise: float) -> Images:
    """Photographs (k, channel, h, w) at the sensor's resolution."""
    values, valid, sampling = samples.values, samples.valid, samples.sampling
    cells, _ = registered_cells(values, valid, sampling, len(angles))
    return wiener_photographs(values, valid, sampling, angles, noise, cells)


def _patterns(samples: RawSamples) -> tuple[int, int]:
    height, width = (side // samples.sampling.period for side in samples.values.shape)
    return height, width


def _whole_patterns(intensities: Images, valid: Mask, sampling: Sampling, options: ReaderOptions) -> RawSamples:
    """Linear samples of the patterns that are whole."""
    height, width = (side // sampling.period * sampling.period for side in intensities.shape)
    if min(height, width) < SMALLEST_SIDE * sampling.period:
        raise InputError(
            f"the mosaic is {intensities.shape[1]}x{intensities.shape[0]} px; at least "
            f"{SMALLEST_SIDE * sampling.period} px a side, {SMALLEST_SIDE} cells, are needed"
        )
    return RawSamples(
        np.ascontiguousarray(linearize(intensities, options.gamma)[:height, :width]),
        np.ascontiguousarray(valid[:height, :width]),
        sampling,
    )


def _of_samples(
    samples: RawSamples, angles: tuple[float, ...], origin: Origin, options: ReaderOptions
) -> tuple[Capture, Sensor]:
    """The photographs of a mosaic whose values are linear, with what a scene is estimated from."""
    k, analyzer = len(angles), options.analyzer
    step = quantization_step(samples.values[None])
    defects = _NO_PLACES if options.keep_defects else defective_samples(samples, step)
    samples, origin = without_defects(samples, defects), replace(origin, defects=len(defects))
    if analyzer is not None:
        _check_angles_of(analyzer, angles)
        samples, origin = samples.without_gains(analyzer.gains), replace(origin, calibrated=True)
    photographs, valid = registered_cells(samples.values, samples.valid, samples.sampling, k)
    # A calibration was made with an order that its fields agree with.
    if options.cell_order is None and analyzer is None:
        samples, photographs, valid, origin = _in_closing_order(samples, photographs, valid, angles, origin)
    sampling = samples.sampling
    gain = options.pair_gain or _sensor_gain(photographs, angles, valid)
    photographs = divide_out_gain(photographs, angles, gain)
    origin = replace(origin, pair_gain=gain, grey_levels=grey_levels(step, origin))
    sensor = Sensor(origin, angles, sampling, 0.0, None, defects)
    samples = samples.without_gains(sensor.gains(None))
    cells = _cells_capture(photographs, valid, sensor, options)
    color = sampling.n_channels > 1
    noise_share = share_of_noise(sampling)
    at_sensor = options.resolution == "sensor"
    level = (noise_of_color_samples(samples) if color else None) or noise_level(cells) / noise_share
    noise = max(LEAST_NOISE, level, step / math.sqrt(12))
    rows, filtered_noise = None if analyzer is None else analyzer.matrix, None
    if at_sensor:
        full = wiener_photographs(samples.values, samples.valid, sampling, angles, noise, photographs, rows)
        samples, period = _with_missing(samples, full, angles, analyzer), sampling.period
        of_cells: Any = partial(_both, cells, samples)
        photographs_of: Any = partial(_interpolated, angles=angles, noise=noise)
        every = np.repeat(np.repeat(valid, period, axis=-2), period, axis=-1)
    else:
        values = filled_samples(samples.values, samples.valid, sampling, photographs)
        cell_filter = CellFilter.fitted(values, sampling, angles, noise, photographs, rows)
        full, every, period = cell_filter.photographs(values), valid, 1
        sensor, filtered_noise = replace(sensor, cell_filter=cell_filter), cell_filter.error
        of_cells = partial(_both, cells, samples) if analyzer is None else partial(_cells_of, samples, sensor, options)
        photographs_of = partial(_filtered, k=k, cell_filter=cell_filter)
    registered = RegisteredCells(period, noise_share, of_cells, photographs_of)
    planes = (full, every) if color else (full[:, 0], every[:, 0])
    capture = Capture.of_planes(
        planes[0],
        options.counted(angles),
        planes[1],
        replace(origin, raw_noise=noise, filtered_noise=filtered_noise),
        samples if at_sensor else None,
        registered,
    )
    return capture, replace(sensor, noise=noise)


def _cells_capture(photographs: Images, valid: Mask, sensor: Sensor, options: ReaderOptions) -> Capture:
    """Registered cells (k, channel, ...), gains divided out, as a capture."""
    analyzer = options.analyzer
    if analyzer is not None:
        photographs += _seen_by(analyzer.missing, photographs, analyzer.matrix)
    planes = (photographs, valid) if sensor.sampling.n_channels > 1 else (photographs[:, 0], valid[:, 0])
    origin = replace(sensor.origin, low_passed=True)
    return Capture.of_planes(planes[0], options.counted(sensor.angles), planes[1], origin)


def _cells_of(samples: RawSamples, sensor: Sensor, options: ReaderOptions) -> tuple[Capture, RawSamples]:
    """What a scene is estimated from, of samples whose gains are divided out."""
    k, analyzer = len(sensor.angles), options.analyzer
    photographs, valid = registered_cells(samples.values, samples.valid, sensor.sampling, k)
    if analyzer is not None:
        of_samples = (samples.values, samples.valid, sensor.sampling, sensor.angles, sensor.noise)
        full = wiener_photographs(*of_samples, photographs, analyzer.matrix)
        samples = _with_missing(samples, full, sensor.angles, analyzer)
    return _cells_capture(photographs, valid, sensor, options), samples


def _with_missing(
    samples: RawSamples, photographs: Images, angles: tuple[float, ...], analyzer: Analyzer | None
) -> RawSamples:
    """Samples as ideal analyzers would have measured them; what these add follows from the photographs."""
    if analyzer is None:
        return samples
    beyond = _seen_by(analyzer.missing, photographs, analyzer_matrix(angles))
    return replace(samples, values=samples.values + samples.sampling.sample(beyond))


def _both(cells: Capture, samples: RawSamples) -> tuple[Capture, RawSamples]:
    return cells, samples


def _in_closing_order(
    samples: RawSamples, cells: Images, valid: Mask, angles: tuple[float, ...], origin: Origin
) -> tuple[RawSamples, Images, Mask, Origin]:
    """Samples and their cells with another order of the cell, where pairs do not add up in the one that was taken."""
    swapped = swapped_blocks(blocks_of(cells, valid), angles, beyond_doubt=True)
    if not swapped or origin.cell_order is None:
        return samples, cells, valid, origin
    order = exchanged_order(origin.cell_order, swapped[0])
    index = np.arange(len(angles))
    index[list(swapped[0])] = swapped[0][::-1]
    sampling, _ = sampling_of(samples.sampling.n_channels > 1, order)
    # Closure tells neither which pair is 0/90 nor the sense of the angles.
    found = replace(origin, cell_order=order, cell_order_found=True, start_unknown=True)
    return replace(samples, sampling=sampling), cells[index], valid[index], found


def _check_angles_of(analyzer: Analyzer, angles: tuple[float, ...]) -> None:
    if not np.allclose(analyzer.angles_deg, angles):
        listed = ", ".join(f"{angle:g}" for angle in analyzer.angles_deg)
        raise InputError(f"the analyzer's calibration is of angles {listed}; give the cell order that it was made with")


def _seen_by(rows: NDArray[np.float64], photographs: Images, analyzer: NDArray[np.float64]) -> Images:
    """What analyzer rows (k, 3) measure of the light of photographs (k, ...) that others took."""
    return np.asarray(np.tensordot((rows @ np.linalg.pinv(analyzer)).astype(np.float32), photographs, axes=1))


def single_plane(pixels: NDArray[Any]) -> NDArray[Any]:
    """A mosaic stored as grey RGB is still one plane; a real colour picture is one photograph of several."""
    if pixels.ndim == 2:
        return pixels
    if all(np.array_equal(pixels[..., 0], pixels[..., channel]) for channel in range(1, pixels.shape[-1])):
        return pixels[..., 0]
    raise InputError(
        "one colour picture holds one polarizer angle at most; "
        "give one file per angle, a stack, or the camera's raw mosaic"
    )


def _sensor_gain(cells: Images, angles: tuple[float, ...], masks: Mask) -> float:
    gain = pair_gain_of(cells, angles, masks)
    return gain if gain is not None and plausible(gain) else 1.0
