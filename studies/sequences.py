"""Films of a polarization camera through one pane: frames per second, how steady their layers are, and how good.

Run ``polaropt study sequences -o OUT``; without ``--photos`` it uses photographs inside scikit-image. The camera stands
still, or turns, so that both scenes pass by at speeds of their own. Frames are raw mosaics as a camera gives them, and
what is timed begins with these. A pane that is "known" is given and stays, one that is "followed" is found from the
first frames.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray
from pandas import DataFrame

from polaropt.capture import FrameReader
from polaropt.kernels import compile_kernels
from polaropt.numerics import block_mean
from polaropt.optics import SceneParameters
from polaropt.separation import Separation, separate
from polaropt.sequence import flicker, separate_sequence
from polaropt.simulation import Camera, photograph_mosaic, sensor_image, stack_layers
from studies.kit.charts import BLUE, ORANGE, new_figure
from studies.kit.frames import markdown, summary
from studies.kit.run import effort_of, publish, run_study, study_parser
from studies.kit.timing import Clock
from studies.photographs import Pair, Photographs, Size, n_pairs_of, sized_pair
from studies.scores import both_psnr

NAME = "sequences"
Images = NDArray[np.float32]

NOISE, BITS, LENS_BLUR_PX = 0.005, 12, 0.7
PANE = SceneParameters(60.0, 20.0, 4.0)
"""Its ghost shift is in pixels of the sensor."""
_SPEEDS_PX = ((2, 1), (-1, 2))
"""Rows and columns by which the scene behind the pane and the mirrored one pass by from frame to frame, where the
camera turns."""
FRAMES = {"quick": 4, "default": 12, "full": 12}
ALONE = 3
"""Frames that are separated each by itself as well, to see what noise does to layers."""


@dataclass(frozen=True)
class Sensor:
    """A camera's sensor and the resolution of the layers: one pixel for each cell, or for each pixel of the sensor."""

    kind: Literal["mono", "color"]
    size: Size
    resolution: Literal["cell", "sensor"]

    @property
    def scale(self) -> int:
        """Pixels of the sensor along a side for each of the layers."""
        if self.resolution == "sensor":
            return 1
        return 4 if self.kind == "color" else 2

    @property
    def layers_size(self) -> Size:
        """Of the layers."""
        return Size(self.size.height // self.scale, self.size.width // self.scale)


_CELLS = (
    Sensor("mono", Size(1024, 1224), "cell"),
    Sensor("color", Size(2048, 2448), "cell"),
    Sensor("mono", Size(2048, 2448), "cell"),
)
SENSORS = {
    "quick": (Sensor("mono", Size(256, 256), "cell"),),
    "default": _CELLS,
    "full": (*_CELLS, Sensor("mono", Size(1024, 1224), "sensor"), Sensor("color", Size(1024, 1224), "sensor")),
}
"""Those of the cameras that there are, whole and a quarter."""


Way = tuple[Literal["still", "turning"], Literal["known", "followed"]]
WAYS: dict[str, tuple[Way, ...]] = {
    "cell": (("still", "known"), ("turning", "known"), ("turning", "followed")),
    "sensor": (("turning", "known"),),
}
"""Whether the camera turns, and what is known of the pane."""


@dataclass(frozen=True)
class Job:
    """One film, separated one way."""

    photos: str | None
    pair: int
    sensor: Sensor
    motion: Literal["still", "turning"]
    pane: Literal["known", "followed"]
    frames: int


@dataclass(frozen=True)
class Row:
    """One film.

    Attributes
    ----------
    sensor, resolution, size, motion, pane : str
        Size is that of the layers.
    pair, frames : int
    first_s, s, cpu_s : float
        Seconds until the first frame is there; mean seconds of the others, and those of the processor in all threads.
    transmission, reflection : float
        Mean PSNR in dB.
    change_transmission, change_reflection : float or None
        Change of the layers from frame to frame (rms) in units of what noise makes of frames that are separated each by
        itself; None where the scene moves.
    """

    sensor: str
    resolution: str
    size: str
    motion: str
    pane: str
    pair: int
    frames: int
    first_s: float
    s: float
    cpu_s: float
    transmission: float
    reflection: float
    change_transmission: float | None
    change_reflection: float | None


@dataclass(frozen=True)
class Film:
    """Raw mosaics (h, w), the true layers (2, channel, h, w) of each, and the pane in pixels of the layers."""

    raw: list[Images]
    layers: list[Images]
    scene: SceneParameters


def film(job: Job) -> Film:
    """A pair of photographs as they are filmed through the pane; noise is seeded by pair and frame."""
    pair = sized_pair(Photographs(job.photos, job.pair), job.sensor.size)
    raw, layers = [], []
    for k in range(job.frames):
        seen = _turned(pair, k - job.frames // 2) if job.motion == "turning" else pair
        seed = np.random.SeedSequence([job.pair, k]).generate_state(1)[0]
        camera = Camera(noise=NOISE, bits=BITS, seed=int(seed), lens_blur_px=LENS_BLUR_PX)
        whole = photograph_mosaic(seen.transmission, seen.reflection, PANE, camera, job.sensor.kind == "color")
        raw.append(np.ascontiguousarray(seen.cropped(whole[None])[0]))
        layers.append(true_layers(seen, camera, job.sensor))
    return Film(raw, layers, PANE.scaled(1 / job.sensor.scale))


def _turned(pair: Pair, k: int) -> Pair:
    """What a frame shows of the larger photographs, k frames after the one in their middle."""
    moved = [
        np.roll(image, (k * down, k * right), axis=(0, 1))
        for image, (down, right) in zip((pair.transmission, pair.reflection), _SPEEDS_PX, strict=True)
    ]
    return replace(pair, transmission=moved[0], reflection=moved[1])


def true_layers(pair: Pair, camera: Camera, sensor: Sensor) -> Images:
    """Layers (2, channel, h, w) as the lens images them, their means over cells where a cell is one pixel."""
    images = (sensor_image(image, sensor.kind == "color") for image in (pair.transmission, pair.reflection))
    layers = stack_layers(*map(camera.through_lens, images))
    cells = block_mean(pair.cropped(layers), sensor.scale)
    return np.asarray(cells.reshape(2, -1, *cells.shape[-2:]))


def run(job: Job) -> list[Row]:
    """Separate one film."""
    shown = film(job)
    scene = shown.scene if job.pane == "known" else None
    clock = Clock()
    frames = separate_sequence(_captures(job, shown), scene, pane="still" if scene is not None else "follow")
    levels, results = [], list[Separation]()
    first_s = cpu_s = 0.0
    for k, result in enumerate(frames):
        if k == 0:
            first_s, cpu_s = clock.read()
        with clock.paused():
            levels.append(both_psnr(result.layers.reshape(shown.layers[k].shape), shown.layers[k]))
            results = [*results[-ALONE + 1 :], result]
    total_s, total_cpu_s = clock.read()
    others = job.frames - 1
    change = _change(job, shown, results) if job.motion == "still" else (None, None)
    sensor, means = job.sensor, np.mean(levels, axis=0)
    return [
        Row(
            sensor.kind, sensor.resolution, str(sensor.layers_size), job.motion, job.pane, job.pair, job.frames,
            first_s, (total_s - first_s) / others, (total_cpu_s - cpu_s) / others, float(means[0]), float(means[1]),
            *change,
        )
    ]  # fmt: skip


def _captures(job: Job, shown: Film) -> Any:
    """Captures of a film's frames, as the camera's reader makes them."""
    reader = FrameReader(resolution=job.sensor.resolution, sensor=job.sensor.kind, white_level=1.0, gamma=1.0)
    return map(reader.read, shown.raw)


def _change(job: Job, shown: Film, results: Sequence[Separation]) -> tuple[float, float]:
    """Change of both layers from frame to frame, in units of that of frames that are separated each by itself."""
    last = replace(shown, raw=shown.raw[-len(results) :])
    alone = flicker(separate(capture, shown.scene) for capture in _captures(job, last))
    seen = flicker(results)
    return seen[0] / alone[0], seen[1] / alone[1]


def tables(frame: DataFrame) -> str:
    """A line for each kind of film."""

    def mean(column: str, form: str) -> Callable[[DataFrame], str]:
        return lambda part: "-" if part[column].isna().any() else format(float(part[column].astype(float).mean()), form)

    cells = {
        "frames per second": lambda part: f"{1 / part.s.mean():.2g}",
        "s": mean("s", ".2f"),
        "processor s": mean("cpu_s", ".2f"),
        "first frame s": mean("first_s", ".1f"),
        "T": mean("transmission", ".1f"),
        "R": mean("reflection", ".1f"),
        "change of T": mean("change_transmission", ".2f"),
        "change of R": mean("change_reflection", ".2f"),
    }
    groups = {name: name for name in ("sensor", "resolution", "size", "motion", "pane")}
    notes = (
        "Seconds are those of a frame after the first, with all cores. T and R in dB, means of the frames. Change: of "
        "layers from frame to frame while nothing moves, in units of what noise does to frames that are separated each "
        "by itself with the pane known."
    )
    return f"{notes}\n\n{markdown(summary(frame, groups, cells))}"


def figures(frame: DataFrame) -> dict[str, Callable[[], Any]]:
    """Frames per second of each kind of film."""
    return {NAME: lambda: _speeds(frame)}


def _speeds(frame: DataFrame) -> Any:
    kinds = frame.groupby(["sensor", "resolution", "size"], sort=False)
    figure = new_figure(8, 0.9 + 0.7 * len(kinds))
    axes = figure.subplots()
    ways = [("known", "still", BLUE), ("known", "turning", ORANGE), ("followed", "turning", "#999999")]
    height = 0.8 / len(ways)
    names = []
    for place, (key, part) in enumerate(kinds):
        names.append("{} {}, {}".format(*key))
        for k, (pane, motion, color) in enumerate(ways):
            seconds = part[(part.pane == pane) & (part.motion == motion)].s
            if len(seconds):
                label = f"pane {pane}, camera {motion}" if place == 0 else None
                axes.barh(place + (k - 1) * height, 1 / seconds.mean(), height, color=color, label=label)
    axes.set_yticks(range(len(names)), names)
    axes.invert_yaxis()
    axes.set_xlabel("frames per second")
    figure.legend(loc="outside lower center", ncols=len(ways), frameon=False)
    return figure


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the study."""
    options = study_parser(__doc__).parse_args(arguments)
    effort = effort_of(options)
    compile_kernels()
    pairs = n_pairs_of(options, 1)
    jobs = [
        Job(options.photos, pair, sensor, motion, pane, FRAMES[effort])
        for sensor in SENSORS[effort]
        for motion, pane in WAYS[sensor.resolution]
        for pair in range(pairs)
    ]
    frame = run_study(NAME, run, jobs, Row, options)
    publish(NAME, options, tables(frame), figures(frame))


if __name__ == "__main__":
    main()
