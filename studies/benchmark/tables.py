"""The benchmark as Markdown: the figures that were asked for beside those that were measured, and all tables."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from pandas import DataFrame

from studies.benchmark import mosaics, processes
from studies.benchmark.kernels import N_GHOSTS
from studies.benchmark.race import INCIDENCES_DEG, OURS, REFERENCE, SCIPY_AUTOGRAD, TORCH_AUTOGRAD
from studies.benchmark.rows import BLIND, IMPORTS, KERNELS, MEMORY, MOSAICS, RACE, RUNNING_ON
from studies.benchmark.separations import MOMENTS
from studies.kit.frames import Cell, markdown, summary, values_of, where

BASELINE = f"{OURS}, closed-form"
CLOCKS = ("wall, with set-up", "wall, solve", "CPU, with set-up", "CPU, solve")

Section = tuple[str, str, DataFrame]
"""A heading, how to read the table, and the table."""


def tables(frame: DataFrame, metadata: Mapping[str, Any]) -> str:
    """The machine, the figures that were asked for, and all tables for which there are rows."""
    sections = [*_races(frame), _ratios(frame), _kernels(frame), _running_on(frame), _mosaics(frame)]
    sections += _each_row(frame)
    shown = [_targets(frame), *(section for section in sections if len(section[2]))]
    parts = [f"## {title}\n\n{note}\n\n{markdown(table, 'lr')}" for title, note, table in shown]
    return "\n\n".join([_machine(metadata), *parts])


def _machine(metadata: Mapping[str, Any]) -> str:
    machine, threads = metadata["machine"], metadata["threads"]
    libraries = ", ".join(f"{name} {version}" for name, version in metadata["libraries"].items() if version)
    return (
        f"{machine['cpu']}, {machine['cores']} cores, {machine['memory_gib']} GiB; "
        f"GPU: {metadata['gpu'] or 'not asked'}; {metadata['system']}; Python {metadata['python']}; {libraries}; "
        f"threads: polaropt {threads['polaropt']}, torch {threads['torch']}; "
        f"commit {metadata['commit'][:12] or 'unknown'}{', modified' if metadata['modified'] else ''}."
    )


# Values as a person writes them.


def figure(value: float) -> str:
    """Three digits."""
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


def ratio(row: Any, other: Any) -> tuple[float, ...]:
    """Ratios within the same rounds, as far as both ran; the other's median stands for rounds of its own."""
    if not (row.samples and other.samples):
        return ()
    if len(row.samples) != len(other.samples):
        return tuple(sample / other.median for sample in row.samples)
    return tuple(a / b for a, b in zip(row.samples, other.samples, strict=True))


def one(frame: DataFrame, **wanted: str) -> Any:
    """The first row with these values, None if there is none."""
    return next(where(frame, **wanted).itertuples(index=False), None)


def _cell(quantity: str | None = None) -> Cell:
    """Median and spread of a quantity; without its name, of the only row."""

    def cell(part: DataFrame) -> str:
        row = one(part) if quantity is None else one(part, quantity=quantity)
        return "-" if row is None else with_spread(row.samples, row.bound)

    return cell


# The tables.


def _races(frame: DataFrame) -> Iterator[Section]:
    """Evaluations and seconds of each contestant, one table for each scene and size."""
    note = (
        "Until the gap (f - f*) / (f cold - f*) is 1e-3 and the transmission within 0.1 dB of that at f*; median "
        "(least..largest). f cold is the objective at the plain intensity, f* the lowest found. Set-up: everything "
        "after the scene is known; what starts cold on the pixels is given the penalties."
    )
    cells: dict[str, Cell] = {
        "evaluations": _cell("evaluations"),
        "by the gap alone": _cell("evaluations, by the gap alone"),
        **{f"{clock} (s)": _cell(clock) for clock in CLOCKS},
        "remark": lambda part: "; ".join(dict.fromkeys(filter(None, part.note))),
    }
    races = where(frame, table=RACE)
    for case, size in values_of(races, "case", "size"):
        part = where(races, case=case, size=size)
        title = f"Time to gap 1e-3: {case} ({INCIDENCES_DEG[case]:g} degrees), {size}"
        yield title, note, summary(part[part.subject != REFERENCE], {"solver": "subject"}, cells)


