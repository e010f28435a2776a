"""What the rows of the study of starts say: means, comparisons with the closed form, and conclusions in words."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from studies.benchmark_race import GAP, NEAR_DB
from studies.learned_init_runs import CLOSED_FORM, LEARNED, Row
from studies.learned_init_scenes import NOISES, regime
from studies.protocol import INCIDENCES_DEG
from studies.stability_scenes import MAP

LAYERS = ("transmission", "reflection")
MOMENTS = ("start", "stopped", "converged")
KEPT_DB = 0.1
"""A solve may end so far below its start."""
_SAME_DB, _CLEAR_DB = 0.05, 0.1


def mean(rows: Sequence[Row], name: str) -> float:
    """Of a column, over the rows that have it."""
    values = [value for row in rows if (value := float(getattr(row, name))) == value]
    return float(np.mean(values)) if values else float("nan")


def of_start(rows: Sequence[Row], start: str) -> list[Row]:
    """Rows of one start."""
    return [row for row in rows if row.start == start]


def regime_of(row: Row) -> str:
    """Its regime, see `studies.learned_init_scenes.regime`."""
    return regime(row.family, row.incidence_deg, row.noise)


@dataclass(frozen=True)
class Comparison:
    """A start against the closed form on the same scenes.

    Attributes
    ----------
    n : int
        Scenes.
    alone, stopped : (float, float)
        What transmission and reflection gain, in dB: at the start, and where the solves stop.
    seconds_near, seconds_gap : float
        Its CPU seconds over those of the closed form, until near the final transmission and until the gap.
    """

    n: int
    alone: tuple[float, float]
    stopped: tuple[float, float]
    seconds_near: float
    seconds_gap: float

    @property
    def verdict(self) -> str:
        """Whether its solves stop better, in words."""
        least, most = min(self.stopped), max(self.stopped)
        if least > -_SAME_DB and most > _CLEAR_DB:
            return "better"
        if most < _SAME_DB and least < -_CLEAR_DB:
            return "worse"
        return "as good" if max(abs(least), abs(most)) <= _CLEAR_DB else "better in one layer, worse in the other"


def compare(rows: Sequence[Row], start: str) -> Comparison:
    """A start against the closed form; both must have a row on every scene."""
    ours, theirs = of_start(rows, start), of_start(rows, CLOSED_FORM)

    def gain(moment: str) -> tuple[float, float]:
        first, second = (mean(ours, f"{layer}_{moment}") - mean(theirs, f"{layer}_{moment}") for layer in LAYERS)
        return first, second

    ratios = [mean(ours, name) / mean(theirs, name) for name in ("cpu_near", "cpu_gap")]
    return Comparison(len(ours), gain("start"), gain("stopped"), ratios[0], ratios[1])


def kept(rows: Sequence[Row], start: str) -> list[tuple[float, float, float]]:
    """Per incidence what the default solve changes on the start: incidence, transmission and reflection in dB."""
    part = of_start(rows, start)
    changes = []
    for incidence in sorted({row.incidence_deg for row in part}):
        there = [row for row in part if row.incidence_deg == incidence]
        change = [mean(there, f"{layer}_stopped") - mean(there, f"{layer}_start") for layer in LAYERS]
        changes.append((incidence, change[0], change[1]))
    return changes


def protocol_rows(rows: Sequence[Row]) -> list[Row]:
    """Those of the paper's incidences with little noise."""
    return [row for row in rows if row.family == MAP and row.noise == NOISES[0] and row.incidence_deg in INCIDENCES_DEG]


