"""What the benchmark writes down: measurements, the machine they were taken on, and the file that holds both."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from studies.record import earlier_rows, metadata, write_document


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
        What was asked for; measurements taken with others, or with other sources, are not taken over.
    """

    def __init__(self, path: Path, settings: dict[str, Any]) -> None:
        self._path = path
        self.metadata = metadata(settings)
        self.measurements = [_measurement(row) for row in earlier_rows(path, self.metadata)]

    def has(self, place: Place) -> bool:
        """Whether a task was done before."""
        return any((m.table, m.case, m.size) == (place.table, place.case, place.size) for m in self.measurements)

    def add(self, measurements: Sequence[Measurement]) -> None:
        """Take in what a task has measured, and write the file."""
        self.measurements.extend(measurements)
        write_document(self._path, self.metadata, [_row(m) for m in self.measurements])

    def find(self, **wanted: str) -> list[Measurement]:
        """Measurements whose fields have these values."""
        return [m for m in self.measurements if all(getattr(m, name) == value for name, value in wanted.items())]


def _row(measurement: Measurement) -> dict[str, Any]:
    row = asdict(measurement)
    if measurement.samples:
        low, high = measurement.spread
        row |= {"median": measurement.median, "low": low, "high": high}
    return row


def _measurement(row: dict[str, Any]) -> Measurement:
    fields = {name: row[name] for name in Measurement.__dataclass_fields__}
    return Measurement(**{**fields, "samples": tuple(fields["samples"])})