def _ratios(frame: DataFrame) -> Section:
    """Seconds of the others over polaropt's."""
    races = where(frame, table=RACE)
    ours = {(row.case, row.size, row.quantity): row for row in where(races, subject=BASELINE).itertuples(index=False)}

    def over_ours(clock: str) -> Cell:
        def cell(part: DataFrame) -> str:
            theirs = one(part, quantity=clock)
            own = None if theirs is None else ours.get((theirs.case, theirs.size, clock))
            return "-" if own is None or own.bound else with_spread(ratio(theirs, own), theirs.bound)

        return cell

    keys = {"solver": "subject", "scene": "case", "size": "size"}
    others = races[~races.subject.isin((BASELINE, REFERENCE))]
    table = summary(others, keys, {clock: over_ours(clock) for clock in CLOCKS})
    return (
        f"Seconds over those of {BASELINE}",
        "Both with their own set-up, or both the solve alone; '>=': broken off.",
        table[~(table[list(CLOCKS)] == "-").all(axis=1)],
    )


def _bounds(frame: DataFrame) -> Iterator[tuple[DataFrame, str, str, float, float]]:
    """Rows of each size, the size, threads, the least seconds that kernels need there, and the bytes per second."""
    kernels = where(frame, table=KERNELS)
    for size in values_of(kernels, "size"):
        part = where(kernels, size=size)
        traffic = one(part, quantity="traffic")
        for rate in where(part, subject="bandwidth").itertuples():
            # At the best rate seen: what disturbs the machine must not loosen the bound.
            yield part, size, rate.quantity.partition(":")[0], traffic.median / rate.high, rate.high


def _kernels(frame: DataFrame) -> Section:
    lines = []
    for part, size, threads, bound, bytes_per_second in _bounds(frame):
        lines.append(["bound", size, threads, figure(1e3 * bound), "1", f"{bytes_per_second / 1e9:.3g} GB/s", ""])
        for wall in where(part, quantity=f"{threads}: wall").itertuples(index=False):
            cpu = one(part, subject=wall.subject, quantity=f"{threads}: CPU")
            milliseconds = with_spread([1e3 * seconds for seconds in wall.samples])
            over = [figure(value / bound) for value in (wall.median, wall.low)]
            lines.append([wall.subject, size, threads, milliseconds, *over, figure(1e3 * cpu.median)])
    note = (
        f"Misfit and local penalties on the pixels, {N_GHOSTS} ghosts beyond the direct light. Bound: layers read, "
        "gradient written with write-allocate, data read, at the best rate of a float32 dot product."
    )
    columns = ["what", "size", "threads", "wall (ms)", "median over the bound", "best over the bound", "CPU (ms)"]
    return "Objective and gradient against the memory bandwidth", note, DataFrame(lines, columns=columns)


def _running_on(frame: DataFrame) -> Section:
    def median(quantity: str, part: DataFrame) -> float:
        row = one(part, quantity=quantity)
        return math.nan if row is None else float(row.median)

    def level(layer: str, moment: str) -> Cell:
        return lambda part: f"{median(f'{layer} {moment}', part):.2f}"

    def gain(moment: str) -> Cell:
        first, last = (f"transmission {when}" for when in (moment, MOMENTS[-1]))
        return lambda part: f"{median(last, part) - median(first, part):+.2f}"

    def evaluations(moment: str) -> Cell:
        return lambda part: f"{median(f'evaluations {moment}', part):.0f}"

    short = dict(zip(MOMENTS, ("start", "default", "1e-6"), strict=True))
    cells = {
        **{f"T {name}": level("transmission", moment) for moment, name in short.items()},
        **{f"1e-6 - {short[moment]}": gain(moment) for moment in MOMENTS[:2]},
        **{f"R {name}": level("reflection", moment) for moment, name in short.items()},
        **{f"evaluations {short[moment]}": evaluations(moment) for moment in MOMENTS[1:]},
    }
    table = summary(where(frame, table=RUNNING_ON), {"incidence": "case", "start": "subject"}, cells)
    note = "PSNR in dB of transmission (T) and reflection (R), 16 px at the border left out."
    return "Running on to a relative change of 1e-6", note, table


