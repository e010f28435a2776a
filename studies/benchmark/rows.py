"""What the benchmark writes down: a row for each quantity of each subject, in the place that it was measured in."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from studies.kit.run import tell

IMPORTS, MEMORY, MOSAICS, KERNELS, BLIND, RUNNING_ON, RACE = TABLES = (
    "imports", "memory", "mosaics", "kernels", "blind", "running on", "time to gap",
)  # fmt: skip


@dataclass(frozen=True)
class Row:
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


@dataclass(frozen=True)
class Place:
    """Where rows belong: one job of the benchmark yields those of one place."""

    table: str
    case: str
    size: str

    def say(self, what: str) -> None:
        """Say beside the progress bar what is measured here."""
        tell(f"{', '.join(filter(None, (self.table, self.case, self.size)))}: {what}")

    def measured(
        self, subject: str, quantity: str, unit: str, samples: Iterable[float], bound: str = "", note: str = ""
    ) -> Row:
        """A quantity measured here."""
        values = tuple(float(sample) for sample in samples)
        spread = (float(np.median(values)), min(values), max(values)) if values else ()
        return Row(self.table, self.case, self.size, subject, quantity, unit, values, bound, note, *spread)
