"""What a study writes down: its rows, and the machine, versions, seeds and settings they were found with."""

from __future__ import annotations

import csv
import hashlib
import importlib.metadata
import json
import os
import platform
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

_LIBRARIES = (
    "numpy", "scipy", "numba", "torch", "nlopt", "casadi", "array-api-compat", "scikit-image", "scikit-learn",
    "matplotlib",
)  # fmt: skip
_THREAD_VARIABLES = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "OMP_WAIT_POLICY")
_ROOT = Path(__file__).parents[1]
_SAME = ("settings", "sources", "machine")


def metadata(settings: dict[str, Any], processes: str = "1") -> dict[str, Any]:
    """Settings, machine, system, versions, threads and commit, as JSON gives them back.

    Of several processes each has one thread.
    """
    from solvers.kernels import thread_count

    told = {
        "command": _command(sys.argv),
        "settings": settings,
        "machine": {"cpu": _cpu_model(), "cores": os.cpu_count(), "memory_gib": round(_memory_bytes() / 2**30, 1)},
        "gpu": _gpu(),
        "system": platform.platform(),
        "python": platform.python_version(),
        "libraries": {name: _version(name) for name in _LIBRARIES},
        "threads": {
            "processes": processes,
            "polaropt": thread_count() if processes == "1" else 1,
            "torch": _torch_threads() if processes == "1" else 1,
            "blas": "1 in polaropt's solves, as `separate` has it; else as the library has it",
            **{name: os.environ.get(name, "") for name in _THREAD_VARIABLES},
        },
        "commit": _git("rev-parse", "HEAD"),
        "sources": _digest(),
        "modified": bool(_git("status", "--porcelain", "--untracked-files=no")),
        "seeds": "noise and azimuth of a scene are seeded by the pair's number (studies.protocol)",
    }
    read_back: dict[str, Any] = json.loads(json.dumps(told))
    return read_back


def write_document(path: Path, metadata: dict[str, Any], rows: Sequence[dict[str, Any]]) -> None:
    """Write rows as JSON (its form: ``record.schema.json``), at once, so that breaking off leaves a whole file."""
    text = json.dumps({"metadata": metadata, "results": list(rows)}, indent=1, allow_nan=False) + "\n"
    partial = path.with_suffix(".partial")
    partial.write_text(text, encoding="utf-8")
    partial.replace(path)


def earlier_rows(path: Path, metadata: dict[str, Any]) -> list[dict[str, Any]]:
    """Rows of a run that was broken off, if it had the same settings, sources and machine."""
    if not path.exists():
        return []
    document = json.loads(path.read_text(encoding="utf-8"))
    if any(document["metadata"].get(name) != metadata[name] for name in _SAME):
        return []
    rows: list[dict[str, Any]] = document["results"]
    return rows


def origin(path: Path) -> str:
    """The command that made a document, and on what it ran, as Markdown."""
    metadata = json.loads(path.read_text(encoding="utf-8"))["metadata"]
    machine = metadata["machine"]
    return f"`{metadata['command']}`, on {machine['cores']} cores ({machine['cpu'].split(' (')[0]})."


def write_csv(path: Path, rows: Sequence[dict[str, Any]]) -> None:
    """Write rows as CSV; several values in one field are set apart by spaces."""
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.DictWriter(file, list(rows[0]) if rows else [])
        writer.writeheader()
        for row in rows:
            writer.writerow({k: " ".join(map(str, v)) if isinstance(v, (list, tuple)) else v for k, v in row.items()})


def write_tables(out: Path, name: str, rows: Sequence[dict[str, Any]], table: str) -> None:
    """Write a study's rows as CSV and its table as Markdown; the rows' JSON is there already."""
    write_csv(out / f"{name}.csv", rows)
    (out / f"{name}.md").write_text(table + "\n", encoding="utf-8")


def _command(arguments: Sequence[str]) -> str:
    """As a person types it; of folders the name alone is told."""
    words = [f"polaropt study {Path(arguments[0]).stem}"]
    for before, word in zip(["", *arguments[1:]], arguments[1:], strict=False):
        words.append("OUT" if before in ("-o", "--out") else Path(word).name if "/" in word else word)
    return " ".join(words)


def _digest() -> str:
    """Of all sources: rows that other code has made are no rows of this run."""
    digest = hashlib.sha256()
    for package in ("polaropt", "priors", "solvers", "studies"):
        for file in sorted((_ROOT / package).rglob("*.py")):
            digest.update(file.read_bytes())
    return digest.hexdigest()[:16]


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