def page(rows: Sequence[Row], weights: str) -> str:
    """The study in Markdown: conclusions, then the tables that they are drawn from."""
    starts = list(dict.fromkeys(row.start for row in rows))
    others = [start for start in starts if start != CLOSED_FORM]
    lines = [
        "# What a start is worth",
        "",
        f"{len(of_start(rows, CLOSED_FORM))} scenes, each found blind once for all starts; weights {weights}. Seconds "
        "are CPU seconds of all cores, from the photographs on: scene, closed form, networks (on one core), solve.",
        "",
    ]
    if LEARNED in starts:
        lines += [f"- {sentence}" for sentence in conclusions(rows, LEARNED)] + [""]
    lines += [*_regime_table(rows, others), "", *_work_table(rows, starts), "", *_quality_table(rows, starts)]
    return "\n".join(lines)


def conclusions(rows: Sequence[Row], start: str) -> list[str]:
    """What the rows say of a start, whatever that is."""
    told: list[Callable[[], str]] = [
        lambda: _alone(rows, start),
        lambda: _not_thrown_away(rows, start),
        lambda: _stopped(rows, start),
        lambda: _in_time(rows, start),
        lambda: _minima(rows, start),
        lambda: _where(rows, start),
    ]
    return [sentence() for sentence in told]


def _alone(rows: Sequence[Row], start: str) -> str:
    parts = [compare(part, start).alone for part in _by_incidence(protocol_rows(rows))]
    least = [min(part[i] for part in parts) for i in (0, 1)]
    mean_ = [float(np.mean([part[i] for part in parts])) for i in (0, 1)]
    return (
        f"Alone, the {start} start is at {mean_[0]:+.2f} dB (transmission) and {mean_[1]:+.2f} dB (reflection) "
        f"against the closed form on the paper's incidences; at the least favourable one "
        f"{least[0]:+.2f} and {least[1]:+.2f} dB."
    )


def _by_incidence(rows: Sequence[Row]) -> list[list[Row]]:
    return [[row for row in rows if row.incidence_deg == theta] for theta in sorted({r.incidence_deg for r in rows})]


def _not_thrown_away(rows: Sequence[Row], start: str) -> str:
    changes = kept(protocol_rows(rows), start)
    worst = min(changes, key=lambda change: min(change[1:]))
    holds = min(worst[1:]) >= -KEPT_DB
    at_once = sum(row.status == "EXPLAINED" for row in of_start(protocol_rows(rows), start))
    return (
        f"The default solve {'keeps' if holds else 'DOES NOT keep'} it: at the worst incidence ({worst[0]:g} deg) it "
        f"changes transmission and reflection by {worst[1]:+.2f} and {worst[2]:+.2f} dB. On {at_once} of "
        f"{len(of_start(protocol_rows(rows), start))} scenes the start itself explains the photographs and is the end."
    )


def _stopped(rows: Sequence[Row], start: str) -> str:
    part = protocol_rows(rows)
    gain = compare(part, start).stopped
    beyond = [mean(of_start(part, start), f"{layer}_converged") - mean(of_start(part, start), f"{layer}_stopped")
              for layer in LAYERS]  # fmt: skip
    return (
        f"Where the solves stop, it is at {gain[0]:+.2f} dB (transmission) and {gain[1]:+.2f} dB (reflection) "
        f"against the solve from the closed form, mean over the paper's incidences. Going on to the minimum would "
        f"change that by {beyond[0]:+.2f} and {beyond[1]:+.2f} dB."
    )


def _in_time(rows: Sequence[Row], start: str) -> str:
    found = compare(protocol_rows(rows), start)
    return (
        f"Until within {NEAR_DB:g} dB of the final transmission it takes {found.seconds_near:.2f} times the closed "
        f"form's CPU seconds, until the gap of {GAP:g} {found.seconds_gap:.2f} times (mean over the paper's angles)."
    )


def _minima(rows: Sequence[Row], start: str) -> str:
    ours, theirs = of_start(rows, start), of_start(rows, CLOSED_FORM)
    counts = [(sum(row.worse_minimum for row in part), sum(row.worse_transmission for row in part))
              for part in (ours, theirs)]  # fmt: skip
    return (
        f"Its minimum lies more than {GAP:g} higher than another start's on {counts[0][0]} of {len(ours)} scenes "
        f"(closed form: {counts[1][0]}), its transmission there more than {NEAR_DB:g} dB lower on {counts[0][1]} "
        f"(closed form: {counts[1][1]})."
    )


