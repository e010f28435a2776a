"""This software against others' methods: the paper's protocol, its special cases, and measured layers.

Run ``python -m studies.peers -o OUT`` (``--quick`` for a look, ``--photos DIR`` for other photographs than those inside
scikit-image, ``--layers DIR`` for measured layers NAME_T.png, NAME_R.png). ``make peers`` first, for the single-image
method.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from studies.camera import Sample, take
from studies.kit.records import row_of, write_tables
from studies.kit.run import effort_of, run_jobs, study_parser, workers_of
from studies.peers.figures import draw
from studies.peers.rows import MEASURED, PROTOCOL, SPECIAL_CASES, Row
from studies.peers.single_image import built
from studies.peers.tables import tables
from studies.photographs import N_PAIRS, measured_pairs, n_pairs_of, pairs_of
from studies.scenes import INCIDENCES_DEG, protocol
from studies.scenes import SPECIAL_CASES as SPECIAL_SCENES
from studies.scores import LAYERS, fitted_psnr, psnr, ssim
from studies.ways import METHODS, Method, NotRun

QUICK_INCIDENCES_DEG = (40, 70)
QUICK_SPECIAL = 2
SPECIAL_PAIRS = 3


@dataclass(frozen=True)
class Job:
    """One scene.

    Attributes
    ----------
    group : str
        The set: `PROTOCOL`, `SPECIAL_CASES` or `MEASURED`.
    scene : str
        The special case, or the incidence in degrees.
    pair : int
    source : str or None
        Folder of photographs or of measured layers; None: photographs inside scikit-image.
    size, margin : int
        Of the frame in pixels, and of what there is around it.
    """

    group: str
    scene: str
    pair: int
    source: str | None
    size: int = 256
    margin: int = 128


def sample(job: Job) -> Sample:
    """Take the photographs of a job."""
    if job.group == MEASURED:
        pair = measured_pairs(Path(job.source or "."), job.size, job.margin)[job.pair]
    else:
        pair = pairs_of(job.source, job.size, job.margin)[job.pair]
    special = {scene.label: scene for scene in SPECIAL_SCENES}
    return take(special[job.scene] if job.group == SPECIAL_CASES else protocol(float(job.scene)), pair)


def run(job: Job, methods: Sequence[Method] = tuple(METHODS.values())) -> list[Row]:
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
    scores: dict[str, float] = {}
    for name, layer, truth in zip(LAYERS, layers, taken.layers, strict=True):
        if layer is not None:
            scores[name] = psnr(layer, truth, taken.unclipped)
            scores[f"{name}_ssim"] = ssim(layer, truth, taken.unclipped)
            scores[f"{name}_fitted"] = fitted_psnr(layer, truth, taken.unclipped)
    return Row(job.group, job.scene, job.pair, method.name, seconds=seconds, **scores)


def jobs_of(photos: str | None, layers: str | None, n_pairs: int, *, quick: bool, size: int, margin: int) -> list[Job]:
    """All scenes, or a few of each set."""
    incidences = [f"{incidence:g}" for incidence in (QUICK_INCIDENCES_DEG if quick else INCIDENCES_DEG)]
    special = [scene.label for scene in SPECIAL_SCENES][: QUICK_SPECIAL if quick else None]
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
    made = run_jobs(run, jobs, options.out / "peers.json", {"single_image": built()}, workers_of(options))
    rows = [row_of(Row, row) for row in made]
    text = tables(rows)
    print(text)
    write_tables(options.out, "peers", made, text)
    draw(rows, options.out)


if __name__ == "__main__":
    main()
