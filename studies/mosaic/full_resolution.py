"""Demosaicking alone, judged on photographs that hold all angles and colours in every pixel.

They were taken by a camera with three sensors and a polarizer turned before it. A mosaic of them is interpolated, and
intensity, degree and angle of polarization are compared with their own.
"""

from __future__ import annotations

import math
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pandas import DataFrame

from polaropt.capture import ANGLES_DEG, WHITE_16, Capture, read_capture, sampling_of, write_png
from polaropt.numerics import block_mean, turn_between
from polaropt.optics import stokes_from_intensities
from studies.kit.frames import Cell, markdown, mean, summary
from studies.mosaic.demosaicking import LENS_BLUR_PX, bilinear, edge_aware, trained
from studies.scores import BORDER_PX

Images = NDArray[np.float32]

FOLDER = "real_mosaics/full_resolution"
SCENE = "toycar"
POLARIZED = 0.05
"""Degree of polarization from which on an angle is compared: below it means little."""
BILINEAR, EDGE_AWARE, LMMSE, WIENER, CELL = (
    "polanalyser, bilinear",
    "polanalyser, edge-aware",
    "LMMSE",
    "polaropt",
    "polaropt, cell",
)
WAYS = {"mono": (BILINEAR, LMMSE, WIENER, CELL), "color": (BILINEAR, EDGE_AWARE, LMMSE, WIENER, CELL)}


@dataclass(frozen=True)
class Job:
    """The mosaic that a sensor would have seen of a scene: all ways."""

    data: str
    sensor: str
    scene: str = SCENE


@dataclass(frozen=True)
class Row:
    """PSNR in dB of one way, means of the colours.

    Attributes
    ----------
    scene, sensor, way : str
    intensity : float
        Of s0 / 2, white = 1: what a photograph of unpolarized light shows.
    degree : float
        Of the degree of linear polarization.
    angle : float
        Of its angle, 90 degrees being the largest error there is, where the true degree is above `POLARIZED`.
    angle_error_deg : float
        Its mean absolute error there.
    false_share : float
        Of the pixels whose true degree is below `POLARIZED`: those that are shown with twice as much or more.
    """

    scene: str
    sensor: str
    way: str
    intensity: float
    degree: float
    angle: float
    angle_error_deg: float
    false_share: float


def run(job: Job) -> list[Row]:
    """Interpolate one mosaic in all ways."""
    files = [Path(job.data) / FOLDER / f"{job.scene}_{angle:03.0f}.png" for angle in ANGLES_DEG]
    photographs = read_capture(files, white_level=WHITE_16).intensities
    color = job.sensor == "color"
    if not color:
        photographs = photographs.mean(axis=1, keepdims=True)
    sampling, _ = sampling_of(color)
    height, width = (side // sampling.period * sampling.period for side in photographs.shape[-2:])
    truth = np.ascontiguousarray(photographs[..., :height, :width])
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "raw.png"
        write_png(file, np.round(sampling.sample(truth) * WHITE_16).astype(np.uint16))
        return [
            Row(job.scene, job.sensor, way, *_scores(*_both(file, way, job.sensor, truth))) for way in WAYS[job.sensor]
        ]


def _both(file: Path, way: str, sensor: str, truth: Images) -> tuple[Images, Images, int]:
    """Photographs that a way makes of a mosaic, the true ones, and pixels of the sensor per pixel of both."""
    color = sensor == "color"

    def read(resolution: str) -> Capture:
        return read_capture(file, sensor=sensor, resolution=resolution, white_level=WHITE_16, pair_gain=1)

    if way == CELL:
        scale = sampling_of(color)[0].period
        found = read("cell").registered.intensities
        return found.reshape(*truth.shape[:2], *found.shape[-2:]), block_mean(truth, scale), scale
    capture = read("sensor")
    assert capture.samples is not None
    raw = capture.samples.values
    assert capture.origin is not None
    ways: dict[str, Callable[[], Images]] = {
        BILINEAR: lambda: bilinear(raw, color),
        EDGE_AWARE: lambda: edge_aware(raw),
        LMMSE: lambda: trained(color, LENS_BLUR_PX).interpolate(raw, capture.origin.raw_noise or 0),
        WIENER: lambda: capture.intensities,
    }
    return ways[way]().reshape(truth.shape), truth, 1


def _scores(photographs: Images, truth: Images, scale: int) -> tuple[float, float, float, float, float]:
    border = slice(BORDER_PX // scale, -(BORDER_PX // scale))
    found, true = (
        polarization(np.asarray(stokes_from_intensities(images, ANGLES_DEG), dtype=np.float64)[..., border, border])
        for images in (photographs, truth)
    )
    polarized = true.degree > POLARIZED
    turn = np.abs(turn_between(found.angle_deg, true.angle_deg))[polarized]
    return (
        _decibels((found.intensity - true.intensity) / 2),
        _decibels(found.degree - true.degree),
        -10 * math.log10(_mean(np.square(turn / 90))),
        _mean(turn),
        _mean(found.degree[~polarized] > 2 * POLARIZED),
    )


@dataclass(frozen=True)
class Polarization:
    """Intensity, degree and angle of linear polarization of Stokes images (channel, h, w)."""

    intensity: NDArray[np.float64]
    degree: NDArray[np.float64]
    angle_deg: NDArray[np.float64]


def polarization(stokes: NDArray[np.float64]) -> Polarization:
    """What is shown of Stokes images (3, [channel,] h, w); nobody shows more than full polarization."""
    intensity = stokes[0]
    degree = np.hypot(stokes[1], stokes[2]) / np.maximum(intensity, _DARK)
    return Polarization(intensity, np.minimum(degree, 1), np.degrees(np.arctan2(stokes[2], stokes[1])) / 2)


_DARK = 1e-6
"""Intensity (white = 1) below which a degree is not divided by it."""


def _mean(values: NDArray[Any]) -> float:
    """Not a number where nothing is of that kind."""
    return float(values.mean()) if values.size else math.nan


def _decibels(errors: NDArray[np.float64]) -> float:
    """Mean over the colours."""
    return float(np.mean(-10 * np.log10(np.square(errors).mean(axis=(-1, -2)))))


def tables(frame: DataFrame) -> str:
    """A line for each way and sensor."""
    cells: dict[str, Cell] = {
        "s0 (dB)": mean("intensity", ".1f"),
        "degree (dB)": mean("degree", ".1f"),
        "angle (dB)": mean("angle", ".1f"),
        "angle error (deg)": mean("angle_error_deg", ".1f"),
        "false polarization (%)": lambda part: f"{100 * part.false_share.mean():.2f}",
    }
    return markdown(summary(frame, {"scene": "scene", "sensor": "sensor", "way": "way"}, cells))
