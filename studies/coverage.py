"""How often the true layers lie within two of the standard errors that are stated, per incidence and noise.

Run ``polaropt study coverage -o OUT``; without ``--photos`` it uses photographs inside scikit-image.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from polaropt.separation import Separation, separate
from studies.camera import take
from studies.coverage_figure import draw
from studies.kit.records import row_of, write_tables
from studies.kit.run import effort_of, run_jobs, study_parser, workers_of
from studies.photographs import N_PAIRS, Image, n_pairs_of, pairs_of
from studies.scenes import INCIDENCES_DEG, protocol

NOISES = (0.005, 0.02)
LAYERS = ("transmission", "reflection")
_BLUR_PX = 1.0
_FLAT, _TEXTURED = 0.33, 0.67
QUICK_INCIDENCES_DEG, QUICK_SIZE, SIZE = (10, 60), 128, 256


@dataclass(frozen=True)
class Job:
    """One scene, separated with the scene known or blind."""

    photos: str | None
    pair: int
    incidence_deg: float
    noise: float
    blind: bool
    size: int


@dataclass(frozen=True)
class Row:
    """One layer of one separation.

    Attributes
    ----------
    covered, covered_flat, covered_textured : float
        Share of the values within two standard errors of the truth: of all pixels, of the third of them where the
        true layer is flattest, and of the third where it is busiest.
    sharpness : float
        Root mean square of the stated errors in units of the true ones.
    rank_correlation : float
        Of stated and true errors over the pixels: whether the picture tells where the errors are.
    known : float
        Mean share of the reflection's detail that is said to be told.
    """

    pair: int
    incidence_deg: float
    noise: float
    scene: str
    layer: str
    covered: float
    covered_flat: float
    covered_textured: float
    sharpness: float
    rank_correlation: float
    known: float


def run(job: Job) -> list[Row]:
    """Separate one scene and compare both layers."""
    pair = pairs_of(job.photos, job.size, job.size // 2)[job.pair]
    sample = take(protocol(job.incidence_deg, noise=job.noise), pair)
    result = separate(sample.capture, None if job.blind else sample.scene)
    known = float(result.reflection_known.mean())
    told = (job.pair, job.incidence_deg, job.noise, "blind" if job.blind else "known")
    return [
        Row(*told, name, *compared(result, i, layer), known)
        for i, (name, layer) in enumerate(zip(LAYERS, pair.frames, strict=True))
    ]


def compared(result: Separation, i: int, layer: Image) -> tuple[float, float, float, float, float]:
    """Coverage of all, flat and textured pixels, sharpness and rank correlation of layer i with the truth (h, w, 3)."""
    from scipy.stats import spearmanr

    true = np.moveaxis(layer, -1, 0)
    error, stated = np.abs(result.layers[i] - true), result.uncertainty[i]
    within = error <= 2 * stated
    busy = busyness(true)
    flat, textured = busy <= np.quantile(busy, _FLAT), busy >= np.quantile(busy, _TEXTURED)
    return (
        float(within.mean()),
        float(within[:, flat].mean()),
        float(within[:, textured].mean()),
        float(np.sqrt(np.mean(np.square(stated)) / np.mean(np.square(error)))),
        float(spearmanr(stated.ravel(), error.ravel()).statistic),
    )


def busyness(layer: np.ndarray) -> np.ndarray:
    """Size of the gradient around each pixel of a layer (channel, h, w), mean over colours, (h, w)."""
    from scipy.ndimage import gaussian_filter

    down, across = np.gradient(layer.mean(axis=0))
    return np.asarray(gaussian_filter(np.hypot(down, across), _BLUR_PX))


def table(rows: Sequence[Row]) -> str:
    """Means per scene, noise and incidence, in per cent but for sharpness and correlation, as a Markdown table."""
    head = "covered | flat | textured | least of a pair | sharpness | rank correlation"
    lines = [f"| scene | noise | theta | T {head} | R {head.replace(' | ', ' | R ')} | R told |", "|" + "---|" * 16]
    for key in dict.fromkeys((row.scene, row.noise, row.incidence_deg) for row in rows):
        part = [row for row in rows if (row.scene, row.noise, row.incidence_deg) == key]
        cells = [cell for name in LAYERS for cell in _cells([row for row in part if row.layer == name])]
        known = 100 * np.mean([row.known for row in part])
        lines.append(f"| {key[0]} | {key[1]:g} | {key[2]:g} | " + " | ".join(cells) + f" | {known:.0f} |")
    return "\n".join(lines)


def _cells(rows: Sequence[Row]) -> list[str]:
    shares = [np.mean([getattr(row, name) for row in rows]) for name in ("covered", "covered_flat", "covered_textured")]
    least = min(row.covered for row in rows)
    ratios = [np.mean([getattr(row, name) for row in rows]) for name in ("sharpness", "rank_correlation")]
    return [f"{100 * share:.1f}" for share in (*shares, least)] + [f"{ratio:.2f}" for ratio in ratios]


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the table and write it with all rows."""
    parser = study_parser(__doc__)
    parser.add_argument("--size", type=int, help="side of the frame in pixels")
    parser.add_argument("--noises", help="standard deviations, comma separated")
    options = parser.parse_args(arguments)
    quick = effort_of(options) == "quick"
    size = options.size or (QUICK_SIZE if quick else SIZE)
    noises = [float(text) for text in options.noises.split(",")] if options.noises else NOISES
    n_pairs = n_pairs_of(options, 1 if quick else N_PAIRS, size, size // 2)
    jobs = [
        Job(options.photos, pair, float(incidence), noise, blind, size)
        for blind in (False, True)
        for noise in noises
        for incidence in (QUICK_INCIDENCES_DEG if quick else INCIDENCES_DEG)
        for pair in range(n_pairs)
    ]
    made = run_jobs(run, jobs, options.out / "coverage.json", {}, workers_of(options))
    rows = [row_of(Row, row) for row in made]
    text = table(rows)
    print(text)
    write_tables(options.out, "coverage", made, text)
    draw(rows, options.out)


if __name__ == "__main__":
    main()
