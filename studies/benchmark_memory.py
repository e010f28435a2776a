"""Peak memory of `separate`, in processes of its own.

``python -m studies.benchmark_memory FILE.npz [--scene I A S] [--warm]`` separates one capture and prints what it took
as JSON.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from studies.kit.timing import peak_mb, reset_peak, resident_mb

if TYPE_CHECKING:
    from studies.benchmark_record import Measurement, Place
    from studies.benchmark_scenes import Example

TABLE = "memory"
INCIDENCE_DEG = 60.0
ABOVE_IMPORTS = "peak above the imports and the capture"
WITH_CAPTURE = "peak above the imports, capture included"
_ROOT = Path(__file__).parents[1]

Tell = Callable[[str], None]


def measure(place: Place, example: Example, repeats: int, tell: Tell) -> list[Measurement]:
    """Peaks of `separate` with the scene known and blind; also with the kernels loaded before."""
    measurements = []
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "capture.npz"
        capture = example.capture
        np.savez(file, intensities=capture.intensities, angles_deg=capture.angles_deg, valid=capture.valid)
        scene = ["--scene", *(str(value) for value in example.scene.values())]
        for name, arguments in (("known scene", scene), ("blind", [])):
            for warm in (False, True):
                tell(f"{name}, kernels loaded" if warm else name)
                flags = [*arguments, "--warm"] if warm else arguments
                told = [_in_a_process(file, flags) for _ in range(repeats)]
                subject = f"{name}, above the kernels too" if warm else name
                for quantity in told[0]:
                    measurements.append(place.measured(subject, quantity, "MB", [one[quantity] for one in told]))
    return measurements


def _in_a_process(file: Path, arguments: Sequence[str]) -> dict[str, float]:
    command = [sys.executable, "-m", "studies.benchmark_memory", str(file), *arguments]
    # Its errors show.
    ran = subprocess.run(command, cwd=_ROOT, stdout=subprocess.PIPE, text=True, check=True)
    told: dict[str, float] = json.loads(ran.stdout)
    return told


def main(arguments: Sequence[str] | None = None) -> None:
    """Separate one capture and print the peaks."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("file", type=Path, help="npz with intensities, angles_deg, valid")
    parser.add_argument("--scene", type=float, nargs=3, help="incidence and azimuth in degrees, ghost shift in pixels")
    parser.add_argument("--warm", action="store_true", help="load and run all kernels before, on a small piece")
    options = parser.parse_args(arguments)
    import scipy  # noqa: F401 (counted with the imports)

    import polaropt

    scene = polaropt.SceneParameters(*options.scene) if options.scene else None
    archive = np.load(options.file)
    if options.warm:
        piece = polaropt.Capture.of_planes(
            archive["intensities"][..., :64, :64], archive["angles_deg"], archive["valid"][..., :64, :64]
        )
        polaropt.separate(piece, scene)
        del piece
    reset_peak()
    imported = resident_mb()
    capture = polaropt.Capture.of_planes(archive["intensities"], archive["angles_deg"], archive["valid"])
    reset_peak()
    captured = resident_mb()
    result = polaropt.separate(capture, scene)
    peak = peak_mb()
    assert np.isfinite(result.layers).all()
    print(json.dumps({ABOVE_IMPORTS: peak - captured, WITH_CAPTURE: peak - imported, "imports": imported}))


if __name__ == "__main__":
    main()
