"""Yang, Ma, Zheng, Cai, Liu: reflections as weak edges of one photograph, by the package fast-reflection-removal.

"Fast single image reflection suppression via convex optimization", CVPR 2019. The package lives in an environment of
its own that ``make peers`` builds; its result has no scale of its own (it is stretched to [0, 1]).
"""

from __future__ import annotations

import subprocess
import tempfile
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from polaropt.capture import Capture

Images = NDArray[np.float32]

PYTHON = Path(__file__).parents[2] / ".venv-peers" / "bin" / "python"
# Its documentation recommends up to 0.13 and shows 0.11.
STRENGTHS = (0.01, 0.03, 0.06, 0.11)


def built() -> bool:
    """Whether ``make peers`` has been run."""
    return PYTHON.exists()


def suppressed(capture: Capture) -> Images:
    """Transmissions (strength, channel, h, w) of the plain intensity."""
    intensity = capture.stokes[0] if capture.color else capture.stokes[0][None]
    photograph = np.moveaxis(np.clip(intensity, 0, 1), 0, -1).astype(np.float64)
    with tempfile.TemporaryDirectory() as folder:
        source, target = (Path(folder) / name for name in ("image.npy", "transmissions.npy"))
        np.save(source, photograph)
        worker = Path(__file__).with_name("worker.py")
        command = [PYTHON, worker, source, target, *map(str, STRENGTHS)]
        subprocess.run([str(part) for part in command], check=True, capture_output=True)
        found = np.moveaxis(np.load(target), -1, 1)
    return np.asarray(found, dtype=np.float32)
