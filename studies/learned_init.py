"""What the learned start is worth: starts alone, where their solves stop, and the minima that they lead to.

Run ``polaropt study learned_init -o OUT`` (``--quick`` for a look, ``--photos DIR`` for other photographs than those
inside scikit-image). Every scene is found blind, once for all starts; its seconds count for all of them alike.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

from studies.command import effort_of, hands_of, n_pairs_of, pairs_of, study_parser
from studies.learned_init_figures import draw
from studies.learned_init_runs import LEARNED, Row, rows_of, start_names
from studies.learned_init_scenes import scenes
from studies.learned_init_scores import page
from studies.record import write_tables
from studies.stability_scenes import Case
from studies.work import row_of, run_jobs

SIZES = {"quick": 128, "default": 192, "full": 256}
N_PAIRS = {"quick": 1, "default": 3, "full": 4}
MOST_EVALUATIONS = {"quick": 60, "default": 120, "full": 150}


@dataclass(frozen=True)
class Job:
    """One scene, by its name and pair, to be solved from every start."""

    photos: str | None
    pair: int
    case: str
    size: int
    most_evaluations: int


@lru_cache(maxsize=1)
def _scenes() -> dict[str, Case]:
    return {case.name: case for case in scenes()}


def run(job: Job) -> list[Row]:
    """Solve one scene from every start."""
    _warm_up(job.photos, job.size)
    pair = pairs_of(job.photos, job.size, job.size // 2)[job.pair]
    return rows_of(_scenes()[job.case], pair, job.most_evaluations)


@lru_cache(maxsize=1)
def _warm_up(photos: str | None, size: int) -> None:
    """Load weights and compiled kernels, once in a process and off the clock; the networks keep to one core.

    Where cores are shared torch's threads wait actively, and their CPU seconds would tell of that alone.
    """
    if LEARNED in start_names():
        import torch

        torch.set_num_threads(1)
    rows_of(scenes()[0], pairs_of(photos, size, size // 2)[0], most_evaluations=4)


def weights_digest() -> str:
    """First digits of the digest of the shipped weights: rows of other weights are no rows of this run."""
    if LEARNED not in start_names():
        return "none"
    from priors.learned import WEIGHTS

    record = json.loads((WEIGHTS / "conditioned.json").read_text(encoding="utf-8"))
    return str(record["sha256"])[:12]


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the study and write it."""
    parser = study_parser(__doc__)
    parser.add_argument("--size", type=int, help="side of the frame in pixels")
    options = parser.parse_args(arguments)
    effort = effort_of(options)
    size = options.size or SIZES[effort]
    n_pairs = n_pairs_of(options, N_PAIRS[effort], size, size // 2)
    wanted = scenes(quick=effort == "quick")
    most = MOST_EVALUATIONS[effort]
    jobs = [Job(options.photos, pair, case.name, size, most) for case in wanted for pair in range(n_pairs)]
    settings = {"weights": weights_digest(), "starts": start_names()}
    made = run_jobs(run, jobs, options.out / "learned_init.json", settings, hands_of(options))
    rows = [row_of(Row, row) for row in made]
    text = page(rows, settings["weights"])
    print(text)
    write_tables(options.out, "learned_init", made, text)
    draw(rows, options.out)


if __name__ == "__main__":
    main()
