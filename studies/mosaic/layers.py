"""Layers from one raw mosaic, at the sensor's resolution, against four full photographs and demosaicking.

The four full photographs are a bound: no mosaic tells as much. Truth is the layers as the lens images them; of a mono
sensor, the mean of their colours.
"""

from __future__ import annotations

import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pandas import DataFrame
from scipy.ndimage import gaussian_filter

from polaropt.capture import ANGLES_DEG, WHITE_16, Capture, Origin, read_capture, sampling_of, write_png
from polaropt.numerics import block_mean
from polaropt.optics import SceneParameters
from polaropt.separation import Separation, separate
from polaropt.simulation import Camera, photograph_mosaic, sensor_image, simulate, stack_layers
from solvers.base import StoppingRule
from studies import ways
from studies.kit.charts import BLUE, ORANGE, VERMILION, Style, legend_below, new_figure
from studies.kit.frames import Cell, joined, largest, markdown, mean, summary, values_of, where
from studies.mosaic.demosaicking import bilinear, trained
from studies.photographs import Pair, pairs_of
from studies.scores import BORDER_PX, LAYERS, pane_errors

Images = NDArray[np.float32]

SIZE_PX, MARGIN_PX = 384, 20
"""Side of the frame: patterns are 2 or 4 px; what is kept beyond it for ghosts to come from."""
INCIDENCES_DEG, QUICK_INCIDENCES_DEG = (40.0, 60.0, 75.0), (60.0,)
SHIFT_PX, NOISE, BITS = 4.0, 0.005, 16
USUAL, DEFECTIVE = "lens blur 0.7 px", "lens blur 0.7 px, defective pixels"
POLARIZED = "lens blur 0.7 px, things polarized"
BLURS_PX = {"sharp": 0.0, USUAL: 0.7, DEFECTIVE: 0.7, POLARIZED: 0.7}
"""Standard deviations of the lens's blur; in the last scenes things behind the pane are polarized by themselves."""
HOT_SHARE, HOT = 5e-4, (0.05, 0.6)
"""Share of the defective sensor's pixels that are hot, and what these add (white = 1)."""
THINGS_DOLP, THINGS_PX = 0.15, 12.0
"""How much, and how large the things are."""
N_PAIRS = 6
# Added to a pair's number for a generator of its own.
_OF_THINGS, _OF_DEFECTS = 1, 2
SENSORS = ("mono", "color")
BOUND, JOINT, CLOSED, LEARNED, FROM_LEARNED, CELL, BILINEAR, LMMSE = WAYS = (
    "four full photographs",
    "joint solve",
    "joint closed form",
    "learned start alone",
    "joint solve from the learned start",
    "cell",
    "demosaicked first",
    "demosaicked first by LMMSE",
)


@dataclass(frozen=True)
class Job:
    """One scene, as one sensor sees it: a pair's number, the pane's incidence, the sensor and the lens's blur."""

    pair: int
    incidence_deg: float
    sensor: str
    lens: str
    photos: str | None = None
    ways: tuple[str, ...] = WAYS


@dataclass(frozen=True)
class Row:
    """What came of one way: PSNR in dB, blind and with the scene known, errors of the scene, seconds of the blind one.

    `nothing` is that of the plain intensity.
    """

    pair: int
    incidence_deg: float
    sensor: str
    lens: str
    way: str
    nothing: float
    blind_transmission: float
    blind_reflection: float
    known_transmission: float
    known_reflection: float
    incidence_error_deg: float
    azimuth_error_deg: float
    shift_error_px: float
    seconds: float
    warnings: tuple[str, ...]


@dataclass(frozen=True)
class Mosaic:
    """A raw mosaic (h, w), the layers that its lens images (2, channel, h, w), the pane, and the four photographs."""

    raw: Images
    layers: Images
    scene: SceneParameters
    photographs: Capture


