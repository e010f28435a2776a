"""What the benchmark writes down: measurements, and the machine they were taken on."""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from studies.kit.records import row_of


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
    median, low, high : float
        Of the repeats; NaN without any.
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
    median: float = math.nan
    low: float = math.nan
    high: float = math.nan

    @property
    def spread(self) -> tuple[float, float]:
        """The least and the largest of the repeats."""
        return self.low, self.high


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
        told = (float(np.median(values)), min(values), max(values)) if values else ()
        return Measurement(self.table, self.case, self.size, subject, quantity, unit, values, bound, note, *told)


@dataclass(frozen=True)
class Record:
    """All measurements of a run, and what they were taken with."""

    metadata: dict[str, Any]
    measurements: tuple[Measurement, ...]

    @classmethod
    def read(cls, path: Path, rows: Sequence[dict[str, Any]]) -> Record:
        """The record of these rows, whose document lies at `path`."""
        document = json.loads(path.read_text(encoding="utf-8"))
        return cls(document["metadata"], tuple(row_of(Measurement, row) for row in rows))

    def find(self, **wanted: str) -> list[Measurement]:
        """Measurements whose fields have these values."""
        return [m for m in self.measurements if all(getattr(m, name) == value for name, value in wanted.items())]
