"""What a study writes down: its rows, and the machine, versions, seeds and settings they were found with.

A document is a JSON file of the form ``record.schema.json``: metadata, and one object for each row.
"""

from __future__ import annotations

import csv
import hashlib
import importlib.metadata
import json
import math
import os
import platform
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any, TypeVar

Row = TypeVar("Row")

_LIBRARIES = (
    "numpy", "scipy", "numba", "torch", "nlopt", "casadi", "array-api-compat", "scikit-image", "scikit-learn",
    "matplotlib", "pandas",
)  # fmt: skip
_THREAD_VARIABLES = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "OMP_WAIT_POLICY")
_ROOT = Path(__file__).parents[2]
_SAME = ("settings", "sources", "machine")
"""Of the metadata: what must be the same for rows of an earlier run to count in this one."""
_COMMIT_DIGITS = 9
# Keeping the results of one study changes these, and not what the next one runs.
_NO_CODE = (":!studies/results", ":!*.md")


def metadata(settings: dict[str, Any], processes: str = "1") -> dict[str, Any]:
    """Settings, machine, system, versions, threads and commit, as JSON gives them back.

    Of several processes each has one thread.
    """
    from solvers.kernels import thread_count

    document = {
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
        "modified": bool(_git("status", "--porcelain", "--untracked-files=no", "--", ".", *_NO_CODE)),
        "seeds": "noise and azimuth of a scene are seeded by the pair's number (studies.scenes)",
    }
    as_written: dict[str, Any] = json.loads(json.dumps(document))
    return as_written


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


def origin(metadata: dict[str, Any]) -> str:
    """The command that made a document, on what it ran and from which code, as Markdown."""
    machine = metadata["machine"]
    where = f"on {machine['cores']} cores ({machine['cpu'].split(' (')[0]})"
    return f"`{metadata['command']}`, {where}, {code_state(metadata)}."


def code_state(metadata: dict[str, Any]) -> str:
    """The commit that a document's rows come from, and whether the code differed from it."""
    commit = metadata["commit"][:_COMMIT_DIGITS] or "unknown"
    return f"commit {commit}" + (f", modified (sources {metadata['sources']})" if metadata["modified"] else "")


def read_metadata(path: Path) -> dict[str, Any]:
    """Of a document."""
    metadata: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))["metadata"]
    return metadata


def write_csv(path: Path, rows: Sequence[dict[str, Any]]) -> None:
    """Write rows as CSV; several values in one field are set apart by spaces."""
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.DictWriter(file, list(rows[0]) if rows else [])
        writer.writeheader()
        for row in rows:
            writer.writerow({k: " ".join(map(str, v)) if isinstance(v, (list, tuple)) else v for k, v in row.items()})


def plain(row: dict[str, Any]) -> dict[str, Any]:
    """A row for JSON, which knows no NaN: what was not measured is null."""
    return {name: None if value != value else value for name, value in row.items()}


def row_of(kind: type[Row], document: dict[str, Any]) -> Row:
    """A row (a dataclass) from its JSON: lists are tuples again, null is not a number."""
    values = {name: value for name, value in document.items() if name != "job"}
    for name, value in values.items():
        if isinstance(value, list):
            values[name] = tuple(value)
        elif value is None and kind.__annotations__[name] == "float":
            values[name] = math.nan
    return kind(**values)


def _command(arguments: Sequence[str]) -> str:
    """As a person types it; of folders the name alone is told."""
    program = Path(arguments[0])
    # A study that is a package is started by its __main__.
    name = program.parent.name if program.stem == "__main__" else program.stem
    words = [f"polaropt study {name}"]
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
    fields: dict[str, str] = {}
    try:
        for line in Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines():
            name, _, value = line.partition(":")
            fields.setdefault(name.strip(), value.strip())
    except OSError:
        return platform.processor() or platform.machine()
    name, family, model = (fields.get(field, "?") for field in ("model name", "cpu family", "model"))
    return f"{name} (family {family}, model {model})"


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
