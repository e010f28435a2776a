"""Raw mosaics as users have them: seconds and memory of reading and separating one file, blind, in a fresh process.

``python -m studies.benchmark.mosaics FILE --small FILE [--sensor S] [--resolution R]`` does it for one file and prints
what it took as JSON. It loads nothing beside what it measures.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from studies.kit.timing import peak_mb, reset_peak, resident_mb

if TYPE_CHECKING:
    from studies.benchmark.rows import Place, Row
    from studies.photographs import Pair

KINDS = {
    "mono": ("mono", "sensor"),
    "color": ("color", "sensor"),
    "mono, cell": ("mono", "cell"),
    "color, cell": ("color", "cell"),
}
"""Sensor, and resolution of the layers."""
WALL, CPU, PEAK = "wall", "CPU", "peak memory"
INCIDENCE_DEG, AZIMUTH_DEG, SHIFT_PX = 60.0, 30.0, 4.0
"""Of the pane before all mosaics."""
NOISE, BITS, LENS_BLUR_PX = 0.005, 12, 0.7
"""Of a sample (white = 1); of its depth, kept in files of 16 bits; of the lens, as the study of mosaics has it."""
SMALL_PX = 128
"""Side of the piece that is separated before, so that all kernels are loaded."""
_ROOT = Path(__file__).parents[2]


def measure_mosaic(place: Place, pair: Pair, repeats: int) -> list[Row]:
    """Seconds and peak memory of one kind, the place's case, at one size."""
    import numpy as np

    from polaropt.capture import WHITE_16, write_png
    from polaropt.optics import SceneParameters
    from polaropt.simulation import Camera, photograph_mosaic

    sensor, resolution = KINDS[place.case]
    camera = Camera(noise=NOISE, bits=BITS, seed=pair.number, lens_blur_px=LENS_BLUR_PX)
    scene = SceneParameters(INCIDENCE_DEG, AZIMUTH_DEG, SHIFT_PX)
    raw = photograph_mosaic(pair.transmission, pair.reflection, scene, camera, sensor == "color")
    values = np.round(np.clip(pair.cropped(raw), 0, 1) * WHITE_16).astype(np.uint16)
    taken: dict[str, list[float]] = {}
    with tempfile.TemporaryDirectory() as folder:
        file, small = Path(folder) / "raw.png", Path(folder) / "small.png"
        write_png(file, values)
        write_png(small, values[:SMALL_PX, :SMALL_PX])
        command = [sys.executable, "-m", "studies.benchmark.mosaics", str(file), "--small", str(small)]
        command += ["--sensor", sensor, "--resolution", resolution]
        for repeat in range(repeats):
            place.say(f"round {repeat + 1} of {repeats}")
            ran = subprocess.run(command, cwd=_ROOT, stdout=subprocess.PIPE, text=True, check=True)
            for quantity, value in json.loads(ran.stdout).items():
                taken.setdefault(quantity, []).append(value)
    units = {WALL: "s", CPU: "s", PEAK: "MB"}
    return [place.measured(place.case, quantity, units[quantity], values) for quantity, values in taken.items()]


def main(arguments: Sequence[str] | None = None) -> None:
    """Read and separate one file, and print what it takes beyond what is loaded."""
    parser = argparse.ArgumentParser(description="Separate one raw mosaic and print the seconds and memory it takes.")
    parser.add_argument("file", type=Path)
    parser.add_argument("--small", type=Path, required=True, help="a piece of it that is separated before")
    parser.add_argument("--sensor", choices=("mono", "color"), default="mono")
    parser.add_argument("--resolution", choices=("sensor", "cell"), default="sensor")
    options = parser.parse_args(arguments)
    import polaropt

    def separated(file: Path) -> polaropt.Separation:
        return polaropt.separate(polaropt.read_capture(file, sensor=options.sensor, resolution=options.resolution))

    separated(options.small)
    reset_peak()
    held, begun = resident_mb(), (time.perf_counter(), time.process_time())
    result = separated(options.file)
    seconds = time.perf_counter() - begun[0], time.process_time() - begun[1]
    peak = peak_mb() - held
    assert result.layers.size
    print(json.dumps({WALL: seconds[0], CPU: seconds[1], PEAK: peak}))


if __name__ == "__main__":
    main()
