"""How far scenes may leave the plain case: errors, failures, and whether the warnings told of them.

Run ``polaropt study stability -o OUT`` (``--quick`` for a look, ``--photos DIR`` for other photographs than those
inside scikit-image). OUT gets ``stability.json``, ``stability.csv``, ``stability.md`` and the figures.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from studies.kit.records import row_of, write_tables
from studies.kit.run import effort_of, run_jobs, study_parser, workers_of
from studies.photographs import n_pairs_of, pairs_of
from studies.scenes import MAP, SCENES, STABILITY, STABILITY_QUICK
from studies.stability_figures import draw
from studies.stability_rows import COMPONENTS, MINIMUM, NOTHING, Row, methods, rows_of
from studies.stability_scores import AUTO, judge, tables

SIZE, MARGIN = 128, 64
N_PAIRS = {"quick": 1, "default": 3, "full": 4}


@dataclass(frozen=True)
class Job:
    """One scene, by its name and pair, to be separated in every way that is wanted."""

    photos: str | None
    pair: int
    case: str
    methods: tuple[str, ...]


def run(job: Job) -> list[Row]:
    """Separate one scene."""
    return rows_of(SCENES[job.case], pairs_of(job.photos, SIZE, MARGIN)[job.pair], job.methods)


def _all_of(named: Sequence[str]) -> tuple[str, ...]:
    """Methods with those that all are measured against."""
    return tuple(dict.fromkeys((AUTO, *named, NOTHING, MINIMUM)))


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the study and write it."""
    parser = study_parser(__doc__)
    parser.add_argument("--families", default="", help="only families whose names contain one of these, by commas")
    parser.add_argument("--methods", help="names by commas; those that all are measured against come by themselves")
    options = parser.parse_args(arguments)
    effort = effort_of(options)
    named = options.methods.split(",") if options.methods else (COMPONENTS,) if effort == "quick" else methods()
    # The map has a third of the scenes, and its figures show what is chosen there.
    on_map = named if options.methods else (COMPONENTS,)
    words = options.families.split(",")
    scenes = [
        case
        for case in (STABILITY_QUICK if effort == "quick" else STABILITY)
        if any(word in case.family for word in words)
    ]
    n_pairs = n_pairs_of(options, N_PAIRS[effort], SIZE, MARGIN)
    jobs = [
        Job(options.photos, pair, case.name, _all_of(on_map if case.family == MAP else named))
        for case in scenes
        for pair in range(n_pairs)
    ]
    made = run_jobs(run, jobs, options.out / "stability.json", {"size": SIZE, "margin": MARGIN}, workers_of(options))
    judged = judge([row_of(Row, row) for row in made], scenes)
    text = tables(judged)
    print(text)
    write_tables(options.out, "stability", made, text)
    draw(judged, options.out)


if __name__ == "__main__":
    main()
