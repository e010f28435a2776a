"""The figures that were asked for, beside those that were measured."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from studies import benchmark_imports, benchmark_memory, benchmark_pipeline, benchmark_solvers
from studies.benchmark_contestants import OURS, SCIPY_AUTOGRAD, TORCH_AUTOGRAD
from studies.benchmark_record import Measurement, Record
from studies.benchmark_tables import BASELINE, Table, figure, kernel_bounds, one, places, ratio, with_spread

_SIZE, _SMALL, _LARGE = "512x512", "256x256", "1224x1024"
_RATIOS = {
    (SCIPY_AUTOGRAD, "hard"): (60, 120),
    (SCIPY_AUTOGRAD, "easy"): (30, 60),
    (TORCH_AUTOGRAD, "hard"): (22, 45),
    (TORCH_AUTOGRAD, "easy"): (11, 22),
}
_EVALUATIONS = {"hard": (30, 15), "easy": (15, 10)}


@dataclass(frozen=True)
class Target:
    """A figure: measured (one value per repeat), to be reached, and beyond."""

    name: str
    where: str
    samples: tuple[float, ...]
    reach: float
    stretch: float | None
    larger_is_better: bool = False
    bound: str = ""

    def row(self) -> tuple[str, ...]:
        """As a line of the table."""
        sign = ">=" if self.larger_is_better else "<="
        asked = [f"{sign} {figure(goal)}" if goal is not None else "-" for goal in (self.reach, self.stretch)]
        return (self.name, self.where, with_spread(self.samples, self.bound), *asked, self._outcome())

    def _outcome(self) -> str:
        if not self.samples:
            return "not measured"
        median = float(np.median(self.samples))
        met = [goal is not None and self._meets(median, goal) for goal in (self.reach, self.stretch)]
        # The true value lies above a bound: that meets a larger goal, and misses a smaller one.
        if self.bound and met[0] != self.larger_is_better:
            return "not told"
        return "beyond" if met[1] else "reached" if met[0] else "missed"

    def _meets(self, value: float, goal: float) -> bool:
        return value >= goal if self.larger_is_better else value <= goal


def target_table(record: Record) -> Table:
    """All figures asked for, as far as they were measured."""
    found = [*_speed(record), *_evaluations(record), *_growth(record), *_kernel(record)]
    found += [*_blind(record), *_memory(record), *_imports(record)]
    note = f"At {_SIZE} where not said otherwise; a run at other sizes takes its nearest. {BASELINE} is meant by ours."
    rows = [target.row() for target in found if target.samples]
    return Table("Against the figures asked for", note, ("figure", "where", "measured", "reach", "beyond", ""), rows)


def _pixels(size: str) -> int:
    width, height = size.split("x")
    return int(width) * int(height)


def _nearest(record: Record, table: str, size: str) -> str:
    """The size measured that is nearest to the one asked for."""
    sizes = {measured for _, measured in places(record, table) if measured}
    return min(sizes, key=lambda other: abs(math.log(_pixels(other) / _pixels(size))), default=size)


def _race(record: Record, case: str, size: str, subject: str, quantity: str) -> Measurement | None:
    where = {"table": benchmark_solvers.TABLE, "case": case, "size": size}
    return one(record, **where, subject=subject, quantity=quantity)


def _speed(record: Record) -> list[Target]:
    size = _nearest(record, benchmark_solvers.TABLE, _SIZE)
    targets = []
    for (rival, case), goals in _RATIOS.items():
        for clock in ("wall, with set-up", "wall, solve", "CPU, with set-up", "CPU, solve"):
            theirs = _race(record, case, size, f"{rival}, cold", clock)
            ours = _race(record, case, size, BASELINE, clock)
            if theirs is None or ours is None or ours.bound:
                continue
            name, where = f"{rival}, cold, over ours: {case}", f"{size}, {clock}"
            targets.append(Target(name, where, ratio(theirs, ours), *goals, True, theirs.bound))
    return targets


def _evaluations(record: Record) -> list[Target]:
    size = _nearest(record, benchmark_solvers.TABLE, _SIZE)
    targets = []
    for case, goals in _EVALUATIONS.items():
        ours = _race(record, case, size, BASELINE, "evaluations")
        if ours is not None:
            targets.append(Target(f"evaluations to 1e-3: {case}", size, ours.samples, *goals, False, ours.bound))
    return targets


def _growth(record: Record) -> list[Target]:
    small, large = (_nearest(record, benchmark_solvers.TABLE, size) for size in (_SMALL, _LARGE))
    targets = []
    for case in _EVALUATIONS:
        for subject in (BASELINE, f"{OURS}, cold"):
            first, last = (_race(record, case, size, subject, "evaluations") for size in (small, large))
            if small == large or first is None or last is None or first.bound or last.bound:
                continue
            growth = (last.median / first.median,)
            targets.append(Target(f"growth of evaluations: {case}", f"{subject}, {small} to {large}", growth, 1.3, 1))
    return targets


def _kernel(record: Record) -> list[Target]:
    targets = []
    for where, threads, bound, _ in kernel_bounds(record):
        wall = one(record, **where, subject="compiled, p = 1", quantity=f"{threads}: wall")
        if wall is not None:
            samples = tuple(seconds / bound for seconds in wall.samples)
            place = f"{where['size']}, {threads}"
            targets.append(Target("objective and gradient over the bound", place, samples, 4, 2))
    return targets


def _blind(record: Record) -> list[Target]:
    table, targets = benchmark_pipeline.BLIND, []
    for case, size in places(record, table):
        where = {"table": table, "case": case, "size": size}
        blind = one(record, **where, subject="blind", quantity="wall")
        known = one(record, **where, subject="known scene", quantity="wall")
        solving = one(record, **where, subject="blind", quantity="wall, solving")
        for name, other in (("separate with the scene known", known), ("its stage Solving", solving)):
            if blind is not None and other is not None:
                targets.append(Target(f"blind separate over {name}", size, ratio(blind, other), 3, 1.5))
    return targets


def _memory(record: Record) -> list[Target]:
    table = benchmark_memory.TABLE
    quantities = (benchmark_memory.ABOVE_IMPORTS, benchmark_memory.WITH_CAPTURE)
    return [
        Target(f"memory of separate: {m.quantity}", f"{m.size}, {m.subject} (MB)", m.samples, 700, 400)
        for quantity in quantities
        for m in record.find(table=table, quantity=quantity)
    ]


def _imports(record: Record) -> list[Target]:
    found = {m.subject: m for m in record.find(table=benchmark_imports.TABLE)}
    if not found:
        return []
    base = found[benchmark_imports.NUMPY_SCIPY]
    help_, bare = found[benchmark_imports.HELP], found[benchmark_imports.BARE_HELP]
    more = tuple(a - b for a, b in zip(help_.samples, bare.samples, strict=True))
    return [
        *(
            Target(f"{name} over {base.subject}", "", ratio(found[name], base), 1.5, 1.2)
            for name in (benchmark_imports.POLAROPT, benchmark_imports.SEPARATE)
        ),
        Target("polaropt --help beyond a minimal typer command's (s)", "", more, 0.1, 0.05),
    ]
