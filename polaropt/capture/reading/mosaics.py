"""The raw mosaic of a polarization camera to a capture."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from polaropt.capture.capture import (
    ANGLES_DEG,
    SMALLEST_SIDE,
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
    looks_color,
    registered_cells,
    sampling_of,
    share_of_noise,
    wiener_photographs,
)
from polaropt.capture.noise import noise_level, noise_of_color_samples
from polaropt.capture.pair_gain import divide_out_gain, orthogonal_pairs, pair_gain_of, plausible
from polaropt.capture.reading.levels import Levels
from polaropt.capture.reading.options import ReaderOptions, origin_of
from polaropt.errors import InputError
from polaropt.numerics import block_mean, quantization_step
from polaropt.optics import Analyzer, analyzer_matrix

Mask = NDArray[np.bool_]
Images = NDArray[np.float32]


def from_mosaic(content: FileContent, levels: Levels, options: ReaderOptions) -> Capture:
    raw = single_plane(content.pixels)
    if options.exposures is not None:
        raise InputError("exposures are for several photographs; a mosaic's are taken at once, leave them out")
    cell_order = options.cell_order or SONY_CELL
    if options.angles_deg != ANGLES_DEG and sorted(options.angles_deg) != sorted(cell_order):
        raise InputError("one single image is taken as a mosaic; give its angles as the cell order")
    intensities, valid = levels.apply(raw)
    color = looks_color(intensities) if options.sensor == "auto" else options.sensor == "color"
    sampling, angles = sampling_of(color, cell_order)
    height, width = (side // sampling.period * sampling.period for side in raw.shape)
    if min(height, width) < SMALLEST_SIDE * sampling.period:
        raise InputError(
            f"the mosaic is {raw.shape[1]}x{raw.shape[0]} px; at least {SMALLEST_SIDE * sampling.period} px a side, "
            f"{SMALLEST_SIDE} cells, are needed"
        )
    samples = RawSamples(
        np.ascontiguousarray(linearize(intensities, options.gamma)[:height, :width]),
        np.ascontiguousarray(valid[:height, :width]),
        sampling,
    )
    origin = origin_of("color mosaic" if color else "mono mosaic", content, levels, options)
    origin = replace(origin, cell_order=cell_order, left_out_px=(raw.shape[0] - height, raw.shape[1] - width))
    return _of_samples(samples, angles, origin, options)


def _of_samples(samples: RawSamples, angles: tuple[float, ...], origin: Origin, options: ReaderOptions) -> Capture:
    """The photographs of a mosaic whose values are linear, with what a scene is estimated from."""
    k, analyzer = len(angles), options.analyzer
    step = quantization_step(samples.values[None])
    if analyzer is not None:
        _check_angles_of(analyzer, angles)
        samples = _without_gains(samples, analyzer.gains)
    photographs, valid = registered_cells(samples.values, samples.valid, samples.sampling, k)
    # A calibration was made with an order that its fields agree with.
    if options.cell_order is None and analyzer is None:
        samples, photographs, valid, origin = _in_closing_order(samples, photographs, valid, angles, origin)
    sampling = samples.sampling
    gain = options.pair_gain or _sensor_gain(photographs, angles, valid)
    photographs = divide_out_gain(photographs, angles, gain)
    if gain != 1:
        pairs = orthogonal_pairs(angles)
        assert pairs is not None
        samples = _without_gains(samples, [gain if i in pairs[1] else 1.0 for i in range(k)])
    origin, counted = replace(origin, pair_gain=gain, grey_levels=grey_levels(step, origin)), options.counted(angles)
    if analyzer is not None:
        photographs += _seen_by(analyzer.missing, photographs, analyzer.matrix)
    color = sampling.n_channels > 1
    planes = (photographs, valid) if color else (photographs[:, 0], valid[:, 0])
    cells = Capture.of_planes(planes[0], counted, planes[1], replace(origin, low_passed=True))
    noise_share = share_of_noise(sampling)
    at_sensor = options.resolution == "sensor"
    level = (noise_of_color_samples(samples) if color else None) or noise_level(cells) / noise_share
    noise = max(level, step / math.sqrt(12))
    rows = None if analyzer is None else analyzer.matrix
    full = wiener_photographs(samples.values, samples.valid, sampling, angles, noise, photographs, rows)
    if analyzer is not None:
        beyond = _seen_by(analyzer.missing, full, analyzer_matrix(angles))
        samples = replace(samples, values=samples.values + sampling.sample(beyond))
    registered = RegisteredCells(cells, sampling.period if at_sensor else 1, noise_share, samples)
    if at_sensor:
        every = np.repeat(np.repeat(planes[1], sampling.period, axis=-2), sampling.period, axis=-1)
    else:
        full, every = block_mean(full, sampling.period), planes[1]
    full = full if color else full[:, 0]
    return Capture.of_planes(
        full, counted, every, replace(origin, raw_noise=noise), samples if at_sensor else None, registered
    )


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


def _without_gains(samples: RawSamples, gains: Sequence[float]) -> RawSamples:
    """Samples less the gain of each photograph's analyzer."""
    of_channels = np.repeat(np.array(gains)[:, None], samples.sampling.n_channels, axis=1)
    return replace(samples, values=samples.values / samples.sampling.laid_out(of_channels, samples.values.shape))


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
