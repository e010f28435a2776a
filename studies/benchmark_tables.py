"""The benchmark's measurements as tables, for the terminal and as Markdown."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from rich.console import Console
from rich.markup import escape
from rich.table import Table as RichTable

from studies import benchmark_imports, benchmark_kernels, benchmark_memory, benchmark_pipeline, benchmark_solvers
from studies.benchmark_contestants import OURS
from studies.benchmark_record import Measurement, Record

BASELINE = f"{OURS}, closed-form"
CLOCKS = ("wall, with set-up", "wall, solve", "CPU, with set-up", "CPU, solve")


@dataclass(frozen=True)
class Table:
    """A table with a sentence on how to read it."""

    title: str
    note: str
    columns: tuple[str, ...]
    rows: list[tuple[str, ...]]

    def markdown(self) -> str:
        """As Markdown."""
        lines = [self.columns, ("---",) + ("---:",) * (len(self.columns) - 1), *self.rows]
        body = "\n".join("| " + " | ".join(cell.replace("|", "/") for cell in line) + " |" for line in lines)
        return f"## {self.title}\n\n{self.note}\n\n{body}\n"

    def show(self, console: Console) -> None:
        """On the terminal."""
        table = RichTable(title=self.title, caption=self.note, title_justify="left", caption_justify="left")
        for i, column in enumerate(self.columns):
            table.add_column(column, justify="left" if i == 0 else "right", overflow="fold")
        for row in self.rows:
            table.add_row(*(escape(cell) for cell in row))
        console.print(table)


def tables(record: Record) -> list[Table]:
    """All tables for which there are measurements."""
    found = [*_races(record), *_ratios(record), *_kernels(record), *_running_on(record)]
    found += [*_blind(record), *_memory(record), *_imports(record)]
    return [table for table in found if table.rows]


def figure(value: float) -> str:
    """Three digits, as a person writes them."""
    if not math.isfinite(value):
        return "-"
    if value != 0 and not 1e-3 <= abs(value) < 1e5:
        return f"{value:.2g}"
    return f"{value:.{max(0, 2 - math.floor(math.log10(abs(value))))}f}" if value else "0"


def with_spread(samples: Sequence[float], bound: str = "") -> str:
    """Median with the least and the largest of the samples."""
    if not samples:
        return "-"
    low, high = min(samples), max(samples)
    spread = f" ({figure(low)}..{figure(high)})" if figure(low) != figure(high) else ""
    return f"{bound + ' ' if bound else ''}{figure(float(np.median(samples)))}{spread}"


def ratio(measurement: Measurement, other: Measurement) -> tuple[float, ...]:
    """Ratios within the same rounds, as far as both ran; the other's median stands for rounds of its own."""
    if not (measurement.samples and other.samples):
        return ()
    if len(measurement.samples) != len(other.samples):
        return tuple(sample / other.median for sample in measurement.samples)
    return tuple(a / b for a, b in zip(measurement.samples, other.samples, strict=True))


def one(record: Record, **wanted: str) -> Measurement | None:
    """The measurement with these fields, None if there is none."""
    return next(iter(record.find(**wanted)), None)


def places(record: Record, table: str) -> list[tuple[str, str]]:
    """Cases and sizes measured for a table, in order."""
    return list(dict.fromkeys((m.case, m.size) for m in record.find(table=table)))


def _cell(measurement: Measurement | None) -> str:
    return "-" if measurement is None else with_spread(measurement.samples, measurement.bound)


def _subjects(record: Record, table: str, case: str, size: str) -> list[str]:
    return list(dict.fromkeys(m.subject for m in record.find(table=table, case=case, size=size)))


def _races(record: Record) -> list[Table]:
    """Evaluations and seconds of each contestant, one table for each scene and size."""
    table = benchmark_solvers.TABLE
    note = (
        "Until the gap (f - f*) / (f cold - f*) is 1e-3 and the transmission within 0.1 dB of that at f*; median "
        "(least..largest). f cold is the objective at the plain intensity, f* the lowest found. Set-up: everything "
        "after the scene is known; what starts cold on the pixels is given the penalties."
    )
    quantities = ("evaluations", "evaluations, by the gap alone", *CLOCKS)
    found = []
    for case, size in places(record, table):
        rows = []
        for subject in _subjects(record, table, case, size):
            if subject == benchmark_solvers.REFERENCE:
                continue
            where = {"table": table, "case": case, "size": size, "subject": subject}
            cells = [_cell(one(record, **where, quantity=quantity)) for quantity in quantities]
            notes = dict.fromkeys(m.note for m in record.find(**where) if m.note)
            rows.append((subject, *cells, "; ".join(notes)))
        degrees = benchmark_solvers.INCIDENCES_DEG[case]
        title = f"Time to gap 1e-3: {case} ({degrees:g} degrees), {size}"
        columns = ("solver", "evaluations", "by the gap alone", *(f"{clock} (s)" for clock in CLOCKS), "remark")
        found.append(Table(title, note, columns, rows))
    return found


