"""Time and evaluations of every solver to the same gap, in interleaved rounds."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from solvers.base import Status
from studies.benchmark_contestants import Contestant, contestants, race, warmed_up
from studies.benchmark_race import Finish, Judge, Limits, Run, find_finish
from studies.benchmark_record import Measurement, Place
from studies.benchmark_scenes import example
from studies.photographs import Photographs, Size

TABLE = "time to gap"
INCIDENCES_DEG = {"hard": 20.0, "easy": 60.0}
REFERENCE = "lowest value found"

Tell = Callable[[str], None]


@dataclass(frozen=True)
class Rounds:
    """How often everything runs, and how long.

    Attributes
    ----------
    repeats : int
    cap_seconds : float
        A solve is broken off after this time.
    slow_seconds : float
        A contestant that takes longer runs only `slow_repeats` times.
    slow_repeats : int
    reference_evaluations : int
        Limit of each run that looks for the lowest value.
    """

    repeats: int
    cap_seconds: float
    slow_seconds: float
    slow_repeats: int
    reference_evaluations: int = 1000


def measure(place: Place, photographs: Photographs, size: Size, rounds: Rounds, tell: Tell) -> list[Measurement]:
    """Race all contestants on one scene."""
    tell("scene")
    judge = Judge(example(photographs, INCIDENCES_DEG[place.case], size))
    finish = find_finish(judge, rounds.reference_evaluations, tell)
    runs = _runs(judge, finish, rounds, tell)
    verdicts = [point.verdict for several in runs.values() for run in several for point in run.points[-1:]]
    finish = finish.lowered(verdicts)
    measurements = _reference(place, finish)
    for contestant, several in runs.items():
        measurements += _measured(place, contestant, several, finish)
    return measurements


def _runs(judge: Judge, finish: Finish, rounds: Rounds, tell: Tell) -> dict[Contestant, list[Run]]:
    runs: dict[Contestant, list[Run]] = {}
    for contestant in contestants():
        tell(f"{contestant.name}: warming up")
        runs[warmed_up(contestant, judge, finish, rounds.cap_seconds)] = []
    for repeat in range(rounds.repeats):
        for contestant, earlier in runs.items():
            if not _again(earlier, rounds):
                continue
            tell(f"{contestant.name}: round {repeat + 1} of {rounds.repeats}")
            earlier.append(race(contestant, judge, finish, Limits(rounds.cap_seconds)))
    return runs


def _again(earlier: list[Run], rounds: Rounds) -> bool:
    """Whether a contestant is to run once more: not where it cannot, is slow, or was cut off."""
    if not earlier:
        return True
    last = earlier[-1]
    if not last.points or last.status is Status.TIME_LIMIT:
        return False
    return len(earlier) < rounds.slow_repeats or last.points[-1].seconds <= rounds.slow_seconds


def _reference(place: Place, finish: Finish) -> list[Measurement]:
    best = finish.best
    values = {
        ("objective", ""): best.value,
        ("objective at the cold start", ""): finish.cold_value,
        ("transmission", "dB"): best.transmission_db,
        ("reflection", "dB"): best.reflection_db,
    }
    return [place.measured(REFERENCE, name, unit, [value]) for (name, unit), value in values.items()]


def _measured(place: Place, contestant: Contestant, runs: list[Run], finish: Finish) -> list[Measurement]:
    """Arrival of a contestant with all repeats, and the curve of its first run."""
    name, first = contestant.name, runs[0]
    if not first.points:
        return [place.measured(name, "evaluations", "", [], note=first.note or "it did not start")]
    arrivals = [run.arrival(finish) for run in runs]
    arrived = [(run, at) for run, at in zip(runs, arrivals, strict=True) if at is not None]
    # A run that did not arrive bounds the time from below.
    ends = arrived or [(run, len(run.points) - 1) for run in runs]
    bound = "" if arrived else ">="
    note = "" if arrived else _shortfall(first, finish)
    if contestant.chooses_threads:
        note = "; ".join(filter(None, (note, f"threads, the fastest here: {contestant.threads}")))
    points = [run.points[at] for run, at in ends]
    rows = [
        place.measured(name, "wall, with set-up", "s", [p.seconds for p in points], bound, note),
        place.measured(name, "CPU, with set-up", "s", [p.cpu_seconds for p in points], bound, note),
        place.measured(
            name, "wall, solve", "s", [run.points[at].seconds - run.set_up[0] for run, at in ends], bound, note
        ),
        place.measured(
            name, "CPU, solve", "s", [run.points[at].cpu_seconds - run.set_up[1] for run, at in ends], bound, note
        ),
        place.measured(name, "evaluations", "", [at + 1 for _, at in ends], bound, note),
    ]
    by_gap = [run.arrival(finish, near=False) for run in runs]
    if all(at is not None for at in by_gap):
        rows.append(place.measured(name, "evaluations, by the gap alone", "", [at + 1 for at in by_gap]))
    return rows + _curve(place, name, first, finish)


def _shortfall(run: Run, finish: Finish) -> str:
    last = run.points[-1].verdict
    off = last.transmission_db - finish.best.transmission_db
    why = "broken off" if run.status is Status.TIME_LIMIT else "ended by itself"
    return f"{why} at gap {finish.gap(last):.1e}, transmission {off:+.2f} dB"


def _curve(place: Place, name: str, run: Run, finish: Finish) -> list[Measurement]:
    points = run.points
    # Nothing falls below the lowest value; rounding of a logarithm's axis.
    gaps = np.maximum([finish.gap(point.verdict) for point in points], 1e-9)
    columns = {
        ("curve: wall, with set-up", "s"): [point.seconds for point in points],
        ("curve: CPU, with set-up", "s"): [point.cpu_seconds for point in points],
        ("curve: gap", ""): list(gaps),
        ("curve: transmission", "dB"): [point.verdict.transmission_db for point in points],
        ("curve: reflection", "dB"): [point.verdict.reflection_db for point in points],
    }
    return [place.measured(name, quantity, unit, values) for (quantity, unit), values in columns.items()]
