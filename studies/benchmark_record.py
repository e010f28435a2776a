"""What the benchmark writes down: measurements, the machine they were taken on, and the file that holds both."""

from __future__ import annotations

import importlib.metadata
import json
import math
import os
import platform
import subprocess
import sys
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

_LIBRARIES = ("numpy", "scipy", "numba", "torch", "nlopt", "casadi", "array-api-compat", "scikit-image", "matplotlib")
_THREAD_VARIABLES = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "OMP_WAIT_POLICY")
_ROOT = Path(__file__).parents[1]


@dataclass(frozen=True)
class Measurement:
    """One quantity of one subject.

    Attributes
    ----------
    table, case, size, subject, quantity, unit : str
        What was measured, on what, of whom.
    samples : tuple of float
        One per repeat; of a curve one per evaluation.
    bound : {"", ">="}
        ">=": the true value is larger, since the run was cut off.
    note : str
        Why there is no sample, or what else must be known.
    """

    table: str
    case: str
    size: str
    subject: str
    quantity: str
    unit: str
    samples: tuple[float, ...] = ()
    bound: str = ""
    note: str = ""

    @property
    def median(self) -> float:
        """Median of the repeats, NaN without any."""
        return float(np.median(self.samples)) if self.samples else math.nan

    @property
    def spread(self) -> tuple[float, float]:
        """The least and the largest of the repeats."""
        return (min(self.samples), max(self.samples)) if self.samples else (math.nan, math.nan)


@dataclass(frozen=True)
class Place:
    """Where measurements belong: one task of the benchmark yields those of one place."""

    table: str
    case: str
    size: str

    def measured(
        self, subject: str, quantity: str, unit: str, samples: Iterable[float], bound: str = "", note: str = ""
    ) -> Measurement:
        """A measurement taken here."""
        values = tuple(float(sample) for sample in samples)
        return Measurement(self.table, self.case, self.size, subject, quantity, unit, values, bound, note)


class Record:
    """All measurements so far, in ``benchmark.json``.

    Parameters
    ----------
    path : Path
    settings : dict
        What was asked for; measurements taken with others, or at another commit, are not taken over.
    """

    def __init__(self, path: Path, settings: dict[str, Any]) -> None:
        self._path = path
        # As it is read back: tuples become lists.
        self.metadata = json.loads(json.dumps({"settings": settings, **metadata()}))
        self.measurements = _earlier(path, self.metadata)

    def has(self, place: Place) -> bool:
        """Whether a task was done before."""
        return any((m.table, m.case, m.size) == (place.table, place.case, place.size) for m in self.measurements)

    def add(self, measurements: Sequence[Measurement]) -> None:
        """Take in what a task has measured, and write the file."""
        self.measurements.extend(measurements)
        document = {"metadata": self.metadata, "results": [_row(m) for m in self.measurements]}
        text = json.dumps(document, indent=1, allow_nan=False) + "\n"
        partial = self._path.with_suffix(".partial")
        partial.write_text(text, encoding="utf-8")
        partial.replace(self._path)

    def find(self, **wanted: str) -> list[Measurement]:
        """Measurements whose fields have these values."""
        return [m for m in self.measurements if all(getattr(m, name) == value for name, value in wanted.items())]


def metadata() -> dict[str, Any]:
    """Machine, system, versions, threads and commit."""
    from solvers.blocks import thread_count

    return {
        "machine": {"cpu": _cpu_model(), "cores": os.cpu_count(), "memory_gib": round(_memory_bytes() / 2**30, 1)},
        "gpu": _gpu(),
        "system": platform.platform(),
        "python": platform.python_version(),
        "libraries": {name: _version(name) for name in _LIBRARIES},
        "threads": {
            "polaropt": thread_count(),
            "torch": _torch_threads(),
            "blas": "1 in polaropt's solves, as `separate` has it; else as the library has it",
            **{name: os.environ.get(name, "") for name in _THREAD_VARIABLES},
        },
        "commit": _git("rev-parse", "HEAD"),
        "modified": bool(_git("status", "--porcelain", "--untracked-files=no")),
        "seeds": "noise and azimuth of a scene are seeded by the pair's number (studies.protocol)",
    }


def _row(measurement: Measurement) -> dict[str, Any]:
    row = asdict(measurement)
    if measurement.samples:
        low, high = measurement.spread
        row |= {"median": measurement.median, "low": low, "high": high}
    return row


def _earlier(path: Path, current: dict[str, Any]) -> list[Measurement]:
    """Measurements of a run that was broken off, if it had the same settings and sources."""
    if not path.exists():
        return []
    document = json.loads(path.read_text(encoding="utf-8"))
    if any(document["metadata"].get(name) != current[name] for name in ("settings", "commit", "machine")):
        return []
    fields = Measurement.__dataclass_fields__
    rows = ({name: row[name] for name in fields} for row in document["results"])
    return [Measurement(**{**row, "samples": tuple(row["samples"])}) for row in rows]


def _cpu_model() -> str:
    """The processor's name, with family and model where the name alone does not tell."""
    told: dict[str, str] = {}
    try:
        for line in Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines():
            name, _, value = line.partition(":")
            told.setdefault(name.strip(), value.strip())
    except OSError:
        return platform.processor() or platform.machine()
    return f"{told.get('model name', '?')} (family {told.get('cpu family', '?')}, model {told.get('model', '?')})"


def _memory_bytes() -> int:
    return os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")


def _gpu() -> str:
    if "torch" not in sys.modules and _version("torch") == "":
        return ""
    import torch

    return torch.cuda.get_device_name() if torch.cuda.is_available() else "none"


def _torch_threads() -> int:
    if _version("torch") == "":
        return 0
    import torch

    return int(torch.get_num_threads())


def _version(name: str) -> str:
    try:
        return importlib.metadata.version(name)
    except importlib.metadata.PackageNotFoundError:
        return ""


def _git(*arguments: str) -> str:
    try:
        ran = subprocess.run(["git", *arguments], cwd=_ROOT, capture_output=True, text=True, check=True)
    except (OSError, subprocess.CalledProcessError):
        return ""
    return ran.stdout.strip()