def _mosaics(frame: DataFrame) -> Section:
    """Seconds and memory of raw mosaics by size, and with which power of the pixels they grow from size to size."""
    found = where(frame, table=MOSAICS)

    def growth(clock: str) -> Cell:
        def cell(part: DataFrame) -> str:
            rows = where(found, case=part.case.iloc[0], quantity=clock)
            smallest, here = rows.iloc[0], one(rows, size=part["size"].iloc[0])
            pixels = _pixels(here.size) / _pixels(smallest["size"])
            return "-" if pixels == 1 else f"{math.log(here.median / smallest['median']) / math.log(pixels):.2f}"

        return cell

    cells = {
        "s": _cell(mosaics.WALL),
        "CPU (s)": _cell(mosaics.CPU),
        "peak memory (MB)": _cell(mosaics.PEAK),
        "growth": growth(mosaics.WALL),
        "growth of CPU": growth(mosaics.CPU),
    }
    note = (
        f"One file read and separated blind in a fresh process, kernels loaded; a pane at {mosaics.INCIDENCE_DEG:g} "
        f"degrees, double images {mosaics.SHIFT_PX:g} px apart, noise {100 * mosaics.NOISE:g} % of white. Memory (MB, "
        "1e6 bytes) is what comes on top of the loaded process, the raw included. Growth: the power of the pixels with "
        "which the seconds grow from the smallest size on."
    )
    return "Raw mosaics", note, summary(found, {"what": "case", "size": "size"}, cells)


def _each_row(frame: DataFrame) -> Iterator[Section]:
    """Tables that have a line for each row."""
    keys = {"what": "subject", "size": "size"}
    blind = summary(where(frame, table=BLIND), keys | {"stage": "quantity"}, {"s": _cell()})
    yield "Separate, scene known and blind", "Seconds.", blind
    note = "MB (1e6 bytes) of resident memory in a fresh process; the capture is read from a file."
    memory = summary(where(frame, table=MEMORY), keys | {"quantity": "quantity"}, {"MB": _cell()})
    yield "Peak memory of separate", note, memory
    note = "Imports are timed inside fresh interpreters, commands from outside."
    yield "Imports", note, summary(where(frame, table=IMPORTS), {"what": "subject"}, {"s": _cell()})


# The figures that were asked for.

_SIZE, _SMALL, _LARGE = "512x512", "256x256", "1224x1024"
_RATIOS = {
    (SCIPY_AUTOGRAD, "hard"): (60, 120),
    (SCIPY_AUTOGRAD, "easy"): (30, 60),
    (TORCH_AUTOGRAD, "hard"): (22, 45),
    (TORCH_AUTOGRAD, "easy"): (11, 22),
}
_EVALUATIONS = {"hard": (30, 15), "easy": (15, 10)}
_MOSAIC_SIZE, _MOSAIC_MB = "2448x2048", 3000
_MOSAIC_SECONDS = {"mono": 10.0, "color": 30.0, "mono, cell": 2.5, "color, cell": 7.5}
"""Of the whole of a camera's raw mosaic; of cells a quarter."""


@dataclass(frozen=True)
class Target:
    """A figure: measured (one value per repeat), to be reached, and beyond, if more was asked for."""

    name: str
    where: str
    samples: tuple[float, ...]
    reach: float
    beyond: float = math.nan
    larger_is_better: bool = False
    bound: str = ""

    def row(self) -> tuple[str, ...]:
        """As a line of the table."""
        sign = ">=" if self.larger_is_better else "<="
        asked = ["-" if math.isnan(goal) else f"{sign} {figure(goal)}" for goal in (self.reach, self.beyond)]
        return (self.name, self.where, with_spread(self.samples, self.bound), *asked, self._outcome())

    def _outcome(self) -> str:
        if not self.samples:
            return "not measured"
        median = float(np.median(self.samples))
        met = [median >= goal if self.larger_is_better else median <= goal for goal in (self.reach, self.beyond)]
        # The true value lies above a bound: that meets a larger goal, and misses a smaller one.
        if self.bound and met[0] != self.larger_is_better:
            return "not told"
        return "beyond" if met[1] else "reached" if met[0] else "missed"


def _targets(frame: DataFrame) -> Section:
    """All figures asked for, as far as they were measured."""
    found = [*_of_races(where(frame, table=RACE)), *_of_kernels(frame), *_of_separations(frame), *_of_imports(frame)]
    found += _of_mosaics(where(frame, table=MOSAICS, size=_MOSAIC_SIZE))
    note = f"At {_SIZE} where not said otherwise; a run at other sizes takes its nearest. {BASELINE} is meant by ours."
    lines = [target.row() for target in found if target.samples]
    columns = ["figure", "where", "measured", "reach", "beyond", ""]
    return "Against the figures asked for", note, DataFrame(lines, columns=columns)


