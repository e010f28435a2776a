"""Where the stability study's methods fail, and whether the warnings told so.

A separation fails where its transmission is worse than the plain intensity by more than 0.1 dB; where it lies more
than 10 dB below what the family gives at its easy end on the same pair and gains less than 6 dB over the better
trivial baseline; or where the reflection's detail correlates with the truth by less than 0.3.

A failure is announced by any warning but those that speak of something else: clipped pixels announce nothing, and a
reflection that cannot be identified says nothing of the transmission. An alarm is false where nothing fails and it is
not true of the scene either (that it was gamma-encoded, say); "strictly" counts those too.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from studies.scenes import Scene
from studies.stability_rows import MINIMUM, NOTHING, Row

WORSE_DB, FAR_DB, LITTLE_GAIN_DB, LEAST_DETAIL = 0.1, 10.0, 6.0, 0.3
AUTO = "auto"

_SAYS_NOTHING = frozenset({"SATURATED"})
_OF_REFLECTION = frozenset({"REFLECTION_NOT_IDENTIFIABLE"})


@dataclass(frozen=True)
class Judged:
    """A row with what went wrong: in the transmission ("worse", "far"), in the reflection, and what was said of it.

    `gain` is the transmission's advantage over the plain intensity in dB.
    """

    row: Row
    gain: float
    worse: bool
    far: bool
    reflection_lost: bool
    facts: frozenset[str]

    @cached_property
    def failed(self) -> bool:
        """Whether anything did."""
        return self.worse or self.far or self.reflection_lost

    @cached_property
    def announced(self) -> bool:
        """Whether all that failed was told of."""
        told = frozenset(self.row.warnings) - _SAYS_NOTHING
        of_transmission = bool(told - _OF_REFLECTION) or not (self.worse or self.far)
        return of_transmission and (bool(told) or not self.reflection_lost)

    @cached_property
    def false_alarm(self) -> bool:
        """Whether a warning speaks of a failure that is none, and of nothing else that is true."""
        return not self.failed and bool(frozenset(self.row.warnings) - self.facts)

    @cached_property
    def strictly_false(self) -> bool:
        """The same where what is true of the scene counts, too, clipped pixels apart."""
        return not self.failed and bool(frozenset(self.row.warnings) - _SAYS_NOTHING)

    @property
    def kinds(self) -> str:
        """What failed, in words."""
        named = (("worse than nothing", self.worse), ("far below", self.far), ("reflection", self.reflection_lost))
        return ", ".join(name for name, fails in named if fails)


@dataclass(frozen=True)
class Score:
    """How some separations did: their number, failures, announcements and the least gain over doing nothing (dB)."""

    n: int
    failed: int
    worse: int
    announced: int
    false_alarms: int
    strictly_false: int
    least_gain: float

    @property
    def recall(self) -> float:
        """Share of the failures that were announced; 1 without any."""
        return self.announced / self.failed if self.failed else 1.0

    @property
    def false_share(self) -> float:
        """Share of the clean separations with a false alarm."""
        return self.false_alarms / max(1, self.n - self.failed)

    @property
    def strictly_false_share(self) -> float:
        """The same, strictly."""
        return self.strictly_false / max(1, self.n - self.failed)


def facts(scene: Scene) -> frozenset[str]:
    """Warnings that are true of a scene, whether or not it fails.

    That the model does not explain the photographs is true where the scene is none of the model's.
    """
    pane, taking = scene.pane, scene.taking
    polarized = pane.screen_dolp > 0 or pane.sky_dolp > 0
    moved, encoded = 2 * taking.shift_px >= 0.5, taking.gamma != 1
    told_wrongly = "told" in scene.family and not scene.easy
    true = {
        "SATURATED": True,
        "NEAR_NORMAL": pane.incidence_deg < 12,
        "GRAZING": pane.incidence_deg > 84,
        "MISALIGNED": moved,
        "GAMMA_ENCODED": encoded,
        "POLARIZED_SOURCE": polarized,
        "INCIDENCE_DOUBTFUL": told_wrongly and scene.family.startswith("incidence"),
        "MODEL_DOES_NOT_EXPLAIN": any((polarized, moved, encoded, told_wrongly, taking.bend_deg)),
    }
    return frozenset(name for name, holds in true.items() if holds)


def judge(rows: Iterable[Row], cases: Iterable[Scene]) -> list[Judged]:
    """Every row of a scene whose easy end is there, judged against the baselines of the same scene and that end."""
    rows = list(rows)
    known = {case.name: case for case in cases}
    easy = {case.family: case.name for case in known.values() if case.easy}
    transmission = {(row.case, row.pair, row.method): row.transmission for row in rows}
    judged = []
    for row in rows:
        best = transmission.get((easy[row.family], row.pair, AUTO))
        if best is None:
            continue
        nothing, minimum = (transmission[row.case, row.pair, name] for name in (NOTHING, MINIMUM))
        far = row.transmission < best - FAR_DB and row.transmission < max(nothing, minimum) + LITTLE_GAIN_DB
        gain = row.transmission - nothing
        judged.append(
            Judged(row, gain, gain < -WORSE_DB, far, row.detail < LEAST_DETAIL, facts(known[row.case]))
        )  # fmt: skip
    return judged


def score(judged: Sequence[Judged]) -> Score:
    """Counts over separations."""
    failed = [part for part in judged if part.failed]
    return Score(
        n=len(judged),
        failed=len(failed),
        worse=sum(part.worse for part in judged),
        announced=sum(part.announced for part in failed),
        false_alarms=sum(part.false_alarm for part in judged),
        strictly_false=sum(part.strictly_false for part in judged),
        least_gain=min((part.gain for part in judged), default=0.0),
    )


def tables(judged: Sequence[Judged]) -> str:
    """The study in Markdown: headline, warnings per family, methods per family, and each failure that nobody told."""
    auto = [part for part in judged if part.row.method == AUTO]
    families = list(dict.fromkeys(part.row.family for part in judged))
    total = score(auto)
    lines = [
        "# Stability",
        "",
        f"{total.n} separations by `auto`: {total.failed} fail, {100 * total.recall:.1f} % of them announced; "
        f"{100 * total.false_share:.1f} % false alarms among the others ({100 * total.strictly_false_share:.1f} % "
        f"strictly). {total.worse} are worse than doing nothing by more than {WORSE_DB:g} dB; "
        f"least gain {total.least_gain:+.2f} dB.",
        "",
        "| family | separations | fail | worse than nothing | announced | false alarms | strictly | least gain |",
        "|---|" + "---:|" * 7,
    ]
    for family in families:
        lines.append(_warning_line(family, score([part for part in auto if part.row.family == family])))
    return "\n".join([*lines, "", *_method_lines(judged, families), "", *_failure_lines(auto)])


def _warning_line(family: str, found: Score) -> str:
    return (
        f"| {family} | {found.n} | {found.failed} | {found.worse} | {found.announced} | {found.false_alarms} "
        f"| {found.strictly_false} | {found.least_gain:+.2f} |"
    )


def _method_lines(judged: Sequence[Judged], families: Sequence[str]) -> list[str]:
    """Per method and family mean PSNR of transmission and reflection, and the share that is worse than nothing."""
    names = list(dict.fromkeys(part.row.method for part in judged))
    lines = ["Means of transmission / reflection in dB (share of transmissions worse than the plain intensity):", ""]
    lines += ["| family | " + " | ".join(names) + " |", "|---|" + "---:|" * len(names)]
    for family in families:
        cells = []
        for name in names:
            parts = [part for part in judged if (part.row.family, part.row.method) == (family, name)]
            if not parts:
                cells.append("-")
                continue
            means = [np.mean([getattr(part.row, layer) for part in parts]) for layer in ("transmission", "reflection")]
            cells.append(f"{means[0]:.1f} / {means[1]:.1f} ({100 * np.mean([p.worse for p in parts]):.0f} %)")
        lines.append(f"| {family} | " + " | ".join(cells) + " |")
    return lines


def _failure_lines(auto: Sequence[Judged]) -> list[str]:
    """All that went wrong with `auto`, scene by scene: what was not announced, and false alarms."""
    lines = ["| scene | pair | T (gain) | R detail | rung | what | told |", "|---|---:|---:|---:|---|---|---|"]
    for part in auto:
        if not part.worse and (part.announced if part.failed else not part.false_alarm):
            continue
        row = part.row
        what = part.kinds + (" (announced)" if part.announced else "") if part.failed else "false alarm"
        lines.append(
            f"| {row.case} | {row.pair} | {row.transmission:.1f} ({part.gain:+.1f}) | {row.detail:.2f} | {row.rung} "
            f"| {what} | {', '.join(row.warnings) or '-'} |"
        )
    return lines