def _ratios(record: Record) -> list[Table]:
    """Seconds of the others over polaropt's."""
    table, rows = benchmark_solvers.TABLE, []
    for case, size in places(record, table):
        for subject in _subjects(record, table, case, size):
            cells = [_over_ours(record, case, size, subject, clock) for clock in CLOCKS]
            if subject not in (BASELINE, benchmark_solvers.REFERENCE) and set(cells) != {"-"}:
                rows.append((subject, case, size, *cells))
    return [
        Table(
            f"Seconds over those of {BASELINE}",
            "Both with their own set-up, or both the solve alone; '>=': broken off.",
            ("solver", "scene", "size", *CLOCKS),
            rows,
        )
    ]


def _over_ours(record: Record, case: str, size: str, subject: str, clock: str) -> str:
    where = {"table": benchmark_solvers.TABLE, "case": case, "size": size, "quantity": clock}
    theirs, ours = one(record, **where, subject=subject), one(record, **where, subject=BASELINE)
    if theirs is None or ours is None or ours.bound:
        return "-"
    return with_spread(ratio(theirs, ours), theirs.bound)


def kernel_bounds(record: Record) -> Iterator[tuple[dict[str, str], str, float, float]]:
    """Where kernels were measured, with how many threads, the least seconds they need and the bytes per second."""
    table = benchmark_kernels.TABLE
    for case, size in places(record, table):
        where = {"table": table, "case": case, "size": size}
        traffic = one(record, **where, quantity="traffic")
        for rate in record.find(**where, subject="bandwidth"):
            assert traffic is not None
            # At the best rate seen: what disturbs the machine must not loosen the bound.
            best = rate.spread[1]
            yield where, rate.quantity.partition(":")[0], traffic.median / best, best


def _kernels(record: Record) -> list[Table]:
    rows = []
    for where, threads, bound, bytes_per_second in kernel_bounds(record):
        size = where["size"]
        rate_cell = f"{bytes_per_second / 1e9:.3g} GB/s"
        rows.append(("bound", size, threads, figure(1e3 * bound), "1", rate_cell, ""))
        for wall in record.find(**where, quantity=f"{threads}: wall"):
            cpu = one(record, **{**where, "subject": wall.subject}, quantity=f"{threads}: CPU")
            best = wall.spread[0] / bound
            milliseconds = with_spread([1e3 * s for s in wall.samples])
            cpu_cell = figure(1e3 * cpu.median) if cpu else "-"
            rows.append(
                (wall.subject, size, threads, milliseconds, figure(wall.median / bound), figure(best), cpu_cell)
            )
    note = (
        f"Misfit and local penalties on the pixels, {benchmark_kernels.N_GHOSTS} ghosts beyond the direct light. "
        "Bound: layers read, gradient written with write-allocate, data read, at the best rate of a "
        "float32 dot product."
    )
    columns = ("what", "size", "threads", "wall (ms)", "median over the bound", "best over the bound", "CPU (ms)")
    return [Table("Objective and gradient against the memory bandwidth", note, columns, rows)]


def _running_on(record: Record) -> list[Table]:
    table, rows = benchmark_pipeline.RUNNING_ON, []
    moments = ("at the start", "at the default stopping", "at 1e-6")
    for case, size in places(record, table):
        for subject in _subjects(record, table, case, size):
            where = {"table": table, "case": case, "size": size, "subject": subject}
            decibels = [_value(record, **where, quantity=f"transmission {moment}") for moment in moments]
            reflection = [_value(record, **where, quantity=f"reflection {moment}") for moment in moments]
            evaluations = [_value(record, **where, quantity=f"evaluations {moment}") for moment in moments[1:]]
            changes = [f"{decibels[2] - earlier:+.2f}" for earlier in decibels[:2]]
            cells = [f"{value:.2f}" for value in (*decibels, *reflection)]
            rows.append((case, subject, *cells[:3], *changes, *cells[3:], *(f"{n:.0f}" for n in evaluations)))
    columns = ("incidence", "start", "T start", "T default", "T 1e-6", "1e-6 - start", "1e-6 - default")
    columns += ("R start", "R default", "R 1e-6", "evaluations default", "evaluations 1e-6")
    note = "PSNR in dB of transmission (T) and reflection (R), 16 px at the border left out."
    return [Table("Running on to a relative change of 1e-6", note, columns, rows)]


def _value(record: Record, **wanted: str) -> float:
    found = one(record, **wanted)
    return math.nan if found is None else found.median


def _blind(record: Record) -> list[Table]:
    rows = [
        (m.subject, m.size, m.quantity, with_spread(m.samples)) for m in record.find(table=benchmark_pipeline.BLIND)
    ]
    return [Table("Separate, scene known and blind", "Seconds.", ("what", "size", "stage", "s"), rows)]


def _memory(record: Record) -> list[Table]:
    rows = [(m.subject, m.size, m.quantity, with_spread(m.samples)) for m in record.find(table=benchmark_memory.TABLE)]
    note = "MB (1e6 bytes) of resident memory in a fresh process; the capture is read from a file."
    return [Table("Peak memory of separate", note, ("what", "size", "quantity", "MB"), rows)]


def _imports(record: Record) -> list[Table]:
    rows = [(m.subject, with_spread(m.samples)) for m in record.find(table=benchmark_imports.TABLE)]
    note = "Imports are timed inside fresh interpreters, commands from outside."
    return [Table("Imports", note, ("what", "s"), rows)]
