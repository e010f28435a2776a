"""What fresh processes take: the peak memory of `separate`, and the seconds of imports and of ``polaropt --help``.

``python -m studies.benchmark.processes FILE.npz [--scene I A S] [--warm]`` separates one capture and prints what it
took as JSON. It loads nothing beside what it measures.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from studies.kit.timing import peak_mb, reset_peak, resident_mb

if TYPE_CHECKING:
    from studies.benchmark.rows import Place, Row
    from studies.camera import Sample

ABOVE_IMPORTS = "peak above the imports and the capture"
WITH_CAPTURE = "peak above the imports, capture included"
NUMPY_SCIPY = "import numpy, scipy"
POLAROPT = "import polaropt"
SEPARATE = "from polaropt import separate"
HELP = "polaropt --help"
BARE_HELP = "--help of a minimal typer command"
_ROOT = Path(__file__).parents[2]
_WARM_PX = 64

# Timed inside: the interpreter's own start is in neither.
_TIMED = "import time; begun = time.perf_counter(); {}; print(time.perf_counter() - begun)"
_MINIMAL = """import typer
app = typer.Typer(add_completion=False)
@app.command()
def hello(name: str = "x") -> None:
    "Say hello."
@app.command()
def bye(name: str = "x") -> None:
    "Say bye."
app()
"""


def measure_imports(place: Place, repeats: int) -> list[Row]:
    """The imports and both helps, interleaved; the first round only fills the file caches.

    polaropt resolves its names when they are first used, so that importing one of them is measured beside the package.
    """
    with tempfile.TemporaryDirectory() as folder:
        minimal = Path(folder) / "minimal.py"
        minimal.write_text(_MINIMAL, encoding="utf-8")
        subjects: dict[str, Callable[[], float]] = {
            NUMPY_SCIPY: lambda: _inside(NUMPY_SCIPY),
            POLAROPT: lambda: _inside(POLAROPT),
            SEPARATE: lambda: _inside(SEPARATE),
            BARE_HELP: lambda: _outside([sys.executable, str(minimal), "--help"]),
            HELP: lambda: _outside([*_command(), "--help"]),
        }
        samples: dict[str, list[float]] = {name: [] for name in subjects}
        for repeat in range(repeats + 1):
            place.say(f"round {repeat} of {repeats}")
            for name, call in subjects.items():
                seconds = call()
                if repeat:
                    samples[name].append(seconds)
    return [place.measured(name, "wall", "s", values) for name, values in samples.items()]


def _inside(statement: str) -> float:
    return float(_run([sys.executable, "-c", _TIMED.format(statement)]))


def _outside(command: list[str]) -> float:
    begun = time.perf_counter()
    _run(command)
    return time.perf_counter() - begun


def _run(command: Sequence[str]) -> str:
    """What a command prints; its errors show."""
    return subprocess.run(command, cwd=_ROOT, stdout=subprocess.PIPE, text=True, check=True).stdout


def _command() -> list[str]:
    """The installed command, or the module where it is not installed."""
    installed = Path(sys.executable).with_name("polaropt")
    return [str(installed)] if installed.exists() else [sys.executable, "-m", "polaropt"]


def measure_memory(place: Place, sample: Sample, repeats: int) -> list[Row]:
    """Peaks of `separate` with the scene known and blind; also with the kernels loaded before."""
    rows = []
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "capture.npz"
        capture = sample.capture
        np.savez(file, intensities=capture.intensities, angles_deg=capture.angles_deg, valid=capture.valid)
        command = [sys.executable, "-m", "studies.benchmark.processes", str(file)]
        scene = ["--scene", *(str(value) for value in sample.scene.values())]
        for name, flags in (("known scene", scene), ("blind", [])):
            for subject, more in ((name, []), (f"{name}, above the kernels too", ["--warm"])):
                place.say(subject)
                peaks = [json.loads(_run([*command, *flags, *more])) for _ in range(repeats)]
                rows += [
                    place.measured(subject, quantity, "MB", [peak[quantity] for peak in peaks]) for quantity in peaks[0]
                ]
    return rows


def main(arguments: Sequence[str] | None = None) -> None:
    """Separate one capture and print the peaks."""
    parser = argparse.ArgumentParser(description="Separate one capture and print the memory that it takes.")
    parser.add_argument("file", type=Path, help="npz with intensities, angles_deg, valid")
    parser.add_argument("--scene", type=float, nargs=3, help="incidence and azimuth in degrees, ghost shift in pixels")
    parser.add_argument("--warm", action="store_true", help="load and run all kernels before, on a small piece")
    options = parser.parse_args(arguments)
    import scipy  # noqa: F401 (counted with the imports)

    import polaropt

    scene = polaropt.SceneParameters(*options.scene) if options.scene else None
    archive = np.load(options.file)

    def photographs(part: slice) -> polaropt.Capture:
        intensities, valid = (archive[name][..., part, part] for name in ("intensities", "valid"))
        return polaropt.Capture.of_planes(intensities, archive["angles_deg"], valid)

    if options.warm:
        polaropt.separate(photographs(slice(_WARM_PX)), scene)
    reset_peak()
    imported = resident_mb()
    capture = photographs(slice(None))
    reset_peak()
    captured = resident_mb()
    result = polaropt.separate(capture, scene)
    peak = peak_mb()
    assert np.isfinite(result.layers).all()
    print(json.dumps({ABOVE_IMPORTS: peak - captured, WITH_CAPTURE: peak - imported, "imports": imported}))


if __name__ == "__main__":
    main()