def run(job: Job) -> list[Row]:
    """Separate one mosaic in all ways."""
    pair = pairs_of(job.photos, SIZE_PX, MARGIN_PX)[job.pair]
    mosaic = take(pair, job)
    rows = []
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "raw.png"
        write_png(file, np.round(np.clip(mosaic.raw, 0, 1) * WHITE_16).astype(np.uint16))
        for way in _ways_of(job):
            began = time.perf_counter()
            capture, scale = _seen(mosaic, way, file, job)
            blind = _separated(capture, way)
            seconds = time.perf_counter() - began
            known = _separated(capture, way, mosaic.scene.scaled(1 / scale))
            truth = block_mean(mosaic.layers, scale) if scale > 1 else mosaic.layers
            errors = pane_errors(blind.scene.scaled(scale), mosaic.scene)
            rows.append(
                Row(
                    job.pair,
                    job.incidence_deg,
                    job.sensor,
                    job.lens,
                    way,
                    _level(capture.stokes[0], truth[0], scale),
                    *(_level(separation.layers[i], truth[i], scale) for separation in (blind, known) for i in (0, 1)),
                    errors.incidence_deg,
                    errors.azimuth_deg,
                    errors.shift_px,
                    seconds,
                    tuple(warning.name for warning in blind.diagnostics.warnings),
                )
            )
    return rows


def _ways_of(job: Job) -> tuple[str, ...]:
    """The job's ways, less the learned start's where its networks were trained on these photographs."""
    learned = ways.LEARNED in ways.judged_starts(job.photos)
    return tuple(way for way in job.ways if learned or way not in (LEARNED, FROM_LEARNED))


def take(pair: Pair, job: Job) -> Mosaic:
    """A pair behind a pane whose azimuth is drawn by its number, as a mosaic and as four photographs."""
    azimuth = float(np.random.default_rng(pair.number).uniform(0, 180))
    scene = SceneParameters(job.incidence_deg, azimuth, SHIFT_PX)
    camera = Camera(ANGLES_DEG, NOISE, BITS, pair.number, BLURS_PX[job.lens])
    color = job.sensor == "color"
    raw = photograph_mosaic(pair.transmission, pair.reflection, scene, camera, color)
    seen = [camera.through_lens(sensor_image(image, color)) for image in (pair.transmission, pair.reflection)]
    layers, larger = stack_layers(*seen), simulate(*seen, scene, ANGLES_DEG, NOISE, BITS, pair.number)
    if job.lens == POLARIZED:
        light = _light_of_things(layers[0], pair.number)
        raw += sampling_of(color)[0].sample(light.reshape(len(light), -1, *raw.shape))
        larger = larger.replace(intensities=larger.intensities + light.reshape(larger.intensities.shape))
    if job.lens == DEFECTIVE:
        random = np.random.default_rng((pair.number, _OF_DEFECTS))
        raw += (random.uniform(size=raw.shape) < HOT_SHARE) * random.uniform(*HOT, raw.shape).astype(np.float32)
    inside = (slice(pair.margin, -pair.margin),) * 2
    return Mosaic(
        np.ascontiguousarray(raw[inside]),
        np.ascontiguousarray(pair.cropped(layers)),
        scene,
        larger.part(*(slice(side.start, SIZE_PX + pair.margin) for side in inside)),
    )


def _light_of_things(behind: Images, number: int) -> Images:
    """What photographs (k, [channel,] h, w) have more where things behind the pane are polarized, all in one direction.

    Half of the scene ([channel,] h, w) are such things, with soft borders, wherever its edges are.
    """
    random = np.random.default_rng((number, _OF_THINGS))
    direction_deg = random.uniform(0, 180)
    things = gaussian_filter(random.standard_normal(behind.shape[-2:]), THINGS_PX) > 0
    cosines = np.cos(2 * np.radians(np.subtract(ANGLES_DEG, direction_deg)))
    polarized = 0.5 * THINGS_DOLP * gaussian_filter(things.astype(np.float32), 1.0) * behind
    return np.multiply.outer(cosines, polarized).astype(np.float32)


def _seen(mosaic: Mosaic, way: str, file: Path, job: Job) -> tuple[Capture, int]:
    """The capture that a way works on, and pixels of the sensor per pixel of it."""
    color = job.sensor == "color"
    if way == BOUND:
        return mosaic.photographs, 1
    if way == BILINEAR:
        return Capture.of_planes(bilinear(mosaic.raw, color), ANGLES_DEG), 1
    if way == LMMSE:
        covariances = trained(color, BLURS_PX[job.lens], job.pair if job.photos is None else None)
        # Beside edges they swing below black. They are Stokes vectors, so that nothing in them tells the noise.
        photographs = np.maximum(covariances.interpolate(mosaic.raw, NOISE), 0)
        return Capture.of_planes(photographs, ANGLES_DEG, origin=Origin(raw_noise=NOISE)), 1
    if way == CELL:
        return read_capture(file, sensor=job.sensor, resolution="cell"), 4 if color else 2
    return read_capture(file, sensor=job.sensor), 1


