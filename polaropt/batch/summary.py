"""``summary.csv``: a row for each capture of a batch, those that failed included."""

from __future__ import annotations

import csv
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from polaropt.batch.job import Row
from polaropt.capture import result_file
from polaropt.errors import check_installed

SUMMARY, PARQUET = "summary.csv", "summary.parquet"


def summary_rows(rows: Sequence[Row]) -> list[dict[str, Any]]:
    """A flat row for each capture, all with the same columns: numbers of the scene, each with its standard error."""
    numbers = dict.fromkeys(name for row in rows for name in row.scene)
    with_errors = {name for row in rows for name in row.errors}
    flat = []
    for row in rows:
        told: dict[str, Any] = {"name": row.name, "status": row.status, "message": row.message, "folder": row.folder}
        for name in numbers:
            told[name] = row.scene.get(name)
            if name in with_errors:
                told[f"{name}_error"] = row.errors.get(name)
        told |= {"warnings": " ".join(row.warnings), "misfit": row.misfit, "seconds": round(row.seconds, 3)}
        flat.append({**told, "files": ";".join(row.files)})
    return flat


def write_summary(folder: Path, rows: Sequence[Row], *, parquet: bool = False) -> None:
    """Write the rows as CSV and, if asked for, as Parquet, each file as a whole."""
    flat = summary_rows(rows)
    with (
        result_file(folder / SUMMARY) as work,
        work.open("w", encoding="utf-8", errors="backslashreplace", newline="") as file,
    ):
        writer = csv.DictWriter(file, list(flat[0]) if flat else ["name"])
        writer.writeheader()
        writer.writerows(flat)
    if parquet:
        check_parquet()
        import pyarrow
        from pyarrow.parquet import write_table

        with result_file(folder / PARQUET) as work:
            write_table(pyarrow.Table.from_pylist(flat), work)


def check_parquet() -> None:
    """InputError where the package that writes Parquet is missing."""
    check_installed(("pyarrow",), "--parquet", "pyarrow")
