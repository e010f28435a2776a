"""The peers' study in Markdown: one table per set, the margins, what each method was told, the paper's own figures."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from studies.peers.published import TABLES, PublishedTable
from studies.peers.rows import Row
from studies.ways import FULL, METHODS

_NOTHING = "-"


def mean(rows: Sequence[Row], name: str) -> float:
    """Mean of what was measured; not a number without any."""
    values = [value for row in rows if not math.isnan(value := getattr(row, name))]
    return float(np.mean(values)) if values else math.nan


def of(rows: Sequence[Row], **wanted: str | int) -> list[Row]:
    """The rows of a group, scene, method or pair."""
    return [row for row in rows if all(getattr(row, name) == value for name, value in wanted.items())]


def tables(rows: Sequence[Row]) -> str:
    """The whole page."""
    parts = [
        "# Against other methods",
        "PSNR in dB of transmission / reflection against the true layers, over pixels that no photograph clips; means "
        "over pairs. A method marked * has no scale of its own: its layers are given the gain and offset that suit the "
        "true ones best. `-` is what a method does not show.",
    ]
    for group in dict.fromkeys(row.group for row in rows):
        parts += [f"## {group[0].upper()}{group[1:]}", _table(of(rows, group=group))]
        margins = _margins(of(rows, group=group))
        if margins:
            parts.append(margins)
    parts += ["## What each method is told", _told()]
    parts += ["## The source paper's own figures", "From that paper's photographs, not from these: PSNR in dB / SSIM."]
    parts += [_published(table) for table in TABLES]
    return "\n\n".join(parts)


def _table(rows: Sequence[Row]) -> str:
    scenes = list(dict.fromkeys(row.scene for row in rows))
    head = ["method", *map(_heading, scenes), "mean", "SSIM", "mean with best gain and offset", "s"]
    lines = [_line(head), "|---" + "|---:" * (len(head) - 1) + "|"]
    for method in METHODS.values():
        its = of(rows, method=method.name)
        name = f"**{method.name}**" if method.ours else method.name + ("*" if method.scaleless else "")
        if its and all(row.not_run for row in its):
            lines.append(_line([name, f"not run: {its[0].not_run}", *[""] * (len(head) - 2)]))
        elif its:
            lines.append(_line([name, *_cells(its, scenes)]))
    return "\n".join(lines)


def _heading(scene: str) -> str:
    """Incidences with their unit."""
    return f"{scene} deg" if scene.isdecimal() else scene


def _cells(rows: Sequence[Row], scenes: Sequence[str]) -> list[str]:
    cells = [_both([row for row in rows if row.scene == scene], "") for scene in scenes]
    return [*cells, _both(rows, ""), _both(rows, "_ssim"), _both(rows, "_fitted"), f"{mean(rows, 'seconds'):.2f}"]


def _both(rows: Sequence[Row], ending: str) -> str:
    digits = 3 if ending == "_ssim" else 1
    values = [mean(rows, layer + ending) for layer in ("transmission", "reflection")]
    return " / ".join(_NOTHING if math.isnan(value) else f"{value:.{digits}f}" for value in values)


def _line(cells: Sequence[str]) -> str:
    return "| " + " | ".join(cells) + " |"


def margins(rows: Sequence[Row], name: str) -> list[tuple[str, float, str]]:
    """Per scene and at last on average: its name, the full solve's lead over the best peer in dB, and that peer."""
    full = of(rows, method=FULL)
    peers = {method.name: of(rows, method=method.name) for method in METHODS.values() if not method.ours}
    found = []
    for scene in [*dict.fromkeys(row.scene for row in rows), "mean"]:
        ours = mean(_at(full, scene), name)
        theirs = {peer: value for peer, its in peers.items() if not math.isnan(value := mean(_at(its, scene), name))}
        if theirs and not math.isnan(ours):
            best = max(theirs, key=theirs.__getitem__)
            found.append((scene, ours - theirs[best], best))
    return found


def _at(rows: Sequence[Row], scene: str) -> list[Row]:
    return [row for row in rows if scene in ("mean", row.scene)]


def _margins(rows: Sequence[Row]) -> str:
    lines = []
    for name, words in (("transmission", "transmission"), ("reflection", "reflection"),
                        ("transmission_fitted", "transmission, all with best gain and offset")):  # fmt: skip
        found = margins(rows, name)
        if found:
            leads = ", ".join(f"{_heading(scene)} {lead:+.1f} ({peer})" for scene, lead, peer in found)
            lines.append(f"- {words}: {leads}")
    return (
        "Lead of the full solve over the best peer that is not part of this project, in dB:\n\n" + "\n".join(lines)
        if lines
        else ""
    )


def _told() -> str:
    lines = ["| method | told of the truth | source |", "|---|---|---|"]
    return "\n".join([*lines, *(_line([method.name, method.given, method.source]) for method in METHODS.values())])


def _published(table: PublishedTable) -> str:
    head = ["method", *table.scenes, "mean"]
    lines = [f"{table.title}:", "", _line(head), "|---" + "|---:" * (len(head) - 1) + "|"]
    for method, figures in table.methods.items():
        average = np.mean(figures, axis=0)
        cells = [f"{psnr:.2f} / {ssim:.3f}" for psnr, ssim in (*figures, average)]
        lines.append(_line([method, *cells]))
    return "\n".join(lines)
