"""This software against others' methods: the paper's protocol, its special cases, and measured layers.

Run ``python -m studies.peers -o OUT`` (``--quick`` for a look, ``--photos DIR`` for other photographs than those inside
scikit-image, ``--layers DIR`` for measured layers NAME_T.png, NAME_R.png). ``make peers`` first, for the single-image
method.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from studies.command import effort_of, hands_of, n_pairs_of, study_parser
from studies.peer_figures import draw
from studies.peer_methods import METHODS, Method, NotRun
from studies.peer_rows import Row
from studies.peer_scenes import MEASURED, PROTOCOL, SPECIAL_CASES, Job, Sample, measured_pairs, sample, special_cases
from studies.peer_scores import score
from studies.peer_single_image import built
from studies.peer_tables import tables
from studies.protocol import INCIDENCES_DEG, N_PAIRS
from studies.record import write_tables
from studies.work import row_of, run_jobs

QUICK_INCIDENCES_DEG = (40, 70)
QUICK_SPECIAL = 2
SPECIAL_PAIRS = 3


def run(job: Job, methods: Sequence[Method] = METHODS) -> list[Row]:
    """Separate one scene by every method."""
    taken = sample(job)
    return [_row(job, method, taken) for method in methods]


def _row(job: Job, method: Method, taken: Sample) -> Row:
    began = time.perf_counter()
    try:
        layers = method.run(taken)
    except NotRun as reason:
        return Row(job.group, job.scene, job.pair, method.name, not_run=str(reason))
    seconds = time.perf_counter() - began
    seen = np.asarray(taken.capture.valid.all(axis=(0, 1)))
    scores: dict[str, float] = {}
    for name, layer, truth in zip(("transmission", "reflection"), layers, taken.layers, strict=True):
        if layer is not None:
            found = score(layer, truth, seen)
            scores |= {name: found.psnr, f"{name}_ssim": found.ssim, f"{name}_fitted": found.fitted}
    return Row(job.group, job.scene, job.pair, method.name, seconds=seconds, **scores)


def jobs_of(photos: str | None, layers: str | None, n_pairs: int, *, quick: bool, size: int, margin: int) -> list[Job]:
    """All scenes, or a few of each set."""
    incidences = [f"{incidence:g}" for incidence in (QUICK_INCIDENCES_DEG if quick else INCIDENCES_DEG)]
    special = list(special_cases())[: QUICK_SPECIAL if quick else None]
    n_measured = 0 if layers is None else len(measured_pairs(Path(layers), size, margin))
    return [
        *(Job(PROTOCOL, scene, pair, photos, size, margin) for scene in incidences for pair in range(n_pairs)),
        *(
            Job(SPECIAL_CASES, scene, pair, photos, size, margin)
            for scene in special
            for pair in range(min(n_pairs, SPECIAL_PAIRS))
        ),
        *(Job(MEASURED, scene, pair, layers, size, margin) for scene in incidences for pair in range(n_measured)),
    ]


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the study and write rows, table and figure."""
    parser = study_parser(__doc__)
    parser.add_argument("--layers", metavar="DIR", help="folder of measured layers NAME_T.png, NAME_R.png")
    options = parser.parse_args(arguments)
    quick = effort_of(options) == "quick"
    size, margin = (128, 64) if quick else (256, 128)
    n_pairs = n_pairs_of(options, 1 if quick else N_PAIRS, size, margin)
    jobs = jobs_of(options.photos, options.layers, n_pairs, quick=quick, size=size, margin=margin)
    made = run_jobs(run, jobs, options.out / "peers.json", {"single_image": built()}, hands_of(options))
    rows = [row_of(Row, row) for row in made]
    text = tables(rows)
    print(text)
    write_tables(options.out, "peers", made, text)
    draw(rows, options.out)


if __name__ == "__main__":
    main()