def _separated(capture: Capture, way: str, scene: SceneParameters | None = None) -> Separation:
    stopping = StoppingRule(max_evaluations=1) if way in (CLOSED, LEARNED) else StoppingRule()
    start = ways.LEARNED if way in (LEARNED, FROM_LEARNED) else ways.CLOSED_FORM_START
    return separate(capture, scene, init=start, stopping=stopping)


def _level(layer: Images, truth: Images, scale: int) -> float:
    """PSNR in dB within the border, mean of the colours'."""
    inner = (..., slice(BORDER_PX // scale, -(BORDER_PX // scale)), slice(BORDER_PX // scale, -(BORDER_PX // scale)))
    found = np.clip(layer.reshape(truth.shape)[inner], 0, 1).astype(np.float64)
    errors = np.square(found - np.clip(truth[inner], 0, 1)).mean(axis=(-1, -2))
    return float(np.mean(-10 * np.log10(np.maximum(errors, 1e-12))))


def tables(frame: DataFrame) -> str:
    """Means per sensor, lens, incidence and way."""
    cells: dict[str, Cell] = {
        "s0": mean("nothing", ".1f"),
        "blind T / R": joined(mean("blind_transmission", ".1f"), mean("blind_reflection", ".1f")),
        "known T / R": joined(mean("known_transmission", ".1f"), mean("known_reflection", ".1f")),
        "worst T": lambda part: f"{part.blind_transmission.min():.1f}",
        "worst against s0": lambda part: f"{(part.blind_transmission - part.nothing).min():+.1f}",
        "theta error (mean, largest)": joined(mean("incidence_error_deg"), largest("incidence_error_deg")),
        "shift error": mean("shift_error_px"),
        "s": mean("seconds", ".1f"),
    }
    by = {"sensor": "sensor", "lens": "lens", "theta": "incidence_deg", "way": "way"}
    ordered = frame.sort_values(["sensor", "lens", "incidence_deg"], ascending=[False, True, True], kind="stable")
    return markdown(summary(ordered, by, cells))


_STYLES = {
    BOUND: Style("grey", "--", "x"),
    JOINT: Style("black", "-", "o", 2.4),
    CLOSED: Style(BLUE, "--", "s"),
    BILINEAR: Style(VERMILION, ":", "^"),
    LMMSE: Style(ORANGE, "-.", "v"),
}


def figures(frame: DataFrame) -> dict[str, Callable[[], Any]]:
    """Blind PSNR of both layers over incidence."""
    return {"mosaic": lambda: _levels(frame)}


def _levels(frame: DataFrame) -> Any:
    """A row of panels for each sensor and lens; what differs in resolution is not drawn beside the rest."""
    kinds = values_of(frame, "sensor", "lens")
    figure = new_figure(10, 0.8 + 3.0 * len(kinds))
    grid = figure.subplots(len(kinds), len(LAYERS), squeeze=False, sharex=True, sharey="col")
    for panels, (sensor, lens) in zip(grid, kinds, strict=True):
        part = where(frame, sensor=sensor, lens=lens)
        for panel, layer in zip(panels, LAYERS, strict=True):
            for way, style in _STYLES.items():
                means = where(part, way=way).groupby("incidence_deg")[f"blind_{layer}"].mean()
                panel.plot(means.index, means, label=way, **style.line)
            panel.set_title(f"{sensor}, {lens}")
            panel.set_ylabel(f"PSNR of the {layer} (dB)")
            panel.set_xticks(values_of(part, "incidence_deg"))
    for panel in grid[-1]:
        panel.set_xlabel("angle of incidence (deg)")
    handles, names = grid[0, 0].get_legend_handles_labels()
    legend_below(figure, handles, names, len(names), handlelength=4)
    return figure
