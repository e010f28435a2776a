"""Seconds that importing takes, and that ``polaropt --help`` takes, in fresh interpreters."""

from __future__ import annotations

import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

from studies.benchmark_record import Measurement, Place

TABLE = "imports"
NUMPY_SCIPY = "import numpy, scipy"
POLAROPT = "import polaropt"
SEPARATE = "from polaropt import separate"
HELP = "polaropt --help"
BARE_HELP = "--help of a minimal typer command"
_ROOT = Path(__file__).parents[1]

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

Tell = Callable[[str], None]


def measure(place: Place, repeats: int, tell: Tell) -> list[Measurement]:
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
            tell(f"round {repeat} of {repeats}")
            for name, call in subjects.items():
                seconds = call()
                if repeat:
                    samples[name].append(seconds)
    return [place.measured(name, "wall", "s", values) for name, values in samples.items()]


def _inside(statement: str) -> float:
    ran = subprocess.run(
        [sys.executable, "-c", _TIMED.format(statement)], cwd=_ROOT, capture_output=True, text=True, check=True
    )
    return float(ran.stdout)


def _outside(command: list[str]) -> float:
    begun = time.perf_counter()
    subprocess.run(command, cwd=_ROOT, capture_output=True, check=True)
    return time.perf_counter() - begun


def _command() -> list[str]:
    """The installed command, or the module where it is not installed."""
    installed = Path(sys.executable).with_name("polaropt")
    return [str(installed)] if installed.exists() else [sys.executable, "-m", "polaropt"]