def _where(rows: Sequence[Row], start: str) -> str:
    verdicts = {name: compare(part, start) for name, part in _by_regime(rows).items()}
    groups = []
    for verdict in dict.fromkeys(found.verdict for found in verdicts.values()):
        names = [name for name, found in verdicts.items() if found.verdict == verdict]
        groups.append(f"{verdict}: {'; '.join(names)}")
    faster = [name for name, found in verdicts.items() if found.seconds_near < 1]
    return (
        f"Against the solve from the closed form it stops {'. '.join(groups)}. It is near the final transmission in "
        f"fewer seconds in {len(faster)} of {len(verdicts)} regimes{': ' if faster else ''}{'; '.join(faster)}."
    )


def _by_regime(rows: Sequence[Row]) -> dict[str, list[Row]]:
    names = dict.fromkeys(regime_of(row) for row in rows)
    return {name: [row for row in rows if regime_of(row) == name] for name in names}


def _regime_table(rows: Sequence[Row], others: Sequence[str]) -> list[str]:
    lines = [
        "Against the closed form (transmission / reflection in dB; ratios of CPU seconds):",
        "",
        f"| regime | start | scenes | alone | stopped | seconds to {NEAR_DB:g} dB | seconds to the gap | it stops |",
        "|---|---|" + "---:|" * 5 + "---|",
    ]
    for name, part in _by_regime(rows).items():
        for start in others:
            found = compare(part, start)
            lines.append(
                f"| {name} | {start} | {found.n} | {found.alone[0]:+.2f} / {found.alone[1]:+.2f} "
                f"| {found.stopped[0]:+.2f} / {found.stopped[1]:+.2f} | {found.seconds_near:.2f} "
                f"| {found.seconds_gap:.2f} | {found.verdict} |"
            )
    return lines


def _work_table(rows: Sequence[Row], starts: Sequence[str]) -> list[str]:
    lines = [
        "Work (means; evaluations until the default end, the gap, and near the final transmission; CPU seconds, of "
        "which scene and start; minima worse in the objective and in transmission):",
        "",
        "| regime | start | evaluations | seconds | scene | start | worse minima | worse transmission |",
        "|---|---|" + "---:|" * 6,
    ]
    for name, part in _by_regime(rows).items():
        for start in starts:
            own = of_start(part, start)
            counts = " / ".join(f"{mean(own, f'evaluations_{where}'):.1f}" for where in ("stopped", "gap", "near"))
            seconds = " / ".join(f"{mean(own, f'cpu_{where}'):.2f}" for where in ("stopped", "gap", "near"))
            lines.append(
                f"| {name} | {start} | {counts} | {seconds} | {mean(own, 'cpu_scene'):.2f} "
                f"| {mean(own, 'cpu_start'):.2f} | {sum(row.worse_minimum for row in own)} of {len(own)} "
                f"| {sum(row.worse_transmission for row in own)} of {len(own)} |"
            )
    return lines


def _quality_table(rows: Sequence[Row], starts: Sequence[str]) -> list[str]:
    """Start, stopped and converged side by side, per scene."""
    lines = [
        "Transmission / reflection in dB, mean over pairs: the start, where its solve stops, its minimum.",
        "",
        "| scene | " + " | ".join(f"{start}: {moment}" for start in starts for moment in MOMENTS) + " |",
        "|---|" + "---:|" * (3 * len(starts)),
    ]
    for case in dict.fromkeys(row.case for row in rows):
        part = [row for row in rows if row.case == case]
        cells = [
            " / ".join(f"{mean(of_start(part, start), f'{layer}_{moment}'):.2f}" for layer in LAYERS)
            for start in starts
            for moment in MOMENTS
        ]
        lines.append(f"| {case} | " + " | ".join(cells) + " |")
    return lines
