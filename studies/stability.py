"""How far scenes may leave the plain case: errors, failures, and whether the warnings told of them.

Run ``python -m studies.stability -o OUT`` (``--quick`` for a look, ``--photos DIR`` for other photographs than those
inside scikit-image). A run that was broken off goes on with what is left. OUT gets ``stability.json``,
``stability.csv``, ``stability.md`` and the figures.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

from studies.protocol import Pair, protocol_pairs, shipped_pairs
from studies.record import earlier_rows, metadata, write_csv, write_document
from studies.stability_figures import draw
from studies.stability_methods import MINIMUM, NOTHING, Row, methods, run
from studies.stability_scenes import Case, cases
from studies.stability_scores import AUTO, judge, tables

SIZE, MARGIN, N_PAIRS, QUICK_PAIRS = 128, 64, 3, 1


def run_all(scenes: Sequence[Case], pairs: Sequence[Pair], path: Path, settings: dict[str, Any]) -> list[Row]:
    """Run what is not in the file yet; it is written after every scene."""
    told = metadata(settings)
    rows = [_row(row) for row in earlier_rows(path, told)]
    done = {(row.case, row.pair) for row in rows}
    left = [(case, pair) for case in scenes for pair in pairs if (case.name, pair.number) not in done]
    columns = (TextColumn("{task.description:45}"), BarColumn(), MofNCompleteColumn())
    with Progress(*columns, TimeElapsedColumn(), TimeRemainingColumn()) as progress:
        task = progress.add_task("", total=len(scenes) * len(pairs), completed=len(scenes) * len(pairs) - len(left))
        for case, pair in left:
            progress.update(task, description=case.name[:45])
            rows += run(case, pair, settings["methods"])
            write_document(path, told, [asdict(row) for row in rows])
            progress.advance(task)
    names = {case.name for case in scenes}
    return [row for row in rows if row.case in names]


def _row(document: dict[str, Any]) -> Row:
    return Row(**{**document, "warnings": tuple(document["warnings"])})


def report(rows: Sequence[Row], scenes: Sequence[Case], out: Path) -> str:
    """Write table, CSV and figures; the table."""
    judged = judge(rows, scenes)
    text = tables(judged)
    write_csv(out / "stability.csv", [asdict(row) for row in rows])
    (out / "stability.md").write_text(text + "\n", encoding="utf-8")
    draw(judged, out)
    return text


def main() -> None:
    """Run the study and write it."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--photos", type=Path, help="folder of photographs (default: those inside scikit-image)")
    parser.add_argument("--pairs", type=int, help=f"pairs at most (default: {N_PAIRS}, quick: {QUICK_PAIRS})")
    parser.add_argument(
        "--families", default="", help="only families whose names contain one of these words, by commas"
    )
    parser.add_argument(
        "--methods", help="names, comma separated; those that all are measured against come by themselves"
    )
    parser.add_argument("--quick", action="store_true", help="one pair and a part of the scenes")
    parser.add_argument("-o", "--out", type=Path, required=True, help="folder for rows, table and figures")
    options = parser.parse_args()
    n_pairs = options.pairs or (QUICK_PAIRS if options.quick else N_PAIRS)
    size = {"size": SIZE, "margin": MARGIN}
    pairs = (
        shipped_pairs(**size)[:n_pairs]
        if options.photos is None
        else protocol_pairs(options.photos, **size, n_pairs=n_pairs)
    )
    wanted = methods() if options.methods is None else (AUTO, *options.methods.split(","), NOTHING, MINIMUM)
    words = options.families.split(",")
    scenes = [case for case in cases(options.quick) if any(word in case.family for word in words)]
    options.out.mkdir(parents=True, exist_ok=True)
    photos = None if options.photos is None else str(options.photos)
    settings = {"photos": photos, "pairs": n_pairs, **size, "methods": list(dict.fromkeys(wanted))}
    rows = run_all(scenes, pairs, options.out / "stability.json", settings)
    print(report(rows, scenes, options.out))
    print(f"wrote {options.out}/stability.json, .csv, .md and figures")


if __name__ == "__main__":
    main()