def _nearest(races: DataFrame, size: str) -> str:
    """The size measured that is nearest to the one asked for."""
    return min(values_of(races, "size"), key=lambda other: abs(math.log(_pixels(other) / _pixels(size))), default=size)


def _pixels(size: str) -> int:
    width, height = size.split("x")
    return int(width) * int(height)


def _of_races(races: DataFrame) -> Iterator[Target]:
    size, small, large = (_nearest(races, size) for size in (_SIZE, _SMALL, _LARGE))
    for (rival, case), goals in _RATIOS.items():
        for clock in CLOCKS:
            place = where(races, case=case, size=size, quantity=clock)
            theirs, ours = one(place, subject=f"{rival}, cold"), one(place, subject=BASELINE)
            if theirs is not None and ours is not None and not ours.bound:
                name, at = f"{rival}, cold, over ours: {case}", f"{size}, {clock}"
                yield Target(name, at, ratio(theirs, ours), *goals, True, theirs.bound)
    evaluations = where(races, quantity="evaluations")
    for case, goals in _EVALUATIONS.items():
        ours = one(evaluations, case=case, size=size, subject=BASELINE)
        if ours is not None:
            yield Target(f"evaluations to 1e-3: {case}", size, ours.samples, *goals, False, ours.bound)
    for case in _EVALUATIONS:
        for subject in (BASELINE, f"{OURS}, cold"):
            first, last = (one(evaluations, case=case, size=size, subject=subject) for size in (small, large))
            if small != large and first is not None and last is not None and not (first.bound or last.bound):
                growth = (last.median / first.median,)
                yield Target(f"growth of evaluations: {case}", f"{subject}, {small} to {large}", growth, 1.3, 1)


def _of_kernels(frame: DataFrame) -> Iterator[Target]:
    for part, size, threads, bound, _ in _bounds(frame):
        wall = one(part, subject="compiled, p = 1", quantity=f"{threads}: wall")
        samples = tuple(seconds / bound for seconds in wall.samples)
        yield Target("objective and gradient over the bound", f"{size}, {threads}", samples, 4, 2)


def _of_separations(frame: DataFrame) -> Iterator[Target]:
    of_blind = where(frame, table=BLIND)
    for size in values_of(of_blind, "size"):
        here = where(of_blind, size=size)
        blind = one(here, subject="blind", quantity="wall")
        others = {
            "separate with the scene known": one(here, subject="known scene", quantity="wall"),
            "its stage Solving": one(here, subject="blind", quantity="wall, solving"),
        }
        for name, other in others.items():
            yield Target(f"blind separate over {name}", size, ratio(blind, other), 3, 1.5)
    for quantity in (processes.ABOVE_IMPORTS, processes.WITH_CAPTURE):
        for row in where(frame, table=MEMORY, quantity=quantity).itertuples():
            yield Target(f"memory of separate: {quantity}", f"{row.size}, {row.subject} (MB)", row.samples, 700, 400)


def _of_mosaics(rows: DataFrame) -> Iterator[Target]:
    for row in where(rows, quantity=mosaics.WALL).itertuples():
        name = f"seconds of a raw mosaic, blind: {row.case}"
        yield Target(name, row.size, row.samples, _MOSAIC_SECONDS[row.case])
    for row in where(rows, quantity=mosaics.PEAK).itertuples():
        yield Target(f"memory of a raw mosaic: {row.case} (MB)", row.size, row.samples, _MOSAIC_MB)


def _of_imports(frame: DataFrame) -> Iterator[Target]:
    found = {row.subject: row for row in where(frame, table=IMPORTS).itertuples()}
    if not found:
        return
    base = found[processes.NUMPY_SCIPY]
    for name in (processes.POLAROPT, processes.SEPARATE):
        yield Target(f"{name} over {base.subject}", "", ratio(found[name], base), 1.5, 1.2)
    both = zip(found[processes.HELP].samples, found[processes.BARE_HELP].samples, strict=True)
    more = tuple(help_ - bare for help_, bare in both)
    yield Target("polaropt --help beyond a minimal typer command's (s)", "", more, 0.1, 0.05)
